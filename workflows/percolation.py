"""Random rest lengths: stressed edges, bulk modulus and C_B against their spread, by the cone program and by strain.

Rest lengths of one network are the same random numbers for every spread, scaled.  The paper prints a spread of 0.3 for
populations in which every edge is stressed and whose bulk modulus is about 10 % below the largest.  The cone program
gives the configuration exactly at the transition; the protocol of the paper strains springs until their energy is 1e-4.
"""

import numpy as np
from matplotlib.figure import Figure

from critflow import CriticalManifold, Status, critical_from_lengths, upper_bound, voronoi_network
from critflow.generators.random_networks import check_voronoi
from critflow.workflow import Axis, Claim, Coordinate, Study, Variable, stable_rng
from critflow.workflow.study import plural

from .shared.checks import check_network
from .shared.figures import legend_below, lettered, panels
from .shared.measurements import coefficients, moduli_with_bounds, stressed_fraction
from .shared.populations import random_lengths
from .shared.power_laws import shown
from .shared.reports import PAPER, series
from .shared.strain_protocol import critical_by_strain
from .shared.tables import bounded, numbers, outcomes

MEASURED = ("solve_status", "stressed_fraction", "bulk", "bulk_error_bound", "C_B", "C_B_error_bound")
NOT_COMPUTED = (Status.missing, *[np.nan] * 5)


def case(parameters, *, seed, n_vertices):
    """Stressed edges and moduli of one network at every spread, by both methods."""
    manifold = CriticalManifold(voronoi_network(n_vertices, seed))
    rows, strained = [], []
    for spread in parameters["spreads"]:
        lengths = random_lengths(stable_rng(seed, "percolation", str(n_vertices)), manifold.network.n_edges, spread)
        rows.append(measured(manifold, critical_from_lengths(manifold, lengths, throw=False)))
        protocol = seed < parameters["protocol_networks"]
        strained.append(measured(manifold, critical_by_strain(manifold, lengths)) if protocol else NOT_COMPUTED)
    return {
        "status": Status.ok,
        **{name: [row[n] for row in rows] for n, name in enumerate(MEASURED)},
        **{f"strained_{name}": [row[n] for row in strained] for n, name in enumerate(MEASURED)},
    }


def measured(manifold, solution):
    """`MEASURED` of the configuration of one set of rest lengths."""
    if solution.status not in (Status.ok, Status.slack_edges):
        return (solution.status, *NOT_COMPUTED[1:])
    critical = solution.value
    bulk = moduli_with_bounds(critical)[:, 0] / upper_bound(manifold, "B_0")
    C_B = [values[2] for values in coefficients(critical)]
    return solution.status, stressed_fraction(critical.sigma), *bulk, *C_B


def check(parameters, axes):
    """Refuse sizes without a network, before anything runs."""
    for n_vertices in axes["n_vertices"]:
        check_network(check_voronoi, n_vertices)


EACH = ("seed", "n_vertices")
SPREAD = (*EACH, "spread")


# The spread that the paper prints as the largest with every edge stressed.
PRINTED_SPREAD = 0.3
# B_0 of random rest lengths over the largest: the "about 10 %" below it of the paper, with half of that as margin.
PRINTED_BULK, BULK_TOLERANCE = 0.9, 0.05
_RESAMPLED = 500  # ensembles behind the interval of the power


def curve(ds):
    """Part of the networks with every edge stressed, mean part of slack edges and networks, (size, spread) each."""
    stressed = ds.stressed_fraction.transpose("n_vertices", "spread", "seed")
    return percolating(ds).mean("seed").values, 1 - stressed.mean("seed").values, stressed.count("seed").values


def percolating(ds):
    """Whether every edge of a network is stressed, (size, spread, network)."""
    full = (ds.solve_status == Status.ok).where(ds.stressed_fraction.notnull())
    return full.transpose("n_vertices", "spread", "seed")


def half_point(spreads, full):
    """The spread at which half of the networks have every edge stressed, between two that were run; else NaN."""
    below = np.flatnonzero(full < 0.5)
    if not len(below) or below[0] == 0:
        return np.nan
    last = below[0] - 1
    part = (full[last] - 0.5) / (full[last] - full[last + 1])
    return float(spreads[last] + part * (spreads[last + 1] - spreads[last]))


def threshold_interval(ds):
    """The 95 % interval of this power when the networks are drawn again with repetition."""
    full, spreads = percolating(ds).values, ds.spread.values
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


