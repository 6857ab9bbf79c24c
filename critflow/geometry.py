"""The critical manifold as a surface in the space of h = |L|²/2: chart, metric and curvature.

Stress is normal to it, and B = ∂h/∂σ holds the rest: tangents B V, metric VᵀB²V and second fundamental form
−VᵀB V/|σ| in any chart σ(s) with V = ∂σ/∂s (`TangentSpace`, `Metric`, `2FF`).  The sign is that of
Σ_α σ_α ∂²h_α/∂s∂s/|σ|, since σᵀB = 0 gives σᵀ∂B = −B; the paper prints the opposite one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from critflow.manifold import CriticalManifold
from critflow.network import Array, edge_values
from critflow.result import InputError


@dataclass(frozen=True, eq=False)
class StereographicChart:
    """Unit stresses by N_b − 1 coordinates s about a pole σ⁰ (`projection`); s = 0 is the pole itself."""

    pole: Array
    basis: Array  # (N_b, N_b − 1), orthonormal and orthogonal to the pole

    @classmethod
    def about(cls, pole: ArrayLike) -> StereographicChart:
        """The chart about a stress (N_b,) of any scale."""
        sigma = edge_values(pole, np.size(pole), "pole", positive=False)
        if not sigma.any():
            raise InputError("the pole of the chart must not be zero everywhere")
        unit = sigma / np.linalg.norm(sigma)
        return cls(unit, scipy.linalg.null_space(unit[None]))

    def sigma(self, s: Array) -> Array:
        """σ(s), of unit norm, (N_b,)."""
        quarter = float(s @ s) / 4
        return (self.basis @ s + (1 - quarter) * self.pole) / (1 + quarter)

    def derivative(self, s: Array) -> Array:
        """V = ∂σ/∂s, (N_b, N_b − 1) (`projectionDeriv`)."""
        quarter = float(s @ s) / 4
        return (self.basis - np.outer(self.pole + self.sigma(s), s) / 2) / (1 + quarter)


@dataclass(frozen=True, eq=False)
class SurfaceGeometry:
    """Geometry at one point of the manifold in a chart: tangents (N_b, N_b − 1), metric and second fundamental form."""

    tangents: Array
    metric: Array
    second_fundamental_form: Array

    def principal_curvatures(self) -> Array:
        """Eigenvalues of the second fundamental form against the metric, (N_b − 1,), ascending."""
        return scipy.linalg.eigh(self.second_fundamental_form, self.metric, eigvals_only=True)


def surface_geometry(manifold: CriticalManifold, chart: StereographicChart, s: ArrayLike) -> SurfaceGeometry:
    """Tangents, metric and second fundamental form at chart coordinates s (N_b − 1,), by dense matrices."""
    at = np.asarray(s, dtype=float)
    if at.shape != (chart.basis.shape[1],):
        raise InputError(f"s must have shape {(chart.basis.shape[1],)}, not {at.shape}: one coordinate less than edges")
    sigma, V = chart.sigma(at), chart.derivative(at)
    tangents = manifold.response(manifold.configuration(sigma)) @ V
    # The response belongs to σ with Σσ² = N_b, and h(σ) does not change with the scale, so ∂h/∂σ does: |σ| = 1 here.
    tangents = tangents * np.sqrt(manifold.network.n_edges)
    return SurfaceGeometry(tangents, tangents.T @ tangents, -V.T @ tangents)
