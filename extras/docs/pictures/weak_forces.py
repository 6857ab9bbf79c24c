"""The picture of extras/docs/theory/weak_forces.md: python extras/docs/pictures/weak_forces.py [FILE]."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from critflow import optimize, voronoi_network
from critflow_extras import AngleSprings, weak_forces
from critflow_extras.weak.weak_equilibrium import weak_equilibrium

critical = optimize(voronoi_network(n_vertices=60, seed=1), "B_0").value
angles = AngleSprings()
full, cubic = (weak_forces(critical, angles, order=order).value for order in ("full", "cubic"))
strains, points = np.linspace(-0.006, 0.006, 121), np.linspace(-0.006, 0.006, 13)
figure, axes = plt.subplots(figsize=(5.6, 3.4), layout="constrained")
for power, colour in ((-3, "#D55E00"), (-4, "#009E73"), (-5, "#0072B2")):
    kappa = 10.0**power
    axes.plot(strains, full.tension(strains, kappa), color=colour, label=f"κ = $10^{{{power}}}$ k")
    axes.plot(strains, cubic.tension(strains, kappa), color=colour, linestyle="--", linewidth=1.4)
    true = weak_equilibrium(critical, angles, points, kappa).value
    axes.plot(points, true.tension, "o", color=colour, markersize=4)
axes.plot(strains, np.maximum(full.work / full.compliance * strains, 0), "k", linewidth=1.2, zorder=0, label="κ = 0")
for name, style in (("full equation", "-"), ("cubic equation", "--"), ("relaxed energies", "o")):
    axes.plot([], [], style, color="0.4", markersize=4, label=name)
axes.set(xlabel="strain γ from the transition", ylabel="tension τ  [k]")
axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(0, 0.68), fontsize=9, ncols=2)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"), dpi=80)
