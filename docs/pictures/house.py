"""Who imports whom, the picture of docs/contributing.md: python docs/pictures/house.py [FILE]."""

import ast
import sys
from collections import Counter
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

PACKAGE = Path(__file__).parents[2] / "critflow"
SCENE, EXTRA, LATER = "#0072B2", "#E69F00", "#D55E00"


def room(parts):
    """The folder of a module of the scene, or of an extra; None for the public names at the top."""
    parts = [part for part in parts if part != "__init__"]
    if parts[:1] == ["extras"]:
        return ("extras", parts[1]) if len(parts) > 1 else None
    return ("scene", parts[0]) if parts and parts[0] != "__main__" else None


imports, lines, order = Counter(), Counter(), []
for path in sorted(PACKAGE.rglob("*.py")):
    text = path.read_text(encoding="utf-8")
    here = room(path.relative_to(PACKAGE).with_suffix("").parts)
    lines[here] += text.count("\n")
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("critflow."):
            there = room(node.module.split(".")[1:])
            if here and there and here != there:
                imports[here, there] += 1

# The scene in an order in which each folder imports only earlier ones; extras with the fewest needs come first.
rooms = {name for name in lines if name}
while rooms:
    free = [name for name in rooms if not any(imports[name, other] for other in rooms - {name})]
    first = min(free or rooms, key=lambda name: (name[0] == "extras", name))
    order.append(first)
    rooms.remove(first)
order.sort(key=lambda name: name[0] == "extras")  # stable
n, at = sum(name[0] == "scene" for name in order), {name: place for place, name in enumerate(order)}

figure, axes = plt.subplots(figsize=(8.4, 8.0), layout="constrained")
axes.axhspan(-0.5, n - 0.5, color=SCENE, alpha=0.06, lw=0)
axes.axhspan(n - 0.5, len(order) - 0.5, color=EXTRA, alpha=0.10, lw=0)
axes.axvline(n - 0.5, color="0.3", lw=1)
for (here, there), count in imports.items():
    row, column = at[here], at[there]
    colour = LATER if column > row else EXTRA if here[0] == "extras" else SCENE
    axes.scatter(column, row, s=18 + 14 * np.sqrt(count), marker="X" if column > row else "o", color=colour, zorder=3)
axes.plot([-0.5, len(order) - 0.5], [-0.5, len(order) - 0.5], color="0.8", lw=0.8, zorder=1)
names = [name for _, name in order]
axes.set_xticks(range(len(order)), names, rotation=90, fontsize=8)
axes.set_yticks(range(len(order)), [f"{key[1]}  {lines[key]:,}" for key in order], fontsize=8)
axes.xaxis.tick_top()
axes.set(xlim=(-0.5, len(order) - 0.5), ylim=(len(order) - 0.5, -0.5))
axes.set_xlabel("imports a module of", fontsize=9)
axes.xaxis.set_label_position("top")
axes.grid(color="0.92", zorder=0)
axes.set_axisbelow(True)
scene, extras = (sum(lines[key] for key in order if key[0] == kind) for kind in ("scene", "extras"))
labels = (
    (0, n - 1, f"scene, {scene:,} lines:\nimports no extra"),
    (n, len(order) - 1, f"extras, {extras:,} lines:\neach can be deleted"),
)
for row, column, text in labels:
    axes.text(column, row, text, ha="right", va="top", fontsize=9, color="0.2")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"), dpi=90)
