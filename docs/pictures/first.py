"""The first picture of docs/start.md: python docs/pictures/first.py [FILE]."""

import sys
from pathlib import Path

from critflow import optimize, voronoi_network
from critflow_extras import draw

network = voronoi_network(n_vertices=200, seed=7)
best = optimize(network, "B_0")
draw(best).figure.savefig(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"), dpi=50)
