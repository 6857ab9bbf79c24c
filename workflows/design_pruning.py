"""Pruning: the stiffness that a network keeps when edges are cut well or at random."""

import numpy as np

import critflow as cf
from critflow.workflow import Claim

from .shared.checks import voronoi_check
from .shared.figures import panels
from .shared.reports import parameters, series, spread
from .shared.tables import network_study, numbers, padded, stacked

METHODS = {"greedy": "greedy", "random": "at random"}
TARGETS = (0.9, 0.8, 0.7, 0.6, 0.5)


def case(parameters, *, seed):
    """The stiffest configuration, pruned for the largest B_0, at random, and towards targets."""
    start = cf.optimize(cf.voronoi_network(parameters["n_vertices"], seed), "bulk_modulus").value
    return {
        "status": cf.Status.ok,
        **stacked([by_method(start, order, parameters["cuts"]) for order in (None, seed)]),
    }


def by_method(start, order, cuts):
    """B_0 while edges are cut in one order, and the targets that such cuts reach."""
    made = cf.prune_towards(start, {"B_0": "largest"}, cuts=cuts, seed=order, throw=False)
    reached = [cf.prune_towards(start, {"B_0": part * made.values[0]}, seed=order, throw=False) for part in TARGETS]
    return {
        "modulus": padded(made.values / made.values[0], cuts + 1),
        "loss": made.objective / cf.upper_bound(made.value.network, "B_0"),
        "drift": abs(made.objective / cf.properties(made.value, "B_0").values["B_0"] - 1),
        "target_error": [one.stats.residual for one in reached],
    }


def figure(ds):
    """B_0 against the part of the edges that is cut."""
    n_vertices = parameters(ds)["n_vertices"]
    figure, (loss,) = panels(
        1,
        f"Pruning at constant stress: $N_v$ = {n_vertices},\nmean ± standard deviation of {ds.sizes['seed']} networks",
        height=4.0,
    )
    share = 100 * np.arange(ds.sizes["cut"]) / (1.5 * n_vertices)
    for n, label in enumerate(METHODS.values()):
        colour, values = series(n)["color"], ds.modulus.values[:, n]
        known = np.isfinite(values).any(axis=0)
        mean, width = np.nanmean(values[:, known], axis=0), np.nanstd(values[:, known], axis=0)
        loss.plot(share[known], mean, color=colour, label=label)
        loss.fill_between(share[known], mean - width, mean + width, color=colour, alpha=0.25, linewidth=0)
    loss.set(
        xlabel="edges cut  [%]", ylabel="$B_0$ over that of the whole network", ylim=(0, 1.02), xlim=(0, None),
        title="stiffness that remains",
    )  # fmt: skip
    loss.legend(frameon=False, title="edges cut")
    return figure


def claims(ds):
    """Accuracy of updates, the gain of a greedy choice, and the targets that cuts reach."""
    cuts, drift = parameters(ds)["cuts"], float(ds.drift.max())
    greedy, random = ds.modulus.isel(cut=cuts).values.T
    errors = dict(zip(METHODS.values(), np.moveaxis(ds.target_error.values, 1, 0), strict=True))
    optimal = np.abs(ds.loss.values - 1).max()
    return [
        Claim.tested(
            "DesignPruningDrift", "values by rank-one updates are those of new factorisations", "< 1e-10",
            f"largest relative error {drift:.1g} after {cuts} cuts", drift < 1e-10, "they drift",
            criterion="1e-10", kind="check",
        ),
        Claim.tested(
            "DesignPruningGreedy", "the best edges cost less stiffness than random ones", "order",
            f"B_0 over the first one after {cuts} cuts: greedy {spread(greedy)}, random {spread(random)}",
            bool(np.nanmin(greedy) > np.nanmax(random)), "they do not",
            criterion="every greedy value above every random one",
        ),
        Claim.tested(
            "DesignPruningOptimal", "at σ = k every pruned network has the largest B_0 of its edges", "1",
            f"B_0 over its bound: 1 within {optimal:.1g}", bool(optimal < 1e-10), "some have not",
            criterion="1e-10", kind="check",
        ),
        Claim(
            "DesignPruningTargets", "distance of B_0 from targets by cuts, which are discrete", "",
            "; ".join(
                f"{label}: median {np.nanmedian(values):.1g}, {np.mean(values < 1e-3):.0%} within 1e-3"
                for label, values in errors.items()
            ), "measured",
        ),
    ]  # fmt: skip


study = network_study(
    name="design_pruning",
    title="Stiffness that networks keep while edges are cut",
    parameters={"n_vertices": 300, "cuts": 90},
    case=case,
    check=voronoi_check("cuts"),
    variables=(
        *numbers(("seed", "method", "cut"), modulus="B_0 after each cut at constant stress, over the first one"),
        *numbers(
            ("seed", "method"),
            loss="B_0 at the end over the largest one of the edges that remain",
            drift="relative error of the last value by updates of rank one",
        ),
        *numbers(("seed", "method", "target"), target_error="distance of a pruned B_0 from its target, relative"),
    ),
    figures={"pruning": figure},
    claims=claims,
)
