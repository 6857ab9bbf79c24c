"""Gradient and Hessian of a quantity on the critical manifold, O(σ) = O(σ, L(σ)), at one stress."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from critflow.critical.manifold import Balance, CriticalManifold
from critflow.critical.quantity import DIFFERENCE, Quantity
from critflow.networks.network import Array


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A quantity at one stress, with the factor that products with its Hessian need.

    value     O
    gradient  dO/dσ, (N_b,) (`TotalDeriv`)
    adjoint   g P⁻¹ gᵀ ∂O/∂L, (N_b, d)
    """

    quantity: Quantity
    balance: Balance
    value: float
    gradient: Array
    adjoint: Array

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
