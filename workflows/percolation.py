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

At s = 0 the transition is that of equal lengths, min V_L; the box V = N_b has nearly equal ones there, V_L = 5e-4.
"""

import numpy as np
from matplotlib.figure import Figure

from critflow import CriticalManifold, Status, critical_from_lengths, upper_bound, voronoi_network
from critflow.engine import Axis, Claim, Coordinate, Study, Variable, stable_rng
from critflow.engine.study import plural
from critflow.points import check_voronoi

from .shared.checks import check_known, check_network
from .shared.figures import legend_below, lettered
from .shared.measurements import coefficients, moduli_with_bounds, stressed_fraction
from .shared.population_reports import PRINTED_SPREAD
from .shared.populations import random_lengths
from .shared.reports import PAPER, half_point, parameters, series, shown
from .shared.strain_protocol import critical_by_strain, critical_in_printed_box
from .shared.structure import face_anisotropy, force_anisotropy, relative_variance
from .shared.tables import bounded, networks, numbers, outcomes, stacked

STATES = {
    "transition": "at the transition, either box",
    "box_N_v": "protocol of the paper, side $\\sqrt{N_v}$",
    "box_N_b": "protocol of the paper, side $\\sqrt{N_b}$",
}
MEASURED = (
    *("stressed_fraction", "B_0_part", "B_0_part_error_bound", "C_B", "C_B_error_bound"),
    *("V_L", "V_tau", "kappa_phys", "kappa_force"),
)
NOT_COMPUTED = {"solve_status": Status.missing} | dict.fromkeys(MEASURED, np.nan)
_SOLVE = {
    "transition": lambda manifold, lengths: critical_from_lengths(manifold, lengths, throw=False),
    "box_N_v": critical_by_strain,
    "box_N_b": critical_in_printed_box,
}


def case(parameters, *, seed, n_vertices):
    """Every state of one network at every spread; the states of the protocol of the first networks only."""
    manifold = CriticalManifold(voronoi_network(n_vertices, seed))
    table = [
        [
            _row(manifold, state, _lengths(manifold, seed, spread))
            if state == "transition" or seed < parameters["protocol_networks"]
            else NOT_COMPUTED
            for spread in parameters["spreads"]
        ]
        for state in parameters["states"]
    ]
    return {"status": Status.ok, **stacked([stacked(rows) for rows in table])}


def _lengths(manifold, seed, spread):
    """Rest lengths of one network, the same random numbers for every spread."""
    network = manifold.network
    return random_lengths(stable_rng(seed, "percolation", str(network.n_vertices)), network.n_edges, spread)


def _row(manifold, state, lengths):
    """The outcome and `MEASURED` of one state."""
    solution = _SOLVE[state](manifold, lengths)
    if solution.status not in (Status.ok, Status.slack_edges):
        return NOT_COMPUTED | {"solve_status": solution.status}
    critical = solution.value
    part = moduli_with_bounds(critical)[:, 0] / upper_bound(manifold, "B_0")
    (_, _, C_B, _), errors = coefficients(critical)
    return {
        "solve_status": solution.status,
        "stressed_fraction": stressed_fraction(critical.sigma),
        "B_0_part": part[0],
        "B_0_part_error_bound": part[1],
        "C_B": C_B,
        "C_B_error_bound": errors[2],
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


def of_state(ds, state):
    """The networks in which a state was computed."""
    one = ds.sel(state=state)
    computed = (one.solve_status != Status.missing).all(["spread", "n_vertices"])
    return one.isel(seed=np.flatnonzero(computed.values))


def curve(ds, state="transition"):
    """Part of the networks with every edge stressed, (size, spread), and the number of networks."""
    full = percolating(ds, state)
    return full.mean("seed").values, full.sizes["seed"]


def percolating(ds, state="transition"):
    """Whether every edge of a network is stressed, (size, spread, network)."""
    one = of_state(ds, state)
    full = (one.stressed_fraction == 1.0).where(one.stressed_fraction.notnull())
    return full.transpose("n_vertices", "spread", "seed")


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
    for state in ds.state.values:
        one = of_state(ds, state).isel(n_vertices=-1)
        if one.sizes["seed"]:
            for spread in ds.spread.values:
                here = one.sel(spread=spread)
                middle = here.median("seed")
                rows.append({
                    "state": str(state), "spread": float(spread), "networks": int(one.sizes["seed"]),
                    "stressed": 100 * float(middle.stressed_fraction),
                    "full": 100 * float((here.stressed_fraction == 1.0).mean()),
                    "gap": 100 * float((1 / here.B_0_part - 1).median()),
                    **{name: float(middle[name]) for name in ("V_L", "V_tau", "kappa_phys", "kappa_force", "C_B")},
                })  # fmt: skip
    return rows


def summary(ds):
    """The table of states and spreads at the largest size, and what the paper says of s = 0.3."""
    return {
        "n_vertices": int(ds.n_vertices.values[-1]),
        "parameters": parameters(ds),
        "printed": {"spread": PRINTED_SPREAD, "stressed": 100, "full": 100, "gap": PRINTED_GAP, "like": "min V_L"},
        "readings": readings(ds),
    }


def percolation_figure(ds):
    """Part of the networks with every edge stressed against the spread, by size, at the transition and in the box."""
    figure = Figure(figsize=(10, 4.2), dpi=150, layout="constrained")
    spreads, sizes = ds.spread.values, ds.n_vertices.values
    shown = [(state, name) for state, name in STATES.items() if state != "box_N_v" and state in ds.state]
    for axes, (state, name) in zip(np.atleast_1d(figure.subplots(1, len(shown), sharey=True)), shown, strict=True):
        (full, n), halves = curve(ds, state), half_points(ds, state)
        for row, (size, half) in enumerate(zip(sizes, halves, strict=True)):
            style = {**series(row), "markersize": 4, "linewidth": 1.3}
            label = f"$N_v$ = {size}" + (f":  $s_{{1/2}}$ = {half:.3f}" if np.isfinite(half) else "")
            error = np.sqrt(np.maximum(full[row] * (1 - full[row]), 0.25 / n) / n)
            axes.fill_between(
                spreads, full[row] - error, full[row] + error, color=style["color"], alpha=0.12, linewidth=0
            )
            axes.plot(spreads, full[row], label=label, **style)
        axes.axvline(PRINTED_SPREAD, color="0.3", linestyle=":", linewidth=1)
        axes.text(PRINTED_SPREAD + 0.005, 1.04, "paper", fontsize=8.5, va="top")
        axes.set(xlabel="spread of rest lengths $s$", ylim=(-0.03, 1.07), title=f"{name} ({plural(n, 'network')})")
        axes.legend(fontsize=8.5, frameon=False, loc="best")
    figure.axes[0].set_ylabel("networks with every edge stressed")
    lettered(*figure.axes)
    figure.suptitle("Every edge is stressed up to a spread that falls with the size, in both boxes", fontsize=11)
    return figure


# Panels of the states: name of the variable, label, and what the paper says of it: a number, or the value at s = 0.
PANELS = {
    "stressed_fraction": ("part of stressed edges", 1.0, "all"),
    "full": ("networks with every edge stressed", 1.0, "all"),
    "gap": ("max $B_0$ above it  [%]", PRINTED_GAP, "about 10 %"),
    "C_B": ("$C_B$  [k]", 0.0, "above 0"),
    "V_L": ("$V_L$", None, "like min $V_L$"),
    "V_tau": ("$V_\\tau$", None, "like min $V_L$"),
    "kappa_phys": ("$\\langle\\kappa_{phys}\\rangle$", None, "like min $V_L$"),
    "kappa_force": ("$\\langle\\kappa_{force}\\rangle$", None, "like min $V_L$"),
}


def _panel(large, name):
    """Values (spread, network) of a panel."""
    if name == "gap":
        return (100 * (1 / large.B_0_part - 1)).transpose("spread", "seed").values
    if name == "full":
        return (large.stressed_fraction == 1.0).transpose("spread", "seed").values.astype(float)
    return large[name].transpose("spread", "seed").values


def spread_figure(ds):
    """Eight measures of the largest networks against the spread, in each state, with the sentences of the paper."""
    figure = Figure(figsize=(12.5, 6.6), dpi=150, layout="constrained")
    panels, spreads = figure.subplots(2, 4).ravel(), ds.spread.values
    shown = [state for state in STATES if state in ds.state and of_state(ds, state).sizes["seed"]]
    for axes, (name, (label, printed, words)) in zip(panels, PANELS.items(), strict=True):
        for n, state in enumerate(shown):
            values = _panel(of_state(ds, state).isel(n_vertices=-1), name)
            known = np.isfinite(values).any(axis=1)
            low, middle, high = np.nanquantile(values[known], (0.1, 0.5, 0.9), axis=1)
            style = {**series(n), "markersize": 3.5, "linewidth": 1.3}
            line = values.mean(axis=1) if name == "full" else middle
            axes.plot(spreads[known], line, label=STATES[state], **style)
            if name != "full":
                axes.fill_between(spreads[known], low, high, color=style["color"], alpha=0.13, linewidth=0)
        if printed is None:
            first = _panel(of_state(ds, shown[0]).isel(n_vertices=-1), name)[0]
            printed = float(np.nanmedian(first)) if spreads[0] == 0 else np.nan
        axes.axhline(printed, color="0.3", linestyle="--", linewidth=1)
        axes.axvline(PRINTED_SPREAD, color="0.3", linestyle=":", linewidth=1)
        axes.set(xlabel="spread of rest lengths $s$", xlim=(0, spreads.max()), title=f"paper: {words}", ylabel=label)
    for axes in (panels[2], panels[5]):
        axes.set_yscale("log")
    # C_B grows without end as edges shrink.
    panels[3].set_yscale("symlog", linthresh=1.0)
    lettered(*panels)
    legend_below(figure, panels[0], ncols=3)
    figure.suptitle(_finding(ds), fontsize=11)
    return figure


def _finding(ds):
    """What the states differ in at the printed spread, as a title."""
    rows = {row["state"]: row for row in readings(ds) if abs(row["spread"] - PRINTED_SPREAD) < 1e-9}
    if not {"transition", "box_N_b"} <= rows.keys():
        return "Random rest lengths: the box and the state that is recorded matter"
    there, printed = rows["transition"], rows["box_N_b"]
    return (
        f"Random rest lengths of spread $s$ = {PRINTED_SPREAD}: the box of side $\\sqrt{{N_b}}$ stresses "
        f"{printed['stressed']:.1f} % of the edges and leaves a gap of {printed['gap']:.0f} %, the exact transition "
        f"{there['stressed']:.1f} % and {there['gap']:.0f} %\n"
        f"({plural(printed['networks'], 'network')} of {int(ds.n_vertices.values[-1]):,} vertices; medians, bands of "
        "80 %; dashed: what the paper says, dotted: its spread)"
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
    at = {row["state"]: row for row in rows if abs(row["spread"] - PRINTED_SPREAD) < 1e-9}
    box = at.get("box_N_b")
    if box is None:
        return
    networks = f"{plural(box['networks'], 'network')}, N_v = {int(sizes[-1])}"
    close = [r["spread"] for r in rows if r["state"] == "box_N_b" and abs(r["gap"] - PRINTED_GAP) <= HALF_DIGIT]
    agreeing = f"; within {HALF_DIGIT} points of {PRINTED_GAP} % at s = " + ", ".join(f"{s:g}" for s in close)
    yield Claim(
        "percolation-gap", f"how far max B_0 lies above random rest lengths of spread {PRINTED_SPREAD:g}", "",
        _listed(at, "gap") + (agreeing if close else ""), "measured", sample=networks,
    )  # fmt: skip
    yield Claim(
        "percolation-stressed", f"stressed edges at spread {PRINTED_SPREAD:g}", "",
        f"{_listed(at, 'stressed')} of the edges, {_listed(at, 'full')} of the networks; in the box of side √N_b half "
        f"of the networks lose it at {_by_size(sizes, half_points(ds, 'box_N_b'))}", "measured", sample=networks,
    )  # fmt: skip


def _by_size(sizes, halves):
    return ", ".join(f"s = {half:.3f} (N_v = {size})" for half, size in zip(halves, sizes, strict=True))


def _listed(at, name):
    words = {"box_N_b": "side √N_b", "box_N_v": "side √N_v", "transition": "at the transition"}
    return ", ".join(f"{word} {at[state][name]:.3g} %" for state, word in words.items() if state in at)


study = Study(
    name="percolation",
    version=2,
    title="Random rest lengths against their spread, by box, state and size of the network",
    references=PAPER,
    axes=(
        networks(80),
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
        *numbers(SPREAD, stressed_fraction="part of the edges under tension"),
        *bounded(
            SPREAD, B_0_part="B_0 over the largest possible on the network", C_B="exact C_B of the stressed part [k]"
        ),
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
    summary=summary,
)
