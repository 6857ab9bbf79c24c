"""The picture of extras/docs/theory/onset.md: python extras/docs/pictures/onset.py [FILE]."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from critflow import critical_from_lengths, voronoi_network
from critflow.deformation import deformation_of
from critflow_extras import critical_strain

network = voronoi_network(n_vertices=100, seed=1)
lengths = np.full(network.n_edges, 1.05 * critical_from_lengths(network, np.ones(network.n_edges)).ratio)
figure, axes = plt.subplots(figsize=(5, 3.2), layout="constrained")
axes.axhline(1, color="0.5", linewidth=0.8)
for name, colour in (("dilation", "#0072B2"), ("uniaxial", "#009E73"), ("simple_shear", "#D55E00")):
    F, strains = deformation_of(name, 2), np.linspace(0, 0.45, 10)
    t = [critical_from_lengths(network.deformed(F.gradient(s)), lengths, throw=False).ratio for s in strains]
    onset = critical_strain(network, lengths, name)
    axes.plot(strains, t, color=colour, label=name.replace("_", " "))
    axes.plot(onset.value.strain, 1, "o", color=colour)
for t, side in ((1.004, "rigid"), (0.988, "floppy")):
    axes.text(0.47, t, side, ha="right", fontsize=9, color="0.35")
axes.set(xlabel="strain γ", ylabel="longest edge over its rest length,\nleast value $t$", ylim=(0.94, 1.1))
axes.legend(frameon=False)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"), dpi=80)
