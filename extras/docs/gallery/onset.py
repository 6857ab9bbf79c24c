"""A floppy network becomes rigid in simple shear.

The edges are 5 % longer than at the isotropic transition. γ_c follows from
cone programs, with bounds.
"""

import numpy as np

import critflow as cf
import critflow_extras as ce

network = cf.voronoi_network(n_vertices=200, seed=1)
ratio = cf.critical_from_lengths(network, np.ones(network.n_edges)).ratio
lengths = np.full(network.n_edges, 1.05 * ratio)
onset = ce.critical_strain(network, lengths, "simple_shear")
width = f"{onset.value.upper - onset.value.lower:.0e}".replace("-", "−")
axes = ce.draw(
    onset.value.configuration,
    title=f"rigid from γ = {onset.value.strain:.6f} ± {width}",
)
axes.figure.colorbar(
    axes.collections[0], ax=axes, shrink=0.7, label="tension, up to a factor"
)
axes.figure.set_size_inches(4.8, 3.9)
axes.figure.savefig("onset.png", dpi=80)
