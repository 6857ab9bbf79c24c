"""The modulus under weak forces as a quantity with its gradient: the stiffest network at given κ can be designed.

The full equation of `weak_forces` gives the value, `weak_derivatives` its derivatives by σ, L and x.  With P y = ∂O/∂x
that by x is a derivative by bond vectors, σ ∘ g y, which the pull-back needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from critflow.deformation import Deformable, Deformation
from critflow.manifold import CriticalConfiguration
from critflow.networks import Array
from critflow.quantities import Balanced, Partials, SpringResponse
from critflow.result import InputError
from critflow_extras.weak.weak_energies import WeakEnergy
from critflow_extras.weak.weak_forces import WeakForces, weak_forces

# Relative error of the modulus, from differences along a strain and from interpolation between tensions.
_ACCURACY = 1e-8


@dataclass(frozen=True, eq=False, repr=False)
class WeakModulus(SpringResponse):
    """(1/V) d²E/dγ² under a weak energy κU, along a deformation and at a strain γ counted from the transition.

    energy, deformation  as for `weak_forces`; `Temperature()` alone: κ is T
    kappa                κ > 0

    The value is `weak_forces(...).value.modulus(strain, kappa)`, NaN where the theory ends; its error is that of the
    theory, `WeakForces.modulus_error`, and of the numbers.  Angle springs of fixed stiffness are stiff without limit
    where edges shrink, so that a largest value may not exist: `design` for a value.
    """

    energy: WeakEnergy
    kappa: float
    strain: float = 0.0
    deformation: Deformable = "dilation"

    maximise = True
    analytic: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if not (np.isfinite(self.strain) and 0 < self.kappa < np.inf):
            raise InputError(f"kappa must be positive and the strain finite, not {self.kappa} and {self.strain}")

    @property
    def name(self) -> str:
        path = self.deformation.name if isinstance(self.deformation, Deformation) else self.deformation
        return f"modulus[{path}] at kappa {self.kappa:g}, strain {self.strain:g}"

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        sigma, L = balance.sigma, balance.bond_vectors
        weak = self._weak(balance)
        if weak is None:
            return np.nan, (np.full_like(sigma, np.nan), np.full_like(L, np.nan))
        by_sigma, by_L, by_x, _ = weak.modulus_derivatives(self.strain, self.kappa)
        y = balance.manifold.prestress.factorize(sigma).solve(by_x)
        by_sigma = by_sigma * np.linalg.norm(weak.critical.sigma) / np.linalg.norm(sigma)
        value = float(weak.modulus(self.strain, self.kappa))
        return value, (by_sigma, by_L + sigma[:, None] * (balance.network.free_incidence @ y))

    def by_stiffness(self, balance: Balanced) -> Array:
        """∂O/∂k (N_b,)."""
        weak = self._weak(balance)
        if weak is None:
            return np.full_like(balance.sigma, np.nan)
        return weak.modulus_derivatives(self.strain, self.kappa)[3]

    def error(self, critical: CriticalConfiguration) -> float:
        weak = self._weak(critical)
        if weak is None:
            return np.nan
        theory = float(weak.modulus_error(self.strain, self.kappa))
        return super().error(critical) + theory + _ACCURACY * abs(float(weak.modulus(self.strain, self.kappa)))

    def _weak(self, balance: Balanced) -> WeakForces | None:
        """The weak forces of the balance where they have a modulus."""
        solved = balance.manifold.solve(balance.sigma)
        if not solved.ok:
            return None
        found = weak_forces(solved.value, self.energy, self.deformation, throw=False)
        return found.value if found.ok and np.isfinite(found.value.modulus(self.strain, self.kappa)) else None
