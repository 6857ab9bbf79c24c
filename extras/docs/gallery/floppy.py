"""Where a floppy network moves.

Discs show the part of each vertex in the zero modes of a displaced Voronoi
network.
"""

import numpy as np

import critflow as cf
import critflow_extras as ce
from critflow_extras.certificates.spaces import zero_modes

network = cf.voronoi_network(n_vertices=100, seed=4)
x = network.positions + 0.05 * np.random.default_rng(0).standard_normal(
    network.positions.shape
)
modes = zero_modes(network, x).value.modes
moving = np.sum(modes**2, axis=(0, 2)) / 2
axes = ce.draw(
    network,
    vertices=moving,
    title=f"{len(modes)} independent motions without a change of length",
)
axes.figure.set_size_inches(4.4, 3.9)
axes.figure.savefig("floppy.png", dpi=80)
