"""A finite shear of the cell.

The same stress balances on the sheared cell, at another configuration; no
minimum-image rule is involved.
"""

import matplotlib.pyplot as plt

import critflow as cf
from critflow.pictures import draw_network

network = cf.voronoi_network(n_vertices=100, seed=4)
edges, offsets = network.edges, network.offsets
sigma = cf.optimize(network, "B_0").value.sigma
figure, row = plt.subplots(
    1, 2, figsize=(5.8, 2.7), layout="constrained", width_ratios=[1, 1.7]
)
for axes, shear in zip(row, (0.0, 0.7), strict=True):
    sheared = network.deformed([[1.0, shear], [0.0, 1.0]])
    critical = cf.CriticalManifold(sheared).configuration(sigma)
    x, tensions = critical.coordinates, critical.tensions
    draw_network(axes, edges, offsets, sheared.cell, x, tensions)
    axes.set_title(f"simple shear {shear}", fontsize=10)
figure.savefig("sheared.png", dpi=90)
