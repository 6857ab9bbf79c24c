"""Linear elasticity of springs at rest, which resist a strain through their self-stresses.

With tensions t of all self-stresses (N_s, N_b) and affine extensions e_a = L·E_a L/|L|,
    V C_ab = (t e_a)ᵀ (t k⁻¹ tᵀ)⁻¹ (t e_b)  (`SelfStressModuli`).
One self-stress has rank one, V C = S ⊗ S/D with S = Σ σ L ⊗ L and D = Σ σ²|L|²/k.

Small networks, and those of large contrast, are decomposed densely (`hierarchical_response`), which is accurate for any
stiffnesses; large ones of moderate contrast by the self-stresses that `rigidity` finds.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.transition import TransitionModulus
from critflow.linalg.matrices import block_laplacian, edge_blocks, spread_columns
from critflow.linalg.tolerances import EPS
from critflow.networks.deformation import strain_basis
from critflow.networks.network import Array, Network
from critflow.response.elasticity import TRUSTED_ERROR, Elasticity, no_elasticity
from critflow.response.moduli_bounds import transition_modulus_bound
from critflow.response.response import accumulated_rounding
from critflow.response.stiffness_contrast import hierarchical_response
from critflow.result import Solution, Stats, Status
from critflow.rigidity.counts import rigidity
from critflow.rigidity.spectrum import CLEAR_GAP, DENSE_EDGES, ZERO_MODE, rounding_note

# Up to this contrast the self-stresses of a large network give its moduli with the rounding errors of their
# compliance, which grow with it.
MODERATE_CONTRAST = 1e6
# Entries of the rigidity matrix up to which networks of larger contrast are decomposed densely.
LARGEST_RESPONSE = 6_000_000

# Shift of RᵀR that excludes floppy motions, in units of its squared singular values.
_SHIFT = 1e-9
_DOUBTFUL = (
    "a singular value of {:.1e} of the rigidity matrix is neither zero to rounding nor far from it, so the number of "
    "self-stresses is not certain: move the configuration"
)

_LOCAL = "no strain loads the self-stresses of the network, so every modulus is zero to rounding: strain it to rigidity"
_ROUNDED = "rounding errors exceed a tenth of the response to strain: use coordinates near zero"


@dataclass(frozen=True, kw_only=True)
class ResponseAtRest(Solution[Elasticity]):
    """Elasticity of springs at rest.

    n_self_stresses  independent self-stresses; those that no strain excites contribute nothing
    factors          (r, m) with V C = factorsᵀ factors; one row S/√D for a single self-stress
    """

    n_self_stresses: int
    factors: Array = field(repr=False)


def response_at_rest(network: Network, coordinates: Array, volume: float) -> ResponseAtRest:
    """Elasticity tensor of springs at rest at coordinates (N_v, d), any number of self-stresses and any stiffnesses.

    Error bound (estimate): `bounds` of the tensor, for the coordinates as given; singular values that are zero to the
    rounding of the coordinates count as zero.
    `Status.floppy` and zeros without self-stress, or where no strain loads one; `Status.singular` and NaN where that
    number is in doubt; `Status.ill_conditioned` and NaN where a bound exceeds a tenth of the tensor, or a large network
    has a contrast of stiffness beyond the rounding of its compliance.
    """
    L = network.bond_vectors(coordinates)
    length, k = np.linalg.norm(L, axis=1), network.stiffness
    basis = strain_basis(network.dimension)[1]
    extension = np.einsum("aei,ei->ea", L @ basis, L) / length[:, None]
    size = network.n_edges * network.dimension * len(network.free)
    contrast = float(k.max() / k.min())
    if network.n_edges <= DENSE_EDGES or (MODERATE_CONTRAST < contrast and size <= LARGEST_RESPONSE):
        found = _dense(network, coordinates, L, extension)
    elif contrast <= MODERATE_CONTRAST:
        found = _by_self_stresses(network, coordinates, L, extension)
    else:
        note = f"the stiffnesses differ by {contrast:.1e}, too much for so large a network: remove the softest edges"
        found = _unknown(len(basis), 0, Status.ill_conditioned, note)
    return _solution(network, extension, volume, found)


def _solution(network: Network, extension: Array, volume: float, found: _Found) -> ResponseAtRest:
    d, m = network.dimension, extension.shape[1]
    stats = Stats("self-stress", 1, residual=found.residual)
    tensors, status, note, factors = no_elasticity(d, volume), found.status, found.note, found.factors
    energy, bounds = factors.T @ factors / volume, (found.bounds + found.bounds.T) / (2 * volume)
    affine = (extension.T * network.stiffness) @ extension / volume
    if status is Status.ok and bounds.max() > TRUSTED_ERROR * np.abs(energy).max():
        contrast = float(network.stiffness.max() / network.stiffness.min())
        if contrast * bounds.max() <= EPS * np.abs(affine).max():
            # Self-stresses of small parts, which the boundary does not load: tensors of the size of squared roundings.
            status, note, energy, factors = Status.floppy, _LOCAL, np.zeros_like(energy), factors[:0]
        else:
            status, note = Status.ill_conditioned, _ROUNDED
    if status in (Status.ok, Status.floppy):
        symmetric = 0.5 * (energy + energy.T)
        tensors = Elasticity(symmetric, 0.5 * (affine + affine.T), np.zeros((d, d)), volume, bounds)
    else:
        factors = np.full((0, m), np.nan)
    return ResponseAtRest(tensors, status, stats, note, n_self_stresses=found.n_self_stresses, factors=factors)


def transition_elasticity(critical: CriticalConfiguration, volume: float, roundings: int = 1) -> ResponseAtRest:
    """The tensor of rank one of a critical configuration with one self-stress, V C = S ⊗ S/D.

    roundings  how often σ was scaled
    """
    sigma, L, k = critical.sigma, critical.bond_vectors, critical.network.stiffness
    basis = strain_basis(critical.network.dimension)[1]
    m = len(basis)
    work = np.einsum("e,ei,aij,ej->a", sigma, L, basis, L, optimize=True)
    factors = (work / np.sqrt(sigma**2 @ (critical.lengths**2 / k)))[None]

    def bound(strain: Array) -> float:
        return transition_modulus_bound(TransitionModulus(strain), critical, roundings)

    # Products of two components are half the differences of squares of their sums.
    single = np.array([bound(strain) for strain in basis])
    bounds = np.diag(single)
    for a in range(m):
        for b in range(a):
            bounds[a, b] = bounds[b, a] = 0.5 * (bound(basis[a] + basis[b]) + single[a] + single[b])
    energy = factors.T @ factors / volume
    bounds = bounds + 8 * EPS * np.abs(energy)
    rates = np.einsum("ei,aij,ej->ae", L, basis, L, optimize=True)
    affine = (rates * (k / critical.lengths**2)) @ rates.T / volume
    nothing = np.zeros((critical.network.dimension,) * 2)
    value = Elasticity(energy, 0.5 * (affine + affine.T), nothing, volume, bounds)
    stats = Stats("transition", residual=critical.residual, error_bound=bounds)
    return ResponseAtRest(value, Status.ok, stats, n_self_stresses=1, factors=factors)


def joined_responses(parts: list[ResponseAtRest]) -> ResponseAtRest:
    """The response of parts that have no vertex in common: tensors add up, and the first failure decides the status."""
    values = [part.value for part in parts]
    value = Elasticity(
        np.sum([one.energy for one in values], axis=0),
        np.sum([one.affine_energy for one in values], axis=0),
        np.zeros_like(values[0].stress),
        values[0].volume,
        np.sum([one.bounds for one in values], axis=0),
    )
    failed = [one for one in parts if not (one.ok or one.status is Status.floppy)]
    worst = (failed or [one for one in parts if one.ok] or parts)[0]
    return ResponseAtRest(
        value,
        worst.status,
        Stats("sum over the taut parts", len(parts), error_bound=value.bounds),
        worst.note,
        n_self_stresses=sum(one.n_self_stresses for one in parts),
        factors=np.vstack([one.factors for one in parts]),
    )


@dataclass(frozen=True, eq=False)
class _Found:
    """Factors (r, m) of V C and error bounds (m, m) of it."""

    factors: Array
    bounds: Array
    n_self_stresses: int
    status: Status = Status.ok
    note: str = ""
    residual: float = np.nan


def _unknown(m: int, n_self_stresses: int, status: Status, note: str, residual: float = np.nan) -> _Found:
    return _Found(np.zeros((0, m)), np.zeros((m, m)), n_self_stresses, status, note, residual)


def _dense(network: Network, coordinates: Array, L: Array, extension: Array) -> _Found:
    """By a dense decomposition, for any contrast."""
    length = np.linalg.norm(L, axis=1)
    mean, k = float(length.mean()), network.stiffness
    R = spread_columns(network, L / length[:, None]).toarray()
    found = hierarchical_response(R, extension / mean, k / k.max(), _row_errors(network, coordinates, length))
    if np.isfinite(found.doubtful):
        note = rounding_note(coordinates, length, found.doubtful) or _DOUBTFUL.format(found.doubtful)
        return _unknown(extension.shape[1], found.n_self_stresses, Status.singular, note, found.largest_zero)
    status = Status.ok if found.n_self_stresses else Status.floppy
    unit = mean * np.sqrt(k.max())
    return _Found(
        _oriented(unit * found.factors),
        unit**2 * found.bounds,
        found.n_self_stresses,
        status,
        residual=found.largest_zero,
    )


def _by_self_stresses(network: Network, coordinates: Array, L: Array, extension: Array) -> _Found:
    """By all self-stresses, for moderate contrast: V C = wᵀ (t k⁻¹ tᵀ)⁻¹ w with w = t e."""
    m, k, length = extension.shape[1], network.stiffness, np.linalg.norm(L, axis=1)
    counts = rigidity(network, coordinates)
    n_stresses = counts.value.n_self_stresses
    if not counts.ok:
        largest, smallest = counts.value.largest_zero, counts.value.smallest_nonzero
        note = counts.note
        if counts.status is Status.singular and np.isfinite(largest):
            near = max(largest, smallest if smallest < CLEAR_GAP * ZERO_MODE else 0.0)
            note = rounding_note(coordinates, length, near) or _DOUBTFUL.format(near)
        return _unknown(m, n_stresses, counts.status, note, counts.stats.residual)
    tensions = counts.value.self_stresses * length
    U = np.asarray(np.linalg.qr(tensions.T / np.sqrt(k)[:, None], mode="r"))
    factors = np.linalg.solve(U.T, tensions @ extension)
    loads = tensions.T @ np.linalg.solve(U, factors)

    # The motion that follows the strain; where tensions do not balance, it does work that is an error.
    pattern, n = block_laplacian(network), network.n_edges
    R = spread_columns(network, L / length[:, None])
    factor = pattern.factorize(edge_blocks(np.ones(n), L / length[:, None], np.zeros(n)), _SHIFT)
    change = loads / k[:, None] - extension
    u = factor.solve(np.asarray(R.T @ change))
    unbalanced = np.asarray(R.T @ loads)
    work = np.abs(unbalanced.T @ u) + np.linalg.norm(u, axis=0) * np.linalg.norm(unbalanced, axis=0)[:, None] * EPS
    errors = _row_errors(network, coordinates, length)[:, None] * (abs(R) @ np.abs(u) + np.abs(extension))
    pairs = np.abs(loads).T[:, None] * (errors + 8 * EPS * np.abs(loads) / k[:, None]).T
    bounds = 2 * work + accumulated_rounding(pairs) + len(k) * EPS * np.abs(factors.T @ factors)
    return _Found(
        _oriented(np.asarray(np.linalg.qr(factors, mode="r"))),
        bounds + bounds.T,
        n_stresses,
        residual=counts.stats.residual,
    )


def _row_errors(network: Network, coordinates: Array, length: Array) -> Array:
    """Relative errors (N_b,) of directions by the rounding of coordinates and products."""
    reach = float(max(np.abs(coordinates).max(), np.abs(network.boundary_vectors).max()))
    return EPS * (2 + reach / length)


def _oriented(factors: Array) -> Array:
    """Factors whose stress has a positive trace where there is a single one."""
    return -factors if len(factors) == 1 and factors[0, : factors.shape[1] // 2 + 1].sum() < 0 else factors
