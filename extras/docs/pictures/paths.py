"""The picture of extras/docs/theory/cables.md: python extras/docs/pictures/paths.py [FILE]."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from critflow import strain_path
from critflow_extras import critical_strain, fibre_network

network = fibre_network("mikado", 150, z=3.4, seed=2)
lengths = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
onset = critical_strain(network, lengths, "simple_shear")
strains = np.linspace(0.002, 0.1, 40)
figure, axes = plt.subplots(1, 2, figsize=(7, 3), layout="constrained")
for taut_only, colour, label in ((False, "#0072B2", "all edges"), (True, "#D55E00", "those taut at the onset")):
    path = strain_path(onset, strains, deformation="simple_shear", taut_only=taut_only).value
    taut = [np.count_nonzero(state.sigma > 1e-9 * state.sigma.max()) for state in path.states]
    axes[0].plot(strains, taut, color=colour, label=label)
    axes[1].plot(strains, path.stress[:, 0, 1], color=colour, label=label)
axes[0].set(xlabel="strain past the onset", ylabel="taut edges", ylim=(0, None))
axes[1].set(xlabel="strain past the onset", ylabel="shear stress [k]")
axes[1].legend(frameon=False)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"), dpi=80)
