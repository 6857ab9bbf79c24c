"""The three-bar linkage of the paper.

Two hinges between two fixed points: the variance of lengths over all stresses.
Equal stresses have equal lengths.
"""

import matplotlib.pyplot as plt
import numpy as np

import critflow as cf

network = cf.three_bar_linkage()
manifold = cf.CriticalManifold(network)
first, last = np.meshgrid(np.geomspace(0.1, 10, 24), np.geomspace(0.1, 10, 24))
variance = np.empty_like(first)
for at in np.ndindex(first.shape):
    lengths = manifold.configuration([first[at], 1.0, last[at]]).lengths
    variance[at] = np.mean(lengths**2) / np.mean(lengths) ** 2 - 1
figure, axes = plt.subplots(figsize=(4.8, 3.8), layout="constrained")
drawn = axes.contourf(first, last, variance, levels=15, cmap="cividis")
figure.colorbar(drawn, label="variance of lengths $V_L$")
axes.set(xlabel="$σ_1/σ_2$", ylabel="$σ_3/σ_2$", xscale="log", yscale="log")
figure.savefig("three_bars.png", dpi=80)
