"""Random rest lengths against their spread: stressed edges, moduli and structure in three states of the same network.

The paper draws rest lengths from a normal distribution of mean 1 and standard deviation s = 0.3, "the largest with full
rigidity percolation", sets V = N_v and prints a box of side √N_b too.  The box matters: its lengths have mean 1 in
absolute units.  The states, each with the same random numbers for every spread, scaled:

    transition  exactly at the transition, by the cone program.  It depends on the ratios of the lengths alone, so that
                it is the same in both boxes.
    box_N_v     recorded by the protocol of the paper in the box V = N_v: strain in steps of 0.01 until the energy is
                1e-4, which ends slightly past the transition.
    box_N_b     the same protocol in the box V = N_b.  The network is rigid there at γ = 0 already and is recorded far
                past the transition; its stress σ = (|L| − ℓ)/|L| makes it a critical configuration, scaled to V = N_v.

An edge is stressed if its stress, of any sign, is above rounding.  Past the transition springs that were slack there
may be compressed.  The lengths are those of the study `ensemble`: with its networks, so are the numbers at its spread.

At s = 0 the transition is that of equal lengths, min V_L; the box V = N_b has nearly equal ones there, V_L = 5e-4.
"""

from itertools import product

import numpy as np

from critflow import CriticalManifold, Status, critical_from_lengths, upper_bound, voronoi_network
from critflow.engine import Axis, Claim, Coordinate, Study, Variable, stable_rng
from critflow.engine.study import SOUND, plural
from critflow.points import check_voronoi

from .shared.checks import check_known, check_network
from .shared.figures import legend_below, lettered, page
from .shared.measurements import edge_fractions, moduli_with_bounds
from .shared.population_reports import PRINTED_SPREAD, sample
from .shared.populations import drawn_lengths
from .shared.reports import PAPER, half_point, series, shown
from .shared.strain_protocol import critical_by_strain, critical_in_printed_box
from .shared.structure import face_anisotropy, force_anisotropy, relative_variance
from .shared.tables import bounded, networks, numbers, outcomes, stacked

STATES = {
    "transition": "transition, either box",
    "box_N_v": "protocol, side $\\sqrt{N_v}$",
    "box_N_b": "protocol, side $\\sqrt{N_b}$",
}
MEASURED = (
    *("stressed_fraction", "tension_fraction", "B_0_part", "B_0_part_error_bound"),
    *("V_L", "V_tau", "kappa_phys", "kappa_force"),
)
NOT_COMPUTED = {"solve_status": Status.missing} | dict.fromkeys(MEASURED, np.nan)
_SOLVE = {
    "transition": lambda manifold, lengths: critical_from_lengths(manifold, lengths, throw=False),
    "box_N_v": critical_by_strain,
    "box_N_b": critical_in_printed_box,
}


def case(parameters, *, seed, n_vertices):
    """Every state of one network at every spread; those of the protocol of the first networks only.

    At the printed spread they are of all networks: the numbers are then those of the study `ensemble`.
    """
    manifold = CriticalManifold(voronoi_network(n_vertices, seed))
    table = [
        [
            _row(manifold, state, drawn_lengths(seed, manifold.network.n_edges, spread))
            if state == "transition" or seed < parameters["protocol_networks"] or spread == PRINTED_SPREAD
            else NOT_COMPUTED
            for spread in parameters["spreads"]
        ]
        for state in parameters["states"]
    ]
    return {"status": Status.ok, **stacked([stacked(rows) for rows in table])}


def _row(manifold, state, lengths):
    """The outcome and `MEASURED` of one state."""
    solution = _SOLVE[state](manifold, lengths)
    if solution.status not in SOUND:
        return NOT_COMPUTED | {"solve_status": solution.status}
    critical = solution.value
    part = moduli_with_bounds(critical)[:, 0] / upper_bound(manifold, "B_0")
    return {
        "solve_status": solution.status,
        **edge_fractions(critical.sigma),
        "B_0_part": part[0],
        "B_0_part_error_bound": part[1],
        "V_L": relative_variance(critical.lengths),
        "V_tau": relative_variance(critical.tensions),
        "kappa_phys": np.nanmean(face_anisotropy(critical)),
        "kappa_force": np.nanmean(force_anisotropy(critical)),
    }


def check(parameters, axes):
    """Refuse sizes without a network, and states that are not known, before anything runs."""
    check_known("state", parameters["states"], STATES)
    for n_vertices in axes["n_vertices"]:
        check_network(check_voronoi, n_vertices)


EACH = ("seed", "n_vertices")
SPREAD = (*EACH, "state", "spread")


