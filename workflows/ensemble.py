"""Seven populations of critical configurations on the same networks, strained past the transition.

The paper's main ensemble: `StructuralMetrics`, `ResponseMetrics` and the claims around them.  Random rest lengths of
the printed spread, 0.3, come twice: `random_lengths` is the state that the protocol of the paper records in its box of
side √N_b, beyond the transition, with nearly every edge stressed; `random_lengths_transition` is exactly at the
transition, which leaves edges slack.

With `network=FILE` the network is that of a file; seeds are then those of random populations and of random starts.
"""

import textwrap
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from critflow import voronoi_network
from critflow.engine import Axis, Coordinate, Study, decimals
from critflow.engine.study import plural
from critflow.paths import check_strains
from critflow.pictures import draw_network, unit_pressure_tensions
from critflow.points import STANDARD_HARD_CORE

from .paper.verdicts import claims_of, committed_run
from .shared.checks import check_deformation, check_fit, check_positive
from .shared.figures import violins
from .shared.measurements import DRAWN, identified, measured, table, verify
from .shared.own_network import check_planar, with_digest
from .shared.population_reports import of, percolation_measurements, population_measurements, summary
from .shared.populations import (
    LABELS,
    MEANING,
    PAPER_POPULATIONS,
    POPULATION_LABELS,
    POPULATIONS,
    SETTINGS,
    configuration,
    prepared,
)
from .shared.reports import PAPER, parameters
from .shared.structure import face_anisotropy, force_anisotropy
from .shared.tables import networks


def case(parameters, *, seed, population, wanted):
    """A critical configuration, its structure, and its moduli at the transition and along the strain path."""
    own = parameters.get("network", "")
    manifold = prepared(voronoi_network, parameters["n_vertices"], seed, parameters["hard_core"], own)
    found = configuration(manifold, parameters, seed, population, random_start=bool(own and seed))
    if not np.isfinite(found.value.coordinates).all():
        return identified(manifold.network, found)
    result = measured(manifold, found, parameters, wanted)
    for name, anisotropy in (("kappa_phys", face_anisotropy), ("kappa_force", force_anisotropy)):
        if name in wanted:
            known = name == "kappa_force" or manifold.network.faces is not None
            result[name] = np.nanmean(anisotropy(found.value)) if known else np.nan
    return result


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_strains(parameters["strains"])
    check_positive(parameters, "threshold", "spread", "hard_core", "fit_window", "fit_degree")
    check_fit(parameters)
    check_deformation(parameters["deformation"])
    check_planar(parameters)


STRUCTURE = {
    "V_L": "length variance $V_L$",
    "kappa_phys": "mean face anisotropy $\\langle\\kappa_{phys}\\rangle$",
    "V_tau": "tension variance $V_\\tau$",
    "kappa_force": "mean force anisotropy $\\langle\\kappa_{force}\\rangle$",
}
RESPONSE = {
    "B_0": "bulk modulus at the transition $B_0$  [$k$]",
    "C_B": "its growth with strain $C_B$  [$k$]",
    "G_0": "shear modulus at the transition $G_0$  [$k$]",
    "C_G_stress_corrected": "its growth with strain $C_G$, stress-corrected  [$k$]",
}
# Quantities on logarithmic axes, and the least value that is drawn.
LEAST_DRAWN = {"V_L": 1e-3, "V_tau": 1e-3, "G_0": 1e-12}

# Characters of a line of the note under a figure of panels, which leave a margin on both sides.
_NOTE_WIDTH = 190
_DRAWINGS = "Drawings: medians of the highest and lowest population; dark, wide edges carry the most tension."


def structure_figure(ds):
    """`StructuralMetrics`: lengths and faces, tensions and force triangles."""
    note = f"{_DRAWINGS} $V_L$ of min $V_L$ vanishes to rounding and stands at {LEAST_DRAWN['V_L']:g}."
    return _panels(
        ds,
        STRUCTURE,
        "Equal lengths need unequal tensions, and only max $G_0$ flattens the triangles of its forces",
        note,
    )