def percolation_figure(ds):
    """Part of the networks with every edge stressed, and part of slack edges."""
    figure = Figure(figsize=(11, 4.4), dpi=110, layout="constrained")
    whole, edges = figure.subplots(1, 2)
    full, slack, counts = curve(ds)
    sizes, spreads = ds.n_vertices.values, ds.spread.values
    halves = np.array([half_point(spreads, row) for row in full])
    for row, (size, half) in enumerate(zip(sizes, halves, strict=True)):
        style = {**series(row), "markersize": 4, "linewidth": 1.3}
        label = f"$N_v$ = {size}" + (f":  $s_{{1/2}}$ = {half:.3f}" if np.isfinite(half) else "")
        error = np.sqrt(np.maximum(full[row] * (1 - full[row]), 0.25 / counts[row]) / counts[row])
        whole.fill_between(spreads, full[row] - error, full[row] + error, color=style["color"], alpha=0.12, linewidth=0)
        whole.plot(spreads, full[row], label=label, **style)
        edges.plot(spreads, np.where(slack[row] > 0, slack[row], np.nan), **style)
    whole.axvline(PRINTED_SPREAD, color="0.3", linestyle="--", linewidth=1)
    whole.text(PRINTED_SPREAD + 0.005, 0.97, "printed in\nthe paper", fontsize=8.5, va="top")
    whole.set(xlabel="spread of rest lengths $s$", ylabel="networks with every edge stressed", ylim=(-0.03, 1.05))
    edges.set(xlabel="spread of rest lengths $s$", ylabel="part of slack edges", yscale="log")
    lines = whole.get_legend_handles_labels()
    figure.legend(*lines, fontsize=9, frameon=False, loc="center right", bbox_to_anchor=(1, 0.4))
    lettered(*figure.axes)
    figure.suptitle(
        "Full percolation of stress is lost at ever smaller spreads of rest lengths as networks grow",
        fontsize=11,
    )
    return figure


SPREAD_PANELS = {
    "bulk": "$B_0$ / largest possible", "stressed_fraction": "part of stressed edges", "C_B": "$C_B$  [k]"
}  # fmt: skip


def of_largest(ds):
    """The largest networks, those that were strained."""
    large = ds.isel(n_vertices=int(ds.n_vertices.values.argmax()))
    strained = large.strained_solve_status.isin([Status.missing]).all("spread")
    return large.isel(seed=np.flatnonzero(~strained.values))


def spread_figure(ds):
    """B_0, stressed part and C_B against the spread, by the cone program and by the protocol of the paper."""
    large, spreads = of_largest(ds), ds.spread.values
    size, count = int(large.n_vertices), large.sizes["seed"]
    figure, panels_ = panels(3, f"Random rest lengths by two methods: {count} networks, $N_v$ = {size:,}", height=3.9)
    for axes, (name, label) in zip(panels_, SPREAD_PANELS.items(), strict=True):
        for n, (prefix, method) in enumerate((("", "cone program"), ("strained_", "strain protocol of the paper"))):
            values = large[prefix + name].transpose("spread", "seed").values
            known = np.isfinite(values).any(axis=1)
            low, middle, high = np.nanquantile(values[known], (0.1, 0.5, 0.9), axis=1)
            style = {**series(n), "markersize": 4, "linewidth": 1.3, "linestyle": ("-", "--")[n]}
            axes.plot(spreads[known], middle, label=method, **style)
            axes.fill_between(spreads[known], low, high, color=style["color"], alpha=0.15, linewidth=0)
        axes.axvline(PRINTED_SPREAD, color="0.3", linestyle=":", linewidth=1)
        axes.set(xlabel="spread of rest lengths $s$", ylabel=label, xlim=(0, spreads.max()))
    left, middle, right = panels_
    left.axhline(PRINTED_BULK, color="0.3", linestyle=":", linewidth=1)
    left.text(0.98, PRINTED_BULK + 0.01, "paper: 0.9", fontsize=8.5, ha="right", transform=left.get_yaxis_transform())
    left.text(PRINTED_SPREAD + 0.01, 0.02, "paper: $s$ = 0.3", fontsize=8.5, transform=left.get_xaxis_transform())
    left.set_ylim(0, 1)
    right.axhline(0, color="0.6", linewidth=0.8)
    lettered(*panels_)
    legend_below(figure, left, ncols=2)
    return figure


