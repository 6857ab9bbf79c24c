"""Systems of stresses and displacements by the saddle matrix [[P ⊗ 1, Rᵀ], [R, 0]].

With P = gᵀ diag(σ) g and R = g L, the equations are  P u + Rᵀ λ = f,  R u = e  for displacements u (n_free, d) and edge
multipliers λ (N_b,).  R has a left null vector, the self-stress σ: the second equation needs a consistent e, and λ is
defined up to a multiple of σ.

The matrix is factorised with a small −δ in place of its zero block, which iteration on the residuals removes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from critflow.networks import Array, Network
from critflow.sparse import Entries, Factor, FixedPattern, end_pairs, free_ends

REFINED = 1e-15  # relative residual at which a refinement is complete
# −δ on the diagonal of the multipliers of a saddle matrix, in units of 1/⟨|σ|⟩: it makes the matrix quasi-definite, so
# that any ordering factorises it, and refinement removes it.
REGULARISATION = 1e-7
STABLE_MARGIN = 1e-7  # part of the mean stress by which P must be positive on the zero modes to count as stable
# Most refinements of one saddle system; a step that does not reduce the residual by CONTRACTION ends it.
MOST_REFINEMENTS = 30
CONTRACTION = 0.9  # reduction of the residual by a refinement that counts


def positive(sigma: Array, margin: float = STABLE_MARGIN) -> bool:
    """Whether every stress is positive, by `margin` times the mean."""
    return bool((sigma > margin * np.mean(np.abs(sigma))).all())


class Saddle:
    """The saddle matrix of one network, quasi-definite by −δ on the diagonal of the multipliers.

    Each row of R is divided by the length of its edge, or rounding would hide the equations of the shortest edges.
    """

    def __init__(self, network: Network, backend: str = "auto"):
        d, n_edges = network.dimension, network.n_edges
        n_coordinates = d * len(network.free)
        self._shape = (len(network.free), d)

        def entries() -> Iterator[Entries]:
            for axis in range(d):
                for i, j, edge, sign in end_pairs(network):
                    yield d * i + axis, d * j + axis, edge, sign
                for end, sign in zip(free_ends(network).T, (-1.0, 1.0), strict=True):
                    edge = np.flatnonzero(end >= 0)
                    yield d * end[edge] + axis, n_coordinates + edge, n_edges * (1 + axis) + edge, sign

        self.pattern = FixedPattern(n_coordinates + n_edges, n_edges * (1 + d), entries(), backend, d > 2)

    def factorize(
        self,
        sigma: Array,
        bond_vectors: Array,
        regularisation: float = REGULARISATION,
        compliance: Array | None = None,
    ) -> SaddleFactor:
        """The factor at stresses σ (N_b,) and bond vectors L (N_b, d), with δ in units of 1/⟨|σ|⟩.

        A compliance C (N_b,) makes R u = e the equations R u − C λ = e; iteration does not remove it.
        """
        shift = self._shifts(sigma, regularisation)
        length = np.linalg.norm(bond_vectors, axis=1)
        compliances = np.zeros(self.pattern.size)
        if compliance is not None:
            compliances[self._shape[0] * self._shape[1] :] = compliance / _divisors(length) ** 2
        scale = np.full(self.pattern.size, float(np.mean(length)))
        scale[: self._shape[0] * self._shape[1]] = float(np.mean(np.abs(sigma) * length))
        factor = self.pattern.factorize(self._values(sigma, bond_vectors), shift - compliances)
        return SaddleFactor(factor, shift, sigma / np.linalg.norm(sigma), scale, _divisors(length))

    def stable(self, sigma: Array, bond_vectors: Array, margin: float = STABLE_MARGIN) -> bool:
        """Whether P is positive on the null space of R, by `margin` times the mean stress.

        Then exactly the multipliers give negative pivots.  A positive stress needs no factorisation.
        """
        if positive(sigma, margin):
            return True
        n_coordinates = self._shape[0] * self._shape[1]
        shift = self._shifts(sigma)
        shift[:n_coordinates] = -margin * float(np.mean(np.abs(sigma)))
        factor = self.pattern.factorize(self._values(sigma, bond_vectors), shift)
        return factor.sound and factor.n_negative == self.pattern.size - n_coordinates

    def _shifts(self, sigma: Array, regularisation: float = REGULARISATION) -> Array:
        shift = np.zeros(self.pattern.size)
        shift[self._shape[0] * self._shape[1] :] = -regularisation / (self._shape[1] * float(np.mean(np.abs(sigma))))
        return shift

    def _values(self, sigma: Array, bond_vectors: Array) -> Array:
        directions = bond_vectors / _divisors(np.linalg.norm(bond_vectors, axis=1))[:, None]
        return np.concatenate([sigma, directions.T.ravel()])


@dataclass(frozen=True, eq=False)
class SaddleFactor:
    """A factorised saddle matrix at one σ and L.

    factor   of the matrix with the regularisation
    shift    the regularisation of each row, (n,)
    null     σ/|σ|, (N_b,)
    scale    size of the terms that cancel in the residual of each row, (n,); the right-hand side itself may vanish
    divisor  lengths that divide the rows of R, (N_b,)
    """

    factor: Factor
    shift: Array
    null: Array
    scale: Array
    divisor: Array

    def solve(self, forces: Array, elongations: Array, tolerance: float = REFINED) -> tuple[Array, Array, float]:
        """u, λ of P u + Rᵀ λ = forces (n_free, d), R u = elongations (N_b,), and the relative residual.

        The component of the elongations along σ, which no displacement gives, is ignored.
        """
        consistent = elongations - (self.null @ elongations) * self.null
        borders = np.zeros((0, len(elongations)))
        u, multipliers, _, error = self.solve_bordered(forces, consistent, borders, tolerance=tolerance)
        return u, multipliers, error

    def solve_bordered(
        self,
        forces: Array,
        elongations: Array,
        borders: Array,
        corner: Array | None = None,
        sums: Array | None = None,
        tolerance: float = REFINED,
        max_refinements: int = MOST_REFINEMENTS,
    ) -> tuple[Array, Array, Array, float]:
        """u, λ, y of P u + Rᵀ λ = forces (n_free, d), R u + Bᵀ y = elongations (N_b,), B λ + C y = sums (k,).

        These are steps of Newton's method with k further unknowns y, such as a factor of the lengths or a strain, whose
        changes of |L|²/2 are the borders B (k, N_b).  Before convergence R has no left null vector, only a nearly null
        one; the borders then keep the system well-conditioned.  The corner C (k, k) and the sums are zero if not given.
        One refinement alone leaves the regularisation in place.  The last value is the relative residual.
        """
        k, n_coordinates = len(borders), forces.size
        border = np.zeros((k, n_coordinates + len(elongations)))
        border[:, n_coordinates:] = borders / self.divisor
        right = np.concatenate([forces.ravel(), elongations / self.divisor])
        corner, sums = np.zeros((k, k)) if corner is None else corner, np.zeros(k) if sums is None else sums
        through = np.array([self.factor.solve(row) for row in border]).reshape(border.shape)
        schur = border @ through.T - corner
        solution, y, best = np.zeros_like(right), np.zeros(k), np.inf
        residual, sum_residual = right, sums
        for _ in range(max_refinements):
            change = self.factor.solve(residual)
            trial, trial_y = solution + change, y
            if k:
                step = np.linalg.solve(schur, border @ change - sum_residual)
                trial, trial_y = trial - step @ through, y + step
            residual = right - self.factor.multiply(trial) + self.shift * trial
            if k:
                residual -= trial_y @ border
                sum_residual = sums - border @ trial - corner @ trial_y
            error = float(np.max(np.abs(residual) / self.scale))
            if not error < CONTRACTION * best:
                break
            solution, y, best = trial, trial_y, error
            if error < tolerance:
                break
        return solution[:n_coordinates].reshape(forces.shape), solution[n_coordinates:] / self.divisor, y, best


def _divisors(length: Array) -> Array:
    """Divisors of the rows of R; the row of an edge without length is zero."""
    return np.where(length > 0, length, 1.0)
