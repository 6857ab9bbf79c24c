"""Bordered systems of weak forces: floppy motions u, R u = e, under the stiffness sP + H of tension and weak forces.

    [[sP + H, Rᵀ], [R, 0]] (u, λ) = (f, e),   P = gᵀ diag(σ) g ⊗ 1,   R = L·g
Elimination of the multipliers with a small compliance gives sP + H + Rᵀ w R, the sum of three constant matrices: one
symbolic analysis serves all s.  Iteration on the residuals removes the compliance (`linalg.saddle`).  Without negative
pivots the stiffness is positive on the floppy motions, up to 1/w.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from critflow.linalg.factor import Entries, Factor, FixedPattern
from critflow.linalg.matrices import spread_columns
from critflow.linalg.saddle import CONDENSED_WEIGHT, CONTRACTION, REFINED
from critflow.linalg.tolerances import MOST_REFINEMENTS
from critflow.networks.network import Array, Network


class WeakSystem:
    """The systems of one configuration, σ (N_b,) and L (N_b, d), with a weak Hessian H, sparse (d·n_free)².

    prestress, hessian, rigidity  P, H and R, sparse
    """

    def __init__(self, network: Network, sigma: Array, bond_vectors: Array, hessian: sp.sparray):
        g, d = network.free_incidence, network.dimension
        self.network, self.sigma, self.bond_vectors = network, sigma, bond_vectors
        self.prestress = sp.csr_array(sp.kron(g.T @ sp.diags_array(sigma) @ g, sp.eye_array(d)))
        self.hessian = sp.csr_array(hessian)
        self.rigidity = spread_columns(network, bond_vectors)
        self.lengths = np.linalg.norm(bond_vectors, axis=1)
        unit = sp.csr_array(sp.diags_array(1 / self.lengths) @ self.rigidity)
        parts = [sp.coo_array(part) for part in (self.prestress, self.hessian, unit.T @ unit)]
        entries = [Entries(part.row, part.col, np.full(part.nnz, n), part.data) for n, part in enumerate(parts)]
        self._pattern = FixedPattern(self.rigidity.shape[1], 3, entries)
        self.scales = [float(np.abs(part.diagonal()).mean()) for part in parts[:2]]

    def factorize(self, s: float, weak: float = 1.0) -> WeakFactor:
        """The factor at sP + weak·H."""
        weight = CONDENSED_WEIGHT * (abs(s) * self.scales[0] + weak * self.scales[1])
        return WeakFactor(self, s, weak, weight, self._pattern.factorize(np.array([s, weak, weight])))


@dataclass(frozen=True, eq=False)
class WeakFactor:
    """A factorised system at sP + weak·H, with the weight w of the constraints."""

    system: WeakSystem
    s: float
    weak: float
    weight: float
    factor: Factor

    @property
    def positive(self) -> bool:
        """Whether the stiffness is positive on all floppy motions."""
        return self.factor.sound and not self.factor.n_negative

    def multiply(self, u: Array) -> Array:
        """(sP + H) u."""
        return np.asarray(self.s * (self.system.prestress @ u) + self.weak * (self.system.hessian @ u))

    def solve(self, forces: Array, elongations: Array | None = None) -> tuple[Array, Array]:
        """u (d·n_free,) and λ (N_b,) of forces (d·n_free,) and elongations (N_b,), whose part along σ is ignored."""
        system, R = self.system, self.system.rigidity
        w = self.weight / system.lengths**2
        null = system.sigma / np.linalg.norm(system.sigma)
        e = np.zeros(len(null)) if elongations is None else elongations - (null @ elongations) * null
        u, multipliers = np.zeros_like(forces), np.zeros_like(e)
        force, elongation, best = forces, e, np.inf
        # Scales of the terms that cancel: the load, and the lengths that it would move without constraints.
        force_scale = float(np.abs(forces).max(initial=0.0)) + float(np.abs(R.T @ (w * e)).max()) / CONDENSED_WEIGHT
        for _ in range(MOST_REFINEMENTS):
            step = self.factor.solve(force + R.T @ (w * elongation))
            new_u = u + step
            new_multipliers = multipliers + w * (R @ step - elongation)
            new_elongation = e - R @ new_u
            new_force = forces - self.multiply(new_u) - R.T @ new_multipliers
            length_scale = float(np.abs(new_u).max(initial=0.0)) * float(system.lengths.mean())
            error = max(
                float(np.abs(new_force).max()) / max(force_scale, 1e-300),
                float(np.abs(new_elongation).max()) / max(length_scale, 1e-300),
            )
            if not error < CONTRACTION * best:
                break
            u, multipliers, force, elongation, best = new_u, new_multipliers, new_force, new_elongation, error
            if error < REFINED:
                break
        return u, multipliers