# How far max B_0 lies above random rest lengths [%], as printed, and half of the last digit.
PRINTED_GAP, HALF_DIGIT = 10, 5
_RESAMPLED = 500  # ensembles behind the interval of the power


def curve(ds, state="transition", name="stressed_fraction"):
    """Part of the networks with every edge stressed, or under tension, and their number, (size, spread) each."""
    full = percolating(ds, state, name)
    return full.mean("seed").values, full.count("seed").values


def percolating(ds, state="transition", name="stressed_fraction"):
    """Whether every edge of a network is stressed, or under tension, (size, spread, network); NaN without a state."""
    fraction = ds[name].sel(state=state)
    return (fraction == 1.0).where(fraction.notnull()).transpose("n_vertices", "spread", "seed")


def half_points(ds, state):
    """The half point of each size."""
    return np.array([half_point(ds.spread.values, row) for row in curve(ds, state)[0]])


def threshold_interval(ds):
    """The 95 % interval of the power of the transition when the networks are drawn again with repetition."""
    full, spreads = percolating(ds).values, ds.spread.values
    if not np.isfinite(threshold_power(ds.n_vertices.values, half_points(ds, "transition"))):
        return np.nan, np.nan
    picks = stable_rng(full.shape[2], "threshold").integers(0, full.shape[2], (_RESAMPLED, full.shape[2]))
    powers = []
    for pick in picks:
        rows = np.nanmean(full[:, :, pick], axis=2)
        powers.append(threshold_power(ds.n_vertices.values, np.array([half_point(spreads, row) for row in rows])))
    return tuple(np.nanquantile(powers, (0.025, 0.975)))


def threshold_power(sizes, halves):
    """The power of N_v with which the half point falls, by least squares of logarithms; NaN for less than two."""
    known = np.isfinite(halves)
    if known.sum() < 2:
        return np.nan
    return float(np.polyfit(np.log(sizes[known]), np.log(halves[known]), 1)[0])


def readings(ds):
    """Rows of the table: medians of the largest networks by state and spread, [%] where a part is meant."""
    rows = []
    for state, spread in product(ds.state.values, ds.spread.values):
        here = ds.sel(state=state, spread=spread).isel(n_vertices=-1)
        here = here.isel(seed=np.flatnonzero(here.stressed_fraction.notnull().values))
        if here.sizes["seed"]:
            middle = here.median("seed")
            full, under_tension = (
                100 * float((here[name] == 1.0).mean()) for name in ("stressed_fraction", "tension_fraction")
            )
            rows.append({
                "state": str(state), "spread": float(spread), "networks": int(here.sizes["seed"]),
                "stressed": 100 * float(middle.stressed_fraction), "tense": 100 * float(middle.tension_fraction),
                "full": full, "full_tense": under_tension, "gap": 100 * float((1 / here.B_0_part - 1).median()),
                **{name: float(middle[name]) for name in ("V_L", "V_tau", "kappa_phys", "kappa_force")},
            })  # fmt: skip
    return rows


# The part of a curve whose edges are all under tension.
UNDER_TENSION = {"linestyle": (0, (4, 2)), "linewidth": 0.9}


def _computed(ds):
    """The states that were computed in some network."""
    return [state for state in STATES if state in ds.state and ds.stressed_fraction.sel(state=state).notnull().any()]


def _draw(axes, spreads, n, curves, tense, label):
    """The n-th curve in its band (low, middle, high), and dashed the part under tension where it is less."""
    (low, middle, high), style = curves, series(n)
    axes.fill_between(spreads, low, high, color=style["color"], alpha=0.12, linewidth=0)
    axes.plot(spreads, middle, **style, markersize=3.5, linewidth=1.2, label=label)
    if (tense < middle).any():
        axes.plot(spreads, tense, **UNDER_TENSION, color=style["color"])


def _finished(figure, panels, tension, ncols):
    """The figure with the spread of the paper in every panel, letters and the legend."""
    for axes in panels:
        axes.axvline(PRINTED_SPREAD, color="0.3", linestyle=":", linewidth=1, label="paper")
    panels[0].plot([], [], **UNDER_TENSION, color="0.4", label=tension)
    lettered(*panels)
    legend_below(figure, panels[0], ncols)
    return figure


