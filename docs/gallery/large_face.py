"""One face as large as possible, at the largest B_0.

A linear program over the isogonal modes; no edge is shorter than 0.15.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf
from critflow.isogonal import face_modes
from critflow.pictures import draw_network

network = cf.voronoi_network(n_vertices=100, seed=6)
modes = face_modes(cf.optimize(network, "B_0").value)
faces = network.faces
chosen = int(faces.sizes.argmax())
sides = faces.edges[faces.starts[chosen] : faces.starts[chosen + 1]]
around = np.bincount(sides, minlength=network.n_edges)
large = modes.largest(around, shortest=0.15).value
B_0 = cf.elasticity(large).value.bulk
figure, axes = plt.subplots(figsize=(4.8, 3.9), layout="constrained")
lines = draw_network(
    axes,
    network.edges,
    network.offsets,
    network.cell,
    large.coordinates,
    large.tensions,
)
perimeter = large.lengths[sides].sum()
axes.set_title(f"perimeter {perimeter:.2f}, $B_0$ = {B_0:.4f} k", fontsize=10)
figure.colorbar(lines, ax=axes, shrink=0.7, label="tension, up to a factor")
figure.savefig("large_face.png", dpi=80)
