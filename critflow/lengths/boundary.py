"""The boundary of a network that moves with the unknowns of Newton's method: b → F(s, q) b.

The strain s is one unknown; an extra may add free components q of the cell.  Derivatives are by (q, s), the strain
last.  Lengths in given ratios need the strain alone, F = (1 + s) 1, a common factor of all lengths.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from critflow.critical.manifold import CriticalManifold
from critflow.networks.network import Array, IntArray, Network
from critflow.result import InputError


class Boundary(ABC):
    """F(s, q) of one network."""

    manifold: CriticalManifold

    @property
    def network(self) -> Network:
        return self.manifold.network

    @property
    def determined(self) -> IntArray:
        """Indices of the components of q that the balance of forces determines."""
        return np.zeros(0, np.int64)

    @abstractmethod
    def gradient(self, s: float, q: Array) -> Array:
        """F(s, q), (d, d); raises `InputError` where det F ≤ 0."""

    @abstractmethod
    def rates(self, s: float, q: Array) -> Array:
        """Derivatives of F(s, q) by (q, s), (n_q + 1, d, d)."""

    def velocities(self, s: float, q: Array) -> Array:
        """A_k = (∂F/∂y_k) F⁻¹ of the determined components of q, and of the strain last, (k, d, d)."""
        return self.rates(s, q)[[*self.determined, -1]] @ np.linalg.inv(self.gradient(s, q))

    def stress_rates(self, s: float, q: Array, sigma: Array, L: Array, velocities: Array) -> Array:
        """∂S_m/∂y_k at affine motion of the stresses S_m of the determined components, (k, k) with a last row of zeros.

        sigma, L, velocities  of the stressed edges, and A_k
        """
        return np.zeros((1, 1))

    def boundary_vectors(self, F: Array) -> Array:
        """F b, (N_b, d)."""
        return self.network.boundary_vectors @ F.T

    def bond_vectors(self, s: float, q: Array, x: Array) -> Array:
        """L = F(s, q) b + g x, (N_b, d), for coordinates x (n_free, d)."""
        return self.boundary_vectors(self.gradient(s, q)) + self.network.free_incidence @ x


@dataclass(frozen=True, eq=False)
class Expansion(Boundary):
    """F = (1 + s) 1, without free components."""

    manifold: CriticalManifold

    def gradient(self, s: float, q: Array) -> Array:
        F = (1 + s) * np.eye(self.network.dimension)
        if not (np.isfinite(s) and np.linalg.det(F) > 0):
            raise InputError(f"a strain of {s:g} inverts or flattens the cell")
        return F

    def rates(self, s: float, q: Array) -> Array:
        return np.eye(self.network.dimension)[None]
