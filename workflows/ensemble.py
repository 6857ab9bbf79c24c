"""Seven populations of critical configurations on the same networks, strained past the transition.

The paper's main ensemble: `StructuralMetrics`, `ResponseMetrics` and the claims around them.

    min_V_L, min_V_tau, max_B_0  optima over all stresses
    max_G_0                      likewise, with a penalty that keeps σ above about `threshold`
    random_stress                σ = |N(0, 1)|
    random_lengths               rest lengths ℓ = N(1, s²), s = `spread`, in the state that the protocol of the paper
                                 records in its box of volume N_b: far past the transition, nearly every edge stressed
                                 and a few of them compressed.  Its stress (|L| − ℓ)/|L| balances, so that it is
                                 critical as well, and it is stored at V = N_v
    random_lengths_transition    the same ℓ exactly at the transition, where edges are slack

Lengths are in units of √(V/N_v), moduli in units of k, energies in units of k V/N_v.  The strain γ of a dilation is
that of the volume, V = V(0) (1 + γ); shears have F = 1 + ε A, A = (e_x e_y + e_y e_x)/2.

With `network=FILE` the network is that of a file; seeds are then those of random populations and of random starts.
"""

import textwrap
from functools import partial

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from critflow import Status, voronoi_network
from critflow.engine import Axis, Coordinate, Study, decimals
from critflow.engine.study import plural, valid_members
from critflow.paths import check_strains
from critflow.pictures import COLOURS, COMPRESSED, SLACK, draw_network, unit_pressure_tensions
from critflow.points import STANDARD_HARD_CORE

from .paper.verdicts import claims_of, committed_run
from .shared.checks import check_deformation, check_fit, check_positive
from .shared.figures import RESOLUTION, TEXT, WIDTH, violins
from .shared.measurements import DRAWN, identified, measured, table, verify
from .shared.own_network import check_planar, with_digest
from .shared.population_reports import medians_of, of, percolation_measurements, population_measurements, summary
from .shared.populations import (
    LABELS,
    MEANING,
    PAPER_POPULATIONS,
    POPULATION_LABELS,
    POPULATIONS,
    SETTINGS,
    configuration,
    drawn_lengths,
    prepared,
)
from .shared.reports import PAPER, minus, parameters
from .shared.structure import face_anisotropy, force_anisotropy
from .shared.tables import PLANE, networks


def case(parameters, *, seed, population, wanted):
    """A critical configuration, its structure, and its moduli at the transition and along the strain path."""
    own = parameters.get("network", "")
    manifold = prepared(voronoi_network, parameters["n_vertices"], seed, parameters["hard_core"], own)
    found = configuration(manifold, parameters, seed, population, random_start=bool(own and seed))
    if not np.isfinite(found.value.coordinates).all():
        return identified(manifold.network, found)
    result = measured(manifold, found, parameters, wanted)
    result["rest_length"] = drawn_lengths(seed, manifold.network.n_edges, parameters["spread"], population)
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


# Quantities of the panels: label, and the extreme median whose network is drawn.
STRUCTURE = {
    "V_L": ("length variance $V_L$", "least"),
    "kappa_phys": ("face anisotropy $\\langle\\kappa_{phys}\\rangle$", "largest"),
    "V_tau": ("tension variance $V_\\tau$", "least"),
    "kappa_force": ("force anisotropy $\\langle\\kappa_{force}\\rangle$", "largest"),
}
RESPONSE = {
    "B_0": ("bulk modulus $B_0$  [$k$]", "largest"),
    "C_B_fit": ("its growth, fitted: $C_B$  [$k$]", "largest"),
    "G_0": ("shear modulus $G_0$  [$k$]", "largest"),
    "C_G_fit": ("its growth, fitted: $C_G$  [$k$]", "largest"),
}
FRACTIONS = ("stressed_fraction", "tension_fraction")
OTHER_GROWTH = "C_G_stress_corrected_fit"  # of the same panel as C_G
# Quantities on logarithmic axes, and the value below which they are zero, drawn beneath a break of the axis.
ZERO = {"V_L": 1e-12, "V_tau": 1e-12, "G_0": 1e-12}


def structure_figure(ds):
    """`StructuralMetrics`: lengths and faces, tensions and force triangles."""
    V_tau, kappa = (medians_of(ds, name, ds.population.values) for name in ("V_tau", "kappa_force"))
    flat = [population for population, value in kappa.items() if value > 0.9]
    unequal = V_tau.get("min_V_L", np.nan) > 3 * V_tau.get("min_V_tau", np.nan)
    found = "Equal lengths need unequal tensions, and only max $G_0$ flattens the triangles of its forces"
    title = found if unequal and flat == ["max_G_0"] else "Structure of populations of critical configurations"
    return _panels(ds, STRUCTURE, title, "")


