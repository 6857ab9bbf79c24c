"""Six populations of critical configurations of networks in three dimensions, strained past the transition.

The study measures for periodic Voronoi networks in three dimensions, where four edges meet at every vertex, what the
paper has on planar populations (`ResponseMetrics`).  Equal lengths often leave edges slack, so that the
least length variance is not attained; the population then contains the configuration of the cone program, with equal
lengths on all stressed edges.  The least tension variance is not attained either, because edges shrink to zero length:
the stored configuration is a near one, with edges of a hundredth of the mean length.
Random rest lengths (`random_lengths`) have s = 0.1, not the 0.3 of the plane, so that few edges are slack.
"""

import numpy as np
from critflow.studies.shared.checks import check_fit, check_network, check_positive
from critflow.studies.shared.figures import counted, lettered, page, points_at
from critflow.studies.shared.measurements import identified, measured, table, verify
from critflow.studies.shared.population_reports import counts, described, of, summary
from critflow.studies.shared.populations import (
    LABELS,
    MEANING,
    NAMES,
    PAPER_POPULATIONS,
    POPULATION_LABELS,
    configuration,
    drawn_lengths,
    prepared,
)
from critflow.studies.shared.reports import PAPER, finite, parameters
from critflow.studies.shared.tables import SPACE, networks

from critflow.engine import Axis, Claim, Coordinate, Study, decimals
from critflow.paths import check_strains
from critflow.pictures import COLOURS
from critflow_extras import foam_network
from critflow_extras.foams.foams import FOAM_HARD_CORE, check_foam

from .shared.parts import NARROW


def case(parameters, *, seed, population, wanted):
    """A critical configuration, and its moduli at the transition and along the strain path."""
    manifold = prepared(foam_network, parameters["n_vertices"], seed, parameters["hard_core"])
    # The least length variance of most foams is not attained: its limit is the optimum of the cone program.
    method = "conic" if population == "min_V_L" else "auto"
    found = configuration(manifold, parameters, seed, population, method)
    if not np.isfinite(found.value.coordinates).all():
        return identified(manifold.network, found)
    drawn = drawn_lengths(seed, manifold.network.n_edges, parameters["spread"], population)
    return {**measured(manifold, found, parameters, wanted), "rest_length": drawn}


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_strains(parameters["strains"])
    check_positive(parameters, "threshold", "spread", "hard_core", "fit_window")
    check_fit(parameters)
    check_network(check_foam, parameters["n_vertices"], parameters["hard_core"])


PANELS = {
    "B_0": "bulk modulus $B_0$  [k / length]",
    "C_B": "its growth $C_B$  [k / length]",
    "G_0": "shear modulus $G_0$  [k / length]",
    "C_G_stress_corrected": "its growth $C_G$,\nstress-corrected  [k / length]",
}
# Growths above are named at the end of their axis, where they would leave no room for all others.
LARGE = 0.3
# A shear modulus below is zero to rounding.
VANISHING = 1e-7


