"""What is measured on one critical configuration, in two and three dimensions alike, and the table that labels it."""

from __future__ import annotations

import numpy as np

from critflow import Status, fit_stiffening, stiffening, strain_path, transition_moduli
from critflow.design.from_lengths import stressed_fraction
from critflow.rigidity.structure import length_variance, tension_variance
from critflow.workflow import Variable

# What has a cost of its own: linear systems at the transition, and the strain path with the lines fitted to it.
_EXACT = ("C_B_exact", "C_G_exact", "C_G_stress_corrected_exact")
_ALONG = (
    *("bulk_modulus", "shear_modulus", "shear_modulus_stress_corrected", "energy", "max_force", "newton_steps"),
    *("path_status", "C_B", "C_G", "C_G_stress_corrected", "C_B_error", "C_G_error", "C_G_stress_corrected_error"),
)


def measured(manifold, found, parameters, wanted, undefined=1.0):
    """Arrays of a configuration that was found: moduli at the transition and along the strain path, variances.

    wanted     names of the variables asked for; what costs more than a sum over the edges is left out with them
    undefined  NaN where coefficients of growth mean nothing
    """
    critical = found.value
    at_transition = transition_moduli(critical)
    result = {
        "sigma": critical.sigma,
        "length": critical.lengths,
        "coordinates": critical.coordinates,
        "bulk_modulus_0": at_transition.bulk,
        "shear_modulus_0": at_transition.shear,
        "length_variance": length_variance(critical),
        "tension_variance": tension_variance(critical),
        "stressed_fraction": stressed_fraction(critical.sigma),
        "residual": critical.residual,
        "optimality": found.stats.residual,
        "iterations": found.stats.steps,
    }
    if not wanted.isdisjoint(_EXACT):
        exact = stiffening(manifold, critical, throw=False).value
        values = (exact.C_B, exact.C_G, exact.C_G_stress_corrected)
        result |= {name: value * undefined for name, value in zip(_EXACT, values, strict=True)}
    if not wanted.isdisjoint(_ALONG):
        result |= _along_path(manifold, critical, parameters, undefined)
    return result


def _along_path(manifold, critical, parameters, undefined):
    strains = np.array(parameters["strains"])
    path = strain_path(manifold.network, critical, strains, pattern=manifold.hessian, throw=False).value
    result = {
        "bulk_modulus": path.bulk_modulus,
        "shear_modulus": path.shear_modulus,
        "shear_modulus_stress_corrected": path.shear_modulus_stress_corrected,
        "energy": path.energy,
        "max_force": path.max_force,
        "newton_steps": path.steps,
        "path_status": path.status,
    }
    for name, moduli in (
        ("C_B", path.bulk_modulus),
        ("C_G", path.shear_modulus),
        ("C_G_stress_corrected", path.shear_modulus_stress_corrected),
    ):
        slope, error = fitted(strains, moduli, parameters["fit_window"])
        result[name], result[f"{name}_error"] = slope * undefined, error * undefined
    return result


def random_lengths(rng, n_edges, spread):
    """Rest lengths drawn from a normal distribution about 1, drawn again where they are not positive."""
    lengths = 1 + spread * rng.standard_normal(n_edges)
    while (negative := lengths <= 0).any():  # a normal distribution with s = 0.3 has one negative length in 2,300
        lengths[negative] = 1 + spread * rng.standard_normal(negative.sum())
    return lengths


def fitted(strains, moduli, window):
    """Slope of a straight line through a modulus and its standard error; NaN with fewer than three strains."""
    if np.count_nonzero(strains <= window) < 3:
        return np.nan, np.nan
    fit = fit_stiffening(strains, moduli, window)
    return fit.slope, fit.slope_error


def table(planar):
    """Names, dimensions, types, units and meanings of everything that is stored; shapes of faces only in the plane."""
    network, member, each = ("seed",), ("population", "seed"), ("population", "seed", "strain")
    # CF knows no stiffness as a unit: what is measured in k is dimensionless, and its name says so.
    in_k = ", in units of k"
    of_modulus = in_k if planar else ", in units of k per length"

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
    yield scalar("bulk_modulus_0", "bulk modulus at the transition" + of_modulus)
    yield scalar("shear_modulus_0", "shear modulus at the transition" + of_modulus)
    yield along("bulk_modulus", "bulk modulus V d2E/dV2" + of_modulus)
    yield along("shear_modulus", "shear modulus (1/V) d2E/dε2, energy convention" + of_modulus)
    yield along("shear_modulus_stress_corrected", "shear modulus less half of dE/dV" + of_modulus)
    yield along("energy", "elastic energy" + in_k)
    yield along("max_force", "largest unbalanced force component" + in_k)
    yield along("newton_steps", "Newton steps of the relaxation", dtype="i2")
    yield along("path_status", "outcome of the strain step", dtype="i1", flags=Status)
    for name, what in (
        ("C_B", "bulk modulus"),
        ("C_G", "shear modulus (energy convention)"),
        ("C_G_stress_corrected", "stress-corrected shear modulus"),
    ):
        yield scalar(name, f"growth of the {what} with strain, straight line fitted to the path" + of_modulus)
        yield scalar(f"{name}_error", f"standard error of the fitted growth of the {what}" + of_modulus)
        yield scalar(f"{name}_exact", f"growth of the {what} with strain, from the transition alone" + of_modulus)
    yield scalar("length_variance", "variance of the lengths over their squared mean, V_L")
    yield scalar("tension_variance", "variance of the tensions over their squared mean, V_τ")
    if planar:
        yield scalar("anisotropy_physical", "mean shape anisotropy of the faces")
        yield scalar("anisotropy_force", "mean shape anisotropy of the force triangles")
    yield scalar("stressed_fraction", "part of the edges under tension")
    yield scalar("status", "outcome of finding the configuration", dtype="i1", flags=Status)
    yield scalar("residual", "largest unbalanced force over the mean tension")
    yield scalar("optimality", "what the method drives to zero: projected gradient, or force")
    yield scalar("iterations", "iterations of the method that found the configuration", dtype="i4")
