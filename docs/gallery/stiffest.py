"""The stiffest configuration of a Voronoi network.

Line width and colour show the tension. B_0 equals its upper bound over all
stresses.
"""

import critflow_extras as ce

import critflow as cf

network = cf.voronoi_network(n_vertices=200, seed=7)
best = cf.optimize(network, "B_0")
axes = ce.draw(
    best, title=f"$B_0$ = {best.objective:.4f} k, bound {best.bound:.4f} k"
)
axes.figure.colorbar(
    axes.collections[0], ax=axes, shrink=0.7, label="tension, up to a factor"
)
axes.figure.set_size_inches(4.8, 3.9)
axes.figure.savefig("stiffest.png", dpi=80)
