"""Laws of springs that stiffen with extension, and that extend by a limited length."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy

from critflow.arguments import shown
from critflow.networks.network import Array
from critflow.result import InputError
from critflow.springs.laws import SpringLaw


@dataclass(frozen=True)
class PowerLaw(SpringLaw):
    """E'' = k (|L|/ℓ)^{n−2} with the exponent n ≥ 2 of the length in the energy; n = 2 is Hookean."""

    exponent: float
    convex: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not (isinstance(self.exponent, int | float | np.number) and 2 <= self.exponent < np.inf):
            raise InputError(f"the exponent of a power law must be at least 2 and finite, not {shown(self.exponent)}")

    def energy(self, extension: Array, rest: Array, k: Array) -> Array:
        # kℓ²/(n − 1)·((λⁿ − 1)/n − (λ − 1)), λ = |L|/ℓ, without the difference: k e² ∫ (1 − s)(1 + s e/ℓ)^{n−2} ds.
        return 0.5 * k * extension**2 * scipy.special.hyp2f1(2 - self.exponent, 1, 3, -extension / rest)

    def tension(self, extension: Array, rest: Array, k: Array) -> Array:
        power = self.exponent - 1
        return k * rest / power * np.expm1(power * np.log1p(extension / rest))

    def stiffness(self, extension: Array, rest: Array, k: Array) -> Array:
        return k * (1 + extension / rest) ** (self.exponent - 2)

    def stiffening(self, extension: Array, rest: Array, k: Array) -> Array:
        return k / rest * (self.exponent - 2) * (1 + extension / rest) ** (self.exponent - 3)


@dataclass(frozen=True)
class WormLike(SpringLaw):
    """The law of Marko and Siggia (1995), E' = ⅔ k m ℓ (¼(1 − u)⁻² − ¼ + u): no spring exceeds (1 + m)ℓ, u = e/(mℓ).

    The slack m > 0 is the largest extension in units of the rest length; the tension diverges there as (1 − u)⁻².
    """

    slack: float
    convex: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not (isinstance(self.slack, int | float | np.number) and 0 < self.slack < np.inf):
            raise InputError(f"the slack of a worm-like law must be positive and finite, not {shown(self.slack)}")

    def energy(self, extension: Array, rest: Array, k: Array) -> Array:
        with np.errstate(divide="ignore"):
            return k * extension**2 * (1 + 0.5 / self._left(extension, rest)) / 3

    def tension(self, extension: Array, rest: Array, k: Array) -> Array:
        left = self._left(extension, rest)
        with np.errstate(divide="ignore"):
            return 2 / 3 * k * extension * (1 + 0.25 * (1 + left) / left**2)

    def stiffness(self, extension: Array, rest: Array, k: Array) -> Array:
        with np.errstate(divide="ignore"):
            return 2 / 3 * k * (1 + 0.5 / self._left(extension, rest) ** 3)

    def stiffening(self, extension: Array, rest: Array, k: Array) -> Array:
        with np.errstate(divide="ignore"):
            return k / (self.slack * rest) / self._left(extension, rest) ** 4

    def _left(self, extension: Array, rest: Array) -> Array:
        """1 − u, the remaining part of the largest extension; zero beyond it."""
        return np.maximum(1 - extension / (self.slack * rest), 0.0)
