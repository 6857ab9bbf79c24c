"""Elastic moduli by linear response at any strain, and how they grow past the transition, exactly and by fits.

Conventions.  Strain γ is volumetric, V → V(1 + γ) with b → (1 + γ)^{1/d} b; strain ε is a pure shear, b → (1 + εA) b.
  bulk modulus                    B = V d²E/dV²
  shear modulus (energy)          G = (1/V) d²E/dε²
  shear modulus (stress-corrected)  G − ½ dE/dV
The moduli are relaxed: vertices follow the strain, μ_ab = (E_ab − Ξ_aᵀ H⁻¹ Ξ_b)/V.  Past the transition
B = B_0 + C_B γ and G = G_0 + C_G γ to first order (`ModulusStrainScaling`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.objectives import dilation, pure_shear, transition_modulus
from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.tolerances import EPS
from critflow.mechanics.laws import HOOKEAN, SpringLaw
from critflow.mechanics.springs import FLOPPY_REST, ElasticState, spring_state
from critflow.networks.network import Array, Network
from critflow.precision.residual import inverse_norm
from critflow.result import InputError, Solution, Stats, Status
from critflow.rigidity.counts import rigidity
from critflow.rigidity.uniqueness import require_only_self_stress


@dataclass(frozen=True)
class Moduli:
    """Bulk and shear modulus in units of k (two dimensions), by the conventions of this module."""

    bulk: float
    shear: float
    shear_stress_corrected: float


@dataclass(frozen=True)
class Fit:
    """A least-squares polynomial in strain: value and slope at the transition with their standard errors."""

    value: float
    slope: float
    value_error: float
    slope_error: float


# Corrections of relaxations below this part of them have settled; so many are tried.
_SETTLED, _REFINEMENTS = 0.05, 4
# Largest error bound, in units of the larger modulus, of a modulus that is given.
_TRUSTED = 0.1

_NO_MODULI = Moduli(np.nan, np.nan, np.nan)
FLOPPY = Moduli(0.0, 0.0, 0.0)


def linear_response(
    state: ElasticState,
    pattern: FixedPattern | None = None,
    exact: bool = False,
    factor: Factor | None = None,
) -> tuple[Solution[Moduli], Array]:
    """Moduli of springs under stress in equilibrium, and the relaxation dx/dγ (n_free, d) that dilation causes.

    With the total rates L̇ = A L + g u of bond vectors and ḣ = L·L̇,
        V μ = ḣᵀ K ḣ + Σ σ (|L̇|² + L·b̈)
    is least at the relaxation u, so that its errors count by their square alone.

    exact  the state is that of equilibrium to the rounding of its numbers, as Newton's method leaves it; if this is
    not known, the exact equilibrium is found to tell how much the moduli change on the way

    `stats.error_bound` bounds the errors of the moduli against those of the exact equilibrium (see `equilibrium`);
    `stats.condition` is ‖H‖‖H⁻¹‖.
    `Status.unstable` and NaN where the Hessian has negative eigenvalues: the springs then buckle under any strain.
    `Status.ill_conditioned` and NaN where a bound exceeds a tenth of the larger modulus.
    Parts that are floppy, as slack ones are, do not resist and take no share; `stats.details["floppy"]` says so.
    """
    pattern = pattern or state.pattern()
    # Where no eigenvalue can be negative any factor will do; whether it is near enough shows.
    found = _responses(state, factor) if factor is not None and _taut(state) else None
    if factor is None or found is None or not found.settled:
        factor = state.factorize(pattern)
        found = _responses(state, factor) if factor.sound and not factor.n_negative else None
    floppy = found is None or not found.settled
    if floppy:
        factor = state.factorize(pattern, FLOPPY_REST * state.stiffness_scale)
        if factor.indefinite:
            stats = Stats("linear response", 2, 2, details={"negative_pivots": factor.n_negative})
            return Solution(_NO_MODULI, Status.unstable, stats), np.zeros_like(state.forces)
        found = _responses(state, factor)
    assert found is not None
    bounds, sure = found.rounding, found.settled
    if not exact:
        way = state.distance(factor, held=floppy)
        apart = np.abs(way.bond_vectors - state.bond_vectors)
        sure = sure and np.isfinite(way.remainder)
        if sure and (apart > EPS * state.lengths[:, None]).any():
            there = _responses(replace(state, bond_vectors=way.bond_vectors), factor)  # type: ignore[type-var]
            bounds = bounds + 2 * np.abs(there.moduli - found.moduli)
            sure = there.settled
    condition = state.largest_stiffness * inverse_norm(factor, found.last)
    details: dict[str, bool | str] = {"floppy": floppy}
    if not sure or bounds.max() > _TRUSTED * np.abs(found.moduli[:2]).max():
        details["note"] = "the response to strain is lost in rounding: measure it further from the transition"
        value, status = _NO_MODULI, Status.ill_conditioned
    else:
        value, status = Moduli(*map(float, found.moduli)), Status.ok
    bound = Moduli(*map(float, bounds)) if sure else Moduli(np.inf, np.inf, np.inf)
    stats = Stats("linear response", 1, 1, found.residual, details, condition, bound)
    return Solution(value, status, stats), found.relaxation


@dataclass(frozen=True)
class _Responses:
    """Moduli (3,), what rounding may have done to them, the relaxation by dilation and its last correction."""

    moduli: Array
    rounding: Array
    relaxation: Array
    last: Array
    residual: float
    settled: bool


def _responses(state: ElasticState, factor: Factor) -> _Responses:
    """The answers to dilation and shear by a factor of the Hessian, refined until corrections are small."""
    network, L, sigma, length = state.network, state.bond_vectors, state.sigma, state.lengths
    V, d = network.volume, network.dimension
    square = length**2
    # dilation has a second derivative of its own, (1 + γ)^{1/d} being curved: b̈ = (1/d)(1/d − 1) b.
    curvatures = ((1 / d) * (1 / d - 1), 0.0)
    moduli, rounding, residual, settled = np.empty(3), np.empty(3), 0.0, True
    for n, (A, curvature) in enumerate(zip((dilation(d), pure_shear(d)), curvatures, strict=True)):
        affine = L @ A
        u, scale = np.zeros_like(state.forces), 0.0
        for refinement in range(_REFINEMENTS + 1):
            rate = affine + network.free_incidence @ u
            hdot = np.einsum("ad,ad->a", L, rate)
            stress, energy = state.resistance(hdot)
            force = -(network.divergence @ (stress[:, None] * L + sigma[:, None] * rate))
            correction = factor.solve(force.ravel()).reshape(u.shape)
            gained = float(np.vdot(force, correction))
            u, moved = u + correction, float(np.abs(correction).max())
            size = float(np.abs(force).max())
            scale = max(scale, size)
            # Where all follows affinely there is next to no relaxation to compare with.
            small = moved <= _SETTLED * max(float(np.abs(u).max()), 1e-5 * state.length_scale)
            # What is gained must not be more than rounding, for it is all that is known of what is missing.
            if refinement and small and abs(gained) <= 4 * EPS * energy:
                break
        settled = settled and small
        residual = max(residual, size / max(scale, 1e-300))
        speed = np.sqrt(np.einsum("ad,ad->a", rate, rate))
        moduli[n] = (energy + float(sigma @ (speed**2 + curvature * square)) - gained) / V
        # Of each edge: the roundings of σ, of the rates from vertices that move further than edges do, of products.
        vertex_speed = np.zeros(network.n_vertices)
        vertex_speed[network.free] = np.sqrt(np.einsum("id,id->i", u, u))
        slip = EPS * (speed + vertex_speed[network.edges].sum(axis=1) + length)
        noise = state.stress_rounding * (speed**2 + abs(curvature) * square)
        noise += 2 * (np.abs(stress) * length + np.abs(sigma) * speed) * slip
        noise += 4 * EPS * np.abs(sigma) * abs(curvature) * square
        rounding[n] = (together(noise) + abs(gained)) / V + 4 * EPS * abs(moduli[n])
        if n == 0:
            relaxation, last = u, correction
    pressure = float(sigma @ square) / (d * V)
    moduli[2] = moduli[1] - 0.5 * pressure
    rounding[2] = rounding[1] + 0.5 * together(2 * state.stress_rounding * square) / (d * V) + 4 * EPS * abs(pressure)
    return _Responses(moduli, rounding, relaxation, last, residual, settled)


def _taut(state: ElasticState) -> bool:
    """Whether nothing pushes, and nothing yields as it is stretched: then no eigenvalue of the Hessian is negative."""
    return bool((state.sigma >= 0).all() and (state.edge_stiffness >= 0).all())


def together(errors: Array) -> float:
    """A bound on the sum of as many roundings: they add up like random numbers, or on lattices some of them alike."""
    return 3 * float(np.linalg.norm(errors)) + 0.25 * float(errors.sum())


def transition_moduli(critical: CriticalConfiguration) -> Moduli:
    """B_0 and G_0 of a critical configuration, where the stress is about to appear (`BulkModulus`, `ShearModulus`).

    Raises `InputError` for configurations with several self-stresses, where one does not tell how the others answer,
    and where rounding hides how many there are.
    """
    require_only_self_stress(critical, "use elastic_moduli(network, coordinates), which takes all of them")
    network, d = critical.network, critical.network.dimension
    bulk, shear = (
        transition_modulus(network, A).evaluate(critical.sigma, critical.bond_vectors)[0]
        for A in (dilation(d), pure_shear(d))
    )
    return Moduli(bulk, shear, shear)


def fit_stiffening(strains: ArrayLike, moduli: ArrayLike, window: float = np.inf, degree: int = 1) -> Fit:
    """Least-squares polynomial of a modulus over 0 ≤ γ ≤ window; its slope at γ = 0 is C with a standard error.

    A straight line over a window w has a bias of order w, a parabola of order w².  Raises `InputError` where fewer
    points than degree + 2 lie in the window: there would be no error to state.
    """
    gamma, values = np.asarray(strains, dtype=float), np.asarray(moduli, dtype=float)
    if gamma.ndim != 1 or gamma.shape != values.shape:
        raise InputError(
            f"strains and moduli must be lists of one length, not of shapes {gamma.shape} and {values.shape}"
        )
    inside = (gamma >= 0) & (gamma <= window * (1 + 1e-12))
    gamma, values = gamma[inside], values[inside]
    if len(gamma) < degree + 2:
        raise InputError(
            f"a fit of degree {degree} needs {degree + 2} strains in its window, not {len(gamma)}: widen it"
        )
    if not np.isfinite(values).all():
        return Fit(np.nan, np.nan, np.nan, np.nan)
    # Scaled strains keep the normal equations well conditioned.
    scale = float(gamma.max())
    design = np.vander(gamma / scale, degree + 1, increasing=True)
    coefficients, *_ = np.linalg.lstsq(design, values, rcond=None)
    residual = values - design @ coefficients
    variance = float(residual @ residual) / (len(gamma) - degree - 1)
    error = np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))
    return Fit(float(coefficients[0]), float(coefficients[1]) / scale, float(error[0]), float(error[1]) / scale)


def elastic_moduli(
    network: Network,
    coordinates: ArrayLike,
    rest_lengths: ArrayLike | None = None,
    tolerance: float = 1e-9,
    *,
    law: SpringLaw = HOOKEAN,
) -> Solution[Moduli]:
    """Relaxed B and G of springs at coordinates (N_v, d) in equilibrium, on either side of the transition.

    rest_lengths  ℓ (N_b,); None: the springs are at rest

    Stressed springs answer by linear response.  Springs at rest answer through their self-stresses S,
    μ_a = ḣ_aᵀ S (Sᵀ K⁻¹ S)⁻¹ Sᵀ ḣ_a/V; without any the network is floppy: moduli exactly 0 and `Status.floppy`.
    Raises `InputError` when the forces do not balance.
    """
    x = np.asarray(coordinates, dtype=float)
    at_rest = np.linalg.norm(network.bond_vectors(x), axis=1)
    state = spring_state(network, at_rest if rest_lengths is None else rest_lengths, x, law)
    stress = float(np.max(np.abs(state.sigma) / network.stiffness))
    if state.max_force > tolerance * float(np.mean(network.stiffness) * np.mean(state.lengths)):
        raise InputError(
            f"the springs are not in equilibrium, a force of {state.max_force:.2g} is left: call equilibrium() first"
        )
    if stress > tolerance:
        return linear_response(state)[0]
    counts = rigidity(network, x)
    if counts.status is not Status.ok:
        return Solution(FLOPPY if counts.status is Status.floppy else _NO_MODULI, counts.status, counts.stats)
    L, S, d = state.bond_vectors, counts.value.self_stresses, network.dimension
    rates = (np.einsum("ad,ad->a", L, L @ A) for A in (dilation(d), pure_shear(d)))
    value = self_stress_moduli(S, np.sum(L**2, axis=1) / network.stiffness, rates, network.volume)
    return Solution(value, Status.ok, Stats("self-stress", 1, 1, counts.stats.residual))


def self_stress_moduli(stresses: Array, flexibility: Array, rates: Iterable[Array], volume: float) -> Moduli:
    """Moduli at rest through self-stresses S (N_s, n), K⁻¹ (n,) and the rates (n,) of dilation and of shear."""
    compliance = (stresses * flexibility) @ stresses.T
    works = [stresses @ rate for rate in rates]
    bulk, shear = (float(work @ np.linalg.solve(compliance, work)) / volume for work in works)
    return Moduli(bulk, shear, shear)