def response_figure(ds):
    """`ResponseMetrics`: moduli at the transition and how they grow past it."""
    deformation = parameters(ds).get("deformation", "dilation")
    # The paper has dilations.
    other = "" if deformation == "dilation" else f" of the {deformation.replace('_', ' ')}"
    B_0, C_B, G_0 = (medians_of(ds, name, ds.population.values) for name in ("B_0", "C_B_fit", "G_0"))
    stiffest = sorted(B_0, key=B_0.__getitem__)[-2:]
    softens = len(B_0) > 2 and all(C_B.get(population, np.nan) < 0 for population in stiffest)
    alone = [population for population, value in G_0.items() if value > 0.01] == ["max_G_0"]
    found = "The stiffest populations soften past the transition, and only max $G_0$ resists shear there"
    title = found if softens and alone else "Moduli of populations of critical configurations"
    return _panels(ds, RESPONSE, title, f"Red lines: no change with strain{other}. {_undefined_note(ds)}")


def _undefined_note(ds):
    """The populations in which edges of zero length leave the growth undefined."""
    unknown = {p: int(np.sum(ds.status.sel(population=p) == Status.edge_collapse)) for p in ds.population.values}
    listed = ", ".join(f"{n} of {LABELS[str(p)]}" for p, n in unknown.items() if n)
    return f"Undefined where edges shrink to zero length: $C_B$ and $C_G$ of {listed}. " if listed else ""


# Inches: width of the figure, of a panel and of a drawing, heights, margins.
_PANEL, _ROW, _LEFT, _GAP, _BELOW, _DRAWING = 2.62, 1.75, 0.62, 0.72, 0.92, 1.5
_NOTE_WIDTH = 122  # characters of a line of the note
_SHOWN_VERTICES = 250  # of a drawing: a whole network would be black in print


