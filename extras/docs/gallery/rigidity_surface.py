"""Strains that leave a network floppy are a convex set.

Each point is the onset of rigidity on a ray of strains; the region inside is
floppy.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf
import critflow_extras as ce
from critflow_extras.cables.rigidity_surface import strain_plane

network = cf.voronoi_network(n_vertices=60, seed=1)
ratio = cf.critical_from_lengths(network, np.ones(network.n_edges)).ratio
stretch, shear = np.diag([1.0, -1.0]), np.array([[0.0, 1.0], [1.0, 0.0]])
figure, axes = plt.subplots(figsize=(4.4, 4.2), layout="constrained")
for excess, colour in ((1.02, "#0072B2"), (1.05, "#D55E00")):
    lengths = np.full(network.n_edges, excess * ratio)
    surface = ce.rigidity_surface(
        network, lengths, strain_plane(stretch, shear, n=16)
    )
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    x, y = surface.strains * np.cos(angle), surface.strains * np.sin(angle)
    axes.fill(x, y, color=colour, alpha=0.2)
    axes.plot(
        x,
        y,
        ".",
        color=colour,
        label=f"lengths {100 * (excess - 1):.0f} % above critical",
    )
axes.set(xlabel="stretch", ylabel="shear", aspect="equal")
axes.legend(frameon=False, fontsize=8)
figure.savefig("rigidity_surface.png", dpi=80)