def claims(ds):
    """The bulk modulus and the stressed part at the printed spread, and the largest spread with every edge stressed."""
    yield from printed_claims(ds)
    sizes = ds.n_vertices.values
    halves = np.array([half_point(ds.spread.values, row) for row in curve(ds)[0]])
    text = ", ".join(f"s = {half:.3f} at N_v = {size}" for half, size in zip(halves, sizes, strict=True))
    yield Claim.tested(
        "percolation-threshold", "every edge is stressed up to a spread of rest lengths of 0.3",
        f"s = {PRINTED_SPREAD}", f"half of the networks lose it at {text}", halves[-1] >= PRINTED_SPREAD,
        "the text describes full percolation, which ends far below the spread it prints",
        criterion=f"half of the largest networks percolate at {PRINTED_SPREAD}", kind="paper",
    )  # fmt: skip
    yield Claim(
        "percolation-size", "how full percolation depends on size", "not stated",
        "the spread at which half of the networks lose it changes as N_v^p, p = "
        + shown((threshold_power(sizes, halves), *threshold_interval(ds))), "measured",
        sample=f"{plural(ds.sizes['seed'], 'network')} a size",
    )  # fmt: skip


def printed_claims(ds):
    """What the paper says of its printed spread, by both methods, and the spread at which the bulk modulus agrees."""
    large, sample = of_largest(ds), of_largest(ds).sizes["seed"]
    size, spreads = int(large.n_vertices), ds.spread.values
    found = {
        name: large[name].median("seed").values for name in ("bulk", "strained_bulk", "strained_stressed_fraction")
    }
    at = int(np.argmin(np.abs(spreads - PRINTED_SPREAD)))
    below = found["bulk"] < PRINTED_BULK - BULK_TOLERANCE
    agreeing = (spreads[: int(np.argmax(below))] if below.any() else spreads).max(initial=0.0)
    networks = f"{plural(sample, 'network')}, N_v = {size}"
    yield Claim.tested(
        "percolation-bulk", "at a spread of 0.3 B_0 is about 10 % below its largest value", f"{PRINTED_BULK}",
        f"cone program {found['bulk'][at]:.2f}, strain protocol {found['strained_bulk'][at]:.2f}; within "
        f"{BULK_TOLERANCE} of {PRINTED_BULK} up to s = {agreeing:g}",
        abs(found["strained_bulk"][at] - PRINTED_BULK) <= BULK_TOLERANCE,
        "both methods agree, so that the value belongs to a narrower spread than the one printed",
        criterion=f"median by the protocol of the paper within {BULK_TOLERANCE}", sample=networks, kind="paper",
    )  # fmt: skip
    stressed = found["strained_stressed_fraction"][at]
    yield Claim.tested(
        "percolation-protocol", "the strain protocol of the paper stresses every edge at a spread of 0.3", "all edges",
        f"{100 * stressed:.1f} % of the edges", stressed == 1,
        "the other edges are slack at the transition and slightly compressed where the protocol stops",
        criterion="every edge of the median network", sample=networks, kind="paper",
    )  # fmt: skip


study = Study(
    name="percolation",
    title="Percolation of stress against the spread of the rest lengths and the size of the network",
    references=PAPER,
    axes=(
        Axis("seed", range(80), "seed of the network", noun="network"),
        Axis("n_vertices", (50, 100, 200, 400, 1000), "number of vertices", key="n_vertices"),
    ),
    parameters={
        "protocol_networks": 20,
        "spreads": (0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2, 0.25, 0.3, 0.4, 0.5),
    },
    coordinates=(Coordinate("spread", "spreads", "spread s of the rest lengths"),),
    case=case,
    check=check,
    variables=(
        *numbers(
            SPREAD,
            stressed_fraction="part of the edges under tension",
            strained_stressed_fraction="part of the edges under tension by the strain protocol",
        ),
        *bounded(
            SPREAD,
            bulk="B_0 over the largest possible on the network",
            C_B="C_B of the stressed part [k]",
            strained_bulk="B_0 by the strain protocol, over the largest possible",
            strained_C_B="C_B by the strain protocol [k]",
        ),
        *outcomes(SPREAD, solve_status="outcome by spread", strained_solve_status="outcome of the strain protocol"),
        Variable("status", EACH, "i1", long_name="whether the case was computed", flags=Status),
    ),
    figures={"percolation": percolation_figure, "spread": spread_figure},
    claims=claims,
)
