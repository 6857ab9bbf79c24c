"""Stiffening coefficients as quantities with exact gradients: growth past the transition can be designed.

A third derivative of the energy is stationary in the responses u and λ, so its derivative by σ needs none of theirs:
    dC/dσ = ∂C/∂σ|_(L,u,λ) + pull-back of ∂C/∂L|_(σ,u,λ),   dC/dk = ∂C/∂k|_(σ,L,u,λ),
one bordered solve for the responses and one with P for the pull-back (`third_order`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from critflow.critical.manifold import Balance, CriticalConfiguration, CriticalManifold
from critflow.critical.quantity import Balanced, Partials, SpringResponse
from critflow.critical.transition import TransitionModulus, dilation, largest_value, pure_shear
from critflow.networks.deformation import Deformation, deformation_of
from critflow.networks.network import Array, Network
from critflow.response.third_order import Term, ThirdOrderEnergy, cubed, squared
from critflow.result import InputError
from critflow.springs.laws import HOOKEAN


@dataclass(frozen=True, eq=False, repr=False)
class Stiffening(SpringResponse):
    """C of the modulus (1/V) d²E/dγ² = M_0 + Cγ along a path of deformations, C = E_γγγ/V − M_0 tr A (`stiffening`).

    deformation  the path, without free components; None: C_B = dB/dγ, or C_G = dG/dγ by the energy convention
                 (`of_shear`), under dilation (`ModulusStrainScaling`)
    maximise     whether the largest value is the best
    """

    analytic: ClassVar[bool] = False
    deformation: Deformation | None = None
    of_shear: bool = False
    maximise: bool = False

    def __post_init__(self) -> None:
        if self.deformation is not None and self.deformation.free:
            raise InputError(f"free components of {self.deformation.name} relax the self-stress: fix the cell")

    @property
    def name(self) -> str:
        if self.deformation is not None:
            return f"stiffening[{self.deformation.name}]"
        return "C_G" if self.of_shear else "C_B"

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        energy, terms, V = *self._energy(balance), balance.network.volume
        third, (growth, modulus) = energy.third(terms), self._growth(balance.network.dimension)
        M_0, (M_sigma, M_L) = modulus.evaluate(balance)
        partials = third.by_stress / V - growth * M_sigma, third.by_bonds / V - growth * M_L
        return third.value / V - growth * M_0, partials

    def error(self, critical: CriticalConfiguration) -> float:
        """That of the partial derivatives, and the error (estimate) of the third derivative for exact bond vectors."""
        energy, terms = self._energy(critical)
        third = energy.third_error(terms, energy.third(terms).by_length)
        return super().error(critical) + third / critical.network.volume

    def by_stiffness(self, balance: Balanced) -> Array:
        """dC/dk (N_b,) at constant σ: the configuration does not depend on k."""
        energy, terms = self._energy(balance)
        growth, modulus = self._growth(balance.network.dimension)
        return energy.third(terms).by_stiffness / balance.network.volume - growth * modulus.by_stiffness(balance)

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

    def best_stress(self, manifold: CriticalManifold) -> Array | None:
        """σ = k of the least C_B in the plane and in space, where B_0 is largest: C_B = (3/d − 2) B_0."""
        least = not (self.maximise or self.of_shear or self.deformation is not None)
        return manifold.network.stiffness if least and manifold.network.dimension > 1 else None

    def _growth(self, dimension: int) -> tuple[float, TransitionModulus]:
        """The growth of the volume, and the modulus that loses by it."""
        if self.of_shear:
            return 1.0, TransitionModulus(pure_shear(dimension))
        if self.deformation is None:
            # C_B has B itself in place of E_γγ.
            return -1.0, TransitionModulus(dilation(dimension))
        A = self.deformation.rate(0.0)
        return float(np.trace(A)), TransitionModulus(A)

    def _energy(self, balance: Balanced) -> tuple[ThirdOrderEnergy, list[Term]]:
        """The energy of Hooke's law and the terms of the third derivative; C_B and C_G share responses at a balance."""
        d = balance.network.dimension
        if self.deformation is not None:
            return _energy(balance, [self.deformation.rate(0.0)]), cubed(0, self.deformation.second_rate(0.0))
        shared = balance.shared if isinstance(balance, Balance) else {}
        if "dilation and shear" not in shared:
            shared["dilation and shear"] = _energy(balance, [dilation(d), pure_shear(d)])
        terms = cubed(0, (1 / d) * (1 / d - 1) * np.eye(d))
        if self.of_shear:
            terms = squared(1, 0, np.zeros((d, d)), pure_shear(d) / d)
        return shared["dilation and shear"], terms


def volumetric_stiffening(network: Network, name: str) -> Stiffening:
    """C_B or C_G."""
    return Stiffening(of_shear=name == "C_G")


def stiffening_along(network: Network, deformation: str) -> Stiffening:
    """stiffening[D] of a deformation D."""
    return Stiffening(deformation_of(deformation, network.dimension))


def _energy(balance: Balanced, strains: list[Array]) -> ThirdOrderEnergy:
    system = balance.manifold.system(balance.sigma)
    return ThirdOrderEnergy(balance.network, balance.sigma, balance.bond_vectors, system, HOOKEAN, strains)
