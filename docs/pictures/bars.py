"""Three bars and a square, the first pictures of docs/tutorial.md: python docs/pictures/bars.py [FILE]."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

BAR, FREE, TENSE, PUSHED = "0.35", "#0072B2", "#0072B2", "#D55E00"
corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def panel(axes, points, bars, pins, title, colours=None, below=""):
    for at, (i, j) in enumerate(bars):
        colour = colours[at] if colours else BAR
        axes.plot(*points[[i, j]].T, color=colour, linewidth=3, ls="--" if colour == PUSHED else "-", zorder=1)
    axes.plot(*points.T, "o", color="white", markeredgecolor="0.2", markersize=7, zorder=2)
    axes.plot(*points[pins].T, "s", color="0.1", markersize=8, zorder=3)
    axes.set_title(title, fontsize=10)
    axes.text(0.5, -0.02, below, transform=axes.transAxes, ha="center", va="top", fontsize=9, color="0.3")
    axes.set_aspect("equal")
    axes.set_axis_off()


def motion(axes, point, step):
    axes.annotate("", point + step, point + 0.12 * step, arrowprops={"arrowstyle": "-|>", "color": FREE, "lw": 1.6})


def pulls(axes, points):
    """Arrows at the inner vertices, the equal forces of the self-stress."""
    for vertex, side in ((1, -1), (1, 1), (2, -1), (2, 1)):
        start = points[vertex] + np.array([0.1 * side, 0.17])
        end = start + np.array([0.33 * side, 0])
        axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": TENSE, "lw": 1.6})


figure, rows = plt.subplots(2, 3, figsize=(8.4, 4.3), height_ratios=(0.62, 1), layout="constrained")
chain = [(0, 1), (1, 2), (2, 3)]
bent = np.array([[0.0, 0.0], [0.7, 0.714], [1.7, 0.714], [2.4, 0.0]])
taut = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])
panel(rows[0, 0], bent, chain, [0, 3], "floppy", below="1 motion, no self-stress")
motion(rows[0, 0], bent[1], np.array([-0.42, 0.41]))
motion(rows[0, 0], bent[2], np.array([-0.42, -0.41]))
panel(rows[0, 1], taut, chain, [0, 3], "critical", [TENSE] * 3, "1 self-stress: equal pulls balance")
pulls(rows[0, 1], taut)
panel(rows[0, 2], taut * [1.08, 1.0], chain, [0, 3], "rigid", [TENSE] * 3, "stretched: the springs are under tension")
for axes in rows[0]:
    axes.set(xlim=(-0.25, 3.45), ylim=(-0.3, 1.2))
sides = [(1, 2), (2, 3), (3, 0)]
panel(rows[1, 0], corners, sides, [0, 1], "a square", below="1 motion, no self-stress")
for corner in (corners[2], corners[3]):
    motion(rows[1, 0], corner + np.array([0.0, 0.16]), np.array([0.36, 0.0]))
panel(rows[1, 1], corners, [*sides, (0, 2)], [0, 1], "with a brace", below="no motion, no self-stress")
stressed = [*sides, (0, 2), (1, 3)]
panel(rows[1, 2], corners, stressed, [0, 1], "with two braces", [TENSE] * 3 + [PUSHED] * 2, "no motion, 1 self-stress")
for axes in rows[1]:
    axes.set(xlim=(-0.75, 1.75), ylim=(-0.15, 1.25))
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"), dpi=90)
