"""Stiffening on demand: triples (B_0, C_B, C_G) of the populations of other networks as targets.

Each triple is attained by a configuration of another random network of the same size.  That of the largest B_0 has
C_B = −B_0/2, which only the stiffest configuration of a network attains: a network with another largest B_0 cannot
(`stiffening_bound`), and `design` refuses it.  One design of each network is strained, and the growth of its moduli
fitted.
"""

from __future__ import annotations

import time

import numpy as np

from critflow import (
    CriticalManifold,
    Status,
    StudyError,
    design,
    stiffening,
    strain_path,
    voronoi_network,
)
from critflow.workflow import Claim, stable_rng

from ..shared.checks import check_network
from ..shared.populations import LABELS, PAPER_POPULATIONS, configuration
from ..shared.reports import series
from .panels import limit, panels, times
from .parts import undefined

SOURCES = (*PAPER_POPULATIONS, "log-normal stress")
NAMES = ("B_0", "C_B", "C_G")
# Strains at which the growth is fitted by a parabola, and seeds of the networks that attain the targets.
STRAINS = np.linspace(0.0, 4e-4, 9)[1:]
OTHER = 100

PARAMETERS = {"n_vertices": 400, "threshold": 0.1, "spread": 0.1, "sources": SOURCES}
VARIABLES = {
    "target": (("source", "name"), "requested B_0, C_B, C_G"),
    "achieved": (("source", "name"), "achieved values, by stiffening()"),
    "error": (("source",), "largest error relative to the largest of the three"),
    "distance": (("source",), "root mean square change of log σ from σ = 1"),
    "independence": (("source", "name"), "sine of the angle of a gradient with the span of the others"),
    "target_status": (("source",), "its outcome"),
    "target_seconds": (("source",), "processor time of one design [s]"),
    "fitted": (("name",), "B_0, C_B and C_G of a strain path of the first design"),
}


def sizes(parameters):
    """Sizes of the inner dimensions."""
    return {"source": len(parameters["sources"]), "name": len(NAMES)}


def check(parameters):
    """Refuse settings that could only fail."""
    check_network(voronoi_network, parameters["n_vertices"], 0)
    unknown = [source for source in parameters["sources"] if source not in SOURCES]
    if unknown:
        raise StudyError(f"no source is called {unknown[0]!r}: choose from {', '.join(SOURCES)}")


def case(parameters, seed):
    """Designs of one network."""
    manifold = CriticalManifold(voronoi_network(parameters["n_vertices"], seed))
    other = CriticalManifold(voronoi_network(parameters["n_vertices"], seed + OTHER))
    found = undefined(VARIABLES, sizes(parameters))
    for n, source in enumerate(parameters["sources"]):
        targets = triple(other, source_of(parameters, other, seed + OTHER, source))
        start = time.process_time()
        made = design(manifold, dict(zip(NAMES, targets, strict=True)), throw=False)
        found["target_seconds"][n] = time.process_time() - start
        got = triple(manifold, made.value)
        found["target"][n], found["achieved"][n] = targets, got
        found["error"][n] = np.abs(got - targets).max() / np.abs(targets).max()
        found["distance"][n], found["target_status"][n] = made.distance, made.status
        found["independence"][n] = [made.independence[name] for name in NAMES]
        if n == 0:
            found["fitted"][:] = fitted(made.value)
    return found


def source_of(parameters, manifold, seed, source):
    """The configuration that attains a target."""
    if source in PAPER_POPULATIONS:
        return configuration(manifold, parameters, seed, source).value
    return manifold.configuration(np.exp(0.4 * stable_rng(seed, source).standard_normal(manifold.network.n_edges)))


def triple(manifold, critical):
    """B_0, C_B, C_G."""
    value = stiffening(manifold, critical, throw=False).value
    return np.array([value.bulk_0, value.C_B, value.C_G])


def fitted(critical):
    """B_0, C_B, C_G of the moduli on a path of dilation."""
    states = strain_path(critical.network, critical, STRAINS, throw=False).value
    (_, C_B, B_0), (_, C_G, _) = (
        np.polyfit(STRAINS, values, 2) for values in (states.bulk_modulus, states.shear_modulus)
    )
    return B_0, C_B, C_G


