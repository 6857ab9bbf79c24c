"""Linear response of springs under stress: relaxations and elasticity with error estimates.

With the total rates L̇_a = E_a L + g u_a of bond vectors under a strain E_a and ḣ_a = L·L̇_a,
    V C_ab = ḣ_aᵀ K ḣ_b + Σ σ L̇_a·L̇_b
is stationary at the relaxations u, so that their errors enter as products (`LinearResponse`).

The strains are dilation, deviators and shears (`unit_strains`), each with a separate relaxation, so that the bulk
modulus is not a difference of larger numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.tolerances import EPS
from critflow.linalg.vectors import product
from critflow.networks.deformation import strain_basis, strain_components
from critflow.networks.network import Array
from critflow.precision.residual import inverse_norm
from critflow.response.tensor import TRUSTED_ERROR, Elasticity, Errors, no_elasticity
from critflow.result import InputError, Solution, Stats, Status
from critflow.springs.minimum import stability_of
from critflow.springs.newton import FLOPPY_SHIFT
from critflow.springs.state import SpringState, times

# Corrections of a relaxation below this part of it have converged; largest number of corrections.
_CONVERGED, _MOST_CORRECTIONS = 0.05, 4
# The contraction of corrections is that observed between two of them times this margin.
_CONTRACTION_MARGIN = 10.0
# Relaxations below this part of the mean length are compared with it instead: all edges then respond affinely.
_NO_RELAXATION = 1e-5


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LinearResponse(Solution[Elasticity]):
    """The elasticity of a state under stress and the responses to strains.

    strains, responses  rows n of `unit_strains`, and dx/dε (n, d, n_free) under them; no rows where not known
    """

    strains: tuple[int, ...]
    responses: Array = field(repr=False)

    def relaxation(self, strain: Array) -> Array:
        """dx/dε (n_free, d) under a strain of components (m,) in `strain_basis`, relative to the affine motion."""
        weights = (basis_change(self.value.dimension) @ strain)[list(self.strains)]
        return (weights @ self.responses.reshape(len(weights), -1)).reshape(self.responses.shape[1:]).T


def linear_response(
    state: SpringState,
    volume: float,
    pattern: FixedPattern | None = None,
    exact: bool = False,
    factor: Factor | None = None,
    condition: bool = True,
    strains: tuple[int, ...] | None = None,
) -> LinearResponse:
    """Elasticity of springs under stress in equilibrium, and the relaxations that strains cause.

    volume     V, to which the moduli refer
    exact      the state is the equilibrium to the rounding of its numbers, as Newton's method returns it; otherwise the
               exact equilibrium is found and the change of the moduli up to it is part of the errors
    factor     of the Hessian at or near the state, if there is one
    condition  whether `stats.condition`, ‖H‖‖H⁻¹‖, is computed, which costs a solve; else it is NaN
    strains    rows of `unit_strains`, such as those of `strains_of`; responses to all others are zero in the result

    Errors (estimate) are those against the exact equilibrium (see `equilibrium`); roundings are summed by
    `accumulated_rounding`.
    `Status.unstable` and NaN where the Hessian has negative eigenvalues: the springs then buckle under any strain;
    `Status.undecided` and NaN where rounding hides whether it has.
    `Status.ill_conditioned` and NaN where an error exceeds a tenth of the larger modulus.
    Floppy parts, such as slack ones, do not resist and contribute nothing.
    """
    d = state.network.dimension
    if d < 2:
        raise InputError("a shear needs at least two dimensions")
    pattern, strains = pattern or state.pattern(), strains or tuple(range(len(unit_strains(d))))
    # Without negative eigenvalues any factor near the state will do; convergence shows whether it is near enough.
    found = _responses(state, factor, volume, strains) if factor is not None and not state.softens else None
    if factor is None or found is None or not found.converged:
        factor = state.factorize(pattern)
        found = _responses(state, factor, volume, strains) if factor.sound and not factor.n_negative else None
    floppy = found is None or not found.converged
    if floppy:
        factor = state.factorize(pattern, FLOPPY_SHIFT * state.stiffness_scale)
        # The shift hides eigenvalues that compression makes negative but small.
        stable, note = (Status.unstable, "") if factor.indefinite else stability_of(state, pattern)
        if stable is not Status.ok:
            nothing, stats = np.zeros((0, d, len(state.network.free))), Stats("linear response", 2)
            return LinearResponse(no_elasticity(d, volume), stable, stats, note, strains=(), responses=nothing)
        found = _responses(state, factor, volume, strains)
    assert found is not None
    errors: Errors | None = found.elasticity.errors if found.converged else None
    if errors is not None and not exact:
        change = _change_to_equilibrium(state, factor, found, floppy, volume, strains)
        errors = change and errors.plus(change)
    number = state.largest_stiffness * inverse_norm(factor, found.last) if condition else np.nan
    stats = Stats("linear response", 1, residual=found.residual, condition=number)
    value, status, note = found.elasticity, Status.ok, ""
    trusted = TRUSTED_ERROR * max(abs(value.bulk), abs(value.shear))
    if errors is None or max(errors.bulk, errors.shear, errors.shear_stress_corrected) > trusted:
        value, status = no_elasticity(d, volume, np.inf), Status.ill_conditioned
        note = "rounding errors exceed a tenth of the response to strain: measure it further from the transition"
    elif not exact:
        value = replace(value, errors=errors)
    return LinearResponse(value, status, stats, note, strains=strains, responses=found.relaxations)


# Strains


@cache
def unit_strains(dimension: int) -> Array:
    """Strains (m, d, d): dilation 1/d, deviators e_i e_iᵀ − 1/d of all axes but the last, shears in Voigt's order."""
    basis, unit = strain_basis(dimension)[1], np.eye(dimension) / dimension
    return np.concatenate([unit[None], basis[: dimension - 1] - unit, basis[dimension:]])


