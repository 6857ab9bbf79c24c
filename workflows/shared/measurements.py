"""Measurements on one critical configuration in two or three dimensions, their labels and their verification."""

from dataclasses import replace

import numpy as np

from critflow import CriticalManifold, InputError, Status, stiffening, strain_path
from critflow.deformation import deformation_of
from critflow.elastic import elasticity_at_transition
from critflow.engine import Variable
from critflow.growth import NO_STIFFENING
from critflow.manifold import require_one_stress_by_count
from critflow.taut_edges import NO_STRESS
from critflow.taut_part import backbone

from .reports import parameters as parameters_of
from .structure import relative_variance
from .tables import NETWORK, numbers, of_network, outcomes
from .verification import balance_error, bond_vectors, contradictions, forces
from .verification import configuration as configuration_checks

# Variables of a drawing of one configuration.
DRAWN = ("edges", "offsets", "cell", "sigma", "length", "position")
# Variables that require linear systems at the transition, or the strain path and the lines fitted to it.
_EXACT = ("C_B", "C_G", "C_G_stress_corrected")
# Each exact coefficient, and the modulus whose line has the slope NAME_fit.
_FITTED = {"C_B": "B", "C_G": "G", "C_G_stress_corrected": "G_stress_corrected"}
_ALONG = (
    *("B", "G", "G_stress_corrected", "energy", "max_force", "newton_steps", "path_status"),
    *(f"{name}_fit{part}" for name in _FITTED for part in ("", "_standard_error", "_deviation")),
)
_DEVIATIONS = tuple(f"{name}_fit_deviation" for name in _FITTED)
# Variables with a bound on their rounding, `NAME_error_bound`.
_AT_TRANSITION, _OF_PATH = ("B_0", "G_0"), _ALONG[:3]
BOUNDED = ("position", *_AT_TRANSITION, *_EXACT, *_OF_PATH)


def bounds(names):
    """The names of the error bounds of variables."""
    return tuple(f"{name}_error_bound" for name in names)


def identified(network, found):
    """The network and the status: all that is stored where no configuration was found."""
    return {**of_network(network), "status": found.status}


def of_configuration(critical):
    """Arrays of a configuration, its variances, the fractions of its stressed edges and its residual force."""
    return {
        "sigma": critical.sigma,
        "length": critical.lengths,
        "position": critical.coordinates,
        "position_error_bound": critical.error_bound,
        "V_L": relative_variance(critical.lengths),
        "V_tau": relative_variance(critical.tensions),
        **edge_fractions(critical.sigma),
        "residual": critical.residual,
    }


def measured(manifold, found, parameters, wanted):
    """Arrays of a configuration: network, variances, moduli at the transition and along the strain path.

    wanted  names of the requested variables; of the others only sums over the edges are computed
    """
    critical = found.value
    parts = rigid_parts(critical)
    moduli = moduli_of_parts(parts, critical.network.volume)
    result = {
        **identified(manifold.network, found),
        **of_configuration(critical),
        **dict(zip(_AT_TRANSITION, np.sum([(each.bulk, each.shear) for each in moduli], axis=0), strict=True)),
        "optimality": found.stats.residual,
        "iterations": found.stats.steps,
    }
    if not wanted.isdisjoint(bounds(_AT_TRANSITION)):
        errors = np.sum([(each.errors.bulk, each.errors.shear) for each in moduli], axis=0)
        result |= dict(zip(bounds(_AT_TRANSITION), errors, strict=True))
    deformation = deformation_of(parameters.get("deformation", "dilation"), manifold.network.dimension)
    side = tightening(critical, deformation)
    if not wanted.isdisjoint((*_EXACT, *bounds(_EXACT), *_DEVIATIONS)):
        # Patterns of the whole serve where no edge is slack.
        known = [known_stiffening(manifold if one is critical else one.manifold, one, deformation) for one in parts]
        for names, of_parts, sign in zip((_EXACT, bounds(_EXACT)), zip(*known, strict=True), (side, 1), strict=True):
            values = np.sum([(one.C_B, one.C_G, one.C_G_stress_corrected) for one in of_parts], axis=0)
            result |= {name: sign * value for name, value in zip(names, values, strict=True)}
    if not wanted.isdisjoint((*_ALONG, *bounds(_OF_PATH))):
        result |= _along_path(parts, parameters, deformation, side)
        result |= {f"{name}_fit_deviation": result[f"{name}_fit"] - result[name] for name in _EXACT if name in result}
    return result


def rigid_parts(critical):
    """The taut parts of a configuration, or itself where edges are too short to count them."""
    try:
        return backbone(critical).components
    except InputError:
        return (critical,)


