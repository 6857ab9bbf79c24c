"""Stiffening coefficients as quantities with exact gradients: growth past the transition can be designed.

A third derivative of the energy is stationary in the responses u and λ, so its derivative by σ needs none of theirs:
    dC/dσ = ∂C/∂σ|_(L,u,λ) + pull-back of ∂C/∂L|_(σ,u,λ),   dC/dk = ∂C/∂k|_(σ,L,u,λ),
one bordered solve for the responses and one with P for the pull-back (`critflow.growth`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from critflow.deformation import Deformation, deformation_of
from critflow.descent import Optimum
from critflow.growth import StrainedEnergy, Term
from critflow.manifold import Balance, CriticalConfiguration, CriticalManifold
from critflow.networks import Array, Network
from critflow.numerics import EPS
from critflow.quantities import (
    Balanced,
    Partials,
    SpringResponse,
    TransitionModulus,
    dilation,
    evaluate,
    largest_value,
    pure_shear,
)
from critflow.result import InputError, Status
from critflow.springs import HOOKEAN
from critflow_extras.sensitivities.gradients import by_stiffness


@dataclass(frozen=True, eq=False, repr=False)
class StiffeningQuantity(SpringResponse):
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
        energy, terms, t, modulus = self._energy(balance)
        third, V, (M_0, (M_sigma, M_L)) = energy.third(terms), balance.network.volume, modulus.evaluate(balance)
        return third.value / V - t * M_0, (third.by_stress / V - t * M_sigma, third.by_bonds / V - t * M_L)

    def error(self, critical: CriticalConfiguration) -> float:
        """That of the partial derivatives, and the error (estimate) of the third derivative for exact bond vectors."""
        energy, terms, _, _ = self._energy(critical)
        third = energy.third_error(terms, energy.third(terms).by_length)
        return super().error(critical) + third / critical.network.volume

    def by_stiffness(self, balance: Balanced) -> Array:
        """dC/dk (N_b,) at constant σ: the configuration does not depend on k."""
        energy, terms, t, modulus = self._energy(balance)
        return energy.third(terms).by_stiffness / balance.network.volume - t * by_stiffness(modulus, balance)

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

    def best_known(self, manifold: CriticalManifold) -> Optimum | None:
        """The least C_B in the plane and in space, at σ = k, where B_0 is largest: C_B = (3/d − 2) B_0."""
        network = manifold.network
        if self.maximise or self.of_shear or self.deformation is not None or network.dimension == 1:
            return None
        solution = manifold.solve(network.stiffness)
        if not solution.ok:
            return Optimum(solution.value, solution.status, solution.stats, solution.note, objective=np.nan)
        here, best = evaluate(manifold.balance(solution.value.sigma), self), self.extreme(manifold)[0]
        stats = replace(solution.stats, method="closed_form", steps=0, residual=here.residual)
        error = partial(float, abs(here.value - best) + EPS * network.n_edges * abs(best))
        return Optimum(solution.value, Status.ok, stats, objective=here.value, error_of=error)

    def _energy(self, balance: Balanced) -> tuple[StrainedEnergy, list[Term], float, TransitionModulus]:
        """The energy of Hooke's law, the terms of E_abc, and t and the modulus M of C = E_abc/V − t M."""
        network, d = balance.network, balance.network.dimension

        def strained(*strains: Array) -> StrainedEnergy:
            system = balance.manifold.system(balance.sigma)
            return StrainedEnergy(network, balance.sigma, balance.bond_vectors, system, HOOKEAN, strains)

        if self.deformation is not None:
            A = self.deformation.rate(0.0)
            terms: list[Term] = [(3, 0, 0, 0, self.deformation.second_rate(0.0))]
            return strained(A), terms, float(np.trace(A)), TransitionModulus(A)
        # C_B and C_G share responses at a balance.
        shared, shear = balance.shared if isinstance(balance, Balance) else {}, pure_shear(d)
        if "dilation and shear" not in shared:
            shared["dilation and shear"] = strained(dilation(d), shear)
        if self.of_shear:
            terms = [(1, 0, 1, 1, np.zeros((d, d))), (2, 1, 0, 1, shear / d)]
            return shared["dilation and shear"], terms, 1.0, TransitionModulus(shear)
        # C_B has B itself in place of E_δδ.
        terms = [(3, 0, 0, 0, (1 / d) * (1 / d - 1) * np.eye(d))]
        return shared["dilation and shear"], terms, -1.0, TransitionModulus(dilation(d))


def volumetric_stiffening(network: Network, name: str) -> StiffeningQuantity:
    """C_B or C_G."""
    return StiffeningQuantity(of_shear=name == "C_G")


def stiffening_along(network: Network, deformation: str) -> StiffeningQuantity:
    """stiffening[D] of a deformation D."""
    return StiffeningQuantity(deformation_of(deformation, network.dimension))
