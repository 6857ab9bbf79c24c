"""The stiffest configuration of a Voronoi network.

Line width and colour show the tension. B_0 equals its upper bound over all
stresses.
"""

import matplotlib.pyplot as plt

import critflow as cf
from critflow.pictures import draw_network

network = cf.voronoi_network(n_vertices=200, seed=7)
best = cf.optimize(network, "B_0")
figure, axes = plt.subplots(figsize=(4.8, 3.9), layout="constrained")
lines = draw_network(
    axes,
    network.edges,
    network.offsets,
    network.cell,
    best.value.coordinates,
    best.value.tensions,
)
axes.set_title(f"$B_0$ = {best.objective:.4f} k, bound {best.bound:.4f} k")
figure.colorbar(lines, ax=axes, shrink=0.7, label="tension, up to a factor")
figure.savefig("stiffest.png", dpi=80)