def figure(ds, parameters):
    """Targets in the planes of B_0 and the coefficients, and the times of the designs."""
    drawn, (left, middle, right) = panels(
        3,
        "Triples $(B_0, C_B, C_G)$ of configurations of other networks, designed at "
        f"$N_v$ = {parameters['n_vertices']} ({ds.sizes['seed']} networks)",
        height=4.4,
    )
    for n, source in enumerate(parameters["sources"]):
        targets, reached = ds.target.values[:, n], ds.target_status.values[:, n] != Status.infeasible
        style, label = series(n), LABELS.get(source, source)
        hollow = style | {"facecolors": "none", "edgecolors": style["color"]}
        hollow.pop("color")
        for axes, column in ((left, 1), (middle, 2)):
            axes.scatter(*targets[reached][:, [0, column]].T, s=20, label=label if reached.any() else None, **style)
            refused = None if reached.any() else f"{label}: refused by the bound"
            axes.scatter(*targets[~reached][:, [0, column]].T, s=34, label=refused, **hollow)
        times(right, ds.distance.values[reached, n], ds.target_seconds.values[reached, n], **style)
    B = np.array([np.nanmin(ds.target.values[..., 0]), np.nanmax(ds.target.values[..., 0])])
    left.plot(B, -B / 2, color="k", linewidth=1, label="$C_B = -B_0/2$")
    left.set(xlabel="$B_0$  [k]", ylabel="$C_B$  [k]", title="growth of the bulk modulus")
    drawn.legend(*left.get_legend_handles_labels(), fontsize=8.5, frameon=False, ncols=4, loc="outside lower center")
    middle.set(xlabel="$B_0$  [k]", ylabel="$C_G$  [k]", title="growth of the shear modulus")
    limit(right, 3, "required: 3 s")
    right.set_ylim(0, None)
    return drawn


def claims(ds, parameters):
    """Bar D2."""
    error, seconds, status = ds.error.values, ds.target_seconds.values, ds.target_status.values
    stiffest = np.array(parameters["sources"]) == "bulk_modulus"
    others = ~stiffest
    reached = error <= 1e-8
    refused = (status[:, stiffest] == Status.infeasible).sum()
    growth = np.abs(ds.fitted.values - ds.achieved.values[:, 0]).max()
    return [
        Claim.tested(
            "design-stiffening-reached",
            "triples (B_0, C_B, C_G) of other networks are reached to 1e-8",
            "all",
            f"{reached[:, others].sum()} of {reached[:, others].size}, largest error {error[reached].max():.1e}",
            reached[:, others].all(),
            "no start reached the others",
        ),
        Claim.tested(
            "design-stiffening-refused",
            "C_B = -B_0/2 of another largest B_0 is refused by the bound",
            "all",
            f"{refused} of {status[:, stiffest].size}",
            reached[:, stiffest].sum() + refused == status[:, stiffest].size,
            "the others end at the best compromise",
        ),
        Claim.tested(
            "design-stiffening-time",
            "one design takes at most 3 s of processor time",
            "3 s",
            f"median {np.nanmedian(seconds):.1f} s, longest {np.nanmax(seconds):.1f} s",
            (seconds <= 3).all(),
            "some start from several stresses",
        ),
        Claim.tested(
            "design-stiffening-path",
            "strain paths of the designs have the requested growth",
            "all",
            f"{len(ds.seed)} paths, largest difference {growth:.1e}",
            growth < 1e-3,
            "the fitted parabola has a bias",
        ),
    ]


def summary(ds, parameters):
    """Largest error, and times."""
    reached = ds.error <= 1e-8
    return {
        "reached": int(reached.sum()),
        "refused": int((ds.target_status == Status.infeasible).sum()),
        "targets": int(reached.size),
        "largest_error": float(ds.error.where(reached).max()),
        "median_seconds": float(ds.target_seconds.median()),
        "longest_seconds": float(ds.target_seconds.max()),
    }
