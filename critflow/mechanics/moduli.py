"""Elastic moduli by linear response at any strain, at the transition, and fits of their growth past it.

Conventions.  Strain γ is volumetric, V → V(1 + γ) with b → (1 + γ)^{1/d} b; strain ε is a pure shear, b → (1 + εA) b.
  bulk modulus                    B = V d²E/dV²
  shear modulus (energy)          G = (1/V) d²E/dε²
  shear modulus (stress-corrected)  G − ½ dE/dV
The moduli are relaxed: vertices follow the strain, μ_ab = (E_ab − Ξ_aᵀ H⁻¹ Ξ_b)/V.  Past the transition
B = B_0 + C_B γ and G = G_0 + C_G γ to first order (`ModulusStrainScaling`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.objectives import dilation, pure_shear, transition_modulus
from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.tolerances import EPS
from critflow.mechanics.laws import HOOKEAN, SpringLaw
from critflow.mechanics.springs import ElasticState, spring_state
from critflow.mechanics.tolerances import FLOPPY_SHIFT, TRUSTED_ERROR
from critflow.networks.network import Array, Network
from critflow.precision.residual import inverse_norm
from critflow.result import InputError, Solution, Stats, Status
from critflow.rigidity.counts import rigidity
from critflow.rigidity.uniqueness import require_only_self_stress

# Corrections of a relaxation below this part of it have converged; largest number of corrections.
_CONVERGED, _MOST_CORRECTIONS = 0.05, 4
# Relaxations below this part of the mean length are compared with it instead: all edges then respond affinely.
_NO_RELAXATION = 1e-5


@dataclass(frozen=True)
class Moduli:
    """Bulk and shear modulus in units of k (two dimensions), by the conventions of this module."""

    bulk: float
    shear: float
    shear_stress_corrected: float


NO_MODULI = Moduli(np.nan, np.nan, np.nan)
FLOPPY = Moduli(0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class LinearResponse(Solution[Moduli]):
    """Moduli of a state under stress.

    relaxation  dx/dγ (n_free, d) under dilation, relative to the affine motion; zero where it is not known
    floppy      whether floppy parts were regularised; they contribute nothing to the moduli
    n_negative  negative eigenvalues of the Hessian, 0 for a stable state
    """

    relaxation: Array = field(repr=False)
    floppy: bool = False
    n_negative: int = 0


@dataclass(frozen=True, kw_only=True)
class SelfStressModuli(Solution[Moduli]):
    """Moduli of a state at rest.

    n_self_stresses  independent self-stresses that resist the strain
    """

    n_self_stresses: int


@dataclass(frozen=True)
class Fit:
    """A least-squares polynomial in strain: value and slope at the transition with their standard errors."""

    value: float
    slope: float
    value_error: float
    slope_error: float


def linear_response(
    state: ElasticState,
    pattern: FixedPattern | None = None,
    exact: bool = False,
    factor: Factor | None = None,
) -> LinearResponse:
    """Moduli of springs under stress in equilibrium, and the relaxation dx/dγ (n_free, d) caused by dilation.

    With the total rates L̇ = A L + g u of bond vectors and ḣ = L·L̇,
        V μ = ḣᵀ K ḣ + Σ σ (|L̇|² + L·b̈)
    is minimal at the relaxation u, so that its errors enter squared only.

    exact   the state is the equilibrium to the rounding of its numbers, as Newton's method returns it; otherwise the
            exact equilibrium is found and the change of the moduli up to it is part of the error bound
    factor  of the Hessian at or near the state, if there is one

    Error bound (estimate): `stats.error_bound` limits the errors of the moduli against those of the exact equilibrium
    (see `equilibrium`); roundings are summed by `accumulated_rounding`.  `stats.condition` is ‖H‖‖H⁻¹‖.
    `Status.unstable` and NaN where the Hessian has negative eigenvalues: the springs then buckle under any strain.
    `Status.ill_conditioned` and NaN where a bound exceeds a tenth of the larger modulus.
    Floppy parts, such as slack ones, do not resist and contribute nothing.
    """
    pattern = pattern or state.pattern()
    # Without negative eigenvalues any factor near the state will do; convergence shows whether it is near enough.
    found = _responses(state, factor) if factor is not None and _taut(state) else None
    if factor is None or found is None or not found.converged:
        factor = state.factorize(pattern)
        found = _responses(state, factor) if factor.sound and not factor.n_negative else None
    floppy = found is None or not found.converged
    if floppy:
        factor = state.factorize(pattern, FLOPPY_SHIFT * state.stiffness_scale)
        if factor.indefinite:
            stats, nothing = Stats("linear response", 2), np.zeros_like(state.forces)
            return LinearResponse(NO_MODULI, Status.unstable, stats, relaxation=nothing, n_negative=factor.n_negative)
        found = _responses(state, factor)
    assert found is not None
    bounds = found.rounding if found.converged else None
    if bounds is not None and not exact:
        change = _change_to_equilibrium(state, factor, found, floppy)
        bounds = None if change is None else bounds + change
    condition = state.largest_stiffness * inverse_norm(factor, found.dilation.last)
    bound = Moduli(np.inf, np.inf, np.inf) if bounds is None else Moduli(*map(float, bounds))
    stats = Stats("linear response", 1, residual=found.residual, condition=condition, error_bound=bound)
    relaxation = found.dilation.relaxation
    if bounds is None or bounds.max() > TRUSTED_ERROR * np.abs(found.moduli[:2]).max():
        note = "the response to strain is lost in rounding: measure it further from the transition"
        return LinearResponse(NO_MODULI, Status.ill_conditioned, stats, note, relaxation=relaxation, floppy=floppy)
    value = Moduli(*map(float, found.moduli))
    return LinearResponse(value, Status.ok, stats, relaxation=relaxation, floppy=floppy)


@dataclass(frozen=True, eq=False)
class _Response:
    """Response to one strain: modulus, its rounding error, the relaxation u (n_free, d) and its last correction."""

    modulus: float
    rounding: float
    relaxation: Array
    last: Array
    residual: float
    converged: bool


@dataclass(frozen=True, eq=False)
class _Responses:
    """Moduli (3,) in the order of `Moduli` and their rounding errors, from the responses to dilation and shear."""

    moduli: Array
    rounding: Array
    dilation: _Response
    residual: float
    converged: bool


def _change_to_equilibrium(state: ElasticState, factor: Factor, found: _Responses, floppy: bool) -> Array | None:
    """Twice the change of the moduli (3,) from the state to the exact equilibrium; None where that is not found."""
    correction = state.exact_displacement(factor, regularised=floppy)
    if not np.isfinite(correction.remainder):
        return None
    apart = np.abs(correction.bond_vectors - state.bond_vectors)
    if not (apart > EPS * state.lengths[:, None]).any():
        return np.zeros(3)
    there = _responses(replace(state, bond_vectors=correction.bond_vectors), factor)  # type: ignore[type-var]
    return 2 * np.abs(there.moduli - found.moduli) if there.converged else None


def _responses(state: ElasticState, factor: Factor) -> _Responses:
    """The responses to dilation and shear by a factor of the Hessian, refined until corrections are small."""
    V, d = state.network.volume, state.network.dimension
    square = state.lengths**2
    # Dilation (1 + γ)^{1/d} is curved: b̈ = (1/d)(1/d − 1) b.
    bulk = _response(state, factor, dilation(d), (1 / d) * (1 / d - 1))
    shear = _response(state, factor, pure_shear(d), 0.0)
    pressure = float(state.sigma @ square) / (d * V)
    pressure_rounding = accumulated_rounding(2 * state.stress_rounding * square) / (d * V)
    corrected = shear.modulus - 0.5 * pressure
    rounding = shear.rounding + 0.5 * pressure_rounding + 4 * EPS * abs(pressure)
    return _Responses(
        np.array([bulk.modulus, shear.modulus, corrected]),
        np.array([bulk.rounding, shear.rounding, rounding]),
        bulk,
        max(bulk.residual, shear.residual),
        bulk.converged and shear.converged,
    )


def _response(state: ElasticState, factor: Factor, A: Array, curvature: float) -> _Response:
    """The response to the strain b → (1 + εA) b + ½ε² `curvature` b."""
    network, L, sigma, square = state.network, state.bond_vectors, state.sigma, state.lengths**2
    affine = L @ A
    u, scale = np.zeros_like(state.forces), 0.0
    for refinement in range(_MOST_CORRECTIONS + 1):
        rate = affine + network.free_incidence @ u
        hdot = np.einsum("ad,ad->a", L, rate)
        stress, energy = state.resistance(hdot)
        force = -(network.divergence @ (stress[:, None] * L + sigma[:, None] * rate))
        correction = factor.solve(force.ravel()).reshape(u.shape)
        gained = float(np.vdot(force, correction))
        u, moved = u + correction, float(np.abs(correction).max())
        size = float(np.abs(force).max())
        scale = max(scale, size)
        small = moved <= _CONVERGED * max(float(np.abs(u).max()), _NO_RELAXATION * state.length_scale)
        # The energy gained by the last correction estimates the remaining error, so it must be rounding.
        if refinement and small and abs(gained) <= 4 * EPS * energy:
            break
    speed = np.sqrt(np.einsum("ad,ad->a", rate, rate))
    modulus = (energy + float(sigma @ (speed**2 + curvature * square)) - gained) / network.volume
    noise = _edge_rounding(state, speed, u, stress, curvature)
    rounding = (accumulated_rounding(noise) + abs(gained)) / network.volume + 4 * EPS * abs(modulus)
    return _Response(modulus, rounding, u, correction, size / max(scale, 1e-300), small)


def _edge_rounding(state: ElasticState, speed: Array, u: Array, stress: Array, curvature: float) -> Array:
    """Rounding error of each edge's part of V μ, (N_b,).

    Sources: σ; rates |L̇| (N_b,) as differences of vertex velocities u, which may exceed them; products.
    """
    network, sigma, length = state.network, state.sigma, state.lengths
    vertex_speed = np.zeros(network.n_vertices)
    vertex_speed[network.free] = np.sqrt(np.einsum("id,id->i", u, u))
    rate_rounding = EPS * (speed + vertex_speed[network.edges].sum(axis=1) + length)
    noise = state.stress_rounding * (speed**2 + abs(curvature) * length**2)
    noise += 2 * (np.abs(stress) * length + np.abs(sigma) * speed) * rate_rounding
    noise += 4 * EPS * np.abs(sigma) * abs(curvature) * length**2
    return noise


def _taut(state: ElasticState) -> bool:
    """Whether no edge is compressed and no stiffness negative: then no eigenvalue of the Hessian is negative."""
    return bool((state.sigma >= 0).all() and (state.edge_stiffness >= 0).all())


def accumulated_rounding(errors: Array) -> float:
    """Error bound (estimate) of a sum whose terms have roundings of these magnitudes (n,): 3‖e‖₂ + ¼ Σ e.

    Independent roundings of mean zero add up to ‖e‖₂ or less (one standard deviation), so 3‖e‖₂ is exceeded in less
    than 1 % of sums.  On lattices symmetric edges round alike and their errors add coherently, of which ¼ Σ e allows
    for a quarter.  The rigorous bound Σ e exceeds typical errors by √n.
    """
    return 3 * float(np.linalg.norm(errors)) + 0.25 * float(errors.sum())


def transition_moduli(critical: CriticalConfiguration) -> Moduli:
    """B_0 and G_0 of a critical configuration, in the limit of zero stress (`BulkModulus`, `ShearModulus`).

    Raises `InputError` for configurations with several self-stresses, all of which contribute to the moduli, and where
    rounding hides their number.
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
    points than degree + 2 lie in the window: their standard error would be undefined.
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

    Stressed springs respond linearly (`LinearResponse`).  Springs at rest resist through their self-stresses S,
    μ_a = ḣ_aᵀ S (Sᵀ K⁻¹ S)⁻¹ Sᵀ ḣ_a/V (`SelfStressModuli`); without any the network is floppy: moduli exactly 0 and
    `Status.floppy`.  Raises `InputError` when the forces do not balance.
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
        return linear_response(state)
    counts = rigidity(network, x)
    n_stresses = counts.value.n_self_stresses
    if not counts.ok:
        value = FLOPPY if counts.status is Status.floppy else NO_MODULI
        return SelfStressModuli(value, counts.status, counts.stats, counts.note, n_self_stresses=n_stresses)
    L, S, d = state.bond_vectors, counts.value.self_stresses, network.dimension
    rates = (np.einsum("ad,ad->a", L, L @ A) for A in (dilation(d), pure_shear(d)))
    value = self_stress_moduli(S, np.sum(L**2, axis=1) / network.stiffness, rates, network.volume)
    stats = Stats("self-stress", 1, residual=counts.stats.residual)
    return SelfStressModuli(value, Status.ok, stats, n_self_stresses=n_stresses)


def self_stress_moduli(stresses: Array, flexibility: Array, rates: Iterable[Array], volume: float) -> Moduli:
    """Moduli at rest through self-stresses S (N_s, n), K⁻¹ (n,) and the rates (n,) of dilation and of shear."""
    compliance = (stresses * flexibility) @ stresses.T
    works = [stresses @ rate for rate in rates]
    bulk, shear = (float(work @ np.linalg.solve(compliance, work)) / volume for work in works)
    return Moduli(bulk, shear, shear)
