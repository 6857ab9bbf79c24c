"""Seven populations of critical configurations on the same networks, strained past the transition.

The paper's main ensemble: `StructuralMetrics`, `ResponseMetrics` and the claims around them.  Random rest lengths come
twice, with the spread that the paper prints (0.3, `random_lengths_wide`) and with the largest one that leaves every
edge of these networks stressed (0.1, `random_lengths`).
"""

from __future__ import annotations

import numpy as np

from critflow import (
    InputError,
    Status,
    StudyError,
    fit_stiffening,
    stiffening,
    strain_path,
    transition_moduli,
    voronoi_network,
)
from critflow.critical import stressed_fraction
from critflow.path import check_strains
from critflow.structure import face_anisotropy, force_anisotropy, length_variance, tension_variance
from critflow.workflow import Axis, Coordinate, Study, Variable, decimals

from ._ensemble_report import claims, gallery, response_figure, structure_figure, summary
from ._ensemble_verify import verify
from ._populations import POPULATIONS, configuration, prepared


def fitted(strains, moduli, window):
    """Slope of a straight line through a modulus and its standard error; NaN with fewer than three strains."""
    if np.count_nonzero(strains <= window) < 3:
        return np.nan, np.nan
    fit = fit_stiffening(strains, moduli, window)
    return fit.slope, fit.slope_error


def case(parameters, *, seed, population):
    """A critical configuration, its structure, and its moduli at the transition and along the strain path."""
    manifold = prepared(parameters["n_vertices"], seed, parameters["hard_core"])
    network = manifold.network
    found = configuration(manifold, parameters, seed, population)
    shared = {"edges": network.edges, "offsets": network.offsets, "cell": network.cell, "status": found.status}
    if not np.isfinite(found.value.coordinates).all():
        return shared
    critical, strains = found.value, np.array(parameters["strains"])
    at_transition = transition_moduli(critical)
    path = strain_path(network, critical, strains, pattern=manifold.hessian, throw=False).value
    exact = stiffening(network, critical, manifold.saddle, throw=False).value
    # Where an edge collapses the infimum has no configuration, so the coefficients of a near one mean nothing.
    undefined = np.nan if found.status is Status.edge_collapse else 1.0
    result = {
        **shared,
        "sigma": critical.sigma,
        "length": critical.lengths,
        "coordinates": critical.coordinates,
        "bulk_modulus_0": at_transition.bulk,
        "shear_modulus_0": at_transition.shear,
        "bulk_modulus": path.bulk_modulus,
        "shear_modulus": path.shear_modulus,
        "shear_modulus_stress_corrected": path.shear_modulus_stress_corrected,
        "energy": path.energy,
        "max_force": path.max_force,
        "newton_steps": path.steps,
        "path_status": path.status,
        "C_B_exact": exact.C_B * undefined,
        "C_G_exact": exact.C_G * undefined,
        "C_G_stress_corrected_exact": exact.C_G_stress_corrected * undefined,
        "length_variance": length_variance(critical),
        "tension_variance": tension_variance(critical),
        "anisotropy_physical": np.nanmean(face_anisotropy(critical)),
        "anisotropy_force": np.nanmean(force_anisotropy(critical)),
        "stressed_fraction": stressed_fraction(critical.sigma),
        "residual": critical.residual,
        "optimality": found.stats.residual,
        "iterations": found.stats.iterations,
    }
    for name, moduli in (
        ("C_B", path.bulk_modulus),
        ("C_G", path.shear_modulus),
        ("C_G_stress_corrected", path.shear_modulus_stress_corrected),
    ):
        slope, error = fitted(strains, moduli, parameters["fit_window"])
        result[name], result[f"{name}_error"] = slope * undefined, error * undefined
    return result


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_strains(parameters["strains"])
    for name in ("threshold", "spread", "spread_wide", "hard_core", "fit_window"):
        if not parameters[name] > 0:
            raise StudyError(f"{name}={parameters[name]} must be positive")
    if parameters["protocol"] not in ("conic", "strain"):
        raise StudyError(f"protocol={parameters['protocol']} must be conic (exact) or strain (the paper's steps)")
    try:
        voronoi_network(parameters["n_vertices"], axes["seed"][0], parameters["hard_core"])
    except InputError as error:
        raise StudyError(str(error)) from error


