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
from critflow.response.third_order import ThirdOrderEnergy, Triple
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
        return responses.derivatives(responses.sums(*self._derivative))

    def error(self, critical: CriticalConfiguration) -> float:
        """That of the partial derivatives, and the error (estimate) of the third derivative for exact bond vectors."""
        third = self._responses(critical).energy.third_error[int(self.of_shear)]
        return super().error(critical) + third / critical.network.volume

    def by_stiffness(self, balance: Balanced) -> Array:
        """dC/dk (N_b,) at constant σ: the configuration does not depend on k."""
        responses = self._responses(balance)
        return responses.by_stiffness(responses.sums(*self._derivative))

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

    @property
    def _derivative(self) -> tuple[int, float]:
        """The number of the third derivative, and the part of the second one that the volume takes from it."""
        if self.of_shear:
            return 1, 1.0
        # The volume grows by tr A: by γ itself under dilation, where C_B has B itself in place of E_γγ.
        return 0, -1.0 if self.deformation is None else float(np.trace(self.deformation.rate(0.0)))


Sums = tuple[float, Array, Array, Array, Array]
"""V C, and its derivatives by σ̂ (N_b,), L (N_b, d), k (N_b,) and the amplitudes, each with the others constant."""


class StrainResponses:
    """The responses at a balance to dilation and shear, or to one path, at which V C is a sum over edges.

    unit_stress  σ̂ = σ/norm, (N_b,)
    energy       third derivatives of the energy, for springs of Hooke's law
    rates        L̇ = L Aᵀ + g u of each strain, (N_b, d)
    slips        R = L·L̇ − c σ̂|L|²/k of each, (N_b,), and slips_by_L their derivatives by L
    """

    def __init__(self, balance: Balanced, path: Deformation | None = None):
        self.network, self.bond_vectors = balance.network, balance.bond_vectors
        self.norm = float(np.linalg.norm(balance.sigma))
        self.unit_stress = s = balance.sigma / self.norm
        d, k, L = self.network.dimension, self.network.stiffness, self.bond_vectors
        if path is None:
            self.strains = [dilation(d), pure_shear(d)]
            growing = Triple.cubed(0, (1 / d) * (1 / d - 1) * np.eye(d))
            self.triples = [growing, Triple.squared(1, 0, np.zeros((d, d)), pure_shear(d) / d)]
        else:
            self.strains, self.triples = [path.rate(0.0)], [Triple.cubed(0, path.second_rate(0.0))]
        system = balance.manifold.system(balance.sigma)
        self.energy = ThirdOrderEnergy(self.network, balance.sigma, L, system, HOOKEAN, self.strains, self.triples)
        responses = self.energy.responses
        self.amplitudes = np.array([response.amplitude for response in responses])
        self.flexibility = dot(L, L) / k
        self.rates = [L @ response.strain.T + response.bond_displacement for response in responses]
        slopes = list(zip(self.rates, self.strains, self.amplitudes, strict=True))
        self.slips = [dot(L, rate) - c * s * self.flexibility for rate, _, c in slopes]
        self.slips_by_L = [rate + L @ A - (2 * c * s / k)[:, None] * L for rate, A, c in slopes]

    def sums(self, number: int, growth: float) -> Sums:
        """E_iij − growth·E_ii of the strains (i, i, j) of a triple, and its derivatives at fixed responses u and λ."""
        triple, k, flexibility = self.triples[number], self.network.stiffness, self.flexibility
        s, L, c = self.unit_stress, self.bond_vectors, self.amplitudes
        m = [response.multipliers for response in self.energy.responses]
        i, _, j = triple.strains
        square, product, cube = growth * c[i] ** 2, c[i] ** 2 * c[j], s**2 * flexibility / k
        by_s = -2 * square * s * flexibility - 9 * product * cube
        by_L = (-2 * square * s**2 / k - 6 * product * s**3 / k**2)[:, None] * L
        by_k = (square * s**2 + 6 * product * s**3 / k) * flexibility / k
        by_c, cubes = np.zeros(len(c)), float(np.sum(s * cube))
        by_c[i] -= 2 * growth * c[i] * float(np.sum(s**2 * flexibility)) + 6 * c[i] * c[j] * cubes
        by_c[j] -= 3 * c[i] ** 2 * cubes
        for term in triple.terms:
            a, b, size, curved = term.b, term.c, term.count * c[term.a], L @ (0.5 * (term.curvature + term.curvature.T))
            stretch, slipping = dot(self.rates[a], self.rates[b]) + dot(L, curved), c[a] * m[b] + c[b] * m[a]
            part = s * stretch + m[a] * self.slips[b] + m[b] * self.slips[a]
            by_s += size * (stretch - slipping * flexibility)
            turned = self.rates[a] @ self.strains[b] + self.rates[b] @ self.strains[a] + 2 * curved
            slips = m[a][:, None] * self.slips_by_L[b] + m[b][:, None] * self.slips_by_L[a]
            by_L += size * (s[:, None] * turned + slips)
            by_k += size * slipping * s * flexibility / k
            by_c[term.a] += term.count * float(np.sum(part))
            for one, other in ((a, b), (b, a)):
                by_c[one] -= size * float(np.sum(m[other] * s * flexibility))
        return self.energy.third[number] - growth * self.energy.second(i, i), by_s, by_L, by_k, by_c

    def derivatives(self, sums: Sums) -> tuple[float, Partials]:
        """C and its partial derivatives by σ and L, with those by the amplitudes, which are functions of σ̂ and L."""
        network, L, s, flexibility = self.network, self.bond_vectors, self.unit_stress, self.flexibility
        value, by_s, by_L, _, by_c = sums
        D = float(s**2 @ flexibility)
        for c, derivative, strain in zip(self.amplitudes, by_c, self.strains, strict=True):
            AL = L @ (0.5 * (strain + strain.T))
            by_s += derivative * (dot(L, AL) - 2 * c * s * flexibility) / D
            by_L += (derivative / D) * (2 * s[:, None] * AL - (2 * c * s**2 / network.stiffness)[:, None] * L)
        by_sigma = (by_s - (by_s @ s) * s) / self.norm
        return value / network.volume, (by_sigma / network.volume, by_L / network.volume)

    def by_stiffness(self, sums: Sums) -> Array:
        """dC/dk, (N_b,): dc/dk = (c/D) σ̂² |L|²/k²."""
        network, flexibility, s = self.network, self.flexibility, self.unit_stress
        by_D = float(sums[4] @ self.amplitudes) / float(s**2 @ flexibility)
        return (sums[3] + by_D * s**2 * flexibility / network.stiffness) / network.volume
