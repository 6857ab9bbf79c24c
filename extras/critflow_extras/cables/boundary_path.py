"""The boundary of a network on a path of deformations: F(s, q) = (1 + Σ_m q_m E_m) F(±s) with free components q.

Paths run from s = 0 in the direction of positive or negative strain γ = ±s; derivatives are by (q, s), the strain last.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from critflow.deformation import Deformation
from critflow.manifold import CriticalManifold
from critflow.networks import Array, IntArray
from critflow.taut_edges import Boundary


@dataclass(frozen=True, eq=False)
class BoundaryPath(Boundary):
    """A network, a deformation and the sign of its strain γ = direction · s.

    sheared  whether free shears of a cell with free sides are not zero: the balance then determines the sides as well
    """

    manifold: CriticalManifold
    deformation: Deformation
    direction: int = 1
    sheared: bool = False

    @cached_property
    def free_strains(self) -> Array:
        """E_m of the free components, (m, d, d)."""
        return self.deformation.free_strains

    @property
    def n_free(self) -> int:
        """Number m of free components."""
        return len(self.deformation.free)

    @cached_property
    def determined(self) -> IntArray:
        """Indices of the free components that the balance of cables determines, others follow from inequalities.

        Where a normal stress Σσ L_i² vanishes and σ ≥ 0, stressed edges have no component along that axis: the boundary
        then moves along it, and in shear of two such axes, without any change of their lengths.  A shear of one such
        axis turns the edges off the other one, and they are shortest without it, unless it undoes a shear of the path.
        """
        unstressed = {name[0] for name in self.deformation.free if name[0] == name[1] and not self.sheared}
        names = enumerate(self.deformation.free)
        return np.array([m for m, name in names if not set(name) <= unstressed], np.int64)

    @cached_property
    def has_free_sides(self) -> bool:
        """Whether a normal component of the cell is free."""
        return any(name[0] == name[1] for name in self.deformation.free)

    @cached_property
    def has_free_shears(self) -> bool:
        """Whether a shear of the cell is free together with a normal component, but not both of its axes."""
        return 0 < len(self.determined) < self.n_free

    @cached_property
    def linear(self) -> bool:
        """Whether F is linear in (q, s) together."""
        return self.deformation.linear_in_strain and not (self.free_strains @ self.deformation.rate(0.0)).any()

    def gradient(self, s: float, q: Array) -> Array:
        """F(s, q), (d, d); raises `InputError` where det F(s) ≤ 0."""
        F = self.deformation.gradient(self.direction * s)
        return self._free(q) @ F if self.n_free else F

    def rates(self, s: float, q: Array) -> Array:
        """Derivatives of F(s, q) by (q, s), (m + 1, d, d)."""
        along = self.direction * self.deformation.rate(self.direction * s)
        if not self.n_free:
            return along[None]
        F = self.deformation.gradient(self.direction * s)
        return np.concatenate([self.free_strains @ F, (self._free(q) @ along)[None]])

    def stress_rates(self, s: float, q: Array, sigma: Array, L: Array, velocities: Array) -> Array:
        m = len(self.determined)
        corner = np.zeros((m + 1, m + 1))
        if m:
            stress = np.einsum("a,ai,aj->ij", sigma, L, L)
            # (∂²F/∂q_m ∂s) F⁻¹; second derivatives by q alone vanish.
            along = self.direction * self.deformation.rate(self.direction * s)
            mixed = self.free_strains[self.determined] @ along @ np.linalg.inv(self.gradient(s, q))
            corner[:-1] = np.einsum("mik,nil,kl->mn", velocities[:-1], velocities, stress)
            corner[:-1, -1] += np.einsum("mij,ij->m", mixed, stress)
        return corner

    def flat_strain(self, s: float, q: Array) -> float:
        """Distance on the line F + r F' at which det F vanishes first; infinite if it does nowhere."""
        F, along = self.gradient(s, q), self.rates(s, q)[-1]
        roots = np.linalg.eigvals(np.linalg.solve(F, along))
        closing = -roots.real[(np.abs(roots.imag) < _REAL * (np.abs(roots).max() or 1.0)) & (roots.real < 0)]
        return float(1 / closing.max()) if len(closing) else np.inf

    def _free(self, q: Array) -> Array:
        return np.eye(self.network.dimension) + np.einsum("m,mij->ij", q, self.free_strains)


# Imaginary part, relative to the largest root, of a real double root after rounding.
_REAL = 1e-7
