"""Objectives on the critical manifold: a value, its partial derivatives, and their derivatives in a direction.

An objective is a function of σ (N_b,) and L (N_b, d) only; the manifold converts its two partial derivatives into a
gradient.  All objectives here are independent of the scale of σ, as the configuration is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from critflow.arguments import checked
from critflow.networks.deformation import Deformable, deformation_of
from critflow.networks.network import Array, Network
from critflow.result import InputError, Record

Partials = tuple[Array, Array]
"""∂O/∂σ (N_b,) and ∂O/∂L (N_b, d)."""


class Objective(Record, ABC):
    """A function O(σ, L) to be optimised over stress; derive from this class for a new objective.

    A subclass must define `evaluate`, must not depend on the scale of σ, and sets `maximise` if the largest value is
    the best.  It may define `differential`, which Newton's method and `stress_hessian` need; without it a descent uses
    gradients only, and tests its end for a saddle by differences of gradients.

    maximise         whether the largest value is the best
    one_self_stress  whether the formula is valid only for networks with one self-stress
    """

    maximise: ClassVar[bool] = False
    one_self_stress: ClassVar[bool] = False

    @abstractmethod
    def evaluate(self, sigma: Array, L: Array) -> tuple[float, Partials]:
        """O, ∂O/∂σ (N_b,) and ∂O/∂L (N_b, d) at stresses σ (N_b,) and bond vectors L (N_b, d), as (O, (∂σ, ∂L))."""

    def differential(self, sigma: Array, L: Array, dsigma: Array, dL: Array) -> Partials:
        """Derivatives of ∂O/∂σ and ∂O/∂L in the direction (σ̇, L̇), with the shapes of the two."""
        raise InputError(
            f"{type(self).__name__} has no second derivatives: define its differential, or choose method='lbfgs'"
        )

    @property
    def has_differential(self) -> bool:
        """Whether `differential` is defined."""
        return type(self).differential is not Objective.differential

    def stiff_diagonal(self, sigma: Array) -> Array | float:
        """A steep part of ∂²O/∂(log σ)² that is diagonal and known, of the sign of a penalty: ≥ 0 when minimised."""
        return 0.0


@dataclass(frozen=True)
class LengthVariance(Objective):
    """V_L = ⟨(|L| − ⟨|L|⟩)²⟩/⟨|L|⟩² (`LengthVariance`)."""

    def evaluate(self, sigma: Array, L: Array) -> tuple[float, Partials]:
        length = np.linalg.norm(L, axis=1)
        value, derivative = _relative_variance(length)
        return value, (np.zeros_like(sigma), (derivative / length)[:, None] * L)

    def differential(self, sigma: Array, L: Array, dsigma: Array, dL: Array) -> Partials:
        length = np.linalg.norm(L, axis=1)
        unit = L / length[:, None]
        dlength = np.einsum("ad,ad->a", unit, dL)
        derivative, change = _relative_variance_differential(length, dlength)
        turning = (derivative / length)[:, None] * (dL - dlength[:, None] * unit)
        return np.zeros_like(sigma), change[:, None] * unit + turning


@dataclass(frozen=True)
class TensionVariance(Objective):
    """V_τ = ⟨(τ − ⟨τ⟩)²⟩/⟨τ⟩² of the tensions τ = σ|L| (`TensionVariance`)."""

    def evaluate(self, sigma: Array, L: Array) -> tuple[float, Partials]:
        length = np.linalg.norm(L, axis=1)
        value, derivative = _relative_variance(sigma * length)
        return value, (derivative * length, (derivative * sigma / length)[:, None] * L)

    def differential(self, sigma: Array, L: Array, dsigma: Array, dL: Array) -> Partials:
        length = np.linalg.norm(L, axis=1)
        unit = L / length[:, None]
        dlength = np.einsum("ad,ad->a", unit, dL)
        derivative, change = _relative_variance_differential(sigma * length, dsigma * length + sigma * dlength)
        stretching = (change * sigma + derivative * dsigma)[:, None] * unit
        turning = (derivative * sigma / length)[:, None] * (dL - dlength[:, None] * unit)
        return change * length + derivative * dlength, stretching + turning


@dataclass(frozen=True)
class TransitionModulus(Objective):
    """Modulus at the transition for b → (1 + γA) b: μ_A = (Σ σḣ)²/(V Σ σ²|L|²/k), ḣ = L·A L (`GenericModulus`).

    strain     (d, d) the affine strain A; only its symmetric part matters
    stiffness  (N_b,) k
    volume     V
    """

    strain: Array
    stiffness: Array
    volume: float

    maximise = True
    one_self_stress = True

    def evaluate(self, sigma: Array, L: Array) -> tuple[float, Partials]:
        AL = L @ self.symmetric
        hdot = np.einsum("ad,ad->a", L, AL)
        flexibility = np.einsum("ad,ad->a", L, L) / self.stiffness
        work, cost = sigma @ hdot, sigma**2 @ flexibility
        ratio = work / cost
        dO_dsigma = 2 * ratio * hdot - 2 * ratio**2 * sigma * flexibility
        dO_dL = (4 * ratio * sigma)[:, None] * AL - (2 * ratio**2 * sigma**2 / self.stiffness)[:, None] * L
        return float(work * ratio / self.volume), (dO_dsigma / self.volume, dO_dL / self.volume)

    def differential(self, sigma: Array, L: Array, dsigma: Array, dL: Array) -> Partials:
        AL, AdL = L @ self.symmetric, dL @ self.symmetric
        hdot, dhdot = np.einsum("ad,ad->a", L, AL), 2 * np.einsum("ad,ad->a", dL, AL)
        flexibility = np.einsum("ad,ad->a", L, L) / self.stiffness
        dflexibility = 2 * np.einsum("ad,ad->a", L, dL) / self.stiffness
        work, cost = sigma @ hdot, sigma**2 @ flexibility
        ratio = work / cost
        dwork = dsigma @ hdot + sigma @ dhdot
        dcost = 2 * (sigma * dsigma) @ flexibility + sigma**2 @ dflexibility
        dratio = dwork / cost - ratio * dcost / cost
        ddO_dsigma = (
            2 * dratio * hdot
            + 2 * ratio * dhdot
            - 4 * ratio * dratio * sigma * flexibility
            - 2 * ratio**2 * (dsigma * flexibility + sigma * dflexibility)
        )
        ddO_dL = (
            (4 * (dratio * sigma + ratio * dsigma))[:, None] * AL
            + (4 * ratio * sigma)[:, None] * AdL
            - (4 * ratio * sigma / self.stiffness * (dratio * sigma + ratio * dsigma))[:, None] * L
            - (2 * ratio**2 * sigma**2 / self.stiffness)[:, None] * dL
        )
        return ddO_dsigma / self.volume, ddO_dL / self.volume

    @property
    def symmetric(self) -> Array:
        """The symmetric part of A, (d, d): rotations do not change the modulus."""
        return 0.5 * (self.strain + self.strain.T)


@dataclass(frozen=True)
class ConstrainedModulus(Objective):
    """μ_A − (1/N_b) Σ (s_α/r)^(−10), s = σ scaled to Σs² = N_b (`ShearMod+Constraint`): keeps every s above about r."""

    modulus: TransitionModulus
    threshold: float = 0.1

    maximise = True
    one_self_stress = True
    exponent: ClassVar[int] = 10

    def evaluate(self, sigma: Array, L: Array) -> tuple[float, Partials]:
        value, (dO_dsigma, dO_dL) = self.modulus.evaluate(sigma, L)
        power, square = self._powers(sigma)
        penalty = power.mean()
        # s scales as σ/|σ|, so the derivative in the direction of σ cancels.
        derivative = self.exponent * (power / sigma - power.sum() * sigma / square) / len(sigma)
        return value - float(penalty), (dO_dsigma + derivative, dO_dL)

    def differential(self, sigma: Array, L: Array, dsigma: Array, dL: Array) -> Partials:
        ddO_dsigma, ddO_dL = self.modulus.differential(sigma, L, dsigma, dL)
        power, square = self._powers(sigma)
        growth = sigma @ dsigma / square
        dpower = -self.exponent * power * (dsigma / sigma - growth)
        change = dpower / sigma - power * dsigma / sigma**2
        change -= (dpower.sum() * sigma + power.sum() * (dsigma - 2 * growth * sigma)) / square
        return ddO_dsigma + self.exponent * change / len(sigma), ddO_dL

    def stiff_diagonal(self, sigma: Array) -> Array | float:
        return self.exponent**2 / len(sigma) * self._powers(sigma)[0]

    def _powers(self, sigma: Array) -> tuple[Array, float]:
        square = float(sigma @ sigma)
        scale = np.sqrt(len(sigma) / square) / self.threshold
        # By squares only: a general power is ten times slower.
        tenth = 1.0 / (scale * sigma) ** 2
        return tenth * (tenth**2) ** 2, square


def dilation(dimension: int) -> Array:
    """The affine strain of dV/V = γ to first order, A = 1/d: its modulus is B_0 (`BulkModulus`)."""
    return np.eye(dimension) / dimension


def pure_shear(dimension: int) -> Array:
    """The pure shear A = ½(e_x e_yᵀ + e_y e_xᵀ): its modulus is G_0 (`ShearModulus`)."""
    if dimension < 2:
        raise InputError("a shear needs at least two dimensions")
    A = np.zeros((dimension, dimension))
    A[0, 1] = A[1, 0] = 0.5
    return A


@checked
def transition_modulus(network: Network, strain: Deformable) -> TransitionModulus:
    """The modulus at the transition of a network for the affine strain A (d, d), or for the start of a deformation.

    An objective of `optimize` for any deformation.
    Raises `InputError` for a deformation with free components, which follow without resistance at the transition.

    >>> import critflow as cf
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> found = cf.optimize(network, cf.transition_modulus(network, 'dilation'), 'closed_form')
    >>> abs(found.objective - cf.bulk_modulus_bound(network)) < 1e-9
    True
    """
    deformation = deformation_of(strain, network.dimension)
    if deformation.free:
        raise InputError(
            f"free components of the cell leave no modulus at the transition: fix those of {deformation.name}"
        )
    return TransitionModulus(deformation.rate(0.0), network.stiffness, network.volume)


def constrained_shear_modulus(network: Network, threshold: float | None) -> Objective:
    """G_0 with the penalty that keeps σ above about r = `threshold`; without a penalty for None."""
    modulus = transition_modulus(network, pure_shear(network.dimension))
    if threshold is None:
        return modulus
    if not threshold > 0:
        raise InputError(f"the threshold r must be positive, not {threshold}: it keeps every stress above about r")
    return ConstrainedModulus(modulus, threshold)


OBJECTIVES: dict[str, Callable[[Network, float | None], Objective]] = {
    "length_variance": lambda network, threshold: LengthVariance(),
    "tension_variance": lambda network, threshold: TensionVariance(),
    "bulk_modulus": lambda network, threshold: transition_modulus(network, dilation(network.dimension)),
    "shear_modulus": constrained_shear_modulus,
}
"""Objectives by name: functions of a network and of the threshold r of a penalty, None without a penalty."""


def named_objective(network: Network, name: str, threshold: float | None = 0.1) -> Objective:
    """The objective of that name for a network; `threshold` is r of the constrained shear modulus, None without it."""
    if name not in OBJECTIVES:
        raise InputError(f"no objective is called {name!r}: choose one of {', '.join(OBJECTIVES)}")
    return OBJECTIVES[name](network, threshold)


def _relative_variance(values: Array) -> tuple[float, Array]:
    """Variance over squared mean, without cancellation, and its derivative."""
    mean = values.mean()
    deviation = values - mean
    variance = float(np.mean(deviation**2) / mean**2)
    return variance, 2 / (len(values) * mean**2) * (deviation - variance * mean)


def _relative_variance_differential(values: Array, change: Array) -> tuple[Array, Array]:
    """The derivative of the relative variance, and its change when the values change."""
    mean, dmean = values.mean(), change.mean()
    variance, derivative = _relative_variance(values)
    dvariance = derivative @ change
    second = 2 / (len(values) * mean**2) * (change - dmean - dvariance * mean - variance * dmean)
    return derivative, second - 2 * dmean / mean * derivative