def response_figure(ds):
    """`ResponseMetrics`: moduli at the transition and how they grow past it."""
    deformation = parameters(ds).get("deformation", "dilation")
    # The paper has dilations.
    other = "" if deformation == "dilation" else f" of the {deformation.replace('_', ' ')}"
    note = f"Red lines: no change with strain{other}. Undefined: edges shrink to zero length. {_DRAWINGS}"
    return _panels(
        ds,
        RESPONSE,
        "The stiffest populations soften past the transition; only max $G_0$ resists shear there, and ever less",
        note,
    )


def _panels(ds, names, title, note):
    """Panels two by two: distributions of each quantity on the left of one, networks as examples on its right."""
    sample = f"{plural(ds.sizes['seed'], 'network')} of {ds.sizes['vertex']:,} vertices."
    lines = textwrap.wrap(f"{sample} {note} {_random_note(ds)}", _NOTE_WIDTH)
    low = 0.15 + 0.17 * len(lines)
    size = (12.5, 4.3 * 2 + 0.45 + low)
    figure = Figure(figsize=size, dpi=150)
    figure.suptitle(title, fontsize=13, y=1 - 0.1 / size[1], va="top")
    of_populations = [LABELS[str(p)].replace("random ", "random\n").replace(", ", "\n") for p in ds.population.values]
    for n, ((name, label), letter) in enumerate(zip(names.items(), "ABCD", strict=True)):
        left, bottom = 6.25 * (n % 2), low + 4.3 * (1 - n // 2)
        axes = _axes(figure, left + 0.72, bottom + 0.5, 4.1, 3.55)
        if name.startswith("C_"):
            axes.axhline(0.0, color="#C00000", linewidth=1.0, zorder=0)
        values = ds[name].transpose("population", "seed")
        drawn = np.maximum(values.values, LEAST_DRAWN.get(name, -np.inf))
        violins(axes, list(drawn), of_populations, log=name in LEAST_DRAWN)
        axes.set_ylabel(label, fontsize=10)
        axes.set_title(letter, loc="left", fontweight="bold", fontsize=12, y=1.0)
        for row, (one, caption) in enumerate(_examples(ds, values)):
            small = _axes(figure, left + 4.93, bottom + 4.05 - 1.8 * (row + 1), 1.25, 1.45)
            _draw(small, one, caption, 8, width=0.75)
    figure.supxlabel("\n".join(lines), fontsize=8.5, color="0.25", y=0.07 / size[1], va="bottom")
    return figure


def _axes(figure, left, bottom, width, height):
    """Axes at a place of a figure in inches: a layout by the sizes of all labels takes longer than the drawing."""
    across, up = figure.get_size_inches()
    return figure.add_axes((left / across, bottom / up, width / across, height / up))


def _examples(ds, values):
    """The networks nearest to the median of the populations with the largest and the least one, with captions."""
    medians = values.median("seed")
    if np.isfinite(medians).any():
        for word, population in (("high", medians.idxmax()), ("low", medians.idxmin())):
            of_population = values.sel(population=population)
            seed = np.abs(of_population - of_population.median()).idxmin()
            value = float(of_population.sel(seed=seed))
            shown = f"{value:.2g}" if abs(value) > 1e-15 else "0"
            yield ds.sel(population=population, seed=seed), f"{word}: {shown}\n{LABELS[str(population.values)]}"


def _draw(axes, one, caption, font_size, width, limits=None):
    """A small picture of a configuration, by its tensions at unit pressure, with its caption as title."""
    # A given height is not searched for: that takes as long as the drawing.
    axes.set_title(caption, fontsize=font_size, y=1.0)
    arrays = (one[name].values for name in ("edges", "offsets", "cell", "position"))
    return draw_network(axes, *arrays, _tensions(one), limits=limits, width=width)


def _tensions(one):
    return unit_pressure_tensions(one.sigma.values, one.length.values, float(abs(np.linalg.det(one.cell.values))))


def gallery(ds):
    """`Networks`: the first network in every population on one scale of the tension, and its bar in the last place."""
    shown = [one for p in ds.population.values if np.isfinite((one := ds.isel(seed=0).sel(population=p)).sigma).all()]
    columns = min(4, len(shown) + 1)
    rows = (len(shown) + columns) // columns
    size = (3.1 * columns, 3.35 * rows + 0.4)
    figure = Figure(figsize=size, dpi=100)
    number = _NUMBERS.get(len(shown), len(shown))
    title = f"One network of {ds.sizes['vertex']} vertices at the rigidity transition in {number} populations"
    figure.suptitle(title, fontsize=13, y=1 - 0.1 / size[1], va="top")
    high = float(np.percentile(np.concatenate([np.abs(_tensions(one)) for one in shown]), 97))
    places = [(3.1 * (n % columns), 3.35 * (rows - 1 - n // columns)) for n in range(rows * columns)]
    for (left, bottom), one in zip(places, shown, strict=False):
        caption = f"{LABELS[str(one.population.values)]}: $B_0$ = {float(one.B_0):.3f}"
        axes = _axes(figure, left + 0.05, bottom + 0.05, 3.0, 3.0)
        lines = _draw(axes, one, caption, 10, width=1.1, limits=(0.0, high))
    left, bottom = places[len(shown)]
    bar = figure.colorbar(lines, cax=_axes(figure, left + 0.4, bottom + 0.2, 0.2, 2.7), extend="max")
    bar.set_label("edge tension at unit pressure")
    return figure


_NUMBERS = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six", 7: "seven"}


def _random_note(ds):
    """The spread of the random rest lengths, their two states, and the edges that are stressed in each."""
    states = {
        "random_lengths": "as recorded by the protocol of the paper in its box",
        "random_lengths_transition": "at the transition",
    }
    given = [p for p in states if p in ds.population]
    stressed = {p: 100 * float(ds.stressed_fraction.sel(population=p).mean()) for p in given}
    listed = "; ".join(f"{LABELS[p]}: {states[p]}, {stressed[p]:.3g} % of the edges stressed" for p in given)
    return f"Random rest lengths have spread $s$ = {parameters(ds)['spread']:g}. {listed}." if given else ""


# Claims


def claims(ds):
    """The statements of the paper on the populations, none for a network from a file or for few populations.

    Where the populations of the paper were not all run, percolation alone is tested.
    """
    if "network" in parameters(ds):
        return []
    if any(p not in ds.population.values or not len(of(ds, "B_0", p)) for p in PAPER_POPULATIONS):
        return claims_of(percolation_measurements(ds))
    return claims_of(population_measurements(ds))


study = Study(
    name="ensemble",
    version=2,
    title="Populations of critical configurations, strained past the rigidity transition",
    references=PAPER,
    committed=committed_run("ensemble"),
    axes=(
        networks(100),
        Axis("population", tuple(POPULATIONS), MEANING, labels=POPULATION_LABELS),
    ),
    parameters={
        "n_vertices": 1000,
        "hard_core": STANDARD_HARD_CORE,
        **SETTINGS,
        "strains": decimals("0.001:0.010:0.001"),
        "fit_window": 0.01,
        "fit_degree": 1,
        "deformation": "dilation",
        "network": "",
    },
    coordinates=(
        Coordinate("strain", "strains", "strain |γ| past the transition, of the deformation and sign that tightens"),
    ),
    case=case,
    check=check,
    complete=partial(with_digest, 1000),
    variables=table(planar=True),
    figures={"gallery": gallery, "structure": structure_figure, "response": response_figure},
    needs={
        "gallery": (*DRAWN, "B_0"),
        "structure": (*DRAWN, *STRUCTURE, "stressed_fraction"),
        "response": (*DRAWN, *RESPONSE, "stressed_fraction"),
        "claims": (*STRUCTURE, *RESPONSE, "C_G", "B", "stressed_fraction"),
        "summary": ("max_force",),
    },
    claims=claims,
    summary=summary,
    verify=verify,
)