def response_figure(ds):
    """Moduli at the transition and their growth, of every population: a point a network."""
    figure = page(
        5.0,
        "In space too the stiffest networks soften, and max $G_0$ alone resists shear\n"
        f"({counted(ds)} of {ds.sizes['vertex']} vertices where four edges meet; bars: medians; random ℓ: "
        f"s = {parameters(ds)['spread']:g})",
    )
    names = [str(name) for name in ds.population.values]
    shown = [LABELS[name].replace("random", "rand.").replace(" ", "\n", 1) for name in names]
    panels = figure.subplots(2, 2, sharex=True)
    valid = ds.valid.transpose("population", "seed").values == 1
    for axes, (name, label) in zip(panels.flat, PANELS.items(), strict=True):
        values = np.where(valid, ds[name].transpose("population", "seed").values, np.nan)
        _draw_points(axes, values)
        for place in np.flatnonzero(~valid.any(axis=1)):
            axes.text(
                place, 0.5, "not attained", transform=axes.get_xaxis_transform(), rotation=90, ha="center", va="center",
                fontsize=9, color="0.3",
            )  # fmt: skip
        if name == "G_0":
            axes.set_yscale("log")
            axes.set_ylim(VANISHING, None)
            for place, n_vanishing in enumerate(np.sum(values < VANISHING, axis=1)):
                _name_beyond(axes, place, f"{n_vanishing} at 0" if n_vanishing else "", end=0)
        elif name.startswith("C_"):
            axes.axhline(0.0, color="0.4", linewidth=0.8, zorder=0)
            if np.nanmax(values) > LARGE:
                axes.set_ylim(1.2 * np.nanmin(values), LARGE)
            for place, row in enumerate(values):
                _name_beyond(axes, place, ", ".join(f"{value:.2g}" for value in row[row > LARGE]), end=1)
        else:
            axes.set_ylim(0, None)
        axes.set(ylabel=label)
        axes.set_xticks(range(len(names)), shown)
    lettered(*panels.flat)
    return figure


def _draw_points(axes, values):
    """Every finite value (populations, networks) as a point, and medians."""
    for place, row in enumerate(values):
        known, colour = finite(row), COLOURS[place % len(COLOURS)]
        points_at(axes, place, known, colour)
        if len(known):
            axes.plot([place - 0.35, place + 0.35], [np.median(known)] * 2, color=colour, linewidth=2)


def _name_beyond(axes, place, text, end):
    """Name values of a population beyond the lower (0) or the upper (1) end of its axis, with an arrow to that end."""
    if text:
        axes.annotate(
            text, (place, end), (0, 12 - 30 * end), xycoords=axes.get_xaxis_transform(), ha="center",
            textcoords="offset points", fontsize=9, arrowprops={"arrowstyle": "->", "color": "0.3"},
        )  # fmt: skip


MEASURED = {
    "B_0": "B_0 [k / length]",
    "C_B": "C_B [k / length]",
    "G_0": "G_0 of shear of x and y [k / length]",
    "C_G": "C_G, energy convention [k / length]",
    "C_G_stress_corrected": "C_G, stress-corrected [k / length]",
    "V_L": "V_L",
    "V_tau": "V_τ",
    "stressed_fraction": "part of the edges with stress of any sign",
    "tension_fraction": "part of the edges under tension",
}


def claims(ds):
    """Measured values of every population: the paper has no statement on three dimensions."""
    for name, words in MEASURED.items():
        values = {p: of(ds, name, p) for p in map(str, ds.population.values)}
        text = "; ".join(f"{NAMES[p]} {described(known)}" for p, known in values.items() if len(known))
        yield Claim(
            f"three-dimensions-{name}", f"{words}, median and range of 90 %", "", text or "undefined", "measured",
            sample=counts(ds, name, tuple(values)),
        )  # fmt: skip


study = Study(
    name="three_dimensions",
    version=3,
    title="Populations of critical configurations in three dimensions, strained past the rigidity transition",
    references=f"{PAPER}, whose networks are planar",
    axes=(
        networks(20),
        Axis("population", PAPER_POPULATIONS, MEANING, labels=POPULATION_LABELS),
    ),
    parameters={
        "n_vertices": 400,
        "hard_core": FOAM_HARD_CORE,
        **NARROW,
        "strains": decimals("0.001:0.010:0.001"),
        "fit_window": 0.01,
    },
    coordinates=(Coordinate("strain", "strains", "strain γ past the transition, V = V(0) (1 + γ)"), *SPACE),
    case=case,
    check=check,
    variables=table(planar=False),
    figures={"response": response_figure},
    needs={
        "response": tuple(PANELS),
        "claims": tuple(MEASURED),
        "summary": ("max_force",),
    },
    claims=claims,
    summary=summary,
    verify=verify,
)
