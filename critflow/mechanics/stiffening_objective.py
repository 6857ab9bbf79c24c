"""C_B and C_G as objectives with exact gradients: networks can be designed for their growth past the transition.

A third derivative of the energy is stationary in the responses u and λ, so its derivative by σ needs none of theirs:
    dC/dσ = ∂C/∂σ|_(L,u,λ) + pull-back of ∂C/∂L|_(σ,u,λ),
one bordered solve for the responses and one with P for the pull-back.  Both partial derivatives are those of a sum over
edges; the amplitudes c_a = σ̂·ḣ_a/D add the chain rule.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from critflow.critical.manifold import CriticalManifold
from critflow.critical.objectives import Objective, Partials, dilation, pure_shear
from critflow.mechanics.laws import HOOKEAN
from critflow.mechanics.third_order import Response, ThirdOrderEnergy, Triple
from critflow.networks.network import Array


@dataclass(frozen=True)
class StiffeningCoefficient(Objective):
    """C_B = dB/dγ or C_G = dG/dγ at the transition for dilation and springs of Hooke's law (`ModulusStrainScaling`).

    manifold   of the network
    of_shear   C_G by the energy convention; otherwise C_B
    largest    whether the largest value is the best
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
        return self.of(Growth(self.manifold, sigma, L))

    def of(self, growth: Growth) -> tuple[float, Partials]:
        """As `evaluate`, from responses that both coefficients share."""
        network, L, s = growth.manifold.network, growth.bond_vectors, growth.unit_stress
        responses = growth.energy.responses
        amplitudes = np.array([response.amplitude for response in responses])
        terms = _Terms(network.stiffness, responses, s, L, amplitudes)
        value, by_s, by_L, by_c = terms.shear() if self.of_shear else terms.bulk()
        # The amplitudes are functions of σ̂ and L.
        flexibility = np.einsum("ad,ad->a", L, L) / network.stiffness
        D = float(s**2 @ flexibility)
        for c, derivative, response in zip(amplitudes, by_c, responses, strict=True):
            symmetric = 0.5 * (response.strain + response.strain.T)
            AL = L @ symmetric
            hdot = np.einsum("ad,ad->a", L, AL)
            by_s += derivative * (hdot - 2 * c * s * flexibility) / D
            by_L += (derivative / D) * (2 * s[:, None] * AL - (2 * c * s**2 / network.stiffness)[:, None] * L)
        by_sigma = (by_s - (by_s @ s) * s) / growth.norm
        return value / network.volume, (by_sigma / network.volume, by_L / network.volume)


class Growth:
    """The responses to dilation and shear at stresses σ and bond vectors L in balance: C_B and C_G share them.

    unit_stress  σ̂ = σ/norm, (N_b,)
    energy       third derivatives of the energy, for springs of Hooke's law
    """

    def __init__(self, manifold: CriticalManifold, sigma: Array, L: Array):
        self.manifold, self.bond_vectors = manifold, L
        self.norm = float(np.linalg.norm(sigma))
        self.unit_stress = sigma / self.norm
        d = manifold.network.dimension
        triples = (
            Triple.cubed(0, (1 / d) * (1 / d - 1) * np.eye(d)),
            Triple.squared(1, 0, np.zeros((d, d)), pure_shear(d) / d),
        )
        strains = (dilation(d), pure_shear(d))
        self.energy = ThirdOrderEnergy(manifold.network, sigma, L, manifold.system(sigma), HOOKEAN, strains, triples)


