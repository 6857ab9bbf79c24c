"""Linear elasticity of springs at rest, which resist a strain through their self-stresses.

With tensions t of all self-stresses (N_s, N_b) and affine extensions e_a = L·E_a L/|L|,
    V C_ab = (t e_a)ᵀ (t k⁻¹ tᵀ)⁻¹ (t e_b)  (`SelfStressModuli`).
Springs on the perimeters of faces have the extensions A e, with the sides A, and likewise for motions.

Small networks, and those of large contrast, are decomposed densely (`hierarchical_response`), which is accurate for any
stiffnesses; large ones of moderate contrast by the self-stresses that `rigidity` finds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from critflow.linalg.matrices import block_laplacian, edge_blocks, spread_columns
from critflow.linalg.tolerances import EPS
from critflow.networks.deformation import strain_basis
from critflow.networks.network import Array, Network
from critflow.response.linear_response import accumulated_rounding
from critflow.response.stiffness_contrast import hierarchical_response
from critflow.response.tensor import TRUSTED_ERROR, Elasticity, Errors, no_elasticity
from critflow.result import Solution, Stats, Status
from critflow.rigidity.counts import rigidity
from critflow.rigidity.spectrum import CLEAR_GAP, DENSE_EDGES, ZERO_MODE, rounding_note
from critflow.springs.tissue import FaceSprings

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
    """

    n_self_stresses: int


def response_at_rest(
    network: Network, coordinates: Array, volume: float, faces: FaceSprings | None = None
) -> ResponseAtRest:
    """Elasticity tensor of springs at rest at coordinates (N_v, d), any number of self-stresses and any stiffnesses.

    faces  whose perimeters are the springs; None: the edges are

    Errors (estimate) are those for the coordinates as given; singular values that are zero to the rounding of the
    coordinates count as zero.
    `Status.floppy` and zeros without self-stress, or where no strain loads one; `Status.singular` and NaN where that
    number is in doubt; `Status.ill_conditioned` and NaN where an error exceeds a tenth of the tensor, or a large
    network has a contrast of stiffness beyond the rounding of its compliance.
    """
    springs = _Springs.of(network, coordinates, faces)
    m, n_springs = springs.extension.shape[1], len(springs.stiffness)
    size = n_springs * network.dimension * len(network.free)
    moderate = springs.contrast <= MODERATE_CONTRAST and faces is None
    if n_springs <= DENSE_EDGES or (not moderate and size <= LARGEST_RESPONSE):
        found = _dense(springs, coordinates)
    elif moderate:
        found = _by_self_stresses(network, coordinates, springs)
    else:
        note = f"the stiffnesses differ by {springs.contrast:.1e}, too much for so large a network: remove the softest"
        found = _unknown(m, 0, Status.ill_conditioned, note if faces is None else "the tissue is too large for moduli")
    return _solution(springs, network.dimension, volume, found)


def _solution(springs: _Springs, d: int, volume: float, found: _Found) -> ResponseAtRest:
    status, note = found.status, found.note
    tensor, errors = found.factors.T @ found.factors / volume, (found.errors + found.errors.T) / (2 * volume)
    affine = (springs.extension.T * springs.stiffness) @ springs.extension / volume
    if status is Status.ok and errors.max() > TRUSTED_ERROR * np.abs(tensor).max():
        if springs.contrast * errors.max() <= EPS * np.abs(affine).max():
            # Self-stresses of small parts, which the boundary does not load: tensors of the size of squared roundings.
            status, note, tensor = Status.floppy, _LOCAL, np.zeros_like(tensor)
        else:
            status, note = Status.ill_conditioned, _ROUNDED
    value = no_elasticity(d, volume)
    if status in (Status.ok, Status.floppy):
        value = Elasticity(tensor, affine, np.zeros((d, d)), volume, Errors.of_tensor(errors, d))
    stats = Stats("self-stress", 1, residual=found.residual)
    return ResponseAtRest(value, status, stats, note, n_self_stresses=found.n_self_stresses)


