"""Pruning: the stiffness that a network keeps when edges are cut well or at random."""

import numpy as np
from critflow.studies.shared.figures import counted, panels
from critflow.studies.shared.reports import parameters, series, spread
from critflow.studies.shared.tables import numbers, padded, stacked

import critflow as cf
import critflow_extras as ce
from critflow.engine import Claim

METHODS = {"greedy": "least cost", "random": "at random"}
TARGETS = (0.9, 0.8, 0.7, 0.6, 0.5)


def pruned(parameters, seed):
    """The stiffest configuration, pruned for the largest B_0, at random, and towards targets."""
    start = cf.optimize(cf.voronoi_network(parameters["pruned_vertices"], seed), "bulk_modulus").value
    return stacked([by_method(start, order, parameters["pruned_edges"]) for order in (None, seed)])


def by_method(start, order, cuts):
    """B_0 while edges are cut in one order, and the targets that such cuts reach."""
    made = ce.prune_towards(start, {"B_0": "largest"}, cuts=cuts, seed=order, throw=False)
    reached = [ce.prune_towards(start, {"B_0": part * made.values[0]}, seed=order, throw=False) for part in TARGETS]
    return {
        "pruned_B_0": padded(made.values / made.values[0], cuts + 1),
        "pruned_part": made.objective / cf.upper_bound(made.value.network, "B_0"),
        "pruned_drift": abs(made.objective / ce.properties(made.value, "B_0").values["B_0"] - 1),
        "pruned_target_error": [one.stats.residual for one in reached],
    }


def figure(ds):
    """B_0 against the part of the edges that is cut."""
    n_vertices = parameters(ds)["pruned_vertices"]
    share = 100 * np.arange(ds.sizes["pruned"]) / (1.5 * n_vertices)
    kept = 100 * np.nanmean(ds.pruned_B_0.values[..., -1], axis=0)
    figure, (axes,) = panels(
        1,
        f"Cuts of the edges that cost least keep {kept[0]:.0f} % of the stiffness, cuts at random {kept[1]:.0f} %\n"
        f"({counted(ds)} of {n_vertices} vertices, pruned at constant stress; mean ± standard deviation)",
        height=2.9,
    )
    for n, label in enumerate(METHODS.values()):
        colour, values = series(n)["color"], 100 * ds.pruned_B_0.values[:, n]
        known = np.isfinite(values).any(axis=0)
        mean, width = np.nanmean(values[:, known], axis=0), np.nanstd(values[:, known], axis=0)
        axes.plot(share[known], mean, color=colour, linestyle=("-", "--")[n])
        axes.fill_between(share[known], mean - width, mean + width, color=colour, alpha=0.25, linewidth=0)
        axes.text(share[known][-1] + 0.2, mean[-1], f"{label}\n{mean[-1]:.0f} %", color=colour, fontsize=9, va="center")
    axes.set(
        xlabel="edges cut  [%]", ylabel="$B_0$ over the first  [%]", ylim=(0, 103),
        xlim=(0, 1.14 * share[-1]),
    )  # fmt: skip
    return figure


def claims(ds):
    """The gain of a greedy choice, and the targets that cuts reach."""
    cuts = parameters(ds)["pruned_edges"]
    greedy, random = ds.pruned_B_0.isel(pruned=cuts).values.T
    errors = dict(zip(METHODS.values(), np.moveaxis(ds.pruned_target_error.values, 1, 0), strict=True))
    return [
        Claim.tested(
            "topology-pruning", "the best edges cost less stiffness than random ones", "order",
            f"B_0 over the first one after {cuts} cuts: least cost {spread(greedy)}, at random {spread(random)}",
            bool(np.nanmin(greedy) > np.nanmax(random)), "they do not",
            criterion="every value of the best edges above every random one",
        ),
        Claim(
            "topology-targets", "distance of B_0 from targets by cuts, which are discrete", "",
            "; ".join(
                f"{label}: median {np.nanmedian(values):.1g}, {np.mean(values < 1e-3):.0%} within 1e-3"
                for label, values in errors.items()
            ), "measured",
        ),
    ]  # fmt: skip


VARIABLES = (
    *numbers(("seed", "method", "pruned"), pruned_B_0="B_0 after each cut at constant stress, over the first one"),
    *numbers(
        ("seed", "method"),
        pruned_part="B_0 at the end over the largest one of the edges that remain",
        pruned_drift="relative error of the last value by updates of rank one",
    ),
    *numbers(
        ("seed", "method", "pruned_target"),
        pruned_target_error="distance of a pruned B_0 from its target, relative",
    ),
)