def moduli_of_parts(parts, volume):
    """The moduli at the transition of each rigid part, which add up."""
    for part in parts:
        require_one_stress_by_count(part.network)
    # A configuration from elsewhere is solved again for its stress, which gives bounds on its errors.
    known = [part if np.isfinite(part.bond_errors).all() else solved(part) for part in parts]
    return [elasticity_at_transition(part, volume) for part in known]


def solved(critical):
    """The configuration of the same stress with bounds on its errors; as it is where they are not found."""
    found = CriticalManifold(critical.network).solve(critical.sigma)
    return found.value if found.ok else critical


def moduli_with_bounds(critical):
    """B_0 and G_0 and the bounds on their errors, (2,) each, summed over the rigid parts."""
    parts = moduli_of_parts(rigid_parts(critical), critical.network.volume)
    return np.sum([[(one.bulk, one.shear), (one.errors.bulk, one.errors.shear)] for one in parts], axis=0)


def known_stiffening(manifold, critical, deformation):
    """Exact coefficients and their error bounds, or NaN where edges are too short to count the self-stresses."""
    try:
        found = stiffening(critical, throw=False, deformation=deformation, manifold=manifold)
    except InputError:
        return NO_STIFFENING, NO_STIFFENING
    known = not isinstance(found.stats.error_bound, float)
    return found.value, found.stats.error_bound if known else NO_STIFFENING


def coefficients(critical):
    """B_0, G_0, C_B and C_G of one configuration and the bounds on their errors, (4,) each; NaN where not defined."""
    both = known_stiffening(None, critical, "dilation")
    return [np.array([each.bulk_0, each.shear_0, each.C_B, each.C_G]) for each in both]


def edge_fractions(sigma):
    """Fractions of the edges with stress of any sign, and under tension: above rounding of the mean |σ|."""
    least = NO_STRESS * np.mean(np.abs(sigma))
    return {"stressed_fraction": np.mean(np.abs(sigma) > least), "tension_fraction": np.mean(sigma > least)}


def tightening(critical, deformation):
    """The sign of the strains that tighten a configuration: it is floppy on the other side of its transition."""
    sigma, L = critical.sigma, critical.bond_vectors
    return -1.0 if np.vdot(sigma[:, None] * L, L @ deformation.velocity(0.0).T) < 0 else 1.0


def _along_path(parts, parameters, deformation, side):
    """Moduli at strains of the tightening sign, and their growth with the distance |γ| from the transition.

    parts  the taut parts alone, of which the coefficients are; their energies and moduli add up
    """
    strains = np.array(parameters["strains"])
    paths = [
        strain_path(
            part,
            side * strains,
            deformation=deformation,
            taut_only=True,
            measure="moduli",
            throw=False,
        ).value
        for part in parts
    ]
    # That of G holds in both conventions.
    sums = {
        **{"B": "bulk_modulus", "G": "shear_modulus", "G_stress_corrected": "shear_modulus_stress_corrected"},
        **{"energy": "energy", "newton_steps": "steps"},
        **dict(zip(bounds(_OF_PATH), ("bulk_modulus_error", *["shear_modulus_error"] * 2), strict=True)),
    }
    result = {name: np.sum([getattr(path, field) for path in paths], axis=0) for name, field in sums.items()}
    result["max_force"] = np.max([path.max_force for path in paths], axis=0)
    # `Status.ok` is zero: of several outcomes one that is not ok.
    result["path_status"] = np.max([path.status for path in paths], axis=0)
    for name, modulus in _FITTED.items():
        slope, error = fitted(strains, result[modulus], parameters["fit_window"], parameters.get("fit_degree", 1))
        result[f"{name}_fit"], result[f"{name}_fit_standard_error"] = slope, error
    return result


def fitted(strains, moduli, window, degree=1):
    """Slope at zero strain of a polynomial through a modulus and its error; NaN with too few strains.

    degree 1  a straight line, as in the paper, with its standard error.  The modulus is a smooth curve without noise,
              so that this scatter about the line says nothing of the distance from the derivative at zero, which is
              about 13 times as large for ten equal steps of strain.
    degree 2  or more: the error is the distance from the slope of one degree less, and twice that from one degree more.
              Either distance may vanish by chance.  In 11 networks of each population the truth was within half of it.
    """
    inside = strains <= window * (1 + 1e-12)
    if np.count_nonzero(inside) < degree + 2 or not np.isfinite(moduli[inside]).all():
        return np.nan, np.nan
    x, y = strains[inside], moduli[inside]
    if degree > 1:
        lower, slope, higher = (np.polyfit(x, y, n)[-2] for n in (degree - 1, degree, degree + 1))
        return slope, abs(slope - lower) + 2 * abs(higher - slope)
    coefficients, covariance = np.polyfit(x, y, 1, cov=True)
    return coefficients[0], np.sqrt(covariance[0, 0])


