"""Fronts of the bulk modulus B_0 against its growth C_B and against C_G, for positive stresses.

Each network has one self-stress.  Stresses are limited from below, in units of their mean, since edges that shrink give
C_B any value above.  The theorem of `quantity` sets the tip of the lower front: C_B ≥ −B_0/2, with equality at
the largest B_0 only, and C_G ≥ −(G_0/3B_0)(C_B + B_0/2).  Random stresses without that limit test it as well.
"""

import numpy as np

import critflow as cf
from critflow.generators.random_networks import check_voronoi
from critflow.result import StudyError
from critflow.workflow import Claim

from .shared.checks import check_network
from .shared.figures import lettered, panels
from .shared.measurements import coefficients
from .shared.reports import parameters, series
from .shared.tables import bounded, network_study, numbers, outcomes, padded, stacked

FRONTS = {
    "stiff_stiffening": {"B_0": "largest", "C_B": "largest"},
    "soft_softening": {"B_0": "smallest", "C_B": "smallest"},
    "stiff_shear": {"B_0": "largest", "C_G": "largest"},
    "stiff_shear_softening": {"B_0": "largest", "C_G": "smallest"},
}
# Rounding of C_B in units of B_0.
ROUNDING = 1e-9


def case(parameters, *, seed):
    """All fronts of one network, and random stresses."""
    network = cf.voronoi_network(parameters["sizes"][seed % len(parameters["sizes"])], seed)
    manifold = cf.CriticalManifold(network)
    (_, _, tip, _), errors = coefficients(manifold.configuration(network.stiffness))
    return {
        "status": cf.Status.ok,
        **stacked([front(manifold, parameters, name) for name in FRONTS]),
        **samples(manifold, parameters, seed),
        "largest_bulk": cf.upper_bound(manifold, "B_0"),
        "tip": tip,
        "tip_error_bound": errors[2],
    }


def front(manifold, parameters, name):
    """The points of one front; undefined unless it is requested."""
    n, statuses = parameters["points"], ()
    columns = dict.fromkeys(
        ("bulk", "growth", "bulk_error_bound", "growth_error_bound", "weight", "residual", "dominated"), ()
    )
    if name in parameters["fronts"]:
        within = {"force_densities": (parameters["least_stress"], None)}
        front = cf.pareto(manifold, FRONTS[name], n, within=within, throw=False)
        goals = [cf.quantity(manifold.network, one) for one in FRONTS[name]]
        errors = np.array([[goal.error(one) for one in front.value] for goal in goals])
        values = (*front.achieved.T, *errors, front.weights[:, 0], front.residuals, front.dominated)
        columns, statuses = dict(zip(columns, values, strict=True)), front.statuses
    columns = {name: padded(values, n) for name, values in columns.items()}
    return {**columns, "point_status": padded(statuses, n, int(cf.Status.missing))}


def samples(manifold, parameters, seed):
    """Moduli and coefficients of log-normal stresses."""
    rng, rows = np.random.default_rng([seed, 1]), []
    for n in range(parameters["samples"]):
        spread = parameters["spreads"][n % len(parameters["spreads"])]
        sigma = np.exp(spread * rng.normal(size=manifold.network.n_edges))
        rows.append(coefficients(manifold.configuration(sigma)))
    columns = np.transpose(rows, (2, 1, 0))
    return {
        f"sampled_{name}{ending}": values
        for name, pair in zip(("bulk", "shear", "C_B", "C_G"), columns, strict=True)
        for ending, values in zip(("", "_error_bound"), pair, strict=True)
    }


def check(parameters, axes):
    """Refuse settings that could only fail."""
    if parameters["points"] < 2:
        raise StudyError(f"points={parameters['points']} must be at least the two ends")
    unknown = [name for name in parameters["fronts"] if name not in FRONTS]
    if unknown:
        raise StudyError(f"no front is called {unknown[0]}: choose from {', '.join(FRONTS)}")
    if not 0 < parameters["least_stress"] < 1:
        raise StudyError(f"least_stress={parameters['least_stress']} must lie between 0 and 1, the mean stress")
    for size in parameters["sizes"]:
        check_network(check_voronoi, size)


