"""Linear elasticity of springs at rest, which resist a strain through their self-stresses.

With affine extensions e_a = L·E_a L/|L| and the rigidity matrix R,
    V ε·Cε = min_u Σ k (e ε + R u)²,
to which only the self-stresses contribute, the tensions k (e ε + R u) of the minimum (`SelfStressModuli`).
Springs on the perimeters of faces have the extensions A e, with the sides A, and likewise for motions
(`FaceSprings.of_edges`).

Springs of moderate contrast are solved by the normal equations, refined on their residual: the number of self-stresses
is that of `Spectrum`, and none of them is computed.  Those of large contrast, and tissues, are decomposed densely
(`hierarchical_response`), which is accurate for any stiffnesses.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from critflow.deformation import strain_basis
from critflow.linear_response import (
    TRUSTED_ERROR,
    Elasticity,
    Errors,
    LinearResponse,
    accumulated_rounding,
    no_elasticity,
)
from critflow.networks import Array, Network
from critflow.numerics import EPS
from critflow.result import Stats, Status
from critflow.self_stress import CLEAR_GAP, ZERO_MODE, Spectrum, edge_without_length
from critflow.sparse import edge_blocks, spread_columns
from critflow_extras.pruning.digits import rounding_note
from critflow_extras.rest.stiffness_contrast import FormAtRest, hierarchical_response

# Up to this contrast the normal equations resolve both the softest springs and the stiffest.
MODERATE_CONTRAST = 1e6
# Entries of the rigidity matrix up to which networks of larger contrast are decomposed densely.
LARGEST_RESPONSE = 6_000_000

# Shift of Rᵀ k R in units of the largest k, which stops floppy motions and which corrections remove; most corrections,
# and the decrease of their work that shows that they converge.
_SHIFT, _MOST_CORRECTIONS, _DECREASE = 1e-12, 20, 0.25
_PROBES = 8  # random null vectors that estimate the largest singular value of all
_DOUBTFUL = (
    "a singular value of {:.1e} of the rigidity matrix is neither zero to rounding nor far from it, so the number of "
    "self-stresses is not certain: move the configuration"
)

_LOCAL = "no strain loads the self-stresses of the network, so every modulus is zero to rounding: strain it to rigidity"
_ROUNDED = "rounding errors exceed a tenth of the response to strain: use coordinates near zero"


class Springs(NamedTuple):
    """Springs at rest."""

    directions: sp.csr_array  # changes of length by unit motions, (n, d·n_free) sparse
    extension: Array  # by the strains of `strain_basis`, (n, m)
    stiffness: Array
    errors: Array  # relative rounding of the directions, (n,)


def response_at_rest(
    network: Network,
    coordinates: Array,
    volume: float,
    perimeters: Callable[[Springs], Springs] | None = None,
) -> LinearResponse:
    """Elasticity tensor of springs at rest at coordinates (N_v, d), any number of self-stresses and any stiffnesses.

    perimeters  the springs on perimeters of faces from those on edges; None: the edges are the springs

    Errors (estimate) are those for the coordinates as given; singular values that are zero to the rounding of the
    coordinates count as zero.
    `Status.floppy` and zeros without self-stress, or where no strain loads one; `Status.singular` and NaN where that
    number is in doubt, or an edge has no length; `Status.ill_conditioned` and NaN where an error exceeds a tenth of the
    tensor, or a large network has a contrast of stiffness beyond the rounding of the normal equations.
    """
    d = network.dimension

    def without_value(status: Status, note: str, solved: FormAtRest | None = None) -> LinearResponse:
        n_self_stresses, residual = (solved.n_self_stresses, solved.largest_zero) if solved else (0, np.nan)
        value, stats = no_elasticity(d, volume), Stats("self-stress", 1, residual=residual)
        return LinearResponse(value, status, stats, note, n_self_stresses=n_self_stresses)

    L = network.bond_vectors(coordinates)
    length = np.linalg.norm(L, axis=1)
    if note := edge_without_length(length):
        return without_value(Status.singular, note)
    edges = _springs(network, coordinates, L, length)
    springs = perimeters(edges) if perimeters else edges
    contrast = float(springs.stiffness.max() / springs.stiffness.min())
    if contrast <= MODERATE_CONTRAST and springs is edges:
        solved = _by_motions(network, coordinates, springs)
    elif len(springs.stiffness) * d * len(network.free) <= LARGEST_RESPONSE:
        solved = _by_groups(springs, float(length.mean()))
    else:
        note = f"the stiffnesses differ by {contrast:.1e}, too much for so large a network: remove the softest"
        return without_value(Status.ill_conditioned, "the tissue is too large for moduli" if perimeters else note)
    if np.isfinite(solved.doubtful):
        note = rounding_note(coordinates, length, solved.doubtful) or _DOUBTFUL.format(solved.doubtful)
        return without_value(Status.singular, note, solved)
    tensor, errors = solved.form / volume, (solved.errors + solved.errors.T) / (2 * volume)
    affine = (springs.extension.T * springs.stiffness) @ springs.extension / volume
    status, note = Status.ok if solved.n_self_stresses else Status.floppy, ""
    if status is Status.ok and errors.max() > TRUSTED_ERROR * np.abs(tensor).max():
        if contrast * errors.max() > EPS * np.abs(affine).max():
            return without_value(Status.ill_conditioned, _ROUNDED, solved)
        # Self-stresses of small parts, which the boundary does not load: tensors of the size of squared roundings.
        status, note, tensor = Status.floppy, _LOCAL, np.zeros_like(tensor)
    bulk = float(tensor[:d, :d].sum()) / d**2
    value = Elasticity(tensor, affine, np.zeros((d, d)), volume, errors_of(errors, d), bulk)
    stats = Stats("self-stress", 1, residual=solved.largest_zero)
    return LinearResponse(value, status, stats, note, n_self_stresses=solved.n_self_stresses)


def errors_of(tensor: Array, dimension: int) -> Errors:
    """The errors of the moduli, which are sums over the tensor, by those of the tensor, (m, m)."""
    bulk, shear = float(tensor[:dimension, :dimension].sum()) / dimension**2, float(tensor[-1, -1])
    return Errors(tensor, bulk, shear, shear)


def _springs(network: Network, coordinates: Array, L: Array, length: Array) -> Springs:
    """The springs on edges."""
    extension = np.einsum("aei,ei->ea", L @ strain_basis(network.dimension)[1], L) / length[:, None]
    directions = spread_columns(network, L / length[:, None])
    # Roundings of differences to the grounded vertex, of their differences g x, of the sums g x + b, and of directions.
    g, b = network.free_incidence, network.boundary_vectors
    x = coordinates if network.pins else coordinates - coordinates[0]
    rounded = (abs(g) @ np.abs(x[network.free])) * (not network.pins and bool(coordinates[0].any()))
    rounded += np.where(b != 0, np.abs(g @ x[network.free]), 0.0)
    errors = EPS * (2 + 0.5 * np.linalg.norm(rounded, axis=1) / length)
    return Springs(directions, extension, network.stiffness, errors)


def _by_groups(springs: Springs, mean: float) -> FormAtRest:
    """By a dense decomposition, for any contrast and springs of this mean length."""
    k = springs.stiffness
    solved = hierarchical_response(springs.directions.toarray(), springs.extension / mean, k / k.max(), springs.errors)
    unit = mean**2 * k.max()
    return solved._replace(form=unit * solved.form, errors=unit * solved.errors)


def _by_motions(network: Network, coordinates: Array, springs: Springs) -> FormAtRest:
    """By the motions u that follow the strains, for moderate contrast: V C = rᵀ k r, r = e + R u, Rᵀ k r = 0.

    An error of u changes V C by its square, which the work of the last correction estimates.
    """
    k, R, extension, spectrum = springs.stiffness, springs.directions, springs.extension, Spectrum(network, coordinates)
    n_stresses = network.n_edges - spectrum.n_coordinates + spectrum.n_motions
    m, largest = extension.shape[1], _largest_zero(spectrum, n_stresses)
    nothing = np.zeros((m, m))
    if spectrum.doubt(largest, spectrum.gap[1]):
        near = max(largest, spectrum.gap[1] if spectrum.gap[1] < CLEAR_GAP * ZERO_MODE else 0.0)
        return FormAtRest(nothing, nothing, n_stresses, largest, near)
    if not n_stresses:
        return FormAtRest(nothing, nothing, 0, largest)
    blocks = edge_blocks(k, spectrum.bond_vectors / spectrum.lengths[:, None], np.zeros(network.n_edges))
    factor = spectrum.pattern.factorize(blocks, _SHIFT * float(k.max()))
    u, work = np.zeros((R.shape[1], m)), np.full(m, np.inf)
    for _ in range(_MOST_CORRECTIONS):
        tension = k[:, None] * (extension + R @ u)
        force = np.asarray(R.T @ tension)
        change = factor.solve(force)
        before, work = work, np.abs(np.einsum("na,na->a", force, change))
        if not (work < _DECREASE * before).any():
            break
        u -= change
    rounding = (
        springs.errors[:, None] * (abs(R) @ np.abs(u) + np.abs(extension)) + 4 * EPS * np.abs(tension) / k[:, None]
    )
    # Tensions that vanish are rounding themselves, and squared.
    errors = 2 * accumulated_rounding(np.abs(tension).T[:, None] * rounding.T) + (k[:, None] * rounding).T @ rounding
    errors += 2 * np.sqrt(np.outer(work, work))
    # Sums over the last axis are pairwise, so that their rounding is that of their terms.
    form = np.sum(tension.T[:, None] * (tension / k[:, None]).T, axis=-1)
    return FormAtRest(form, errors, n_stresses, largest)


def _largest_zero(spectrum: Spectrum, n_stresses: int) -> float:
    """The largest singular value that counts as zero: of large networks an estimate from a few null vectors.

    Tensions and motions share their singular values, so the smaller null space has all that matter.  A value of one
    of its n vectors appears in p random ones reduced by √(p/n), to a factor of ten or so.
    """
    count = min(n_stresses, spectrum.n_motions)
    if spectrum.dense or not count:
        return spectrum.gap[0]
    probes = min(count, _PROBES)
    return spectrum.null_vectors(probes, n_stresses < spectrum.n_motions)[1] * float(np.sqrt(count / probes))
