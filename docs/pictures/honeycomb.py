"""A honeycomb with and without its symmetry, for docs/tutorial.md: python docs/pictures/honeycomb.py [FILE]."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from critflow import CriticalManifold, elasticity, lattice, optimize, voronoi_network
from critflow.pictures import draw_network

honeycomb = lattice("honeycomb", 4, 4)
critical = CriticalManifold(honeycomb).configuration(np.ones(honeycomb.n_edges))
step = 0.08 * np.random.default_rng(0).standard_normal(critical.coordinates.shape)
network = voronoi_network(n_vertices=200, seed=7)
best = optimize(network, "B_0")
figure, row = plt.subplots(1, 3, figsize=(8.4, 3.1), layout="constrained")
comb = honeycomb.edges, honeycomb.offsets, honeycomb.cell
draw_network(row[0], *comb, critical.coordinates, critical.tensions)
row[0].set_title(f"honeycomb: $B_0$ = {elasticity(critical).value.bulk:.3f} k", fontsize=10)
draw_network(row[1], *comb, critical.coordinates + step, np.zeros(honeycomb.n_edges), width=2)
row[1].set_title("every vertex moved: floppy, $B_0$ = 0", fontsize=10)
draw_network(row[2], network.edges, network.offsets, network.cell, best.value.coordinates, best.value.tensions)
row[2].set_title(f"200 vertices: $B_0$ = {best.objective:.3f} k", fontsize=10)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"), dpi=90)
