"""A test print: a sheet of ribbons as wide as their stiffnesses require.

Stiffnesses of a triangulation are chosen for Poisson's ratio 0.1.  A ribbon
has k ∝ width/|L|; the SVG file, 100 mm wide, is the same drawing to cut.
"""

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

import critflow as cf
import critflow_extras as ce
from critflow.pictures import add_cell, periodic_segments

network = cf.delaunay_network(24, seed=1)
lengths = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
state = cf.spring_state(network, lengths, network.positions)
limits = {"stiffnesses": (0.3 / lengths, 3 / lengths)}  # of widths
goal = ce.isotropic_targets(2, 0.7, 0.1)
found = ce.design(state, goal, change="stiffness", within=limits).value
ce.write_network(found, "print.svg", size=100, width=1.5, by_stiffness=True)

width = found.network.stiffness * lengths
width *= 1.5 / width.mean()  # mm
figure = Figure(figsize=(4.8, 4.2), layout="constrained")
axes = figure.add_subplot(title="Poisson's ratio 0.1, by width of ribbons")
outline = add_cell(axes, network.cell)
segments, edges = periodic_segments(
    network.edges, network.offsets, network.cell, network.positions
)
figure.canvas.draw()
scale = axes.get_window_extent().width / figure.dpi * 72 / 100  # points a mm
ribbons = LineCollection(
    segments, linewidths=scale * width[edges], colors="0.2"
)
axes.add_collection(ribbons).set_clip_path(outline)
for size in (width.min(), 1.5, width.max()):
    axes.plot([], [], "0.2", linewidth=scale * size, label=f"{size:.2f} mm")
figure.legend(loc="outside right upper", frameon=False)
figure.savefig("print.png", dpi=80)
