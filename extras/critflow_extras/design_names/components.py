"""Components of the stress S/√D at the transition, which determines all moduli there, and of the elasticity tensor.

S:A/√D = W/√D,   C = S⊗S/(V D),   with W and D of `critflow.quantities`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from critflow.deformation import strain_basis
from critflow.manifold import CriticalManifold
from critflow.networks import Array, Network
from critflow.numerics import dot
from critflow.quantities import Balanced, Partials, SpringResponse, largest_value


class WorkAndCost:
    """W and D of one strain at a balance, with the derivatives of functions f(W, D) of them by σ and L."""

    def __init__(self, balance: Balanced, A: Array):
        self.sigma, self.L, self.k, self.A = balance.sigma, balance.bond_vectors, balance.network.stiffness, A
        self.AL = self.L @ A
        self.hdot = dot(self.L, self.AL)
        self.flexibility = dot(self.L, self.L) / self.k
        self.square = self.sigma * self.sigma
        self.work, self.cost = (self.sigma @ self.hdot).item(), (self.square @ self.flexibility).item()

    def partials(self, f_W: float, f_D: float) -> Partials:
        """∂O/∂σ and ∂O/∂L of f(W, D)."""
        by_sigma = f_W * self.hdot + 2 * f_D * self.sigma * self.flexibility
        by_L = (2 * f_W * self.sigma)[:, None] * self.AL + (2 * f_D * self.square / self.k)[:, None] * self.L
        return by_sigma, by_L

    @property
    def by_stiffness(self) -> Array:
        """−∂D/∂k, (N_b,)."""
        return np.asarray(self.square * self.flexibility / self.k)


@dataclass(frozen=True, eq=False, repr=False)
class StressComponent(SpringResponse):
    """Component S:A/√D of the stress, S = Σσ L⊗L, D = Σσ²|L|²/k: all that linear elasticity is at the transition.

    strain  (d, d) A, symmetric
    name    in tables, targets and messages
    """

    strain: Array
    name: str = "S"

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        terms = WorkAndCost(balance, self.strain)
        root = np.sqrt(terms.cost).item()
        return terms.work / root, terms.partials(1 / root, -0.5 * terms.work / (terms.cost * root))

    def by_stiffness(self, balance: Balanced) -> Array:
        terms = WorkAndCost(balance, self.strain)
        return 0.5 * terms.work / (terms.cost * np.sqrt(terms.cost).item()) * terms.by_stiffness

    def extreme(self, manifold: CriticalManifold, positive: bool = True) -> tuple[float, float]:
        reach = float(np.sqrt(largest_value(manifold, self.strain) * manifold.network.volume))
        return (0.0 if positive and np.linalg.eigvalsh(self.strain)[0] >= 0 else -reach), reach

    def unit(self, network: Network) -> float:
        return float(np.sqrt(network.stiffness.mean())) * network.spacing


@dataclass(frozen=True, eq=False, repr=False)
class TensorComponent(SpringResponse):
    """Component C_ab of the elasticity tensor; at the transition C_ab = S_a S_b/(V D).

    first, second  `StressComponent`s a and b
    """

    first: StressComponent
    second: StressComponent

    @property
    def name(self) -> str:
        return f"C_{self.first.name[2:]}{self.second.name[2:]}"

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        (a, of_a), (b, of_b) = self.first.evaluate(balance), self.second.evaluate(balance)
        volume = balance.network.volume
        by_sigma, by_L = ((b * one + a * two) / volume for one, two in zip(of_a, of_b, strict=True))
        return a * b / volume, (by_sigma, by_L)

    def by_stiffness(self, balance: Balanced) -> Array:
        a, b = self.first.evaluate(balance)[0], self.second.evaluate(balance)[0]
        return (b * self.first.by_stiffness(balance) + a * self.second.by_stiffness(balance)) / balance.network.volume

    def extreme(self, manifold: CriticalManifold, positive: bool = True) -> tuple[float, float]:
        """Extreme values of s_a s_b/V on the ellipsoid of S/√D."""
        form = modulus_form(manifold, np.array([self.first.strain, self.second.strain]))
        reach = float(np.sqrt(form[0, 0] * form[1, 1]))
        low = 0.5 * (float(form[0, 1]) - reach)
        # S is positive definite under tension: normal components are positive.
        normal = positive and all(np.linalg.eigvalsh(one.strain)[0] >= 0 for one in (self.first, self.second))
        return max(low, 0.0) if normal or self.first is self.second else low, 0.5 * (float(form[0, 1]) + reach)


def tensor_component(network: Network, name: str) -> SpringResponse:
    """The quantity of a name: S_xx, ..., C_xxxx, ..."""
    return _components(network.dimension)[name]


@cache
def _components(d: int) -> dict[str, SpringResponse]:
    """Components of the stress and of the elasticity tensor by name: the same objects at every call."""
    stress = [StressComponent(strain, f"S_{axes}") for axes, strain in zip(*strain_basis(d), strict=True)]
    tensor = [TensorComponent(first, second) for a, first in enumerate(stress) for second in stress[a:]]
    return {one.name: one for one in (*stress, *tensor)}


def modulus_form(manifold: CriticalManifold, strains: Array) -> Array:
    """The largest μ_A as a quadratic form of the strain A in a basis (m, d, d), from sums of two strains: (m, m)."""
    m = len(strains)
    form = np.empty((m, m))
    for a in range(m):
        for b in range(a + 1):
            form[a, b] = form[b, a] = largest_value(manifold, strains[a] + strains[b])
    single = np.diag(form) / 4
    return np.asarray(0.5 * (form - single[:, None] - single[None]))
