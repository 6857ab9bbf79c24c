"""The movie of extras/docs/index.md, cables that become rigid in shear: python extras/docs/pictures/movie.py [FILE].

Writes movie.gif and movie.png, its last frame.
"""

import sys
from io import BytesIO
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from PIL import Image

from critflow import Cable, equilibrium, spring_state, strain_path
from critflow.deformation import deformation_of
from critflow.pictures import TENSION_MAP, add_cell, add_edges, periodic_segments
from critflow_extras import critical_strain, fibre_network

FLOPPY, RIGID, LAST = 14, 24, 0.12  # frames before and after the onset; strain of the last one past it

network = fibre_network("mikado", 150, z=3.4, seed=2)
lengths = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
onset = critical_strain(network, lengths, "simple_shear")
past = np.linspace(0.0, LAST, RIGID + 1)[1:]
path = strain_path(onset, past, deformation="simple_shear").value
shear = deformation_of("simple_shear", 2)
states = []
for strain in np.linspace(0.0, onset.value.strain, FLOPPY):
    F = shear.gradient(strain)
    start = spring_state(network.deformed(F), lengths, network.positions @ F.T, law=Cable())
    state = equilibrium(start, throw=False).value
    states.append((state.network, state.coordinates, np.zeros(network.n_edges)))
states += [(state.network, state.coordinates, state.sigma * state.lengths) for state in path.states]
strains = np.concatenate([np.linspace(0.0, onset.value.strain, FLOPPY), onset.value.strain + past])
stress = 1e3 * np.concatenate([np.zeros(FLOPPY), path.stress[:, 0, 1]])
limit = float(np.percentile(states[-1][2], 98))
# A vertex under tension moves with the cell: others are slack, and their places are those of rounding.
taut = network.edges[states[-1][2].argmax(), 0]

frames = []
for at, (deformed, x, tensions) in enumerate(states):
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.6, 3.3), width_ratios=(1.45, 1), layout="constrained")
    x = x - x[taut] + shear.gradient(strains[at]) @ network.positions[taut]
    segments, edges = periodic_segments(deformed.edges, deformed.offsets, deformed.cell, x)
    shown = np.where(tensions > 1e-3 * limit, tensions, 0.0)[edges]
    add_edges(left, segments, shown, (0.0, limit), add_cell(left, deformed.cell), width=1.8)
    side = network.cell[0, 0]
    left.set(xlim=(-0.02 * side, side * (1 + strains[-1]) * 1.02), ylim=(-0.02 * side, 1.02 * side))
    left.set_title("floppy: no tension anywhere" if at < FLOPPY else "rigid: tension in part of the edges", fontsize=10)
    figure.colorbar(ScalarMappable(Normalize(0, limit), TENSION_MAP), ax=left, label="tension [k × length]", shrink=0.8)
    right.axvline(onset.value.strain, color="0.6", linewidth=0.8, linestyle="--")
    right.text(onset.value.strain, 0.93 * stress[-1], "$\\gamma_c$  ", ha="right", color="0.35")
    right.plot(strains[: at + 1], stress[: at + 1], color="#D55E00")
    right.plot(strains[at], stress[at], "o", color="#D55E00")
    right.set(xlim=(0, 1.03 * strains[-1]), ylim=(-0.04 * stress[-1], 1.05 * stress[-1]))
    right.set(xlabel="shear strain γ", ylabel="shear stress [$10^{-3}$ k]")
    stream = BytesIO()
    figure.savefig(stream, dpi=80)
    plt.close(figure)
    frames.append(Image.open(stream).convert("RGB"))

file = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_suffix(".png")
frames[-1].save(file, optimize=True)
palette = frames[-1].quantize(128, dither=Image.Dither.NONE)
few = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
durations = [150] * (len(few) - 1) + [2500]
few[0].save(file.with_suffix(".gif"), save_all=True, append_images=few[1:], duration=durations, loop=0)
