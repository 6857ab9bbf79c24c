"""Stiffening on demand: triples (B_0, C_B, C_G) of the populations of other networks as targets.

Each triple is attained by a configuration of another random network of the same size.  That of the largest B_0 has
C_B = −B_0/2, which only the stiffest configuration of a network attains: a network with another largest B_0 cannot
(`quantity`), and `design` refuses it.  One design of each network is strained, and the growth of its moduli
fitted.
"""

import numpy as np

import critflow as cf
from critflow.result import StudyError
from critflow.workflow import Claim, stable_rng

from .shared.checks import voronoi_check
from .shared.figures import legend_below, lettered, panels
from .shared.measurements import coefficients
from .shared.populations import LABELS, PAPER_POPULATIONS, configuration
from .shared.reports import MISSED, duration, parameters, series
from .shared.tables import bounded, network_study, numbers, outcomes, seconds, stacked, timed

SOURCES = (*PAPER_POPULATIONS, "log-normal stress")
NAMES = ("B_0", "C_B", "C_G")
# Strains at which the growth is fitted by a parabola, and seeds of the networks that attain the targets.
STRAINS = np.linspace(0.0, 4e-4, 9)[1:]
OTHER = 100


def case(parameters, *, seed):
    """Designs of one network; the first is strained."""
    manifold = cf.CriticalManifold(cf.voronoi_network(parameters["n_vertices"], seed))
    other = cf.CriticalManifold(cf.voronoi_network(parameters["n_vertices"], seed + OTHER))
    triples = [attained(other, parameters, seed + OTHER, source) for source in parameters["sources"]]
    designs, rows = zip(*(designed(manifold, targets) for targets in triples), strict=True)
    return {"status": cf.Status.ok, "fitted": fitted(designs[0].value), **stacked(rows)}


def attained(manifold, parameters, seed, source):
    """The triple of one configuration of another network."""
    if source in PAPER_POPULATIONS:
        return triple(configuration(manifold, parameters, seed, source).value)[0]
    sigma = np.exp(0.4 * stable_rng(seed, source).standard_normal(manifold.network.n_edges))
    return triple(manifold.configuration(sigma))[0]


def triple(critical):
    """B_0, C_B, C_G and the bounds on their errors."""
    return [numbers[[0, 2, 3]] for numbers in coefficients(critical)]


def designed(manifold, targets):
    """One design, with its error and its cost."""
    made, time = timed(cf.design, manifold, dict(zip(NAMES, targets, strict=True)), throw=False)
    achieved, errors = triple(made.value)
    return made, {
        "target": targets,
        "achieved": achieved,
        "achieved_error_bound": errors,
        "error": np.abs(achieved - targets).max() / np.abs(targets).max(),
        "distance": made.distance,
        "target_status": made.status,
        "target_seconds": time,
    }


def fitted(critical):
    """B_0, C_B, C_G of the moduli on a path of dilation."""
    path = cf.strain_path(critical, STRAINS, throw=False).value
    (_, C_B, B_0), (_, C_G, _) = (np.polyfit(STRAINS, moduli, 2) for moduli in (path.bulk_modulus, path.shear_modulus))
    return B_0, C_B, C_G


def check(parameters, axes):
    """Refuse settings that could only fail."""
    voronoi_check()(parameters, axes)
    unknown = [source for source in parameters["sources"] if source not in SOURCES]
    if unknown:
        raise StudyError(f"no source is called {unknown[0]!r}: choose from {', '.join(SOURCES)}")


def figure(ds):
    """Targets in the planes of B_0 and the coefficients."""
    figure, (left, middle) = panels(
        2,
        "Triples $(B_0, C_B, C_G)$ of configurations of other networks, designed at "
        f"$N_v$ = {parameters(ds)['n_vertices']} ({ds.sizes['seed']} networks)",
        height=4.4,
    )
    for n, source in enumerate(parameters(ds)["sources"]):
        targets, reached = ds.target.values[:, n], ~np.isin(ds.target_status.values[:, n], MISSED)
        style, label = series(n), LABELS.get(source, source)
        hollow = {"facecolors": "none", "edgecolors": style["color"], "marker": style["marker"]}
        for axes, column in ((left, 1), (middle, 2)):
            axes.scatter(*targets[reached][:, [0, column]].T, s=20, label=label if reached.any() else None, **style)
            refused = None if reached.any() else f"{label}: refused by the bound"
            axes.scatter(*targets[~reached][:, [0, column]].T, s=34, label=refused, **hollow)
    B = np.array([np.nanmin(ds.target.values[..., 0]), np.nanmax(ds.target.values[..., 0])])
    left.plot(B, -B / 2, color="k", linewidth=1, label="$C_B = -B_0/2$")
    left.set(xlabel="$B_0$  [k]", ylabel="$C_B$  [k]", title="growth of the bulk modulus")
    legend_below(figure, left, ncols=4)
    middle.set(xlabel="$B_0$  [k]", ylabel="$C_G$, energy  [k]", title="growth of the shear modulus")
    lettered(left, middle)
    return figure


def claims(ds):
    """Errors and refusals, and the growth on strain paths."""
    error, time = ds.error.values, ds.target_seconds.values
    stiffest = np.array(parameters(ds)["sources"]) == "max_B_0"
    reached, refused = error <= 1e-8, (ds.target_status.values[:, stiffest] == cf.Status.infeasible).sum()
    growth = np.abs(ds.fitted.values - ds.achieved.values[:, 0]).max()
    return [
        Claim.tested(
            "design-stiffening-reached", "triples (B_0, C_B, C_G) of other networks are reached to 1e-8", "all",
            f"{reached[:, ~stiffest].sum()} of {reached[:, ~stiffest].size}, largest error {error[reached].max():.1e}; "
            f"{duration(np.nanmedian(time))} each in the median, at most {duration(np.nanmax(time))}",
            reached[:, ~stiffest].all(), "no start reached the others",
            criterion="1e-8 of the largest number, every triple", kind="check",
        ),
        Claim.tested(
            "design-stiffening-refused", "C_B = -B_0/2 of another largest B_0 is refused by the bound", "all",
            f"{refused} of {reached[:, stiffest].size}",
            reached[:, stiffest].sum() + refused == reached[:, stiffest].size,
            "the others end at the best compromise", criterion="every triple that is not reached", kind="check",
        ),
        Claim.tested(
            "design-stiffening-path", "strain paths of the designs have the requested growth", "all",
            f"{len(ds.seed)} paths, largest difference {growth:.1e}", growth < 1e-3,
            "the fitted parabola has a bias", criterion="1e-3 k", kind="check",
        ),
    ]  # fmt: skip


study = network_study(
    name="design_stiffening",
    title="Stiffening on demand",
    parameters={"n_vertices": 400, "threshold": 0.1, "spread": 0.1, "sources": SOURCES},
    case=case,
    check=check,
    variables=(
        *numbers(("seed", "source", "name"), target="requested B_0, C_B, C_G"),
        *bounded(("seed", "source", "name"), achieved="achieved values, by stiffening()"),
        *numbers(
            ("seed", "source"),
            error="largest error relative to the largest of the three",
            distance="root mean square change of log σ from σ = 1",
        ),
        *outcomes(("seed", "source"), target_status="outcome of the design"),
        *seconds(("seed", "source"), target_seconds="processor time of the design [s]"),
        *numbers(("seed", "name"), fitted="B_0, C_B and C_G of a strain path of the first design"),
    ),
    figures={"stiffening": figure},
    claims=claims,
)
