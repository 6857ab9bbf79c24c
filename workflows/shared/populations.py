"""The populations of critical configurations that several studies compare.

The populations are listed here by name: a new objective in the library changes no study.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from critflow import CriticalConfiguration, CriticalManifold, Solution, critical_from_lengths, optimize
from critflow.engine import AxisLabel, stable_rng
from critflow.pictures import COLOURS

from .own_network import own_manifold
from .strain_protocol import critical_in_printed_box

# Settings of the populations in the paper: threshold r of max G_0, spread s of random rest lengths.
SETTINGS = {"threshold": 0.1, "spread": 0.3}
_WIDE = "random_lengths_wide"  # stream of the random rest lengths


def random_lengths(rng, n_edges, spread):
    """Rest lengths from a normal distribution of mean 1, drawn again where they are not positive."""
    lengths = 1 + spread * rng.standard_normal(n_edges)
    while (negative := lengths <= 0).any():  # at spread 0.3 one length in 2,300 is negative
        lengths[negative] = 1 + spread * rng.standard_normal(negative.sum())
    return lengths


def _recorded(manifold, parameters, rng):
    """Random rest lengths as the protocol of the paper records them in its box, beyond the transition."""
    return critical_in_printed_box(manifold, random_lengths(rng, manifold.network.n_edges, parameters["spread"]))


def _at_transition(manifold, parameters, rng):
    """The same rest lengths exactly at the transition."""
    lengths = random_lengths(rng, manifold.network.n_edges, parameters["spread"])
    return critical_from_lengths(manifold, lengths, throw=False)


def _random_stress(manifold, parameters, rng):
    return manifold.solve(np.abs(rng.standard_normal(manifold.network.n_edges)))


def drawn_lengths(seed, n_edges, spread, population="random_lengths"):
    """Rest lengths ℓ of one network, as drawn (N_b,): the same in every state; NaN for populations without them."""
    known = POPULATIONS[population].stream == _WIDE
    return random_lengths(stable_rng(seed, _WIDE), n_edges, spread) if known else np.full(n_edges, np.nan)


@dataclass(frozen=True)
class Population:
    """One population, of which each network has one configuration.

    label, symbol  name in print, as plain text and in TeX
    rule           quantity of which the configuration is the optimum, or function of manifold, parameters and generator
    stream         word of the random numbers, part of every stored number: it stays when a population is renamed
    in_paper       whether the paper has the population
    """

    name: str
    label: str
    symbol: str
    colour: str
    rule: str | Callable[..., Solution]
    stream: str
    in_paper: bool = False


POPULATIONS = {
    one.name: one
    for one in (
        Population("min_V_L", "min V_L", "min $V_L$", COLOURS[0], "V_L", "length_variance", in_paper=True),
        Population("min_V_tau", "min V_τ", "min $V_\\tau$", COLOURS[1], "V_tau", "tension_variance", in_paper=True),
        Population("max_B_0", "max B_0", "max $B_0$", COLOURS[2], "B_0", "bulk_modulus", in_paper=True),
        Population("max_G_0", "max G_0", "max $G_0$", COLOURS[3], "G_0", "shear_modulus", in_paper=True),
        Population("random_lengths", "random ℓ", "random $\\ell$", COLOURS[4], _recorded, _WIDE, in_paper=True),
        Population(
            "random_stress", "random σ", "random $\\sigma$", COLOURS[5], _random_stress, "random_stress", in_paper=True
        ),
        Population(
            "random_lengths_transition",
            "random ℓ, transition",
            "random $\\ell$, transition",
            COLOURS[6],
            _at_transition,
            _WIDE,
        ),
    )
}
PAPER_POPULATIONS = tuple(name for name, one in POPULATIONS.items() if one.in_paper)
# The quantity of each optimum, and names in print.
OPTIMA = {name: one.rule for name, one in POPULATIONS.items() if isinstance(one.rule, str)}
LABELS = {name: one.symbol for name, one in POPULATIONS.items()}
NAMES = {name: one.label for name, one in POPULATIONS.items()}
MEANING = "population of critical configurations: " + ", ".join(f"{p} = {name}" for p, name in NAMES.items())
# Coordinates along the axis of the populations, so that an analysis needs no table of its own.
POPULATION_LABELS = (
    AxisLabel("population_label", "name of the population", NAMES),
    AxisLabel("population_symbol", "name of the population with its symbol in TeX", LABELS),
    AxisLabel(
        "population_color", "colour of the population in figures", {p: one.colour for p, one in POPULATIONS.items()}
    ),
)


@lru_cache(maxsize=2)
def prepared(make, n_vertices, seed, hard_core, own=""):
    """The manifold of a network that `make` generates, or of FILE@DIGEST, with the analysis of its matrices."""
    return own_manifold(own) if own else CriticalManifold(make(n_vertices, seed, hard_core))


def configuration(
    manifold, parameters, seed, population, method="auto", random_start=False
) -> Solution[CriticalConfiguration]:
    """One configuration of a population, by a method of `optimize` where it is an optimum.

    Random populations, and random starts of descents, draw from a generator of the seed and the population.
    """
    rule, rng = POPULATIONS[population].rule, stable_rng(seed, POPULATIONS[population].stream)
    if callable(rule):
        return rule(manifold, parameters, rng)
    start = np.exp(0.5 * rng.standard_normal(manifold.network.n_edges)) if random_start else None
    return optimize(manifold, rule, method, threshold=parameters["threshold"], start=start, throw=False)