def table():
    """Names, dimensions, types, units and meanings of everything that is stored."""
    network, member, each = ("seed",), ("population", "seed"), ("population", "seed", "strain")
    # CF knows no stiffness as a unit: what is measured in k is dimensionless, and its name says so.
    in_k = ", in units of k"

    def scalar(name, long_name, dtype="f8", **more):
        return Variable(name, member, dtype, long_name=long_name, **more)

    def along(name, long_name, dtype="f8", **more):
        return Variable(name, each, dtype, long_name=long_name, **more)

    yield Variable("edges", (*network, "edge", "end"), "i4", long_name="vertices at tail and head of each edge")
    yield Variable(
        "offsets", (*network, "edge", "axis"), "i2", long_name="cell image in which the head of each edge lies"
    )
    yield Variable("cell", (*network, "axis", "axis_"), "f8", long_name="cell vectors as rows")
    yield Variable(
        "sigma", (*member, "edge"), "f8", long_name="geometric stress (tension per length), sum of squares N_b"
    )
    yield Variable("length", (*member, "edge"), "f8", long_name="edge length at the transition")
    yield Variable("coordinates", (*member, "vertex", "axis"), "f8", long_name="vertex coordinates at the transition")
    yield scalar("bulk_modulus_0", "bulk modulus at the transition" + in_k)
    yield scalar("shear_modulus_0", "shear modulus at the transition" + in_k)
    yield along("bulk_modulus", "bulk modulus V d2E/dV2" + in_k)
    yield along("shear_modulus", "shear modulus (1/V) d2E/dε2, energy convention" + in_k)
    yield along("shear_modulus_stress_corrected", "shear modulus less half of dE/dV" + in_k)
    yield along("energy", "elastic energy" + in_k)
    yield along("max_force", "largest unbalanced force component" + in_k)
    yield along("newton_steps", "Newton steps of the relaxation", dtype="i2")
    yield along("path_status", "outcome of the strain step", dtype="i1", flags=Status)
    for name, what in (
        ("C_B", "bulk modulus"),
        ("C_G", "shear modulus (energy convention)"),
        ("C_G_stress_corrected", "stress-corrected shear modulus"),
    ):
        yield scalar(name, f"growth of the {what} with strain, straight line fitted to the path" + in_k)
        yield scalar(f"{name}_error", f"standard error of the fitted growth of the {what}" + in_k)
        yield scalar(f"{name}_exact", f"growth of the {what} with strain, from the transition alone" + in_k)
    yield scalar("length_variance", "variance of the lengths over their squared mean, V_L")
    yield scalar("tension_variance", "variance of the tensions over their squared mean, V_τ")
    yield scalar("anisotropy_physical", "mean shape anisotropy of the faces")
    yield scalar("anisotropy_force", "mean shape anisotropy of the force triangles")
    yield scalar("stressed_fraction", "part of the edges under tension")
    yield scalar("status", "outcome of finding the configuration", dtype="i1", flags=Status)
    yield scalar("residual", "largest unbalanced force over the mean tension")
    yield scalar("optimality", "what the method drives to zero: projected gradient, or force")
    yield scalar("iterations", "iterations of the method that found the configuration", dtype="i4")


study = Study(
    name="ensemble",
    title="Populations of critical configurations, strained past the rigidity transition",
    references="Hain, Santangelo and Manning, Optimizing properties on the critical rigidity manifold of "
    "underconstrained central-force networks (arXiv:2407.13939)",
    axes=(
        Axis("seed", range(100), "seed of the network", noun="networks"),
        Axis("population", POPULATIONS, "population of critical configurations"),
    ),
    parameters={
        "n_vertices": 1000,
        "hard_core": 0.82,
        "threshold": 0.1,
        "spread": 0.1,
        "spread_wide": 0.3,
        "protocol": "conic",
        "strains": decimals("0.001:0.010:0.001"),
        "fit_window": 0.01,
    },
    coordinates=(Coordinate("strain", "strains", "volumetric strain past the transition"),),
    case=case,
    check=check,
    variables=tuple(table()),
    figures={"gallery": gallery, "structure": structure_figure, "response": response_figure},
    claims=claims,
    summary=summary,
    verify=verify,
)