@cache
def basis_change(dimension: int) -> Array:
    """T (m, m): the strain a of `strain_basis` is Σ_n T_na `unit_strains`_n."""
    units = np.array([strain_components(E) for E in unit_strains(dimension)])
    return np.rint(np.linalg.inv(units).T)  # of whole numbers


def strains_of(rates: Array) -> tuple[int, ...]:
    """Rows of `unit_strains` for the moduli, dilation and the last shear, and for rates A (n, d, d) of a cell."""
    d = rates.shape[1]
    parts = np.array([basis_change(d) @ strain_components(0.5 * (A + A.T)) for A in rates])
    last = parts.shape[1] - 1
    return tuple(n for n in range(last + 1) if n in (0, last) or parts[:, n].any())


@cache
def stress_products(dimension: int) -> Array:
    """Sums of the entries of |E_a||E_b|, (m, m): the effect of an error of the stress on its terms."""
    basis = np.abs(strain_basis(dimension)[1])
    return np.einsum("aij,bjk->ab", basis, basis)


# Responses


@dataclass(frozen=True, eq=False)
class _Responses:
    """Responses to all strains, from one factor.

    elasticity         with rounding errors
    relaxations  u (m, d, n_free) under `unit_strains`
    last         the last correction of the first of them, (n_free·d,)
    """

    elasticity: Elasticity
    relaxations: Array
    last: Array
    residual: float
    converged: bool


def _change_to_equilibrium(
    state: SpringState, factor: Factor, found: _Responses, floppy: bool, volume: float, strains: tuple[int, ...]
) -> Errors | None:
    """Twice the change of the elasticity up to the exact equilibrium; None where that is not found."""
    correction = state.exact_displacement(factor, regularised=floppy)
    if not np.isfinite(correction.remainder):
        return None
    here = found.elasticity
    apart = np.abs(correction.bond_vectors - state.bond_vectors)
    if not (apart > EPS * state.lengths[:, None]).any():
        return Errors(np.zeros_like(here.tensor), 0.0, 0.0, 0.0)
    moved = replace(state, bond_vectors=correction.bond_vectors)
    responses = _responses(moved, factor, volume, strains)
    if not responses.converged:
        return None
    there = responses.elasticity
    return Errors(
        2 * np.abs(there.tensor - here.tensor),
        2 * abs(there.bulk - here.bulk),
        2 * abs(there.shear - here.shear),
        2 * abs(there.shear_stress_corrected - here.shear_stress_corrected),
    )


