"""Quantities of critical configurations: a value, its partial derivatives, and what else is known about it.

A quantity is a function of a stress σ (N_b,) and the bond vectors L (N_b, d) that it balances on one network.  The
manifold converts its two partial derivatives into a gradient and products with the Hessian of O(σ) = O(σ, L(σ))
(`evaluate`).  No quantity depends on the scale of σ, as the configuration does not.  Quantities hold no network, so
that one of them serves a network and its parts alike.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from critflow.critical.manifold import Balance, CriticalConfiguration, CriticalManifold
from critflow.linalg.tolerances import EPS
from critflow.networks.network import Array, Network
from critflow.result import InputError, Record

DIFFERENCE = 1e-5  # relative step of central differences: their error is its square, and rounding leaves as many digits

Partials = tuple[Array, Array]
"""∂O/∂σ (N_b,) and ∂O/∂L (N_b, d)."""


class Balanced(Protocol):
    """A stress σ (N_b,) and bond vectors L (N_b, d) of one network: a `Balance` or a `CriticalConfiguration`."""

    @property
    def network(self) -> Network: ...
    @property
    def sigma(self) -> Array: ...
    @property
    def bond_vectors(self) -> Array: ...
    @property
    def manifold(self) -> CriticalManifold: ...


@dataclass(frozen=True, eq=False)
class StressedBonds:
    """A stress σ (N_b,) and bond vectors L (N_b, d) without coordinates: a `Balanced` where P is not needed."""

    manifold: CriticalManifold
    sigma: Array
    bond_vectors: Array

    @property
    def network(self) -> Network:
        return self.manifold.network


class Quantity(Record, ABC):
    """A function O(σ, L) of a network; derive from this class for a new one.

    A subclass must define `evaluate` and must not depend on the scale of σ.  The other methods are optional.

    maximise         whether the largest value is the best
    one_self_stress  whether the formula is valid only for networks with one self-stress
    elastic          whether it is a response of springs, which pressures in faces would change
    """

    maximise: bool = False
    one_self_stress: ClassVar[bool] = False
    elastic: ClassVar[bool] = False

    @property
    def name(self) -> str:
        """The name in tables, targets and messages."""
        return type(self).__name__

    @abstractmethod
    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        """O, and ∂O/∂σ (N_b,) and ∂O/∂L (N_b, d), as (O, (∂σ, ∂L)), at the σ and L of a balance."""

    def differential(self, balance: Balanced, dsigma: Array, dL: Array) -> Partials:
        """Derivatives of ∂O/∂σ and ∂O/∂L in the direction (σ̇, L̇), with the shapes of the two.

        Optional: without it products with the Hessian are differences of gradients, and Newton's method is refused.
        """
        raise InputError(f"{self.name} has no second derivatives: define its differential, or choose method='lbfgs'")

    def by_stiffness(self, balance: Balanced) -> Array:
        """∂O/∂k (N_b,) at constant σ and L; by central differences unless a subclass knows better."""
        network, rows = balance.network, np.empty(balance.network.n_edges)
        for edge, k in enumerate(network.stiffness):
            ends = []
            for sign in (1, -1):
                stiffness = network.stiffness.copy()
                stiffness[edge] = k * (1 + sign * DIFFERENCE)
                changed = network.with_stiffness(stiffness)
                there = StressedBonds(CriticalManifold.of(changed), balance.sigma, balance.bond_vectors)
                ends.append(self.evaluate(there)[0])
            rows[edge] = (ends[0] - ends[1]) / (2 * DIFFERENCE * k)
        return rows

    def error(self, critical: CriticalConfiguration) -> float:
        """Error (estimate) of the value at a configuration: |∂O/∂L| times the errors of the bonds, and rounding."""
        value, (by_sigma, by_L) = self.evaluate(critical)
        size = np.linalg.norm(by_L, axis=1)
        rounding = 4 * EPS * float(np.sum(np.abs(by_sigma * critical.sigma)) + size @ critical.lengths + abs(value))
        return float(size @ critical.bond_errors) + rounding

    def extreme(self, manifold: CriticalManifold, positive: bool = True) -> tuple[float, float]:
        """The smallest and the largest value that is possible on a network (proof); infinite where none is known.

        positive  whether every stress is positive
        """
        return -np.inf, np.inf

    def unit(self, network: Network) -> float:
        """The natural unit of the values on a network, in which absolute tolerances hold: 1 by default."""
        return 1.0

    @property
    def has_differential(self) -> bool:
        """Whether `differential` is defined."""
        return type(self).differential is not Quantity.differential

    def preconditioner(self, balance: Balanced) -> Array | float:
        """Diagonal Hessian (N_b,) of a penalty in log σ, of the sign ≥ 0 when minimised: the first matrix of L-BFGS."""
        return 0.0


class SpringResponse(Quantity):
    """A response of springs, such as a modulus, by a formula that is valid for one self-stress only."""

    one_self_stress: ClassVar[bool] = True
    elastic: ClassVar[bool] = True

    def unit(self, network: Network) -> float:
        """⟨k⟩ (V/N_v)^((2 − d)/d), the unit of moduli."""
        d = network.dimension
        return float(network.stiffness.mean()) * (1.0 if d == 2 else network.spacing ** (2 - d))


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A quantity at one stress, with the factor that products with its Hessian need."""

    quantity: Quantity
    balance: Balance
    value: float  # O
    gradient: Array  # dO/dσ, (N_b,) (`TotalDeriv`)
    adjoint: Array  # g P⁻¹ gᵀ ∂O/∂L, (N_b, d)

    def hessian_product(self, dsigma: Array) -> Array:
        """(∂²O/∂σ∂σ) σ̇, (N_b,), by two solves; by differences of gradients, to nine digits, without a differential."""
        balance = self.balance
        if not self.quantity.has_differential:
            step = DIFFERENCE / float(np.abs(dsigma / balance.sigma).max())
            ends = [evaluate(balance.manifold, self.quantity, balance.sigma + s * dsigma) for s in (step, -step)]
            return (ends[0].gradient - ends[1].gradient) / (2 * step)
        dL = balance.tangent(dsigma)
        second = self.quantity.differential(balance, dsigma, dL)
        return balance.pull_back_tangent(dL, self.adjoint, dsigma, second)


def evaluate(manifold: CriticalManifold, quantity: Quantity, sigma: Array) -> Evaluation:
    """Value and gradient of a quantity at a stress σ (N_b,), unchecked, by one factorisation and 2d solves."""
    return evaluate_at(manifold.balance(sigma), quantity)


def evaluate_at(balance: Balance, quantity: Quantity) -> Evaluation:
    """Value and gradient of a quantity at a balance, by d solves."""
    value, partials = quantity.evaluate(balance)
    gradient, adjoint = balance.pull_back(*partials)
    return Evaluation(quantity, balance, value, gradient, adjoint)