def figure(ds):
    """Fronts of the last network, in units of its largest B_0: C_B and C_G."""
    one, least = ds.isel(seed=-1), parameters(ds)["least_stress"]
    unit, n = float(one.largest_bulk), parameters(ds)["sizes"][int(one.seed) % len(parameters(ds)["sizes"])]
    title = f"Fronts of one network of {n} vertices over stresses of at least {least:g} of their mean"
    figure, row = panels(2, title, height=4.0)
    for axes, name, pair in zip(row, ("C_B", "C_G"), ((0, 1), (2, 3)), strict=True):
        axes.scatter(one.sampled_bulk / unit, one[f"sampled_{name}"] / unit, s=5, color="0.75", label="random σ")
        for place, front in enumerate(pair):
            known = one.isel(front=front).dropna("point", subset=["bulk"])
            label = ", ".join(f"{end} ${target}$" for target, end in list(FRONTS.values())[front].items())
            axes.plot(known.bulk / unit, known.growth / unit, ms=4, lw=1, label=label, **series(place))
        convention = ", energy" * (name == "C_G")
        axes.set(xlabel="$B_0 / \\max B_0$", ylabel=f"${name} / \\max B_0${convention}", yscale="symlog")
    row[0].plot([0, 1], [0, -0.5], color="k", lw=1.6, label="$C_B = -B_0/2$")
    row[0].legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(0, 0.5))
    row[1].legend(fontsize=8, frameon=False, loc="upper left")
    row[1].set_yscale("linear")
    lettered(*row)
    return figure


def claims(ds):
    """The theorem, on the fronts and on random stresses, and the certificates of the fronts."""
    of_bulk = ds.isel(front=[0, 1])
    ratios = (of_bulk.growth / of_bulk.bulk, ds.sampled_C_B / ds.sampled_bulk)
    gap = np.concatenate([ratio.values.ravel() + 0.5 for ratio in ratios])
    joint = ds.sampled_C_G + ds.sampled_shear / (3 * ds.sampled_bulk) * (ds.sampled_C_B + ds.sampled_bulk / 2)
    least, tip = float(np.nanmin(gap)), float(np.abs(ds.tip / ds.largest_bulk + 0.5).max())
    known, certified = np.isfinite(ds.bulk.values).sum(), ds.point_status.values == cf.Status.ok
    weights, worse = ds.weight.values[certified], int(ds.dominated.sum())
    return [
        Claim.tested(
            "DesignSoftening", "no positive stress softens more than C_B = −B_0/2, attained at the largest B_0",
            "proved (docs/theory)",
            f"least C_B/B_0 + 1/2 = {least:.1e} of {np.isfinite(gap).sum()} configurations; at the tip {tip:.0e}",
            bool(least > -ROUNDING and tip < ROUNDING and float(joint.min()) > 0), "a configuration softens more",
            f"C_G + (G_0/3B_0)(C_B + B_0/2) ≥ {float(joint.min()):.2g} k", criterion=f"{ROUNDING:g} B_0", kind="check",
        ),
        Claim.tested(
            "DesignFronts", "points of the fronts satisfy their first-order conditions", "weights ≥ 0",
            f"{certified.sum()} of {known} points certified, largest residual {np.nanmax(ds.residual.values):.0e}; "
            f"{worse} dominated by another of their front",
            bool(certified.sum() == known and weights.min() >= -1e-5 and worse == 0),
            "the search ended before the conditions held at the other points",
            criterion="every point: status ok, weights ≥ −1e-5, none dominated", sample=f"{known} points", kind="check",
        ),
    ]  # fmt: skip


study = network_study(
    name="design_fronts",
    title="Fronts of the bulk modulus and its growth",
    parameters={
        "fronts": tuple(FRONTS),
        "sizes": (12, 18, 24),
        "points": 5,
        "least_stress": 0.2,
        "samples": 60,
        "spreads": (0.1, 0.3, 1.0),
    },
    case=case,
    check=check,
    variables=(
        *bounded(
            ("seed", "front", "point"),
            bulk="bulk modulus B_0 on the front [k]",
            growth="C_B or C_G there [k]",
        ),
        *numbers(
            ("seed", "front", "point"),
            weight="weight of B_0 in the first-order conditions",
            residual="residual of the first-order conditions",
            dominated="whether another point of the front is better in both",
        ),
        *outcomes(("seed", "front", "point"), point_status="outcome of each point"),
        *bounded(
            ("seed", "sample"),
            sampled_bulk="B_0 of random stresses [k]",
            sampled_shear="G_0 of them [k]",
            sampled_C_B="C_B of them [k]",
            sampled_C_G="C_G of them, energy convention [k]",
        ),
        *numbers(("seed",), largest_bulk="largest B_0 of the network [k]"),
        *bounded(("seed",), tip="C_B there [k]"),
    ),
    figures={"fronts": figure},
    claims=claims,
)
