"""One network in four critical configurations.

Every panel has the same edges and a single self-stress; only the objective
differs.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf
from critflow.pictures import draw_network

network = cf.voronoi_network(n_vertices=100, seed=3)
edges, offsets, cell = network.edges, network.offsets, network.cell
stress = np.abs(np.random.default_rng(0).standard_normal(network.n_edges))
found = {
    "largest bulk modulus": cf.optimize(network, "B_0").value,
    "equal lengths": cf.optimize(network, "V_L").value,
    "equal tensions": cf.optimize(network, "V_tau").value,
    "random stress": cf.CriticalManifold(network).configuration(stress),
}
figure, grid = plt.subplots(2, 2, figsize=(4.6, 4.6), layout="constrained")
for axes, (title, critical) in zip(grid.flat, found.items(), strict=True):
    x, tensions = critical.coordinates, critical.tensions
    lines = draw_network(axes, edges, offsets, cell, x, tensions)
    axes.set_title(title, fontsize=10)
figure.colorbar(lines, ax=grid, shrink=0.6, label="tension, up to a factor")
figure.savefig("populations.png", dpi=80)
