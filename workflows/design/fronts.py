"""Fronts of the bulk modulus B_0 against its growth C_B and against C_G, for positive stresses.

Each network has one self-stress.  Stresses are limited from below, in units of their mean, since edges that shrink give
C_B any value above.  The theorem of `quantity` sets the tip of the lower front: C_B ≥ −B_0/2, with equality at
the largest B_0 only, and C_G ≥ −(G_0/3B_0)(C_B + B_0/2).  Random stresses without that limit test it as well.
"""

from __future__ import annotations

import numpy as np

from critflow import CriticalManifold, Status, pareto, stiffening, upper_bound, voronoi_network
from critflow.result import StudyError
from critflow.workflow import Claim

from ..shared.checks import check_network
from ..shared.reports import series
from .panels import panels

FRONTS = {
    "stiff_stiffening": {"B_0": "largest", "C_B": "largest"},
    "soft_softening": {"B_0": "smallest", "C_B": "smallest"},
    "stiff_shear": {"B_0": "largest", "C_G": "largest"},
    "stiff_shear_softening": {"B_0": "largest", "C_G": "smallest"},
}
PARAMETERS = {
    "fronts": tuple(FRONTS),
    "sizes": (12, 18, 24),
    "points": 5,
    "least_stress": 0.2,
    "samples": 60,
    "spreads": (0.1, 0.3, 1.0),
}
VARIABLES = {
    "bulk": (("front", "point"), "bulk modulus B_0 on the front [k]"),
    "growth": (("front", "point"), "C_B or C_G there [k]"),
    "weight": (("front", "point"), "weight of B_0 in the first-order conditions"),
    "residual": (("front", "point"), "residual of the first-order conditions"),
    "dominated": (("front", "point"), "whether another point of the front is better in both"),
    "point_status": (("front", "point"), "outcome of each point"),
    "sampled_bulk": (("sample",), "B_0 of random stresses [k]"),
    "sampled_shear": (("sample",), "G_0 of them [k]"),
    "sampled_C_B": (("sample",), "C_B of them [k]"),
    "sampled_C_G": (("sample",), "C_G of them, energy convention [k]"),
    "largest_bulk": ((), "largest B_0 over all stresses [k]"),
    "tip": ((), "C_B there [k]"),
}
# Rounding of C_B in units of B_0.
ROUNDING = 1e-9


def sizes(parameters):
    """Sizes of the inner dimensions."""
    return {"front": len(FRONTS), "point": parameters["points"], "sample": parameters["samples"]}


def check(parameters):
    """Refuse settings that could only fail."""
    if parameters["points"] < 2:
        raise StudyError(f"points={parameters['points']} must be at least the two ends")
    unknown = [name for name in parameters["fronts"] if name not in FRONTS]
    if unknown:
        raise StudyError(f"no front is called {unknown[0]}: choose from {', '.join(FRONTS)}")
    if not 0 < parameters["least_stress"] < 1:
        raise StudyError(f"least_stress={parameters['least_stress']} must lie between 0 and 1, the mean stress")
    for size in parameters["sizes"]:
        check_network(voronoi_network, size, 0)


def case(parameters, seed):
    """All fronts of one network, and random stresses."""
    network = voronoi_network(parameters["sizes"][seed % len(parameters["sizes"])], seed)
    manifold = CriticalManifold(network)
    shape = (len(FRONTS), parameters["points"])
    found = {name: np.full(shape, np.nan) for name in ("bulk", "growth", "weight", "residual", "dominated")}
    found["point_status"] = np.full(shape, int(Status.missing))
    within = {"force_densities": (parameters["least_stress"], None)}
    for row, (name, objectives) in enumerate(FRONTS.items()):
        if name not in parameters["fronts"]:
            continue
        front = pareto(manifold, objectives, parameters["points"], within=within, throw=False)
        n = len(front.value)
        found["bulk"][row, :n], found["growth"][row, :n] = front.achieved.T
        found["weight"][row, :n], found["residual"][row, :n] = front.weights[:, 0], front.residuals
        found["point_status"][row, :n], found["dominated"][row, :n] = front.statuses, front.dominated
    stiffest = stiffening(manifold.configuration(network.stiffness)).value
    found |= {"largest_bulk": upper_bound(manifold, "B_0"), "tip": stiffest.C_B}
    return found | samples(manifold, parameters, seed)


def samples(manifold, parameters, seed):
    """Moduli and coefficients of log-normal stresses."""
    rng = np.random.default_rng([seed, 1])
    names = ("bulk", "shear", "C_B", "C_G")
    found = {f"sampled_{name}": np.full(parameters["samples"], np.nan) for name in names}
    for n in range(parameters["samples"]):
        spread = parameters["spreads"][n % len(parameters["spreads"])]
        sigma = np.exp(spread * rng.normal(size=manifold.network.n_edges))
        solved = stiffening(manifold.configuration(sigma), throw=False, manifold=manifold)
        if solved.ok:
            value = solved.value
            for name, number in zip(names, (value.bulk_0, value.shear_0, value.C_B, value.C_G), strict=True):
                found[f"sampled_{name}"][n] = number
    return found


