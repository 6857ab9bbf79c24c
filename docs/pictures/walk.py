"""A walk on the critical manifold, for docs/tutorial.md: python docs/pictures/walk.py [FILE]."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from critflow import CriticalManifold, elasticity, optimize, voronoi_network
from critflow.pictures import TENSION_MAP, draw_network

network = voronoi_network(n_vertices=100, seed=3)
manifold = CriticalManifold(network)
start = np.abs(np.random.default_rng(0).standard_normal(network.n_edges))
end = optimize(network, "V_L").value.sigma
middle = np.ones(network.n_edges)
mixed = np.linspace(0.0, 1.0, 25)
stresses = [a ** (1 - t) * b**t for a, b in ((start, middle), (middle, end)) for t in mixed]
moduli = [elasticity(manifold.configuration(sigma)).value.bulk for sigma in stresses]
steps = np.concatenate([mixed, 1 + mixed])
figure = plt.figure(figsize=(8.4, 4.9), layout="constrained")
grid = figure.add_gridspec(2, 3, height_ratios=(1.35, 1))
stops = {"A: random stress": start, "B: stress 1 on every edge": middle, "C: equal lengths": end}
for at, (title, sigma) in enumerate(stops.items()):
    critical, axes = manifold.configuration(sigma), figure.add_subplot(grid[0, at])
    draw_network(axes, network.edges, network.offsets, network.cell, critical.coordinates, critical.tensions)
    axes.set_title(title, fontsize=10)
bar = ScalarMappable(Normalize(0, 1), TENSION_MAP)
figure.colorbar(bar, ax=axes, label="tension over the\nlargest in the panel", shrink=0.85)
axes = figure.add_subplot(grid[1, :])
axes.plot(steps, moduli, color="#0072B2")
for at, letter in enumerate("ABC"):
    axes.plot(at, np.interp(at, steps, moduli), "o", color="#0072B2")
    axes.annotate(letter, (at, np.interp(at, steps, moduli)), (0, -14), textcoords="offset points", ha="center")
axes.axhline(optimize(network, "B_0").bound, color="#D55E00", linewidth=0.9, label="upper bound")
axes.set(xlabel="position on the path, interpolated in log σ", ylabel="$B_0$ [k]", xticks=(0, 1, 2), ylim=(0.17, 0.3))
axes.legend(frameon=False, loc="lower right")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"), dpi=90)
