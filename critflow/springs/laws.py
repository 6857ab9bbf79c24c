"""Spring laws: the energy of one spring as a function of its extension e = |L| − ℓ.

Every law has zero tension and E'' = k at |L| = ℓ, so that all laws share the critical configurations and the moduli at
the transition; they differ past it, from C_B and C_G on (`ForceDensity`, `ModifiedStiffness`).  Near the transition e
is tiny, so laws are functions of e itself, without cancellation.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np

from critflow.networks.network import Array
from critflow.result import InputError

LAW_AT_REST = 1e-12  # energy and tension that a law may have at rest: rounding of its formula
LAW_STIFFNESS_AT_REST = 1e-9  # relative deviation of E'' from k at rest
# Relative deviation of a function of a law from the fourth-order difference of the previous one, with steps of a
# fiftieth of the reach of the law, which is accurate to 1e-7.
LAW_CONSISTENCY = 1e-4


class SpringLaw(ABC):
    """Energy, tension E', stiffness E'' and E''' of springs of extensions e, rest lengths ℓ and stiffnesses k.

    All arguments and results are arrays (N_b,).  Beyond the longest extension of a law the energy is infinite.  A new
    law is a subclass with these four methods.

    convex  E'' ≥ 0 for all e ≥ 0: an equilibrium without compressed springs is then the global minimum of the energy,
            and `strain_path` need not check that it stays on its branch.  False is correct for every law
    """

    convex: ClassVar[bool] = False
    # Whether the energy is zero below the rest length: every equilibrium of a convex law is then the global minimum.
    one_sided: ClassVar[bool] = False

    @property
    def near_rest(self) -> SpringLaw:
        """The law next to |L| = ℓ, where E'' = k: Hookean, but for springs that are slack below."""
        return self if self.one_sided else HOOKEAN

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

    convex: ClassVar[bool] = True

    def energy(self, extension: Array, rest: Array, k: Array) -> Array:
        return 0.5 * k * extension**2

    def tension(self, extension: Array, rest: Array, k: Array) -> Array:
        return k * extension

    def stiffness(self, extension: Array, rest: Array, k: Array) -> Array:
        return k

    def stiffening(self, extension: Array, rest: Array, k: Array) -> Array:
        return np.zeros_like(k)


@dataclass(frozen=True)
class Cable(SpringLaw):
    """E = ½ k e² for e > 0, else zero: a cable.  Convex, so every equilibrium is a global minimum; E'' = k at rest."""

    convex: ClassVar[bool] = True
    one_sided: ClassVar[bool] = True

    def energy(self, extension: Array, rest: Array, k: Array) -> Array:
        return 0.5 * k * np.maximum(extension, 0.0) ** 2

    def tension(self, extension: Array, rest: Array, k: Array) -> Array:
        return k * np.maximum(extension, 0.0)

    def stiffness(self, extension: Array, rest: Array, k: Array) -> Array:
        return np.where(extension >= 0, k, 0.0)

    def stiffening(self, extension: Array, rest: Array, k: Array) -> Array:
        return np.zeros_like(k)


HOOKEAN = Hookean()

# Extensions, in units of ℓ, at which the derivatives and the convexity of a law are checked.
_REACHES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
_STRETCHES = (1e-3, 1e-2, 0.1, 0.3, 1.0, 3.0)


def checked_law(law: SpringLaw, rest: Array, k: Array) -> SpringLaw:
    """The law itself if it is consistent for springs ℓ, k (N_b,), else an `InputError`.

    At rest it has zero energy, zero tension and the stiffness k; each of its functions is the derivative of the
    previous one at a few extensions; a law with `convex = True` has no negative E'' at a few stretched lengths.
    """
    if not isinstance(law, SpringLaw):
        raise InputError(f"law must be a SpringLaw such as Hookean() or PowerLaw(4), not {law!r:.60}")
    # Tests have the formulas of the laws of this package.
    if type(law).__module__.startswith(f"{__package__}."):
        return law
    name, functions = type(law).__name__, (law.energy, law.tension, law.stiffness, law.stiffening)
    nothing = np.zeros_like(rest)
    energy, tension, stiffness = (f(nothing, rest, k) for f in functions[:3])
    if not (np.abs(energy) <= LAW_AT_REST * k * rest**2).all() or not (np.abs(tension) <= LAW_AT_REST * k * rest).all():
        raise InputError(f"the law {name} must have no energy and no tension at rest: subtract its values at e = 0")
    if not (np.abs(stiffness - k) <= LAW_STIFFNESS_AT_REST * k).all():
        found = float(np.ravel(stiffness / k)[0])
        advice = "scale it" if found > 0 else "give an energy with a minimum at rest"
        raise InputError(f"the law {name} has {found:.3g} k as its stiffness at rest where E'' must be k: {advice}")
    # Far inside the largest extension of the law.
    reach = next((r for r in _REACHES if np.isfinite(law.energy(r * rest, rest, k)).all()), _REACHES[-1]) * rest
    for order, (function, derivative) in enumerate(pairwise(functions), 1):
        for e in (-0.2 * reach, nothing, 0.2 * reach):
            value, size = derivative(e, rest, k), k * reach ** (2 - order)
            error = np.abs(value - _difference(function, e, rest, k, 0.02 * reach))
            if not (error <= LAW_CONSISTENCY * np.maximum(size, np.abs(value))).all():
                raise InputError(
                    f"the law {name} is not consistent: its {derivative.__name__} is not the derivative of its "
                    f"{function.__name__} at small extensions"
                )
    for stretch in _STRETCHES if law.convex else ():
        reached = np.isfinite(law.energy(stretch * rest, rest, k))
        if (law.stiffness(stretch * rest, rest, k)[reached] < 0).any():
            raise InputError(
                f"the law {name} has a negative stiffness at an extension of {stretch:g} ℓ, so it is not convex: "
                "remove its `convex = True`"
            )
    return law


def _difference(function: Callable[[Array, Array, Array], Array], e: Array, rest: Array, k: Array, h: Array) -> Array:
    """The derivative by the extension as a central difference of fourth order."""
    ends = [function(e + n * h, rest, k) for n in (-2, -1, 1, 2)]
    return (8 * (ends[2] - ends[1]) - (ends[3] - ends[0])) / (12 * h)