def _growths(of_modulus):
    """Names and meanings of the exact and the fitted coefficients; `of_modulus` is the text on their unit."""
    growths = {}
    for name, modulus in (
        ("C_B", "bulk modulus"),
        ("C_G", "shear modulus (energy convention)"),
        ("C_G_stress_corrected", "stress-corrected shear modulus"),
    ):
        growths[name] = f"growth of the {modulus} with strain, from the transition alone{of_modulus}"
        growths[f"{name}_fit"] = f"slope of a line fitted to the {modulus} along the path{of_modulus}"
        growths[f"{name}_fit_standard_error"] = f"scatter about the line fitted to the {modulus}{of_modulus}"
        growths[f"{name}_fit_deviation"] = f"fitted less exact growth of the {modulus}{of_modulus}"
    return growths


_NOT_UNIQUE = (
    "min_V_tau and max_B_0 are not unique: isogonal modes keep all tensions, V_tau and the moduli at the transition, "
    "and change this; the stored configuration is the one from the start sigma = 1, which for max_B_0 is sigma = k"
)
_FIT_COMMENTS = {
    "": "not the derivative at the transition, {name}: the modulus is curved within the fitted strains",
    "_standard_error": (
        "standard error of the straight line of fit_degree 1: scatter about it, not its distance from {name}, which is "
        "about 13 times larger and is {name}_fit_deviation; with fit_degree 2 or more: an error bar that contains "
        "{name}, the distances from the slopes of one degree less and more"
    ),
    "_deviation": "what the fit misses, {name}_fit less {name}",
}
_STATE = (
    "state: exactly at the transition; of random_lengths the one that the protocol of the paper records in its box, "
    "far past the transition of rest_length, and critical as well if `length` are the rest lengths"
)
_DILATED = "strained from the stored configuration with `length` as rest lengths, V = V(0) (1 + γ) in a dilation"
_SHEAR = "shear F = 1 + ε A with A = (e_x e_y + e_y e_x)/2, vertices relaxed"
_SHAPE = (
    "κ = 2 (λ_1^4 + λ_2^4)/(λ_1^2 + λ_2^2)^2 - 1, with λ_1 and λ_2 the eigenvalues of the gyration tensor of the "
    "corners about their centre: 0 for regular polygons, 1 for a line"
)
_LENGTHS = "generated networks have V = N_v, so that the unit of length is (V/N_v)^(1/d)"
_DRAWN_LENGTHS = (
    "mean 1, in the unit of length of the paper's box of volume N_b; critical_from_lengths of them is "
    "random_lengths_transition, and if the state of random_lengths is rigid without strain, its sigma is proportional "
    "to 1 - rest_length (V/N_b)^(1/d) / length"
)
_COMMENTS = {
    "sigma": (_STATE, _NOT_UNIQUE),
    "length": (_STATE, _LENGTHS, _NOT_UNIQUE),
    "position": (_STATE, _LENGTHS, _NOT_UNIQUE),
    "rest_length": (_DRAWN_LENGTHS,),
    "V_L": (_STATE, _NOT_UNIQUE),
    "V_tau": (_STATE,),
    "B_0": (_STATE,),
    "G_0": (_STATE, _SHEAR),
    **dict.fromkeys(("B", "energy", "max_force"), (_DILATED,)),
    **dict.fromkeys(("G", "G_stress_corrected"), (_DILATED, _SHEAR)),
    "C_B": (_STATE, _NOT_UNIQUE, "C_B of max_B_0 is -B_0/2 for all of them"),
    **dict.fromkeys(("C_G", "C_G_stress_corrected"), (_STATE, _SHEAR, _NOT_UNIQUE)),
    "kappa_phys": (_SHAPE, _STATE, _NOT_UNIQUE),
    "kappa_force": (_SHAPE, _STATE),
    **{f"{name}_fit{part}": (text.format(name=name),) for name in _FITTED for part, text in _FIT_COMMENTS.items()},
}
COMMENTS = {name: "; ".join(texts) for name, texts in _COMMENTS.items()}


_SHAPES = {
    "kappa_phys": "mean shape anisotropy κ of the faces",
    "kappa_force": "mean shape anisotropy κ of the force triangles",
}


