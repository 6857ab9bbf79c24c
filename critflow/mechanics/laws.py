"""Spring laws: how the energy of one spring grows with its extension e = |L| − ℓ.

Every law is at rest at |L| = ℓ, with no tension there and E''(ℓ) = k, so that all laws share the critical
configurations and the moduli at the transition; they differ past it, from C_B and C_G on (`ForceDensity`,
`ModifiedStiffness`).  Near the transition e is tiny, so laws are functions of e itself and lose none of its digits.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import hyp2f1

from critflow.networks.network import Array
from critflow.result import InputError


class SpringLaw(ABC):
    """Energy, tension E', stiffness E'' and E''' of springs of extensions e, rest lengths ℓ and stiffnesses k.

    All arguments and answers are arrays (N_b,).  A spring that cannot be stretched so far has an infinite energy.
    """

    @abstractmethod
    def energy(self, extension: Array, rest: Array, k: Array) -> Array:
        """E, zero at rest."""

    @abstractmethod
    def tension(self, extension: Array, rest: Array, k: Array) -> Array:
        """E' = dE/d|L|, zero at rest."""

    @abstractmethod
    def stiffness(self, extension: Array, rest: Array, k: Array) -> Array:
        """E'', k at rest."""

    @abstractmethod
    def stiffening(self, extension: Array, rest: Array, k: Array) -> Array:
        """E'''."""


@dataclass(frozen=True)
class Hookean(SpringLaw):
    """E = ½ k e² (`HookeanEnergy`)."""

    def energy(self, extension: Array, rest: Array, k: Array) -> Array:
        return 0.5 * k * extension**2

    def tension(self, extension: Array, rest: Array, k: Array) -> Array:
        return k * extension

    def stiffness(self, extension: Array, rest: Array, k: Array) -> Array:
        return k

    def stiffening(self, extension: Array, rest: Array, k: Array) -> Array:
        return np.zeros_like(k)


@dataclass(frozen=True)
class PowerLaw(SpringLaw):
    """E'' = k (|L|/ℓ)^{n−2} with the exponent n ≥ 2 of the length in the energy; n = 2 is Hookean."""

    exponent: float

    def __post_init__(self) -> None:
        if not 2 <= self.exponent < np.inf:
            raise InputError(f"the exponent of a power law must be at least 2 and finite, not {self.exponent}")

    def energy(self, extension: Array, rest: Array, k: Array) -> Array:
        # kℓ²/(n − 1)·((λⁿ − 1)/n − (λ − 1)), λ = |L|/ℓ, without the difference: k e² ∫ (1 − s)(1 + s e/ℓ)^{n−2} ds.
        return 0.5 * k * extension**2 * hyp2f1(2 - self.exponent, 1, 3, -extension / rest)

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

    The slack m > 0 is what a spring can gain, as a part of its rest length; tension diverges there as (1 − u)⁻².
    """

    slack: float

    def __post_init__(self) -> None:
        if not 0 < self.slack < np.inf:
            raise InputError(f"the slack of a worm-like law must be positive and finite, not {self.slack}")

    def energy(self, extension: Array, rest: Array, k: Array) -> Array:
        with np.errstate(divide="ignore"):
            return k * extension**2 * (1 + 0.5 / self._room(extension, rest)) / 3

    def tension(self, extension: Array, rest: Array, k: Array) -> Array:
        room = self._room(extension, rest)
        with np.errstate(divide="ignore"):
            return 2 / 3 * k * extension * (1 + 0.25 * (1 + room) / room**2)

    def stiffness(self, extension: Array, rest: Array, k: Array) -> Array:
        with np.errstate(divide="ignore"):
            return 2 / 3 * k * (1 + 0.5 / self._room(extension, rest) ** 3)

    def stiffening(self, extension: Array, rest: Array, k: Array) -> Array:
        with np.errstate(divide="ignore"):
            return k / (self.slack * rest) / self._room(extension, rest) ** 4

    def _room(self, extension: Array, rest: Array) -> Array:
        """1 − u, what is left to the contour length; none beyond it."""
        return np.maximum(1 - extension / (self.slack * rest), 0.0)


HOOKEAN = Hookean()

# Laws whose energy is convex in the extension of stretched springs.
CONVEX_LAWS = (Hookean, PowerLaw, WormLike)

# Relative error that fourth-order differences stay below, their steps being a fiftieth of what a law can reach.
_CONSISTENT = 1e-4


def checked_law(law: SpringLaw, rest: Array, k: Array) -> SpringLaw:
    """The law itself if springs ℓ, k (N_b,) can follow it, else an `InputError`.

    At rest it has no energy, no tension and the stiffness k; each of its functions is the derivative of the one
    before, at a few extensions about rest.
    """
    if not isinstance(law, SpringLaw):
        raise InputError(f"law must be a SpringLaw such as Hookean() or PowerLaw(4), not {law!r:.60}")
    if type(law) in CONVEX_LAWS:
        return law
    name = type(law).__name__
    at_rest = np.zeros_like(rest)
    energy, tension, stiffness, _ = (f(at_rest, rest, k) for f in _functions(law))
    if not (np.abs(energy) <= 1e-12 * k * rest**2).all() or not (np.abs(tension) <= 1e-12 * k * rest).all():
        raise InputError(f"the law {name} must have no energy and no tension at rest: subtract what it has at e = 0")
    if not (np.abs(stiffness - k) <= 1e-9 * k).all():
        found = float(np.ravel(stiffness / k)[0])
        advice = "scale it" if found > 0 else "give an energy with a minimum at rest"
        raise InputError(f"the law {name} has {found:.3g} k as its stiffness at rest where E'' must be k: {advice}")
    for reach in (1e-1, 1e-2, 1e-3, 1e-4, 1e-5):
        # Far inside what the law can reach.
        if np.isfinite(law.energy(reach * rest, rest, k)).all():
            break
    step = 0.02 * reach * rest
    for function, derivative, order in zip(_functions(law), _functions(law)[1:], (1, 2, 3), strict=False):
        for e in (-0.2 * reach * rest, at_rest, 0.2 * reach * rest):
            value, scale = derivative(e, rest, k), k * (reach * rest) ** (2 - order)
            difference = _derivative(lambda e, f=function: f(e, rest, k), e, step)  # type: ignore[misc]
            if not (np.abs(value - difference) <= _CONSISTENT * np.maximum(scale, np.abs(value))).all():
                raise InputError(
                    f"the law {name} is not consistent: its {derivative.__name__} is not the derivative of its "
                    f"{function.__name__} at small extensions"
                )
    return law


def _functions(law: SpringLaw) -> tuple[Callable[[Array, Array, Array], Array], ...]:
    return law.energy, law.tension, law.stiffness, law.stiffening


def _derivative(function: Callable[[Array], Array], e: Array, h: Array) -> Array:
    """Central difference of fourth order."""
    return (8 * (function(e + h) - function(e - h)) - (function(e + 2 * h) - function(e - 2 * h))) / (12 * h)
