"""Pruning: the stiffness that a network keeps when edges are cut well or at random."""

from __future__ import annotations

import numpy as np

import critflow as cf
from critflow.workflow import Claim, Study

from .shared.checks import voronoi_check
from .shared.figures import panels
from .shared.reports import PAPER, parameters, series, spread
from .shared.tables import networks, numbers, outcomes, padded, stacked

METHODS = {"greedy": "greedy", "random": "at random"}


def case(parameters, *, seed):
    """The stiffest configuration, pruned for the largest B_0 and at random."""
    start = cf.optimize(cf.voronoi_network(parameters["n_vertices"], seed), "bulk_modulus").value
    return {
        "status": cf.Status.ok,
        **stacked([by_method(start, order, parameters["cuts"]) for order in (None, seed)]),
    }


def by_method(start, order, cuts):
    """B_0 while edges are cut in one order."""
    made = cf.prune_towards(start, {"B_0": "largest"}, cuts=cuts, seed=order, throw=False)
    return {"modulus": padded(made.values / made.values[0], cuts + 1), "drift": made.drift}


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
    """Accuracy of updates, and the gain of a greedy choice."""
    cuts, drift = parameters(ds)["cuts"], float(ds.drift.max())
    greedy, random = ds.modulus.isel(cut=cuts).values.T
    return [
        Claim.tested(
            "DesignPruningDrift", "values by rank-one updates are those of new factorisations", "< 1e-10",
            f"largest relative error {drift:.1g} after {cuts} cuts",
            drift < 1e-10, "they drift", criterion="1e-10", kind="check",
        ),
        Claim.tested(
            "DesignPruningGreedy", "the best edges cost less stiffness than random ones", "order",
            f"B_0 over the first one after {cuts} cuts: greedy {spread(greedy)}, random {spread(random)}",
            bool(np.nanmin(greedy) > np.nanmax(random)), "they do not",
            criterion="every greedy value above every random one",
        ),
    ]  # fmt: skip


study = Study(
    name="design_pruning",
    title="Stiffness that networks keep while edges are cut",
    references=PAPER,
    axes=(networks(10),),
    parameters={"n_vertices": 300, "cuts": 90},
    case=case,
    check=voronoi_check("cuts"),
    variables=(
        *numbers(("seed", "method", "cut"), modulus="B_0 after each cut at constant stress, over the first one"),
        *numbers(
            ("seed", "method"),
            drift="relative error of the last value by updates of rank one",
        ),
        *outcomes(("seed",), status="outcome of the case"),
    ),
    figures={"pruning": figure},
    claims=claims,
)