def _error_bound(name, dims):
    """The variable of the bound on the rounding error of another one."""
    state = ", before the stress is scaled to its sum of squares" if name == "position" else ""
    return Variable(f"{name}_error_bound", dims, "f8", long_name=f"bound on the rounding error of {name}{state}")


def table(planar):
    """The stored variables with their comments; shapes of faces in the plane only."""
    member, each = ("population", "seed"), ("population", "seed", "strain")
    # CF has no unit of stiffness: quantities in units of k are dimensionless, and their long names contain the unit.
    in_k, power = ", in units of k", "1/2" if planar else "1/3"
    of_modulus = in_k if planar else ", in units of k per length"
    in_length = f", in units of (V/N_v)^({power})"
    rows = (
        *NETWORK,
        *numbers(
            (*member, "edge"),
            sigma="geometric stress (tension per length), sum of squares N_b",
            length="edge length of the critical configuration" + in_length,
            rest_length="rest length as drawn, of the populations of random rest lengths",
        ),
        *numbers((*member, "vertex", "axis"), position=f"coordinates of the critical configuration{in_length}"),
        *numbers(
            member,
            B_0="bulk modulus of the critical configuration" + of_modulus,
            G_0="shear modulus of the critical configuration" + of_modulus,
        ),
        *numbers(
            each,
            B="bulk modulus V d2E/dV2" + of_modulus,
            G="shear modulus (1/V) d2E/dε2, energy convention" + of_modulus,
            G_stress_corrected="shear modulus less half of dE/dV" + of_modulus,
            energy=f"elastic energy{in_k} {'V/N_v' if planar else '(V/N_v)^(2/3)'}",
            max_force=f"largest unbalanced force component{in_k} (V/N_v)^({power})",
        ),
        *numbers(each, "i2", newton_steps="Newton steps of the relaxation"),
        *outcomes(each, path_status="outcome of the strain step"),
        *numbers(
            member,
            **_growths(of_modulus),
            V_L="variance of the lengths over their squared mean, V_L",
            V_tau="variance of the tensions over their squared mean, V_τ",
            **_SHAPES if planar else {},
            stressed_fraction="part of the edges with stress of any sign",
            tension_fraction="part of the edges under tension",
        ),
        *outcomes(member, status="outcome of finding the configuration"),
        *numbers(
            member,
            residual="largest unbalanced force over the mean tension",
            optimality="residual of the method: projected gradient, or force",
        ),
        *numbers(member, "i4", iterations="iterations of the method that found the configuration"),
        *(_error_bound(name, each if name in _OF_PATH else member) for name in BOUNDED),
    )  # fmt: skip
    # Where an edge collapses the infimum is not attained, and its coefficients are not defined.
    growths = {*_growths(""), *bounds(_EXACT)}
    return tuple(
        replace(
            variable,
            comment=COMMENTS.get(variable.name, ""),
            undefined_at=(Status.edge_collapse,) if variable.name in growths else (),
        )
        for variable in rows
    )


def verify(ds):
    """A line for each stored configuration that the numbers next to it contradict."""
    parameters = parameters_of(ds)
    fit = parameters["fit_window"], parameters.get("fit_degree", 1)
    return contradictions(ds, ("seed", "population"), lambda one: _checks(one, *fit))


def _checks(one, window, degree):
    if not np.isfinite(one.residual):  # no configuration was found
        return
    sigma = one.sigma.values
    tension, force = sigma * one.length.values, np.abs(forces(one, bond_vectors(one))).max()
    yield from configuration_checks(one)
    yield (
        "residual",
        np.isclose(force / tension.mean(), one.residual, rtol=1e-3, atol=balance_error(one, tension) / tension.mean()),
    )
    yield "tension everywhere", int(one.status) != Status.ok or sigma.min() > 0
    yield "sigma", np.isclose(np.sum(sigma**2), len(sigma), rtol=1e-10)
    least = 1e-9 * np.abs(sigma).mean()
    for name, above in (("stressed_fraction", np.abs(sigma) > least), ("tension_fraction", sigma > least)):
        yield name, np.isclose(np.mean(above), one[name], rtol=1e-12)
    yield "energy along the path", not (np.diff(one.energy.values) < 0).any()
    for name, modulus in _FITTED.items():
        line = fitted(one.strain.values, one[modulus].values, window, degree)
        slope = f"{name}_fit"
        if np.isfinite(one[slope]):
            yield slope, np.allclose(line, (one[slope], one[f"{slope}_standard_error"]), rtol=1e-9)
            yield f"{slope}_deviation", np.isclose(one[slope] - one[name], one[f"{slope}_deviation"], equal_nan=True)
