"""Taut and slack edges at the onset.

A diluted lattice of cables in simple shear: thin grey edges are slack, and the
others carry all of the force.
"""

import numpy as np

import critflow as cf
import critflow_extras as ce

network = ce.diluted(cf.lattice("triangular", 10, 10), z=3.4, seed=1)
onset = ce.critical_strain(network, np.ones(network.n_edges), "simple_shear")
n_taut = len(onset.value.taut_edges)
axes = ce.draw(
    onset.value.configuration,
    title=f"{n_taut} of {network.n_edges} edges are taut",
)
axes.figure.colorbar(
    axes.collections[0], ax=axes, shrink=0.7, label="tension, up to a factor"
)
axes.figure.set_size_inches(4.8, 3.9)
axes.figure.savefig("slack.png", dpi=80)
