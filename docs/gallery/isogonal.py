"""Configurations of equal B_0: an isogonal mode.

Directions and tensions of all edges are the same in each panel; the lengths are
not.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf
from critflow.isogonal import face_modes
from critflow.pictures import draw_network

network = cf.voronoi_network(n_vertices=60, seed=3)
edges, offsets, cell = network.edges, network.offsets, network.cell
modes = face_modes(cf.optimize(network, "B_0").value)
direction = np.random.default_rng(0).standard_normal(network.faces.n_faces)
figure, row = plt.subplots(1, 2, figsize=(5.6, 3), layout="constrained")
for axes, fraction in zip(row, (0.0, 0.9), strict=True):
    critical = modes.towards(direction, fraction)
    x, tensions = critical.coordinates, critical.tensions
    draw_network(axes, edges, offsets, cell, x, tensions)
    B_0 = cf.elasticity(critical).value.bulk
    axes.set_title(f"$B_0$ = {B_0:.10f} k", fontsize=10)
figure.savefig("isogonal.png", dpi=90)
