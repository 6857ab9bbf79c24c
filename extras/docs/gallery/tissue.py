"""A vertex model at its transition.

Springs act on the perimeters of the faces, all equal here; the mean shape index
is about 3.81.
"""

import numpy as np

import critflow as cf
import critflow_extras as ce

network = cf.voronoi_network(n_vertices=200, seed=7)
tissue = ce.critical_from_perimeters(
    network, np.ones(network.faces.n_faces), throw=False
).value
axes = ce.draw(
    tissue.configuration,
    title=f"mean shape index {tissue.shape_index.mean():.3f}",
)
axes.figure.colorbar(
    axes.collections[0], ax=axes, shrink=0.7, label="tension, up to a factor"
)
axes.figure.set_size_inches(4.8, 3.9)
axes.figure.savefig("tissue.png", dpi=80)
