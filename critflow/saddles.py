"""Systems of stresses and displacements: the saddle matrix [[P ⊗ 1, Rᵀ], [R, 0]], by two strategies.

With P = gᵀ diag(σ) g and R = g L, the equations are  P u + Rᵀ λ = f,  R u = e  for displacements u (n_free, d) and edge
multipliers λ (N_b,).  R has a left null vector, the self-stress σ: the second equation needs a consistent e, and λ is
defined up to a multiple of σ.

`Saddle` factorises the matrix itself, with a small −δ in place of its zero block; it serves stresses of any sign.

`CondensedSaddle` eliminates the multipliers, for σ > 0.  With a small compliance 1/w,  R u − λ/w = e,  the equations
are (P ⊗ 1 + Rᵀ w R) u = f + Rᵀ w e,  λ = w (R u − e).  That matrix has the pattern of the elastic Hessian, d·n_free
unknowns in place of d·n_free + N_b, and is positive definite.

Either removes its regularisation by iteration on the residuals of the saddle system; for the compliance this is the
method of multipliers (Hestenes; Powell, 1969).  Each step gains 1/w times the least stiffness that the constraints add.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from critflow.networks import Array, Network
from critflow.numerics import MOST_REFINEMENTS, REGULARISATION, STABLE_MARGIN, dot
from critflow.sparse import Entries, Factor, FixedPattern, block_laplacian, edge_blocks, end_pairs, free_ends

# w |L|² of a condensed system in units of ⟨|σ|⟩.  The gap of R closes as 1/N_v: 1e8 takes 3 refinements at 1,000
# vertices and at 1,000,000.
CONDENSED_WEIGHT = 1e8
REFINED = 1e-15  # relative residual at which a refinement is complete
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
                    yield Entries(d * i + axis, d * j + axis, edge, sign)
                for end, sign in zip(free_ends(network).T, (-1.0, 1.0), strict=True):
                    edge = np.flatnonzero(end >= 0)
                    yield Entries(d * end[edge] + axis, n_coordinates + edge, n_edges * (1 + axis) + edge, sign)

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


class CondensedSaddle:
    """The same systems for σ > 0, through the matrix P ⊗ 1 + Rᵀ w R."""

    def __init__(self, network: Network, backend: str = "auto"):
        self._network = network
        self.pattern = block_laplacian(network, backend)

    def factorize(self, sigma: Array, bond_vectors: Array) -> CondensedFactor:
        """The factor at stresses σ > 0 (N_b,) and bond vectors L (N_b, d)."""
        square = dot(bond_vectors, bond_vectors)
        # Relative to |L|²: directions count, or rounding would hide the equations of short edges.
        weight = CONDENSED_WEIGHT * float(np.mean(np.abs(sigma))) / square
        factor = self.pattern.factorize(edge_blocks(weight, bond_vectors, sigma))
        return CondensedFactor(self._network, factor, sigma, bond_vectors, np.sqrt(square), weight)


@dataclass(frozen=True, eq=False)
class CondensedFactor:
    """A factorised condensed matrix at σ (N_b,) and L (N_b, d), with lengths |L| and weights w (N_b,)."""

    network: Network
    factor: Factor
    sigma: Array
    bond_vectors: Array
    lengths: Array
    weight: Array

    def solve(self, forces: Array, elongations: Array, tolerance: float = REFINED) -> tuple[Array, Array, float]:
        """As `SaddleFactor.solve`."""
        L, w = self.bond_vectors, self.weight
        g, divergence = self.network.free_incidence, self.network.divergence
        # Residuals are relative to the size of the terms that cancel in them.
        force_scale = float(np.mean(np.abs(self.sigma) * self.lengths))
        length_scale = float(np.mean(self.lengths))
        null = self.sigma / np.linalg.norm(self.sigma)
        elongations = elongations - (null @ elongations) * null
        u, multipliers, best = np.zeros_like(forces), np.zeros_like(elongations), np.inf
        force, elongation = forces, elongations
        for _ in range(MOST_REFINEMENTS):
            right = force + divergence @ ((w * elongation)[:, None] * L)
            step = self.factor.solve(right.ravel()).reshape(forces.shape)
            new_u = u + step
            new_multipliers = multipliers + w * (dot(L, g @ step) - elongation)
            rates = g @ new_u
            elongation = elongations - dot(L, rates)
            force = forces - divergence @ (self.sigma[:, None] * rates + new_multipliers[:, None] * L)
            missing = float(np.abs(elongation / self.lengths).max())
            error = max(float(np.abs(force).max()) / force_scale, missing / length_scale)
            if not error < CONTRACTION * best:
                break
            u, multipliers, best = new_u, new_multipliers, error
            if error < tolerance:
                break
        return u, multipliers, best


def _divisors(length: Array) -> Array:
    """Divisors of the rows of R; the row of an edge without length is zero."""
    return np.where(length > 0, length, 1.0)
