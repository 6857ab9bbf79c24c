"""Gradient and Hessian of an objective on the critical manifold, O(σ) = O(σ, L(σ)), at one stress."""

from __future__ import annotations

from dataclasses import dataclass

from critflow.critical.manifold import Balance, CriticalManifold
from critflow.critical.quantity import Objective
from critflow.networks.network import Array


@dataclass(frozen=True, eq=False)
class Evaluation:
    """An objective at one stress, with the factor that products with its Hessian need.

    value     O
    gradient  dO/dσ, (N_b,) (`TotalDeriv`)
    adjoint   g P⁻¹ gᵀ ∂O/∂L, (N_b, d)
    """

    objective: Objective
    balance: Balance
    value: float
    gradient: Array
    adjoint: Array

    def hessian_product(self, dsigma: Array) -> Array:
        """(∂²O/∂σ∂σ) σ̇, (N_b,), by two solves.

        Raises `NotImplementedError` for an objective without a `differential`.
        """
        balance = self.balance
        dL = balance.tangent(dsigma)
        second = self.objective.differential(balance.sigma, balance.bond_vectors, dsigma, dL)
        return balance.pull_back_tangent(dL, self.adjoint, dsigma, second)


def evaluate(manifold: CriticalManifold, objective: Objective, sigma: Array) -> Evaluation:
    """Value and gradient of an objective at a stress σ (N_b,), unchecked, by one factorisation and 2d solves."""
    balance = manifold.balance(sigma)
    value, partials = objective.evaluate(sigma, balance.bond_vectors)
    gradient, adjoint = balance.pull_back(*partials)
    return Evaluation(objective, balance, value, gradient, adjoint)
