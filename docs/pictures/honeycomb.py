"""A honeycomb with and without its symmetry, for docs/tutorial.md: python docs/pictures/honeycomb.py [FILE]."""

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from critflow import CriticalManifold, elasticity, lattice, optimize, voronoi_network
from critflow_extras import draw

honeycomb = lattice("honeycomb", 4, 4)
critical = CriticalManifold(honeycomb).configuration(np.ones(honeycomb.n_edges))
step = 0.08 * np.random.default_rng(0).standard_normal(critical.coordinates.shape)
moved = replace(honeycomb, positions=critical.coordinates + step)
best = optimize(voronoi_network(n_vertices=200, seed=7), "B_0")
figure, row = plt.subplots(1, 3, figsize=(8.4, 3.1), layout="constrained")
draw(critical, row[0], title=f"honeycomb: $B_0$ = {elasticity(critical).value.bulk:.3f} k")
draw(moved, row[1], title="every vertex moved: floppy, $B_0$ = 0", width=1)
draw(best, row[2], title=f"200 vertices: $B_0$ = {best.objective:.3f} k")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"), dpi=90)