def figure(ds, parameters):
    """Fronts in units of the largest B_0 of each network: C_B, its tip, and C_G."""
    drawn, (left, middle, right) = panels(
        3,
        f"Fronts over stresses of at least {parameters['least_stress']:g} of their mean; grey: random stresses",
        height=4.0,
    )
    fronts = list(FRONTS)
    for axes, pair, sampled in ((left, (0, 1), "C_B"), (middle, (0, 1), "C_B"), (right, (2, 3), "C_G")):
        for i, seed in enumerate(ds.seed.values):
            one, unit = ds.isel(seed=i), float(ds.largest_bulk[i])
            style = series(int(seed) % len(parameters["sizes"]))
            axes.scatter(one.sampled_bulk / unit, one[f"sampled_{sampled}"] / unit, s=3, color="0.8", zorder=0)
            for line, front in zip(("-", "--"), pair, strict=True):
                known = one.isel(front=front).dropna("point", subset=["bulk"])
                axes.plot(known.bulk / unit, known.growth / unit, ls=line, ms=3, lw=0.8, **style)
    x = np.linspace(0, 1, 2)
    for axes in (left, middle):
        axes.plot(x, -x / 2, color="k", lw=1.6, label="$C_B = -B_0/2$" if axes is middle else None)
        axes.plot(1, -0.5, "k*", ms=8)
        axes.set(xlabel="$B_0 / \\max B_0$", ylabel="$C_B / \\max B_0$")
    for n, size in enumerate(parameters["sizes"]):
        middle.plot([], [], ms=3, lw=0.8, label=f"$N_v$ = {size}", **series(n))
    for axes, pair in ((left, (0, 1)), (right, (2, 3))):
        for line, front in zip(("-", "--"), pair, strict=True):
            (bulk, of_bulk), (growth, of_growth) = FRONTS[fronts[front]].items()
            axes.plot([], [], "k" + line, lw=0.8, label=f"{of_bulk} ${bulk}$, {of_growth} ${growth}$")
    left.set(title="growth of the bulk modulus", yscale="symlog")
    middle.set(title="at the tip", xlim=(0.85, 1.01), ylim=(-0.6, 2))
    right.set(xlabel="$B_0 / \\max B_0$", ylabel="$C_G / \\max B_0$", title="growth of the shear modulus")
    right.set_yscale("symlog")
    left.set_ylim(top=3e3)
    left.legend(fontsize=8, frameon=False, loc="upper left")
    right.set_ylim(top=60)
    right.legend(fontsize=8, frameon=False, loc="upper left")
    drawn.legend(*middle.get_legend_handles_labels(), fontsize=8.5, frameon=False, ncols=4, loc="outside lower center")
    return drawn


def claims(ds, parameters):
    """The theorem, on the fronts and on random stresses, and the certificates of the fronts."""
    of_bulk = ds.isel(front=[0, 1])
    gap = np.concatenate(
        [
            (of_bulk.growth / of_bulk.bulk + 0.5).values.ravel(),
            (ds.sampled_C_B / ds.sampled_bulk + 0.5).values.ravel(),
        ]
    )
    joint = ds.sampled_C_G + ds.sampled_shear / (3 * ds.sampled_bulk) * (ds.sampled_C_B + ds.sampled_bulk / 2)
    known = np.isfinite(ds.bulk.values)
    certified = int(np.count_nonzero(ds.point_status.values == int(Status.ok)))
    least, tip = float(np.nanmin(gap)), float(np.abs(ds.tip / ds.largest_bulk + 0.5).max())
    weights = ds.weight.values[ds.point_status.values == int(Status.ok)]
    worse = int(ds.dominated.sum())
    return [
        Claim.tested(
            "DesignSoftening",
            "no positive stress softens more than C_B = −B_0/2, attained at the largest B_0",
            "proved (docs/theory)",
            f"least C_B/B_0 + 1/2 = {least:.1e} of {np.isfinite(gap).sum()} configurations; at the tip {tip:.0e}",
            bool(least > -ROUNDING and tip < ROUNDING and float(joint.min()) > 0),
            "a configuration softens more",
            f"C_G + (G_0/3B_0)(C_B + B_0/2) ≥ {float(joint.min()):.2g} k",
        ),
        Claim.tested(
            "DesignFronts",
            "points of the fronts satisfy their first-order conditions",
            "weights ≥ 0",
            f"{certified} of {known.sum()} points certified, largest residual {np.nanmax(ds.residual.values):.0e}; "
            f"{worse} dominated by another of their front",
            bool(certified == known.sum() and weights.min() >= -1e-5 and worse == 0),
            "the search ended before the conditions held at the other points",
        ),
    ]