def _panels(ds, names, title, note):
    """Panels two by two with the distributions of each quantity, and below one network of each panel."""
    ds = valid_members(ds)
    note = (
        f"{plural(ds.sizes['seed'], 'network')} of {ds.sizes['vertex']:,} vertices; marks: medians. {note}"
        f"Drawings: parts of networks at the median of a population; dark, wide edges carry the most tension. "
        f"{_random_note(ds)}"
    )
    lines = textwrap.wrap(note, _NOTE_WIDTH)
    low = 0.1 + 0.16 * len(lines)
    bottom = low + _DRAWING + 0.55 + _BELOW  # of the panels
    size = (WIDTH, bottom + 2 * _ROW + 0.3 + 0.5)
    figure = Figure(figsize=size, dpi=RESOLUTION)
    figure.suptitle(title, fontsize=TEXT + 1, y=1 - 0.08 / size[1], va="top")
    shown = [LABELS[str(p)] for p in ds.population.values]
    for n, ((name, (label, word)), letter) in enumerate(zip(names.items(), "ABCD", strict=True)):
        left, up = _LEFT + (_PANEL + _GAP) * (n % 2), bottom + (_ROW + 0.3) * (1 - n // 2)
        axes = _axes(figure, left, up, _PANEL, _ROW)
        _distributions(axes, ds, name, shown if n > 1 else [""] * len(shown))
        axes.set_ylabel(label, fontsize=TEXT)
        axes.set_title(letter, loc="left", fontweight="bold", fontsize=TEXT, y=1.0)
        small = _axes(figure, 0.12 + n * (_DRAWING + 0.15), low + 0.08, _DRAWING, _DRAWING)
        if one := example_of(ds, name, word):
            part = np.sqrt(min(1.0, _SHOWN_VERTICES / ds.sizes["vertex"]))
            _draw(small, one[0], f"{letter}: {word} {one[1]}", TEXT, width=1.0, part=part)
        else:
            small.set_axis_off()
    figure.supxlabel("\n".join(lines), fontsize=7.5, color="0.25", y=0.05 / size[1], va="bottom")
    return figure


def _distributions(axes, ds, name, labels):
    """The distributions of a quantity in all populations, with zeros below a break of a logarithmic axis."""
    values = ds[name].transpose("population", "seed").values
    if name.startswith("C_"):
        axes.axhline(0.0, color="#C00000", linewidth=1.0, zorder=0)
    zero = values < ZERO.get(name, -np.inf)
    known = values[np.isfinite(values) & ~zero]
    if broken := zero.any() and len(known):
        least, most = np.log10([known.min(), known.max()])
        floor = least - 0.3 * max(most - least, 0.5)
        values = np.where(zero, 10**floor, values)
    # Values that are not defined are counted in the note.
    violins(axes, [row[np.isfinite(row)] for row in values], labels, ds.population_color.values, log=name in ZERO)
    axes.tick_params(axis="x", labelrotation=40)
    for label in axes.get_xticklabels():
        label.set(horizontalalignment="right", rotation_mode="anchor")
    if broken:
        _break(axes, floor, least)
    if name == "C_G_fit" and OTHER_GROWTH in ds:
        other = ds[OTHER_GROWTH].transpose("population", "seed").values
        places = np.flatnonzero(np.isfinite(other).any(axis=1))
        low, middle, high = np.nanquantile(other[places], (1 / 6, 0.5, 5 / 6), axis=1)
        style = {"fmt": "D", "color": "0.15", "markersize": 4, "markerfacecolor": "white", "linewidth": 1}
        axes.errorbar(places, middle, (middle - low, high - middle), **style)
        low, high = axes.get_ylim()
        axes.set_ylim(low - 0.25 * (high - low), high)  # room for the legend
        axes.plot([], [], color=COLOURS[0], linewidth=5, alpha=0.45, label="energy, as printed")
        axes.plot(
            [],
            [],
            "D",
            color="0.15",
            markersize=4,
            markerfacecolor="white",
            label="stress-corrected (median, two thirds)",
        )
        axes.legend(fontsize=7.5, frameon=False, loc="lower left", handlelength=1.2, borderaxespad=0.1)


def _break(axes, floor, least):
    """Name a place (floor) below the least value zero, and mark the break of the axis between, both as logarithms."""
    places = [(place, text.get_text()) for place, text in zip(axes.get_yticks(), axes.get_yticklabels(), strict=True)]
    low, high = axes.get_ylim()
    kept = [(floor, "0"), *((place, text) for place, text in places if place > least - 0.1)]
    axes.set_yticks(*zip(*kept, strict=True))
    middle = (0.5 * (floor + least) - low) / (high - low)
    for shift in (0.0, 0.035):
        axes.plot(
            [-0.02, 0.02], [middle + shift - 0.015, middle + shift + 0.015], transform=axes.transAxes, color="black",
            linewidth=0.9, clip_on=False,
        )  # fmt: skip


def _axes(figure, left, bottom, width, height):
    """Axes at a place of a figure in inches: a layout by the sizes of all labels takes longer than the drawing."""
    across, up = figure.get_size_inches()
    return figure.add_axes((left / across, bottom / up, width / across, height / up))


def example_of(ds, name, word):
    """The network nearest to the median of the population with the least or largest median, and its caption."""
    medians = medians_of(ds, name, ds.population.values)
    if not medians:
        return None
    population = (max if word == "largest" else min)(medians, key=medians.__getitem__)
    of_population = ds[name].sel(population=population)
    seed = np.abs(of_population - medians[population]).idxmin()
    value = medians[population]
    text = "0" if abs(value) < ZERO.get(name, 0.0) else minus(f"{value:.2g}")
    return ds.sel(population=population, seed=seed), f"{text}\n{LABELS[population]}"


def _draw(axes, one, caption, font_size, width, limits=None, part=1.0):
    """A small picture of a part of a configuration, by its tensions at unit pressure, with its caption as title."""
    # A given height is not searched for: that takes as long as the drawing.
    axes.set_title(caption, fontsize=font_size, y=1.0)
    arrays = (one[name].values for name in ("edges", "offsets", "cell", "position"))
    lines = draw_network(axes, *arrays, _tensions(one), limits=limits, width=width)
    if part < 1:
        for low_high, set_limits in ((axes.get_xlim(), axes.set_xlim), (axes.get_ylim(), axes.set_ylim)):
            middle, half = np.mean(low_high), 0.5 * part * np.ptp(low_high)
            set_limits(middle - half, middle + half)
    return lines


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
    title = f"One network of {ds.sizes['vertex']:,} vertices at the rigidity transition in {number} populations"
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
    styles = {"compression": {"color": COMPRESSED, "linestyle": (0, (2, 1))}, "no tension": {"color": SLACK}}
    handles = [Line2D([], [], label=label, **style) for label, style in styles.items()]
    figure.legend(handles=handles, loc="lower left", bbox_to_anchor=((left + 1.2) / size[0], 0.3), frameon=False)
    return figure


_NUMBERS = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six", 7: "seven"}


def _random_note(ds):
    """The spread of the random rest lengths, their two states, and the edges that are stressed in each."""
    states = {
        "random_lengths": "as recorded in the box of the paper",
        "random_lengths_transition": "at the transition",
    }
    parts = []
    for p in (p for p in states if p in ds.population):
        stressed, tense = (100 * np.median(of(ds, name, p)) for name in ("stressed_fraction", "tension_fraction"))
        parts.append(f"{LABELS[p]}: {states[p]}, {stressed:.1f} % of the edges stressed, {tense:.1f} % under tension")
    return f"Random rest lengths, $s$ = {parameters(ds)['spread']:g} (medians): {'; '.join(parts)}." if parts else ""


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
    version=3,
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
        Coordinate(
            "strain",
            "strains",
            "strain |γ| past the transition, of the sign that tightens; V = V(0) (1 + γ) in a dilation",
        ),
        *PLANE,
    ),
    case=case,
    check=check,
    complete=partial(with_digest, 1000),
    variables=table(planar=True),
    figures={"gallery": gallery, "structure": structure_figure, "response": response_figure},
    needs={
        "gallery": (*DRAWN, "B_0"),
        "structure": (*DRAWN, *STRUCTURE, *FRACTIONS),
        "response": (*DRAWN, *RESPONSE, OTHER_GROWTH, *FRACTIONS),
        "claims": (*STRUCTURE, *RESPONSE, OTHER_GROWTH, "C_B", "B", *FRACTIONS, "sigma", "length", "cell"),
        "summary": ("max_force",),
    },
    claims=claims,
    summary=summary,
    verify=verify,
)