def _responses(state: SpringState, factor: Factor, volume: float, strains: tuple[int, ...]) -> _Responses:
    """The responses to some rows of `unit_strains` by a factor of the Hessian, refined until corrections are small.

    The first of them is the dilation, the last one the last shear.
    """
    network, sigma = state.network, state.sigma
    d, m, n = network.dimension, len(strains), network.n_edges
    # Edges are the last axis: NumPy is several times slower where that is short.
    L, K = np.ascontiguousarray(state.bond_vectors.T), state.modified_stiffness
    affine = (unit_strains(d)[list(strains)].reshape(m * d, d) @ L).reshape(m, d, n)
    divergence, incidence = network.divergence, network.free_incidence
    rate, direct, least = affine, np.zeros((m, m)), _NO_RELAXATION * state.length_scale
    u, scale, energy = np.zeros((m, d * len(network.free))), np.zeros(m), np.zeros(m)
    for refinement in range(_MOST_CORRECTIONS + 1):
        hdot = np.add.reduce(L * rate, axis=1)
        tension = times(K, hdot)
        stressed = sigma * rate
        pulls = tension[:, None] * L + stressed
        # The forces of all strains in one product.
        force = -product(divergence, pulls.reshape(m * d, n).T)
        force = force.reshape(-1, m, d).swapaxes(0, 1).reshape(m, -1)
        stretching = hdot @ tension.T
        form = stretching + stressed.reshape(m, -1) @ rate.reshape(m, -1).T
        direct = direct if refinement else form
        correction = np.array([factor.solve(each) for each in force])
        gained = force @ correction.T
        size, u = _largest(force), u + correction
        scale = np.maximum(scale, size)
        small = bool((_largest(correction) <= _CONVERGED * np.maximum(_largest(u), least)).all())
        before, energy = energy, np.abs(gained.diagonal())
        # The energy that a correction leaves is its gain times the contraction, and must be rounding.
        unfinished = energy * _contraction(energy, before)
        if refinement and small and (unfinished <= 4 * EPS * stretching.diagonal()).all():
            break
        motion = u.reshape(m, -1, d).swapaxes(0, 1).reshape(-1, m * d)
        rate = affine + np.ascontiguousarray(product(incidence, motion).T).reshape(m, d, n)
    relaxations = u.reshape(m, -1, d).swapaxes(1, 2)
    speed = np.sqrt(np.add.reduce(rate * rate, axis=1))
    noise, first = _rounding(state, speed, relaxations, tension)
    unfinished = np.sqrt(np.outer(unfinished, unfinished))
    return _Responses(
        _elasticity(state, volume, strains, (form - gained, direct), (noise, unfinished), first),
        relaxations,
        correction[0],
        float((size / np.maximum(scale, 1e-300)).max()),
        small,
    )


