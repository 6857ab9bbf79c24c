"""A net between fixed points.

The sides of a square net are pinned to a circle; twice the stress in one
direction shortens its edges.
"""

import numpy as np

import critflow as cf
import critflow_extras as ce

n = 9
grid = np.arange(n * n).reshape(n, n)
rows = np.column_stack([grid[1:-1, :-1].ravel(), grid[1:-1, 1:].ravel()])
columns = np.column_stack([grid[:-1, 1:-1].ravel(), grid[1:, 1:-1].ravel()])
angle = np.linspace(-0.7, 0.7, n)[1:-1]
pins = {}
for at, a in enumerate(angle, start=1):
    pins[grid[at, -1]], pins[grid[at, 0]] = (
        (np.cos(a), np.sin(a)),
        (-np.cos(a), np.sin(a)),
    )
    pins[grid[-1, at]], pins[grid[0, at]] = (
        (np.sin(a), np.cos(a)),
        (np.sin(a), -np.cos(a)),
    )
used, edges = np.unique(np.vstack([rows, columns]), return_inverse=True)
pins = {
    int(np.searchsorted(used, corner)): place for corner, place in pins.items()
}
network = cf.Network(edges.reshape(-1, 2), pins=pins)
sigma = np.where(np.arange(network.n_edges) < len(rows), 1.0, 2.0)
axes = ce.draw(cf.CriticalManifold(network).configuration(sigma), width=2.5)
axes.figure.colorbar(
    axes.collections[0], ax=axes, shrink=0.7, label="tension, up to a factor"
)
axes.figure.set_size_inches(4.8, 3.9)
axes.figure.savefig("hanging.png", dpi=80)
