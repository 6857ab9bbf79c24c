"""A vertex model at its transition.

Springs act on the perimeters of the cells; the mean shape index is about 3.81.
"""

import numpy as np

import critflow as cf

network = cf.voronoi_network(n_vertices=200, seed=7)
found = cf.critical_from_perimeters(cf.cells_of(network), np.ones(network.faces.n_faces), throw=False)
tissue = found.value
moved = cf.Network(network.edges, network.offsets, network.cell, positions=tissue.coordinates)
axes = cf.draw(moved, width=2, title=f"{found.status.name}: mean shape index {tissue.shape_index.mean():.3f}")
axes.figure.savefig("tissue.png", dpi=60)
