"""Networks of the literature, one of each kind: python extras/docs/pictures/networks.py [FILE]."""

import sys
from pathlib import Path

from matplotlib.figure import Figure

from critflow import delaunay_network, lattice, voronoi_network
from critflow.pictures import draw_network
from critflow_extras import diluted, fibre_network, packing_network, regular_network

SHEARED = [[1.5, 0.0], [0.6, 1.0]]
NETWORKS = {
    "triangular, z = 3.6": diluted(lattice("triangular", 14, 14), z=3.6, seed=1),
    "kagome, z = 3.4": diluted(lattice("kagome", 8, 8), z=3.4, seed=1),
    "phantom, z = 3.4": fibre_network("phantom", 14, 14, z=3.4, seed=1),
    "Mikado, z = 3.6": fibre_network("mikado", 200, z=3.6, seed=1),
    "Voronoi, oblique cell": voronoi_network(200, seed=1, cell=SHEARED),
    "Delaunay, z = 4.2": diluted(delaunay_network(150, seed=1), z=4.2, seed=1),
    "packing, z = 4.5": packing_network(150, z=4.5, seed=1),
    "regular, z = 3": regular_network(150, z=3, seed=1),
}
figure = Figure(figsize=(10, 5.4), dpi=100, layout="constrained")
for axes, (title, network) in zip(figure.subplots(2, 4).flat, NETWORKS.items(), strict=True):
    draw_network(axes, network.edges, network.offsets, network.cell, network.positions, width=0.5)
    axes.set_title(title, fontsize=9)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"))