class _Terms:
    """V C as a sum over edges at fixed responses u and λ: a function of σ̂ (N_b,), L (N_b, d) and the amplitudes c.

    rates  L̇ = L Aᵀ + g u of both strains; slips  R = L·L̇ − c σ̂|L|²/k of both, with their derivatives by L
    """

    def __init__(self, stiffness: Array, responses: tuple[Response, ...], s: Array, L: Array, c: Array):
        self.k, self.s, self.L, self.c = stiffness, s, L, c
        self.square = _dot(L, L)
        self.flexibility = self.square / stiffness
        self.strains = [response.strain for response in responses]
        self.weights = [response.multipliers for response in responses]
        self.rates = [L @ response.strain.T + response.bond_displacement for response in responses]
        self.slips = [_dot(L, rate) - a * s * self.flexibility for rate, a in zip(self.rates, c, strict=True)]
        stretch = 2 * (s / stiffness)[:, None] * L
        self.slips_by_L = [rate + L @ A - a * stretch for rate, A, a in zip(self.rates, self.strains, c, strict=True)]

    def bulk(self) -> tuple[float, Array, Array, Array]:
        """V C_B, and its derivatives by σ̂, L and c (2,)."""
        (A, _), (m, _), c, s, L = self.strains, self.weights, self.c[0], self.s, self.L
        rate, slip, flexibility = self.rates[0], self.slips[0], self.flexibility
        d = L.shape[1]
        curvature = (1 / d) * (1 / d - 1)
        dilating = _dot(rate, rate) + curvature * self.square
        cube = s**2 * flexibility / self.k
        edges = c**2 * s**2 * flexibility - 3 * c**3 * s * cube + 3 * c * (s * dilating + 2 * m * slip)
        by_s = 2 * c**2 * s * flexibility - 9 * c**3 * cube + 3 * c * (dilating - 2 * c * m * flexibility)
        along = 2 * c**2 * s**2 / self.k - 6 * c**3 * s**3 / self.k**2 + 6 * c * curvature * s
        by_L = along[:, None] * L + (6 * c * s)[:, None] * (rate @ A) + (6 * c * m)[:, None] * self.slips_by_L[0]
        by_c = 2 * c * s**2 * flexibility - 9 * c**2 * s * cube + 3 * (s * dilating + 2 * m * slip)
        by_c -= 6 * c * m * s * flexibility
        return float(np.sum(edges)), by_s, by_L, np.array([np.sum(by_c), 0.0])

    def shear(self) -> tuple[float, Array, Array, Array]:
        """V C_G, and its derivatives by σ̂, L and c (2,)."""
        (A, B), (m, n), (a, b), s, L = self.strains, self.weights, self.c, self.s, self.L
        (rate_a, rate_b), (slip_a, slip_b), flexibility = self.rates, self.slips, self.flexibility
        d = L.shape[1]
        shearing = _dot(rate_b, rate_b)
        mixed = _dot(rate_a, rate_b) + _dot(L, L @ B) / d
        cube = s**2 * flexibility / self.k
        single, double = s * shearing + 2 * n * slip_b, s * mixed + n * slip_a + m * slip_b
        edges = -3 * a * b**2 * s * cube + a * single + 2 * b * double - b**2 * s**2 * flexibility
        by_s = -9 * a * b**2 * cube + a * (shearing - 2 * b * n * flexibility)
        by_s += 2 * b * (mixed - (a * n + b * m) * flexibility) - 2 * b**2 * s * flexibility
        along = -6 * a * b**2 * s**3 / self.k**2 - 2 * b**2 * s**2 / self.k
        by_L = along[:, None] * L + (2 * a * s)[:, None] * (rate_b @ B) + (2 * a * n)[:, None] * self.slips_by_L[1]
        by_L += (2 * b * s)[:, None] * (rate_b @ A + rate_a @ B + (L @ B + L @ B.T) / d)
        by_L += (2 * b) * (n[:, None] * self.slips_by_L[0] + m[:, None] * self.slips_by_L[1])
        by_a = -3 * b**2 * s * cube + single - 2 * b * n * s * flexibility
        by_b = -6 * a * b * s * cube + 2 * double - 2 * (a * n + b * m + b * s) * s * flexibility
        return float(np.sum(edges)), by_s, by_L, np.array([np.sum(by_a), np.sum(by_b)])


def _dot(a: Array, b: Array) -> Array:
    """Products of the vectors of each edge, (N_b,)."""
    return np.asarray(np.einsum("ad,ad->a", a, b))
