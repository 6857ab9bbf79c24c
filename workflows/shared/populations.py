"""The populations of critical configurations that several studies compare.

The populations are listed here by name: a new objective in the library changes no study.
"""

from functools import lru_cache

import numpy as np

from critflow import CriticalConfiguration, CriticalManifold, Solution, critical_from_lengths, optimize
from critflow.engine import AxisLabel, stable_rng
from critflow.pictures import COLOURS

from .strain_protocol import critical_in_printed_box

# The quantity whose optimum each of these populations is.
OPTIMA = {"min_V_L": "V_L", "min_V_tau": "V_tau", "max_B_0": "B_0", "max_G_0": "G_0"}
# The populations of the paper.  Its random rest lengths are recorded beyond the transition, see `strain_protocol`;
# `random_lengths_transition` has the same rest lengths, exactly there.
PAPER_POPULATIONS = (*OPTIMA, "random_lengths", "random_stress")
POPULATIONS = (*PAPER_POPULATIONS, "random_lengths_transition")
# Names in print, as mathematics and as plain text.
LABELS = {
    "min_V_L": "min $V_L$",
    "min_V_tau": "min $V_\\tau$",
    "max_B_0": "max $B_0$",
    "max_G_0": "max $G_0$",
    "random_lengths": "random $\\ell$",
    "random_stress": "random $\\sigma$",
    "random_lengths_transition": "random $\\ell$, transition",
}
NAMES = {p: label.replace("$", "").replace("\\tau", "τ") for p, label in LABELS.items()}
NAMES = {p: name.replace("\\ell", "ℓ").replace("\\sigma", "σ") for p, name in NAMES.items()}
MEANING = "population of critical configurations: " + ", ".join(f"{p} = {name}" for p, name in NAMES.items())
# Coordinates along the axis of the populations, so that an analysis needs no table of its own.
POPULATION_LABELS = (
    AxisLabel("population_label", "name of the population", NAMES),
    AxisLabel("population_symbol", "name of the population with its symbol in TeX", LABELS),
    AxisLabel("population_color", "colour of the population in figures", dict(zip(POPULATIONS, COLOURS, strict=True))),
)
# Words of the random streams.  They are part of every stored number and stay when a population is renamed.
STREAMS = {
    "min_V_L": "length_variance",
    "min_V_tau": "tension_variance",
    "max_B_0": "bulk_modulus",
    "max_G_0": "shear_modulus",
    "random_lengths": "random_lengths_wide",
    "random_stress": "random_stress",
    "random_lengths_transition": "random_lengths_wide",
}
# The parameter with the spread of the rest lengths of each population.
SPREADS = {"random_lengths": "spread", "random_lengths_transition": "spread"}


@lru_cache(maxsize=2)
def prepared(make, n_vertices, seed, hard_core):
    """The manifold of one network, made by `voronoi_network` or `foam_network`, with the analysis of its matrices."""
    return CriticalManifold(make(n_vertices, seed, hard_core))


def configuration(
    manifold, parameters, seed, population, method="auto", random_start=False
) -> Solution[CriticalConfiguration]:
    """One configuration of a population, by a method of `optimize` where it is an optimum.

    Random populations, and random starts of descents, draw from a generator of the seed and the population.
    """
    rng = stable_rng(seed, STREAMS[population])
    if population in OPTIMA:
        start = np.exp(0.5 * rng.standard_normal(manifold.network.n_edges)) if random_start else None
        return optimize(
            manifold, OPTIMA[population], method, threshold=parameters["threshold"], start=start, throw=False
        )
    if population == "random_stress":
        return manifold.solve(np.abs(rng.standard_normal(manifold.network.n_edges)))
    lengths = random_lengths(rng, manifold.network.n_edges, parameters["spread"])
    if population == "random_lengths":
        return critical_in_printed_box(manifold, lengths)
    return critical_from_lengths(manifold, lengths, throw=False)


def random_lengths(rng, n_edges, spread):
    """Rest lengths from a normal distribution of mean 1, drawn again where they are not positive."""
    lengths = 1 + spread * rng.standard_normal(n_edges)
    while (negative := lengths <= 0).any():  # at spread 0.3 one length in 2,300 is negative
        lengths[negative] = 1 + spread * rng.standard_normal(negative.sum())
    return lengths