def percolation_figure(ds):
    """Part of the networks with every edge stressed against the spread, by size and state."""
    figure, shown, spreads = page(3.4, _percolation_title(ds)), _computed(ds), ds.spread.values
    panels = np.atleast_1d(figure.subplots(1, len(shown), sharey=True))
    for axes, state in zip(panels, shown, strict=True):
        (full, n), (tense, _) = curve(ds, state), curve(ds, state, "tension_fraction")
        error = np.sqrt(np.maximum(full * (1 - full), 0.25 / np.maximum(n, 1)) / np.maximum(n, 1))
        for row, size in enumerate(ds.n_vertices.values):
            curves = [(full + sign * error)[row] for sign in (-1, 0, 1)]
            _draw(axes, spreads, row, curves, tense[row], f"$N_v$ = {size:,}")
        title = f"{STATES[state]}\n({_networks(spreads, n)})"
        axes.set(xlabel="spread of rest lengths $s$", ylim=(-0.03, 1.05), title=title)
    panels[0].set_ylabel("networks with every edge stressed")
    return _finished(figure, panels, "under tension", 4)


def _networks(spreads, n):
    """How many networks the curves are of, and how many at the spread of the paper where these are more."""
    printed = np.isclose(spreads, PRINTED_SPREAD)
    few, more = (int(np.max(n, initial=0, where=there)) for there in (~printed, printed))
    return (
        f"{plural(few, 'network')}, {more} at $s$ = {PRINTED_SPREAD}"
        if 0 < few < more
        else plural(max(few, more), "network")
    )


def _percolation_title(ds):
    """Where the printed spread percolates, by state, as computed."""
    at = _at_printed_spread(ds)
    if not {"transition", "box_N_b"} <= at.keys():
        return "Every edge is stressed up to a spread that depends on size, box and state"
    size, n = int(ds.n_vertices.values[-1]), plural(at["transition"]["networks"], "network")
    return (
        f"At the spread of the paper, $s$ = {PRINTED_SPREAD}, every edge is stressed in {at['box_N_b']['full']:.0f} %\n"
        f"of the networks in the box of side $\\sqrt{{N_b}}$ and in {at['transition']['full']:.0f} % at the transition "
        f"($N_v$ = {size:,}, {n})"
    )


def _at_printed_spread(ds):
    """The rows of the table at the spread of the paper, by state."""
    return {row["state"]: row for row in readings(ds) if abs(row["spread"] - PRINTED_SPREAD) < 1e-9}


# Panels of the states: name of the variable, label, and what the paper says of it: a number, or the value at s = 0.
PANELS = {
    "stressed_fraction": ("part of the edges", 1.0, "all stressed"),
    "gap": ("max $B_0$ above it  [%]", PRINTED_GAP, "about 10 %"),
    "V_L": ("$V_L$", None, "like min $V_L$"),
    "V_tau": ("$V_\\tau$", None, "like min $V_L$"),
    "kappa_phys": ("$\\langle\\kappa_{phys}\\rangle$", None, "like min $V_L$"),
    "kappa_force": ("$\\langle\\kappa_{force}\\rangle$", None, "like min $V_L$"),
}


def _panel(large, name):
    """Values (spread, network) of a panel."""
    values = 100 * (1 / large.B_0_part - 1) if name == "gap" else large[name]
    return values.transpose("spread", "seed").values


def spread_figure(ds):
    """Measures of the largest networks against the spread, in each state, with the sentences of the paper."""
    figure, shown = page(5.4, _finding(ds)), _computed(ds)
    panels, spreads, large = figure.subplots(2, 3).ravel(), ds.spread.values, ds.isel(n_vertices=-1)
    for axes, (name, (label, printed, words)) in zip(panels, PANELS.items(), strict=True):
        for n, state in enumerate(shown):
            values, tense = (_panel(large.sel(state=state), one) for one in (name, "tension_fraction"))
            known = np.isfinite(values).any(axis=1)
            curves = np.nanquantile(values[known], (0.1, 0.5, 0.9), axis=1)
            under = np.nanmedian(tense[known], axis=1) if name == "stressed_fraction" else curves[1]
            _draw(axes, spreads[known], n, curves, under, STATES[state])
        if printed is None:
            first = _panel(large.sel(state=shown[0]), name)[0]
            printed = float(np.nanmedian(first)) if spreads[0] == 0 else np.nan
        axes.axhline(printed, color="0.3", linestyle=(0, (1, 1)), linewidth=1)
        axes.set(title=f"paper: {words}", ylabel=label)
    for axes in panels[3:]:
        axes.set_xlabel("spread of rest lengths $s$")
    for axes in (panels[1], panels[3]):
        axes.set_yscale("log")
    return _finished(figure, panels, "under tension (A)", 3)


