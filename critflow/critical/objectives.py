"""Objectives on the critical manifold: a value, its partial derivatives, and their change along a direction.

An objective sees σ (N_b,) and L (N_b, d) and nothing else; the manifold turns its two partial derivatives into a
gradient.  All objectives here are unchanged when σ is scaled, as the configuration is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from critflow.networks.network import Array, Network
from critflow.result import InputError

Partials = tuple[Array, Array]
"""∂O/∂σ (N_b,) and ∂O/∂L (N_b, d)."""


class Objective(ABC):
    """What can be optimised over stress."""

    maximise: ClassVar[bool] = False

    @abstractmethod
    def evaluate(self, sigma: Array, L: Array) -> tuple[float, Partials]:
        """Value and partial derivatives."""

    @abstractmethod
    def differential(self, sigma: Array, L: Array, dsigma: Array, dL: Array) -> Partials:
        """Derivatives of the two partials along (σ̇, L̇)."""

    def stiff_diagonal(self, sigma: Array) -> Array | float:
        """A steep part of ∂²O/∂(log σ)² that is diagonal and known, of the sign of a penalty: ≥ 0 when minimised."""
        return 0.0


@dataclass(frozen=True)
class LengthVariance(Objective):
    """V_L = ⟨(|L| − ⟨|L|⟩)²⟩/⟨|L|⟩² (`LengthVariance`)."""

    def evaluate(self, sigma: Array, L: Array) -> tuple[float, Partials]:
        length = np.linalg.norm(L, axis=1)
        value, slope = _relative_variance(length)
        return value, (np.zeros_like(sigma), (slope / length)[:, None] * L)

    def differential(self, sigma: Array, L: Array, dsigma: Array, dL: Array) -> Partials:
        length = np.linalg.norm(L, axis=1)
        unit = L / length[:, None]
        dlength = np.einsum("ad,ad->a", unit, dL)
        slope, dslope = _relative_variance_differential(length, dlength)
        return np.zeros_like(sigma), dslope[:, None] * unit + (slope / length)[:, None] * (dL - dlength[:, None] * unit)


@dataclass(frozen=True)
class TensionVariance(Objective):
    """V_τ = ⟨(τ − ⟨τ⟩)²⟩/⟨τ⟩² of the tensions τ = σ|L| (`TensionVariance`)."""

    def evaluate(self, sigma: Array, L: Array) -> tuple[float, Partials]:
        length = np.linalg.norm(L, axis=1)
        value, slope = _relative_variance(sigma * length)
        return value, (slope * length, (slope * sigma / length)[:, None] * L)

    def differential(self, sigma: Array, L: Array, dsigma: Array, dL: Array) -> Partials:
        length = np.linalg.norm(L, axis=1)
        unit = L / length[:, None]
        dlength = np.einsum("ad,ad->a", unit, dL)
        slope, dslope = _relative_variance_differential(sigma * length, dsigma * length + sigma * dlength)
        along = (dslope * sigma + slope * dsigma)[:, None] * unit
        across = (slope * sigma / length)[:, None] * (dL - dlength[:, None] * unit)
        return dslope * length + slope * dlength, along + across


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
        """The symmetric part of A, (d, d): the modulus does not see rotations."""
        return 0.5 * (self.strain + self.strain.T)


@dataclass(frozen=True)
class ConstrainedModulus(Objective):
    """μ_A − (1/N_b) Σ (s_α/r)^(−10), s = σ scaled to Σs² = N_b (`ShearMod+Constraint`): keeps every s above about r."""

    modulus: TransitionModulus
    threshold: float = 0.1

    maximise = True
    exponent: ClassVar[int] = 10

    def evaluate(self, sigma: Array, L: Array) -> tuple[float, Partials]:
        value, (dO_dsigma, dO_dL) = self.modulus.evaluate(sigma, L)
        power, square = self._powers(sigma)
        penalty = power.mean()
        # s scales as σ/|σ|, so the slope along σ cancels.
        slope = self.exponent * (power / sigma - power.sum() * sigma / square) / len(sigma)
        return value - float(penalty), (dO_dsigma + slope, dO_dL)

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


def transition_modulus(network: Network, strain: ArrayLike) -> TransitionModulus:
    """The modulus at the transition of a network for the affine strain A (d, d)."""
    A = np.asarray(strain, dtype=float)
    if A.shape != (network.dimension,) * 2 or not np.isfinite(A).all():
        raise InputError(f"the affine strain must be a finite {network.dimension} × {network.dimension} matrix")
    return TransitionModulus(A, network.stiffness, network.volume)


def named_objective(network: Network, name: str, threshold: float = 0.1) -> Objective:
    """The objective of that name for a network; `threshold` is r of the constrained shear modulus."""
    if name == "length_variance":
        return LengthVariance()
    if name == "tension_variance":
        return TensionVariance()
    if name == "bulk_modulus":
        return transition_modulus(network, dilation(network.dimension))
    if name == "shear_modulus":
        if not threshold > 0:
            raise InputError(f"the threshold r must be positive, not {threshold}: it keeps every stress above about r")
        return ConstrainedModulus(transition_modulus(network, pure_shear(network.dimension)), threshold)
    raise InputError(f"no objective is called {name!r}: choose one of {', '.join(OBJECTIVES)}")


OBJECTIVES = ("length_variance", "tension_variance", "bulk_modulus", "shear_modulus")


def _relative_variance(values: Array) -> tuple[float, Array]:
    """Variance over squared mean, without cancellation, and its derivative."""
    mean = values.mean()
    deviation = values - mean
    variance = float(np.mean(deviation**2) / mean**2)
    return variance, 2 / (len(values) * mean**2) * (deviation - variance * mean)


def _relative_variance_differential(values: Array, change: Array) -> tuple[Array, Array]:
    """The derivative of the relative variance, and its change when the values change."""
    mean, dmean = values.mean(), change.mean()
    variance, slope = _relative_variance(values)
    dvariance = slope @ change
    dslope = 2 / (len(values) * mean**2) * (change - dmean - dvariance * mean - variance * dmean)
    return slope, dslope - 2 * dmean / mean * slope
