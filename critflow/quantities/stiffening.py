"""Stiffening coefficients as quantities with exact gradients: growth past the transition can be designed.

A third derivative of the energy is stationary in the responses u and λ, so its derivative by σ needs none of theirs:
    dC/dσ = ∂C/∂σ|_(L,u,λ) + pull-back of ∂C/∂L|_(σ,u,λ),   dC/dk = ∂C/∂k|_(σ,L,u,λ),
one bordered solve for the responses and one with P for the pull-back.  The partial derivatives are those of a sum over
edges; the amplitudes c_a = σ̂·ḣ_a/D add the chain rule.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from critflow.critical.extreme import largest_value
from critflow.critical.manifold import Balance, CriticalConfiguration, CriticalManifold
from critflow.critical.quantity import Balanced, Partials, Quantity, dot
from critflow.critical.transition import dilation, pure_shear
from critflow.networks.deformation import Deformation
from critflow.networks.network import Array
from critflow.response.third_order import Response, ThirdOrderEnergy, Triple
from critflow.result import InputError
from critflow.springs.laws import HOOKEAN


@dataclass(frozen=True, eq=False)
class Stiffening(Quantity):
    """C of the modulus (1/V) d²E/dγ² = M_0 + Cγ along a path of deformations, C = E_γγγ/V − M_0 tr A (`stiffening`).

    deformation  the path, without free components; None: C_B = dB/dγ, or C_G = dG/dγ by the energy convention
                 (`of_shear`), under dilation (`ModulusStrainScaling`)
    largest      whether the largest value is the best
    """

    deformation: Deformation | None = None
    of_shear: bool = False
    largest: bool = False

    one_self_stress: ClassVar[bool] = True
    elastic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.deformation is not None and self.deformation.free:
            raise InputError(
                f"the free components of {self.deformation.name} relax the self-stress, so nothing stiffens at the "
                "transition: choose a path with a fixed cell"
            )

    @property
    def name(self) -> str:
        if self.deformation is not None:
            return f"stiffening[{self.deformation.name}]"
        return "C_G" if self.of_shear else "C_B"

    @property
    def maximise(self) -> bool:  # type: ignore[override]
        """Whether the largest value is the best."""
        return self.largest

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        responses = self._responses(balance)
        return responses.derivatives(self._sums(responses))

    def error(self, critical: CriticalConfiguration) -> float:
        """That of the partial derivatives, and the error (estimate) of the third derivative for exact bond vectors."""
        third = self._responses(critical).energy.third_error[int(self.of_shear)]
        return super().error(critical) + third / critical.network.volume

    def by_stiffness(self, balance: Balanced) -> Array:
        """dC/dk (N_b,) at constant σ: the configuration does not depend on k."""
        responses = self._responses(balance)
        return responses.by_stiffness(self._sums(responses))

    def extreme(self, manifold: CriticalManifold, positive: bool = True) -> tuple[float, float]:
        """C_B ≥ (3/d − 2) max B_0 for σ > 0: −½ max B_0 in the plane, −max B_0 in space.

        Springs of Hooke's law satisfy  C_B = (3/d − 2) B_0 + (3c/V) Σ σ̂|L̇_⊥|²  with the amplitude c = σ̂·ḣ/D > 0 of
        the stress and the rates L̇_⊥ at which edges turn under dilation.  No term of the sum is negative for σ > 0, and
        all vanish only at the largest B_0.  Compressed edges can have any C_B.
        """
        if not positive or self.of_shear or self.deformation is not None:
            return -np.inf, np.inf
        d = manifold.network.dimension
        return (3 / d - 2) * largest_value(manifold, dilation(d)), np.inf

    def _responses(self, balance: Balanced) -> StrainResponses:
        """The responses, shared by C_B and C_G at one balance."""
        if self.deformation is not None or not isinstance(balance, Balance):
            return StrainResponses(balance, self.deformation)
        if "dilation and shear" not in balance.shared:
            balance.shared["dilation and shear"] = StrainResponses(balance)
        return balance.shared["dilation and shear"]

    def _sums(self, responses: StrainResponses) -> Sums:
        if self.of_shear:
            return responses.terms.shear()
        # The volume grows by tr A: by γ itself under dilation, where C_B has B itself in place of E_γγ.
        return responses.terms.cubed(-1.0 if self.deformation is None else float(np.trace(self.deformation.rate(0.0))))


class StrainResponses:
    """The responses at a balance to dilation and shear, or to one path.

    unit_stress  σ̂ = σ/norm, (N_b,)
    energy       third derivatives of the energy, for springs of Hooke's law
    terms        the same as sums over edges
    """

    def __init__(self, balance: Balanced, path: Deformation | None = None):
        self.network, self.bond_vectors = balance.network, balance.bond_vectors
        self.norm = float(np.linalg.norm(balance.sigma))
        self.unit_stress = balance.sigma / self.norm
        d = self.network.dimension
        strains: tuple[Array, ...]
        triples: tuple[Triple, ...]
        if path is None:
            curvature = (1 / d) * (1 / d - 1) * np.eye(d)
            strains = (dilation(d), pure_shear(d))
            triples = (Triple.cubed(0, curvature), Triple.squared(1, 0, np.zeros((d, d)), pure_shear(d) / d))
        else:
            curvature = path.second_rate(0.0)
            strains, triples = (path.rate(0.0),), (Triple.cubed(0, curvature),)
        system = balance.manifold.system(balance.sigma)
        L = self.bond_vectors
        self.energy = ThirdOrderEnergy(self.network, balance.sigma, L, system, HOOKEAN, strains, triples)
        self.amplitudes = np.array([response.amplitude for response in self.energy.responses])
        k = self.network.stiffness
        self.terms = _Terms(k, self.energy.responses, self.unit_stress, L, self.amplitudes, curvature)

    def derivatives(self, sums: Sums) -> tuple[float, Partials]:
        """C and its partial derivatives by σ and L, with those by the amplitudes, which are functions of σ̂ and L."""
        network, L, s = self.network, self.bond_vectors, self.unit_stress
        value, by_s, by_L, _, by_c = sums
        flexibility = self.terms.flexibility
        D = float(s**2 @ flexibility)
        for c, derivative, response in zip(self.amplitudes, by_c, self.energy.responses, strict=True):
            symmetric = 0.5 * (response.strain + response.strain.T)
            AL = L @ symmetric
            hdot = dot(L, AL)
            by_s += derivative * (hdot - 2 * c * s * flexibility) / D
            by_L += (derivative / D) * (2 * s[:, None] * AL - (2 * c * s**2 / network.stiffness)[:, None] * L)
        by_sigma = (by_s - (by_s @ s) * s) / self.norm
        return value / network.volume, (by_sigma / network.volume, by_L / network.volume)

    def by_stiffness(self, sums: Sums) -> Array:
        """dC/dk, (N_b,): dc/dk = (c/D) σ̂² |L|²/k²."""
        network, flexibility, s = self.network, self.terms.flexibility, self.unit_stress
        by_D = float(sums[4] @ self.amplitudes) / float(s**2 @ flexibility)
        return (sums[3] + by_D * s**2 * flexibility / network.stiffness) / network.volume


Sums = tuple[float, Array, Array, Array, Array]
"""V C, and its derivatives by σ̂ (N_b,), L (N_b, d), k (N_b,) and the amplitudes, each with the others constant."""


class _Terms:
    """V C as a sum over edges at fixed responses u and λ: a function of σ̂ (N_b,), L (N_b, d) and the amplitudes c.

    rates  L̇ = L Aᵀ + g u of all strains; slips  R = L·L̇ − c σ̂|L|²/k of all, with their derivatives by L
    """

    def __init__(
        self, stiffness: Array, responses: tuple[Response, ...], s: Array, L: Array, c: Array, curvature: Array
    ):
        self.k, self.s, self.L, self.c = stiffness, s, L, c
        self.curvature = 0.5 * (curvature + curvature.T)
        self.square = dot(L, L)
        self.flexibility = self.square / stiffness
        self.strains = [response.strain for response in responses]
        self.weights = [response.multipliers for response in responses]
        self.rates = [L @ response.strain.T + response.bond_displacement for response in responses]
        self.slips = [dot(L, rate) - a * s * self.flexibility for rate, a in zip(self.rates, c, strict=True)]
        stretch = 2 * (s / stiffness)[:, None] * L
        self.slips_by_L = [rate + L @ A - a * stretch for rate, A, a in zip(self.rates, self.strains, c, strict=True)]

    def cubed(self, growth: float) -> Sums:
        """E_aaa − growth·E_aa of the first strain."""
        A, m, c, s, L = self.strains[0], self.weights[0], self.c[0], self.s, self.L
        rate, slip, flexibility = self.rates[0], self.slips[0], self.flexibility
        curved = L @ self.curvature
        stretch = dot(rate, rate) + dot(L, curved)
        cube = s**2 * flexibility / self.k
        edges = -growth * c**2 * s**2 * flexibility - 3 * c**3 * s * cube + 3 * c * (s * stretch + 2 * m * slip)
        by_s = -2 * growth * c**2 * s * flexibility - 9 * c**3 * cube + 3 * c * (stretch - 2 * c * m * flexibility)
        along = -2 * growth * c**2 * s**2 / self.k - 6 * c**3 * s**3 / self.k**2
        by_L = along[:, None] * L + (6 * c * s)[:, None] * (rate @ A + curved)
        by_L += (6 * c * m)[:, None] * self.slips_by_L[0]
        by_k = (growth * c**2 * s**2 + 6 * c**2 * m * s + 6 * c**3 * s**3 / self.k) * flexibility / self.k
        by_c = -2 * growth * c * s**2 * flexibility - 9 * c**2 * s * cube + 3 * (s * stretch + 2 * m * slip)
        by_c -= 6 * c * m * s * flexibility
        amplitudes = np.zeros(len(self.strains))
        amplitudes[0] = np.sum(by_c)
        return float(np.sum(edges)), by_s, by_L, by_k, amplitudes

    def shear(self) -> Sums:
        """V C_G of the second strain, along the first."""
        (A, B), (m, n), (a, b), s, L = self.strains, self.weights, self.c, self.s, self.L
        (rate_a, rate_b), (slip_a, slip_b), flexibility = self.rates, self.slips, self.flexibility
        d = L.shape[1]
        shearing = dot(rate_b, rate_b)
        mixed = dot(rate_a, rate_b) + dot(L, L @ B) / d
        cube = s**2 * flexibility / self.k
        single, double = s * shearing + 2 * n * slip_b, s * mixed + n * slip_a + m * slip_b
        edges = -3 * a * b**2 * s * cube + a * single + 2 * b * double - b**2 * s**2 * flexibility
        by_s = -9 * a * b**2 * cube + a * (shearing - 2 * b * n * flexibility)
        by_s += 2 * b * (mixed - (a * n + b * m) * flexibility) - 2 * b**2 * s * flexibility
        along = -6 * a * b**2 * s**3 / self.k**2 - 2 * b**2 * s**2 / self.k
        by_L = along[:, None] * L + (2 * a * s)[:, None] * (rate_b @ B) + (2 * a * n)[:, None] * self.slips_by_L[1]
        by_L += (2 * b * s)[:, None] * (rate_b @ A + rate_a @ B + (L @ B + L @ B.T) / d)
        by_L += (2 * b) * (n[:, None] * self.slips_by_L[0] + m[:, None] * self.slips_by_L[1])
        by_k = 6 * a * b**2 * s**3 / self.k + b**2 * s**2 + (4 * a * b * n + 2 * b**2 * m) * s
        by_k *= flexibility / self.k
        by_a = -3 * b**2 * s * cube + single - 2 * b * n * s * flexibility
        by_b = -6 * a * b * s * cube + 2 * double - 2 * (a * n + b * m + b * s) * s * flexibility
        return float(np.sum(edges)), by_s, by_L, by_k, np.array([np.sum(by_a), np.sum(by_b)])
