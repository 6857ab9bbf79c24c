"""The critical manifold as a surface in the space of h = |L|²/2: chart, tangents, metric and second fundamental form.

The surface is h(σ) (`SelfStressParamaterization_Lsqr`).  Stress is normal to it, and B = ∂h/∂σ gives the rest:
tangents B V, metric VᵀB²V and second fundamental form −VᵀB V/|σ| in any chart σ(s) with V = ∂σ/∂s (`TangentSpace`,
`Metric`, `2FF`).  The sign is that of Σ_α σ_α ∂²h_α/∂s∂s/|σ|, since σᵀB = 0 gives σᵀ∂B = −B; the paper prints the
opposite one.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from critflow.manifold import CriticalConfiguration, CriticalManifold
from critflow.networks import Array


@dataclass(frozen=True, eq=False)
class StereographicChart:
    """Unit stresses by N_b − 1 coordinates s about a pole σ⁰ (`projection`); s = 0 is the pole itself.

    The basis v of the pole's complement is the last N_b − 1 columns of the reflection 1 − 2uuᵀ that takes the pole to
    an end of the first axis.
    """

    pole: Array  # (N_b,), of unit norm
    mirror: Array  # u, (N_b,), of unit norm

    @classmethod
    def about(cls, pole: ArrayLike) -> Self:
        """The chart about a stress (N_b,) of any scale."""
        unit = np.asarray(pole, dtype=float) / np.linalg.norm(pole)
        mirror = unit.copy()
        mirror[0] += np.copysign(1.0, unit[0])  # the end of the axis that lies farther away, so that nothing cancels
        return cls(unit, mirror / np.linalg.norm(mirror))

    def _reflected(self, w: Array) -> Array:
        return w - 2 * (self.mirror @ w) * self.mirror

    @property
    def basis(self) -> Array:
        """v, (N_b, N_b − 1): orthonormal and orthogonal to the pole."""
        return np.column_stack([self._reflected(axis) for axis in np.eye(len(self.pole))[1:]])

    def sigma(self, s: Array) -> Array:
        """σ(s), of unit norm, (N_b,)."""
        quarter = float(s @ s) / 4
        return (self._reflected(np.append(0.0, s)) + (1 - quarter) * self.pole) / (1 + quarter)

    def coordinates(self, sigma: Array) -> Array:
        """s of a stress (N_b,) of any scale but the antipode of the pole."""
        return 2 * self._reflected(sigma)[1:] / (float(np.linalg.norm(sigma)) + float(self.pole @ sigma))

    def derivative(self, s: Array) -> Array:
        """V = ∂σ/∂s, (N_b, N_b − 1) (`projectionDeriv`)."""
        half = (self.pole + self.sigma(s)) / 2
        return 1 / (1 + float(s @ s) / 4) * (self.basis - s * half[:, None])


def surface_geometry(
    manifold: CriticalManifold, critical: CriticalConfiguration, chart: StereographicChart, s: Array
) -> tuple[Array, Array, Array]:
    """Tangents, metric and second fundamental form of a configuration at its coordinates s (N_b − 1,) in a chart.

    Tangents ∂h/∂s = B V, (N_b, N_b − 1) (`TangentSpace`); metric VᵀB²V (`Metric`); second form Σ_α σ_α ∂²h_α/∂s∂s =
    −VᵀBV for the unit normal σ/|σ| (`2FF`, with the sign that finite differences have).
    """
    V = chart.derivative(s)
    # h(σ) does not change with the scale of σ, so B = ∂h/∂σ goes as its inverse: |σ|B is that of the unit stress.
    tangents = manifold.response(critical) * float(np.linalg.norm(critical.sigma)) @ V
    return tangents, tangents.T @ tangents, -V.T @ tangents