@dataclass(frozen=True, eq=False)
class _Springs:
    """Springs at rest.

    directions  changes of length by unit motions, (n, d·n_free) sparse
    extension   by the strains of `strain_basis`, (n, m)
    errors      relative rounding of the directions, (n,)
    lengths     |L| of the edges, (N_b,)
    """

    directions: sp.csr_array
    extension: Array
    stiffness: Array
    errors: Array
    lengths: Array

    @classmethod
    def of(cls, network: Network, coordinates: Array, faces: FaceSprings | None) -> _Springs:
        L = network.bond_vectors(coordinates)
        length = np.linalg.norm(L, axis=1)
        extension = np.einsum("aei,ei->ea", L @ strain_basis(network.dimension)[1], L) / length[:, None]
        reach = float(max(np.abs(coordinates).max(), np.abs(network.boundary_vectors).max()))
        errors, directions = EPS * (2 + reach / length), spread_columns(network, L / length[:, None])
        if faces is None:
            return cls(directions, extension, network.stiffness, errors, length)
        A = faces.sides
        return cls(sp.csr_array(A @ directions), A @ extension, faces.stiffness, A @ errors, length)

    @property
    def contrast(self) -> float:
        """Ratio of the largest stiffness and the smallest."""
        return float(self.stiffness.max() / self.stiffness.min())


@dataclass(frozen=True, eq=False)
class _Found:
    """Factors (r, m) of V C and errors (m, m) of it."""

    factors: Array
    errors: Array
    n_self_stresses: int
    status: Status = Status.ok
    note: str = ""
    residual: float = np.nan


def _unknown(m: int, n_self_stresses: int, status: Status, note: str, residual: float = np.nan) -> _Found:
    return _Found(np.zeros((0, m)), np.zeros((m, m)), n_self_stresses, status, note, residual)


def _dense(springs: _Springs, coordinates: Array) -> _Found:
    """By a dense decomposition, for any contrast."""
    mean, k = float(springs.lengths.mean()), springs.stiffness
    found = hierarchical_response(springs.directions.toarray(), springs.extension / mean, k / k.max(), springs.errors)
    if np.isfinite(found.doubtful):
        note = rounding_note(coordinates, springs.lengths, found.doubtful) or _DOUBTFUL.format(found.doubtful)
        m = springs.extension.shape[1]
        return _unknown(m, found.n_self_stresses, Status.singular, note, found.largest_zero)
    status = Status.ok if found.n_self_stresses else Status.floppy
    unit = mean * np.sqrt(k.max())
    factors, errors = unit * found.factors, unit**2 * found.errors
    return _Found(factors, errors, found.n_self_stresses, status, residual=found.largest_zero)


def _by_self_stresses(network: Network, coordinates: Array, springs: _Springs) -> _Found:
    """By all self-stresses, for moderate contrast: V C = wᵀ (t k⁻¹ tᵀ)⁻¹ w with w = t e."""
    k, length, R, extension = springs.stiffness, springs.lengths, springs.directions, springs.extension
    counts = rigidity(network, coordinates)
    n_stresses = counts.value.n_self_stresses
    if not counts.ok:
        largest, smallest = counts.value.largest_zero, counts.value.smallest_nonzero
        note = counts.note
        if counts.status is Status.singular and np.isfinite(largest):
            near = max(largest, smallest if smallest < CLEAR_GAP * ZERO_MODE else 0.0)
            note = rounding_note(coordinates, length, near) or _DOUBTFUL.format(near)
        return _unknown(extension.shape[1], n_stresses, counts.status, note, counts.stats.residual)
    tensions = counts.value.self_stresses * length
    U = np.asarray(np.linalg.qr(tensions.T / np.sqrt(k)[:, None], mode="r"))
    factors = np.linalg.solve(U.T, tensions @ extension)
    loads = tensions.T @ np.linalg.solve(U, factors)

    # The motion that follows the strain; where tensions do not balance, it does work that is an error.
    n, L = network.n_edges, network.bond_vectors(coordinates)
    factor = block_laplacian(network).factorize(edge_blocks(np.ones(n), L / length[:, None], np.zeros(n)), _SHIFT)
    u = factor.solve(np.asarray(R.T @ (loads / k[:, None] - extension)))
    unbalanced = np.asarray(R.T @ loads)
    work = np.abs(unbalanced.T @ u) + np.linalg.norm(u, axis=0) * np.linalg.norm(unbalanced, axis=0)[:, None] * EPS
    rounding = springs.errors[:, None] * (abs(R) @ np.abs(u) + np.abs(extension))
    pairs = np.abs(loads).T[:, None] * (rounding + 8 * EPS * np.abs(loads) / k[:, None]).T
    errors = 2 * work + accumulated_rounding(pairs) + len(k) * EPS * np.abs(factors.T @ factors)
    factors = np.asarray(np.linalg.qr(factors, mode="r"))
    return _Found(factors, errors + errors.T, n_stresses, residual=counts.stats.residual)
