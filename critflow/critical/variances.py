"""Variances of lengths and of tensions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from critflow.critical.manifold import CriticalManifold
from critflow.critical.quantity import Balanced, Partials, Quantity
from critflow.linalg.vectors import norms
from critflow.networks.network import Array, Network


class OfLengths(Quantity):
    """A quantity of lengths and tensions: independent of the stiffness, and not negative but for signed areas."""

    def by_stiffness(self, balance: Balanced) -> Array:
        return np.zeros_like(balance.sigma)

    def extreme(self, manifold: CriticalManifold, positive: bool = True) -> tuple[float, float]:
        return 0.0, np.inf


class _RelativeVariance(OfLengths):
    """⟨(v − ⟨v⟩)²⟩/⟨v⟩² of v = w|L|, where the weights w are one, or the stresses."""

    of_tensions: ClassVar[bool]

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        L = balance.bond_vectors
        length = norms(L)
        if self.of_tensions:
            value, derivative = _relative_variance(balance.sigma * length)
            return value, (derivative * length, (derivative * balance.sigma / divisors(length))[:, None] * L)
        value, derivative = _relative_variance(length)
        return value, (np.zeros_like(length), (derivative / divisors(length))[:, None] * L)


@dataclass(frozen=True, repr=False)
class LengthVariance(_RelativeVariance):
    """V_L = ⟨(|L| − ⟨|L|⟩)²⟩/⟨|L|⟩² (`LengthVariance`)."""

    name: ClassVar[str] = "V_L"
    of_tensions: ClassVar[bool] = False


@dataclass(frozen=True, repr=False)
class TensionVariance(_RelativeVariance):
    """V_τ = ⟨(τ − ⟨τ⟩)²⟩/⟨τ⟩² of the tensions τ = σ|L| (`TensionVariance`)."""

    name: ClassVar[str] = "V_tau"
    of_tensions: ClassVar[bool] = True


def variance(network: Network, name: str) -> Quantity:
    """V_L or V_tau."""
    return LengthVariance() if name == LengthVariance.name else TensionVariance()


def divisors(length: Array) -> Array:
    """Lengths (N_b,), NaN for an edge without length: there |L| has no derivative."""
    return np.where(length.real > 0, length, np.nan)


def _relative_variance(values: Array) -> tuple[float, Array]:
    """Variance over squared mean, without cancellation, and its derivative."""
    mean = _mean(values)
    deviation = values - mean
    square = mean * mean  # not a power, whose last bit depends on the units
    variance = _mean(deviation * deviation) / square
    return variance, 2 / (len(values) * square) * (deviation - variance * mean)


def _mean(values: Array) -> float:
    """The bits of `values.mean()`, which takes three times as long for small networks."""
    return np.add.reduce(values).item() / len(values)
