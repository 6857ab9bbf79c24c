"""Three configurations of one B_0 that soften, keep and stiffen: python extras/docs/pictures/design.py [FILE]."""

import sys
from pathlib import Path

from matplotlib.figure import Figure

from critflow import CriticalManifold, voronoi_network
from critflow.pictures import draw_network
from critflow_extras import design

manifold = CriticalManifold(voronoi_network(100, seed=1))
fig = Figure(figsize=(9, 3.3), layout="constrained")
kinds = {"softens": -0.05, "keeps": 0.0, "stiffens": 0.3}
for axes, (kind, growth) in zip(fig.subplots(1, 3), kinds.items(), strict=True):
    found = design(manifold, {"B_0": 0.25, "C_B": growth})
    network, critical = found.value.network, found.value
    draw_network(axes, network.edges, network.offsets, network.cell, critical.coordinates, critical.tensions)
    axes.set_title(f"{kind}: $C_B$ = {growth:g} k".replace("-", "−"), pad=3)
fig.savefig(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"), dpi=110)
