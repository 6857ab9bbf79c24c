"""Pruning: the stiffness that a network keeps when edges are cut well or at random, and the time to find them."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from critflow import optimize, prune_towards, upper_bound, voronoi_network
from critflow.workflow import Claim

from ..shared.checks import check_network, check_positive
from ..shared.reports import series, spread
from .panels import panels
from .parts import undefined

PARAMETERS = {"n_vertices": 300, "cuts": 90, "repeats": 20}
METHODS = {"greedy": "greedy", "random": "at random"}
VARIABLES = {
    "modulus": (("method", "cut"), "B_0 after each number of cuts at constant stress, over the first one"),
    "edges": (("method",), "part of the edges that remains, without those that hang"),
    "drift": (("method",), "relative error of the last value by updates of rank one"),
    "factorisations": (("method",), "factorisations of the prestress matrix"),
    "loss": ((), "B_0 at the end over the largest one of the edges that remain"),
    "target_error": (("method", "target"), "distance of a pruned B_0 from its target, relative"),
    "target_cuts": (("method", "target"), "number of cuts to a target"),
    "updates_seconds": ((), "time of greedy cuts by updates [s]"),
    "factorised_seconds": ((), "time of the same cuts with a factorisation each [s]"),
    "update_difference": ((), "largest relative difference of their values"),
}
TARGETS = (0.9, 0.8, 0.7, 0.6, 0.5)
# Smallest distance from a target that is drawn.
FLOOR = 1e-7


def sizes(parameters):
    """Sizes of the inner dimensions."""
    return {"method": len(METHODS), "cut": parameters["cuts"] + 1, "target": len(TARGETS)}


def check(parameters):
    """Refuse settings that could only fail."""
    check_positive(parameters, "cuts", "repeats")
    check_network(voronoi_network, parameters["n_vertices"], 0)


def case(parameters, seed):
    """The stiffest configuration, pruned for the largest B_0, at random, and towards targets."""
    start = optimize(voronoi_network(parameters["n_vertices"], seed), "bulk_modulus").value
    found = undefined(VARIABLES, sizes(parameters))
    for n, method in enumerate(METHODS):
        order = None if method == "greedy" else seed
        made = prune_towards(start, cuts=parameters["cuts"], seed=order, throw=False)
        found["modulus"][n, : len(made.values)] = made.values / made.values[0]
        found["edges"][n] = len(made.edges) / start.network.n_edges
        found["drift"][n], found["factorisations"][n] = made.drift, made.factorisations
        if method == "greedy":
            found["loss"] = made.objective / upper_bound(made.value.network, "B_0")
        for place, part in enumerate(TARGETS):
            reached = prune_towards(start, target=part * made.values[0], seed=order, throw=False)
            found["target_error"][n, place], found["target_cuts"][n, place] = reached.stats.residual, len(reached.cuts)
    timed = []
    for name, bound in (("updates_seconds", 1e-10), ("factorised_seconds", 0.0)):
        begin = perf_counter()
        timed.append(prune_towards(start, cuts=parameters["repeats"], drift=bound).values)
        found[name] = perf_counter() - begin
    found["update_difference"] = np.abs(timed[0] / timed[1] - 1).max()
    return found


def figure(ds, parameters):
    """B_0 against the part of the edges that is cut, and the distance from targets."""
    drawn, (loss, reach) = panels(
        2,
        f"Pruning of the stiffest network at constant stress: $N_v$ = {parameters['n_vertices']}, "
        f"mean ± standard deviation of {ds.sizes['seed']} networks",
        height=4.0,
    )
    share = 100 * np.arange(ds.sizes["cut"]) / (1.5 * parameters["n_vertices"])
    for n, label in enumerate(METHODS.values()):
        values = ds.modulus.isel(method=n).transpose("seed", "cut").values
        known = np.isfinite(values).any(axis=0)
        mean, width = np.nanmean(values[:, known], axis=0), np.nanstd(values[:, known], axis=0)
        loss.plot(share[known], mean, color=series(n)["color"], label=label)
        loss.fill_between(share[known], mean - width, mean + width, color=series(n)["color"], alpha=0.25, linewidth=0)
    loss.set(
        xlabel="edges cut  [%]", ylabel="$B_0$ over that of the whole network", ylim=(0, 1.02), xlim=(0, None),
        title="stiffness that remains",
    )  # fmt: skip
    loss.legend(frameon=False, title="edges cut")
    for n, label in enumerate(METHODS.values()):
        errors = ds.target_error.isel(method=n).transpose("seed", "target").values
        for place, part in enumerate(TARGETS):
            at = np.full(len(errors), part + 0.016 * (n - 0.5))
            style = series(n) | {"linestyle": "none", "label": label if place == 0 else None}
            reach.semilogy(at, np.maximum(errors[:, place], FLOOR), alpha=0.6, markersize=5, **style)
    reach.axhline(1e-3, color="0.5", linestyle=":")
    reach.text(1.0, 1e-3, " 10⁻³", fontsize=9, va="center", transform=reach.get_yaxis_transform())
    reach.set(
        xlabel="target of $B_0$ over that of the whole network", ylabel="relative distance from the target",
        ylim=(FLOOR, 1), title="targets met by cuts",
    )  # fmt: skip
    reach.legend(frameon=False, ncols=2, loc="upper right")
    return drawn


def claims(ds, parameters):
    """Accuracy and time of updates, and the gain of a greedy choice."""
    ratio = (ds.factorised_seconds / ds.updates_seconds).values
    drift, difference = float(ds.drift.max()), float(ds.update_difference.max())
    last = ds.modulus.isel(cut=parameters["cuts"])
    greedy, random = (last.isel(method=n).values for n in range(2))
    reached, optimal = ds.target_error, ds.loss.values
    return [
        Claim.tested(
            "DesignPruningDrift",
            "values by rank-one updates are those of new factorisations",
            "< 1e-10",
            f"largest relative error {drift:.1g} after {parameters['cuts']} cuts, {difference:.1g} in every step of "
            f"{parameters['repeats']}",
            drift < 1e-10 and difference < 1e-10,
            "they drift",
        ),
        Claim(
            "DesignPruningSpeed",
            "time of greedy cuts with a factorisation each over that with updates, both with all values after a cut",
            "",
            f"{spread(ratio, 3)} for {parameters['repeats']} cuts, set-up included",
            "measured",
        ),
        Claim.tested(
            "DesignPruningGreedy",
            "the best edges cost less stiffness than random ones",
            "order",
            f"B_0 over the first one after {parameters['cuts']} cuts: greedy {spread(greedy)}, random {spread(random)}",
            bool(np.nanmin(greedy) > np.nanmax(random)),
            "they do not",
        ),
        Claim.tested(
            "DesignPruningOptimal",
            "at σ = k every pruned network has the largest B_0 of its edges",
            "1",
            f"B_0 over its bound: 1 within {np.abs(optimal - 1).max():.1g}",
            bool((np.abs(optimal - 1) < 1e-10).all()),
            "some have not",
        ),
        Claim(
            "DesignPruningTargets",
            "distance of B_0 from targets by cuts, which are discrete",
            "",
            "; ".join(
                f"{label}: median {np.median(reached.isel(method=n)):.1g}, "
                f"{float((reached.isel(method=n) < 1e-3).mean()):.0%} within 1e-3"
                for n, label in enumerate(METHODS.values())
            ),
            "measured",
        ),
    ]
