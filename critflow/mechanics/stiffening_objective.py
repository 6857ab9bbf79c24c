"""C_B and C_G as objectives with exact gradients: networks can be designed for their growth past the transition.

A third derivative of the energy is stationary in the responses u and λ, so its derivative by σ needs none of theirs:
    dC/dσ = ∂C/∂σ|_(L,u,λ) + pull-back of ∂C/∂L|_(σ,u,λ),
one bordered solve for the responses and one with P for the pull-back.  Both partial derivatives are those of a sum over
edges, by complex steps, which are exact to rounding; the amplitudes c_a = σ̂·ḣ_a/D add the chain rule.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from critflow.critical.manifold import CriticalManifold
from critflow.critical.objectives import Objective, Partials, dilation, pure_shear
from critflow.mechanics.laws import HOOKEAN
from critflow.mechanics.third_order import Response, ThirdOrderEnergy, Triple
from critflow.networks.network import Array

# Imaginary step of complex differentiation: far below rounding of the real part.
_STEP = 1e-30


@dataclass(frozen=True)
class StiffeningCoefficient(Objective):
    """C_B = dB/dγ or C_G = dG/dγ at the transition for dilation and springs of Hooke's law (`ModulusStrainScaling`).

    manifold   of the network
    of_shear   C_G by the energy convention; otherwise C_B
    maximise   whether the largest value is the best
    """

    manifold: CriticalManifold = field(repr=False)
    of_shear: bool = False
    largest: bool = False

    one_self_stress: ClassVar[bool] = True

    @property
    def maximise(self) -> bool:  # type: ignore[override]
        """Whether the largest value is the best."""
        return self.largest

    def evaluate(self, sigma: Array, L: Array) -> tuple[float, Partials]:
        network = self.manifold.network
        energy = _energy(self.manifold, sigma, L)
        terms = _Terms(network.stiffness, energy.responses, network.dimension)
        norm = float(np.linalg.norm(sigma))
        s = sigma / norm
        amplitudes = np.array([response.amplitude for response in energy.responses])
        value, by_s, by_L, by_c = terms.derivatives(s, L, amplitudes, self.of_shear)
        # The amplitudes are functions of σ̂ and L.
        square = np.einsum("ad,ad->a", L, L)
        flexibility = square / network.stiffness
        D = float(s**2 @ flexibility)
        for c, derivative, response in zip(amplitudes, by_c, energy.responses, strict=True):
            symmetric = 0.5 * (response.strain + response.strain.T)
            AL = L @ symmetric
            hdot = np.einsum("ad,ad->a", L, AL)
            by_s += derivative * (hdot - 2 * c * s * flexibility) / D
            by_L += (derivative / D) * (2 * s[:, None] * AL - (2 * c * s**2 / network.stiffness)[:, None] * L)
        by_sigma = (by_s - (by_s @ s) * s) / norm
        return value / network.volume, (by_sigma / network.volume, by_L / network.volume)


def _energy(manifold: CriticalManifold, sigma: Array, L: Array) -> ThirdOrderEnergy:
    d = manifold.network.dimension
    triples = (
        Triple.cubed(0, (1 / d) * (1 / d - 1) * np.eye(d)),
        Triple.squared(1, 0, np.zeros((d, d)), pure_shear(d) / d),
    )
    strains = (dilation(d), pure_shear(d))
    return ThirdOrderEnergy(manifold.network, sigma, L, manifold.system(sigma), HOOKEAN, strains, triples)


@dataclass(frozen=True, eq=False)
class _Terms:
    """V C as a sum over edges at fixed responses u and λ."""

    stiffness: Array
    responses: tuple[Response, ...]
    dimension: int

    def edges(self, s: Any, L: Any, c: Any, of_shear: bool) -> Any:
        """Contributions (N_b,) of the edges, analytic in σ̂ (N_b,), L (N_b, d) and the amplitudes c (2,)."""
        d, k = self.dimension, self.stiffness
        square = np.sum(L * L, axis=1)
        flexibility = square / k
        goals = [amplitude * s * flexibility for amplitude in c]
        rates = [L @ response.strain + response.bond_displacement for response in self.responses]
        rests = [np.sum(L * rate, axis=1) - goal for rate, goal in zip(rates, goals, strict=True)]
        m, n = (response.multipliers for response in self.responses)
        third = -3 * k / square**2
        if not of_shear:
            dilating = np.sum(rates[0] * rates[0], axis=1) + (1 / d) * (1 / d - 1) * square
            growth = third * goals[0] ** 3 + 3 * c[0] * (s * dilating + 2 * m * rests[0])
            return c[0] ** 2 * s**2 * flexibility + growth
        shearing = np.sum(rates[1] * rates[1], axis=1)
        mixed = np.sum(rates[0] * rates[1], axis=1) + np.sum(L * (L @ self.responses[1].strain), axis=1) / d
        growth = third * goals[0] * goals[1] ** 2 + c[0] * (s * shearing + 2 * n * rests[1])
        growth = growth + 2 * c[1] * (s * mixed + n * rests[0] + m * rests[1])
        return growth - c[1] ** 2 * s**2 * flexibility

    def derivatives(self, s: Array, L: Array, c: Array, of_shear: bool) -> tuple[float, Array, Array, Array]:
        """V C and its partial derivatives by σ̂ (N_b,), L (N_b, d) and the amplitudes (2,)."""
        by_L, by_c = np.empty_like(L), np.empty(len(c))
        for axis in range(L.shape[1]):
            step = np.zeros(L.shape, complex)
            step[:, axis] = 1j * _STEP
            by_L[:, axis] = self.edges(s, L + step, c, of_shear).imag / _STEP
        by_s = self.edges(s + 1j * _STEP, L, c, of_shear).imag / _STEP
        for n in range(len(c)):
            moved = c.astype(complex)
            moved[n] += 1j * _STEP
            by_c[n] = float(np.sum(self.edges(s, L, moved, of_shear)).imag) / _STEP
        return float(np.sum(self.edges(s, L, c, of_shear))), by_s, by_L, by_c
