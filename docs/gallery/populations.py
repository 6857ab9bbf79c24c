"""One network in four critical configurations.

Every panel has the same edges and a single self-stress; only the objective
differs.
"""

import critflow_extras as ce
import matplotlib.pyplot as plt
import numpy as np

import critflow as cf

network = cf.voronoi_network(n_vertices=100, seed=3)
stress = np.abs(np.random.default_rng(0).standard_normal(network.n_edges))
found = {
    "largest bulk modulus": cf.optimize(network, "B_0").value,
    "equal lengths": cf.optimize(network, "V_L").value,
    "equal tensions": cf.optimize(network, "V_tau").value,
    "random stress": cf.CriticalManifold(network).configuration(stress),
}
figure, grid = plt.subplots(2, 2, figsize=(4.6, 4.6), layout="constrained")
for axes, (title, critical) in zip(grid.flat, found.items(), strict=True):
    ce.draw(critical, axes, title=title)
figure.colorbar(
    axes.collections[0], ax=grid, shrink=0.6, label="tension, up to a factor"
)
figure.savefig("populations.png", dpi=80)