def _elasticity(
    state: SpringState,
    volume: float,
    strains: tuple[int, ...],
    forms: tuple[Array, Array],
    errors: tuple[Array, Array],
    first: Array,
) -> Elasticity:
    """Tensor, moduli and their errors from V C_ab (m, m), relaxed and affine, rounding and unfinished relaxation.

    first  parts (N_b,) of the rounding of the first form, that of the dilation
    """
    (noise, unfinished), d, form = errors, state.network.dimension, forms[0] / volume
    sigma, square, L = state.sigma, state.lengths**2, state.bond_vectors.T
    form_rounding = (noise + unfinished) / volume + 4 * EPS * np.abs(form)
    T, stress = basis_change(d)[list(strains)], (sigma * L) @ L.T / volume
    stress_rounding = float(accumulated_rounding(2 * state.stress_rounding * square)) / volume
    # Dilation (1 + γ)^{1/d} is curved: b̈ = (1/d)(1/d − 1) b.
    trace, curvature = float(sigma @ square) / volume, (1 / d) * (1 / d - 1)
    bulk = float(form[0, 0] + curvature * trace)
    stretched = first + (state.stress_rounding + 4 * EPS * np.abs(sigma)) * abs(curvature) * square
    bulk_rounding = (float(accumulated_rounding(stretched)) + float(unfinished[0, 0])) / volume + 4 * EPS * abs(bulk)
    shear_rounding = float(form_rounding[-1, -1])
    corrected_rounding = shear_rounding + 0.5 * stress_rounding / d + 4 * EPS * abs(trace / d)
    tensor = T.T @ form @ T
    rounding = np.abs(T).T @ form_rounding @ np.abs(T) + 4 * EPS * np.abs(tensor)
    rounding += (stress_rounding + 4 * EPS * float(np.abs(stress).max())) * stress_products(d)
    bounds = Errors(0.5 * (rounding + rounding.T), bulk_rounding, shear_rounding, corrected_rounding)
    return Elasticity(tensor, T.T @ forms[1] @ T / volume, stress, volume, bounds, bulk)


def _contraction(energy: Array, before: Array) -> float:
    """The part of an error that a correction leaves, from the energies (m,) of two; at most 1.

    The largest of all strains with a margin, since the first correction may shrink faster than those after it.
    """
    positive = before > 0
    ratio = float(np.maximum.reduce(np.where(positive, energy, 1.0) / np.where(positive, before, 1.0)))
    return min(1.0, _CONTRACTION_MARGIN * float(np.sqrt(ratio)))


def _rounding(state: SpringState, speed: Array, u: Array, tension: Array) -> tuple[Array, Array]:
    """Rounding errors of V C_ab, (m, m), and the parts (N_b,) of the first one.

    Sources: σ; rates |L̇| (m, N_b) as differences of vertex velocities u (m, d, n_free), which may exceed them; products
    with K ḣ (m, N_b).
    """
    network, sigma, length = state.network, np.abs(state.sigma), state.lengths
    vertex_speed = np.zeros((len(u), network.n_vertices))
    vertex_speed[:, network.free_rows] = np.sqrt(np.add.reduce(u * u, axis=1))
    tail, head = np.ascontiguousarray(network.edges.T)
    rate_rounding = EPS * (speed + vertex_speed.take(tail, 1) + vertex_speed.take(head, 1) + length)
    pull = np.abs(tension) * length + sigma * speed
    loose = state.stress_rounding * speed
    mixed = _accumulated_products(pull, rate_rounding)
    return _accumulated_products(loose, speed) + mixed + mixed.T, loose[0] * speed[0] + 2 * pull[0] * rate_rounding[0]


def _accumulated_products(one: Array, other: Array) -> Array:
    """`accumulated_rounding` of all products of rows of two arrays (m, n) without negative entries, (m, m)."""
    return np.asarray(3 * np.sqrt(one**2 @ (other**2).T) + 0.25 * one @ other.T)


def _largest(vectors: Array) -> Array:
    """Largest component of each of the vectors (m, n), (m,)."""
    return np.maximum.reduce(np.abs(vectors), axis=-1, initial=0.0)


def accumulated_rounding(errors: Array) -> Any:
    """Error (estimate) of sums whose terms have roundings of these magnitudes (..., n): 3‖e‖₂ + ¼ Σ e.

    Independent roundings of mean zero add up to ‖e‖₂ or less (one standard deviation), so 3‖e‖₂ is exceeded in less
    than 1 % of sums.  On lattices symmetric edges round alike and their errors add coherently, of which ¼ Σ e allows
    for a quarter.  The rigorous bound Σ e exceeds typical errors by √n.
    """
    return 3 * np.sqrt(np.add.reduce(errors * errors, axis=-1)) + 0.25 * np.add.reduce(errors, axis=-1)