def _finding(ds):
    """What the states differ in at the printed spread, as a title."""
    at = _at_printed_spread(ds)
    if not {"transition", "box_N_b"} <= at.keys():
        return "Random rest lengths: the box and the state that is recorded matter"
    there, printed = at["transition"], at["box_N_b"]
    size, n = int(ds.n_vertices.values[-1]), plural(printed["networks"], "network")
    return (
        f"At $s$ = {PRINTED_SPREAD} the box of side $\\sqrt{{N_b}}$ stresses {printed['stressed']:.1f} % of the edges "
        f"and leaves a gap of {printed['gap']:.0f} %,\n"
        f"the transition {there['stressed']:.1f} % and {there['gap']:.0f} % (medians of {n} of {size:,} vertices)\n"
        "Curves: medians, bands hold 80 %; dotted: what the paper says, and its spread"
    )


def claims(ds):
    """Where stress ceases to percolate, by size, and the states of the printed spread.

    The statements of the paper on this spread are those of the study `ensemble`.
    """
    sizes, rows = ds.n_vertices.values, readings(ds)
    n = f"{plural(ds.sizes['seed'], 'network')} a size"
    yield Claim(
        "percolation-threshold", "the spread of rest lengths at which half of the networks have slack edges", "",
        f"{_by_size(sizes, half_points(ds, 'transition'))} at the transition", "measured", sample=n,
    )  # fmt: skip
    power = shown((threshold_power(sizes, half_points(ds, "transition")), *threshold_interval(ds)))
    yield Claim("percolation-size", "its power of the size, at the transition", "", power, "measured", sample=n)
    at = _at_printed_spread(ds)
    box = at.get("box_N_b")
    if box is None:
        return
    networks = f"{sample(ds, box['networks'])}, N_v = {int(sizes[-1])}"
    close = [r["spread"] for r in rows if r["state"] == "box_N_b" and abs(r["gap"] - PRINTED_GAP) <= HALF_DIGIT]
    agreeing = f"; within {HALF_DIGIT} points of {PRINTED_GAP} % at s = " + ", ".join(f"{s:g}" for s in close)
    yield Claim(
        "percolation-gap", f"how far max B_0 lies above random rest lengths of spread {PRINTED_SPREAD:g}", "",
        _listed(at, "gap") + (agreeing if close else ""), "measured", sample=networks,
    )  # fmt: skip
    yield Claim(
        "percolation-stressed", f"stressed edges at spread {PRINTED_SPREAD:g}", "",
        f"{_listed(at, 'stressed')} of the edges; every edge in {_listed(at, 'full')} of the networks, every edge "
        f"under tension in {_listed(at, 'full_tense')}; in the box of side √N_b half of the networks lose it at "
        f"{_by_size(sizes, half_points(ds, 'box_N_b'))}", "measured", sample=networks,
    )  # fmt: skip


def _by_size(sizes, halves):
    known = [f"s = {half:.3f}" if np.isfinite(half) else "no spread of this run" for half in halves]
    return ", ".join(f"{text} (N_v = {size})" for text, size in zip(known, sizes, strict=True))


def _listed(at, name):
    words = {"box_N_b": "side √N_b", "box_N_v": "side √N_v", "transition": "at the transition"}
    return ", ".join(f"{word} {at[state][name]:.3g} %" for state, word in words.items() if state in at)


study = Study(
    name="percolation",
    version=3,
    title="Random rest lengths against their spread, by box, state and size of the network",
    references=PAPER,
    axes=(
        networks(100),
        Axis("n_vertices", (50, 100, 200, 400, 1000), "number of vertices", key="n_vertices"),
    ),
    parameters={
        "protocol_networks": 24,
        "states": tuple(STATES),
        "spreads": (0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2, 0.25, 0.3, 0.4, 0.5),
    },
    coordinates=(
        Coordinate("state", "states", "state of the network: at the transition, or recorded in a box by the protocol"),
        Coordinate("spread", "spreads", "spread s of the rest lengths"),
    ),
    case=case,
    check=check,
    variables=(
        *numbers(
            SPREAD,
            stressed_fraction="part of the edges with stress of any sign",
            tension_fraction="part of the edges under tension",
        ),
        *bounded(SPREAD, B_0_part="B_0 over the largest possible on the network"),
        *numbers(
            SPREAD,
            V_L="variance of the lengths over their squared mean",
            V_tau="variance of the tensions over their squared mean",
            kappa_phys="mean shape anisotropy of the faces",
            kappa_force="mean shape anisotropy of the force triangles",
        ),
        *outcomes(SPREAD, solve_status="outcome by state and spread; missing where it was not computed"),
        Variable("status", EACH, "i1", long_name="whether the case was computed", flags=Status),
    ),
    figures={"percolation": percolation_figure, "spread": spread_figure},
    claims=claims,
)
