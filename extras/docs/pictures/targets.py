"""The picture of extras/docs/theory/targets.md: python extras/docs/pictures/targets.py [FILE]."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from critflow import CriticalManifold, Status, upper_bound, voronoi_network
from critflow_extras import design

manifold = CriticalManifold(voronoi_network(n_vertices=20, seed=1))
largest = upper_bound(manifold, "B_0")
outcomes = {"reached": [], "not reached": [], "infeasible": []}
for bulk in np.linspace(0.20, 0.305, 8):
    for growth in np.linspace(-0.2, 0.3, 7):
        found = design(manifold, {"B_0": bulk, "C_B": growth}, max_steps=40, throw=False)
        refused = "infeasible" if found.status is Status.infeasible else "not reached"
        outcomes["reached" if found.reached else refused].append((bulk, growth))
figure, axes = plt.subplots(figsize=(5, 3.2), layout="constrained")
styles = (("o", "#009E73"), ("s", "#E69F00"), ("x", "#D55E00"))
for (outcome, points), (marker, colour) in zip(outcomes.items(), styles, strict=True):
    axes.plot(*np.array(points).reshape(-1, 2).T, marker, color=colour, label=outcome)
axes.plot([0.19, largest, largest], [-0.19 / 2, -largest / 2, 0.32], color="0.3", linewidth=1, label="bound")
axes.set(xlabel="$B_0$ [k]", ylabel="$C_B$ [k]")
figure.legend(loc="outside upper center", ncols=4, frameon=False, fontsize=9, columnspacing=1.2, handletextpad=0.4)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"), dpi=80)
