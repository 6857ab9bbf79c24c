"""Linear elasticity of springs at rest for any contrast of stiffness.

V ε·Cε = min_u Σ k (R u + e ε)²: a least-squares problem with weights k, rows R of the rigidity matrix and affine
extensions e.  With weights that span more than 1e16, rounding errors of stiff rows exceed soft rows entirely.  Here
edges are grouped by stiffness, and motions and strains are split into those that the stiffest group resists, those that
only the next one resists, and so on.  A motion of a later set leaves the edges of stiffer groups unchanged *exactly*:
these entries are set to zero, so that a stiff group exerts no rounding errors on soft motions.  In units of the
stiffness that first resists each motion the matrix is then well conditioned, for any contrast, and every energy
has a small relative error.

Motions and strains that a group resists to rounding only count as free of it, as in `rigidity`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg

from critflow.networks import Array
from critflow.numerics import EPS
from critflow.self_stress import CLEAR_GAP, ROUNDING_MARGIN, ZERO_MODE

# Stiffnesses within this factor are compared directly; beyond it motions that stiffer edges resist are separated from
# those that they do not.  Its square root enters rounding errors.
GROUP_CONTRAST = 1e3

# Rounding errors of a product with orthonormal vectors, in units of EPS, as observed up to 1,000 unknowns.
_PRODUCT = 8.0
# A strain that a group resists by less than this times the rounding may be free of it.
_CLEAR_STRAIN = 1e3


class FormAtRest(NamedTuple):
    """The tensor V C (m, m) of springs at rest, and what it is made of."""

    form: Array
    errors: Array  # of V C (estimate), (m, m)
    n_self_stresses: int  # independent self-stresses of all edges
    largest_zero: float  # largest singular value that counts as zero
    doubtful: float = np.nan  # a singular value that is neither zero to rounding nor clearly different; NaN without one


def hierarchical_response(R: Array, extension: Array, stiffness: Array, row_errors: Array) -> FormAtRest:
    """Response of springs with rigidity matrix R (N_b, n), affine extensions (N_b, m) and stiffness k (N_b,).

    row_errors  relative errors (N_b,) of the rows, by the rounding of the coordinates

    Errors (estimate): to first order, an error of a row changes the energy by tension times error times motion; the
    errors are those of the rows, of the products with the basis, and the entries that are set to zero.
    """
    order = np.argsort(-stiffness, kind="stable")
    R, extension, k, row_errors = R[order], extension[order], stiffness[order], row_errors[order]
    basis = _Basis(R, extension, _groups(k), ROUNDING_MARGIN * float(np.linalg.norm(row_errors)))
    return _solved(basis, R, extension, k, row_errors)


def _groups(stiffness: Array) -> list[slice]:
    """Ranges of edges, in descending order of stiffness, whose stiffness differs by less than a factor each."""
    starts = [0]
    for edge, k in enumerate(stiffness):
        if k < stiffness[starts[-1]] / GROUP_CONTRAST:
            starts.append(edge)
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], len(stiffness)], strict=True)]


class _Basis:
    """Motions and strains by the group that first resists them."""

    def __init__(self, R: Array, extension: Array, groups: list[slice], zero: float):
        n, m = R.shape[1], extension.shape[1]
        self.groups, self._zero = groups, zero
        self.largest_zero, self.doubtful = 0.0, np.nan
        free, strains, following = np.eye(n), np.eye(m), np.zeros((n, m))
        motions, resisted, followed, turned = [], [], [], []
        self.motion_groups: list[int] = []
        self.strain_groups: list[int] = []
        for number, group in enumerate(groups):
            left, values, right = _singular_values(R[group] @ free)
            rank = self._rank(values, CLEAR_GAP * ZERO_MODE)
            change = R[group] @ following + extension[group] @ strains
            amplitudes = left[:, :rank].T @ change
            # What no motion of this group's freedom compensates, it resists.
            rest = change - left[:, :rank] @ amplitudes
            _, sizes, directions = _singular_values(rest)
            n_resisted = self._rank(sizes / np.sqrt(len(rest)), _CLEAR_STRAIN * zero)
            resisted.append(strains @ directions[:n_resisted].T)
            followed.append(following @ directions[:n_resisted].T)
            # A strain that changes nothing stays apart exactly.
            mixed = np.abs(strains) @ rest.any(axis=0)
            turned.append(np.repeat(_PRODUCT * EPS * mixed[:, None], n_resisted, axis=1))
            left_over = directions[n_resisted:].T
            strains = strains @ left_over
            following = following @ left_over - free @ (
                right[:rank].T @ ((amplitudes @ left_over) / values[:rank, None])
            )
            motions.append(free @ right[:rank].T)
            free = free @ right[rank:].T
            self.motion_groups += [number] * rank
            self.strain_groups += [number] * n_resisted
        # Orthonormal, (n, r) and (m, s).
        self.motions, self.strains = np.hstack(motions), np.hstack(resisted)
        # Motions (n, s) that keep stiffer groups unchanged under these strains, and rounding of the strains, (m, s).
        self.following, self.strain_errors = np.hstack(followed), np.hstack(turned)

    def _rank(self, values: Array, clear: float) -> int:
        """The number of singular values that are not zero; records the largest zero and those that are not clear."""
        rank = int(np.count_nonzero(values > self._zero))
        if rank < len(values):
            self.largest_zero = max(self.largest_zero, float(values[rank]))
        if rank and values[rank - 1] < clear:
            self.doubtful = float(values[rank - 1])
        return rank


def _singular_values(matrix: Array) -> tuple[Array, Array, Array]:
    """U, s and Vᵀ with all right vectors, of a matrix that may be empty."""
    rows, columns = matrix.shape
    if not (rows and columns):
        return np.zeros((rows, 0)), np.zeros(0), np.eye(columns)
    left, values, right = np.linalg.svd(matrix, full_matrices=rows < columns)
    return left, values, right


def _solved(basis: _Basis, R: Array, extension: Array, k: Array, row_errors: Array) -> FormAtRest:
    """Least squares in the basis, in units of the stiffness that first resists each motion or strain."""
    group_of_row = np.repeat(np.arange(len(basis.groups)), [g.stop - g.start for g in basis.groups])
    scale = np.sqrt(np.array([k[g.start] for g in basis.groups]))
    motion_scale, strain_scale = scale[basis.motion_groups], scale[basis.strain_groups]
    earlier = group_of_row[:, None] < np.array(basis.motion_groups, int)
    columns = np.where(earlier, 0.0, R @ basis.motions) * (np.sqrt(k)[:, None] / motion_scale)
    earlier = group_of_row[:, None] < np.array(basis.strain_groups, int)
    change = np.where(earlier, 0.0, R @ basis.following + extension @ basis.strains)
    loads = change * (np.sqrt(k)[:, None] / strain_scale)
    Q, T = np.linalg.qr(columns)
    amplitudes = -scipy.linalg.solve_triangular(T, Q.T @ loads) if len(T) else np.zeros((0, loads.shape[1]))
    rest = loads + columns @ amplitudes
    factors_of_strains = np.linalg.qr(rest, mode="r") * strain_scale
    factors = factors_of_strains @ basis.strains.T

    # Errors in scaled strains: tension times the error of the change of length.
    u = basis.motions @ (amplitudes / motion_scale[:, None]) + basis.following / strain_scale
    reach = np.abs(R) @ np.abs(u) + np.abs(extension @ (basis.strains / strain_scale))
    drops = _PRODUCT * EPS + basis.largest_zero
    sizes = np.zeros((len(basis.groups), rest.shape[1]))
    for number in range(len(basis.groups)):
        moved = np.array(basis.motion_groups, int) <= number
        sizes[number] = np.linalg.norm(amplitudes[moved] / motion_scale[moved, None], axis=0)
        sizes[number] += np.linalg.norm(basis.following, axis=0) / strain_scale + 1 / strain_scale
    errors = row_errors[:, None] * reach + drops * sizes[group_of_row]
    errors = np.sqrt(k)[:, None] * errors + 4 * EPS * np.abs(rest)
    form = np.abs(rest).T @ errors
    form = (form + form.T) * np.outer(strain_scale, strain_scale)
    # An error of the directions of the strains gives a small component of the tensor a part of the large ones.
    size, turned = np.abs(basis.strains), basis.strain_errors
    scaled = np.abs(factors_of_strains).T @ np.abs(factors_of_strains)
    mixed = size @ scaled @ turned.T
    total = size @ form @ size.T + mixed + mixed.T + turned @ scaled @ turned.T
    n_self_stresses = len(k) - basis.motions.shape[1]
    return FormAtRest(factors.T @ factors, total, n_self_stresses, basis.largest_zero, basis.doubtful)
