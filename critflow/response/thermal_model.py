"""Temperature on a critical network: entropic and energetic springs in series.

At temperature T, an energy, floppy motions under the tension τ have the weight exp(−τ vᵀP v/2T), so that
    ⟨½ vᵀP v⟩ = T ∂/∂τ ½ ln det τP = N_f T/2τ = Φ(s),   s = τ/T,   Φ(s) = N_f/2s
and the scalar equation of weak forces is D τ² − c γ τ − N_f T/2 = 0, with T in place of κ.  It takes τ at its most
probable value.  The first terms that it leaves out, as free energies in units of T:
    n_1 = ½ ln(D + N_f/(2 T s²))     the tension fluctuates; of relative order 1/N_f
    n_2 = ½ ln det H − ½ N_f ln τ    with the Hessian H of the strained springs: bands couple, and shapes change with τ
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from critflow.critical.manifold import CriticalConfiguration
from critflow.networks.network import Array
from critflow.response.weak_model import Modes
from critflow.response.weak_strain import WeakStrain, moved
from critflow.response.weak_system import WeakSystem
from critflow.springs.state import spring_state

_STRAIN = 1e-4  # of the differences of n_2: the tension is small, and H keeps ten digits of the soft band


@dataclass(frozen=True, eq=False)
class ThermalModes(Modes):
    """No motions of their own, and Φ(s) = N_f/2s."""

    n_floppy: int

    def work(self, s: Array, load: Array) -> Array:
        return np.asarray(self.n_floppy / (2 * s))

    def work_slope(self, s: Array, load: Array) -> Array:
        return np.asarray(self.n_floppy / (2 * s**2))


class ThermalModel:
    """Φ(s) of temperature in place of a `WeakModel`, for a system without a weak Hessian."""

    end = 0.0
    covered = (0.0, np.inf)

    def __init__(self, critical: CriticalConfiguration, system: WeakSystem, strain: WeakStrain, compliance: float):
        size = system.rigidity.shape[1]
        self.system, self.compliance = system, compliance
        self.n_floppy = size - critical.network.n_edges + 1
        self.modes = self.coarse = self.leading = self.extended(None)
        self.scale = self.n_floppy / abs(strain.work)  # s at strains below the transition of order one
        self._slope = _band_slope(critical, strain, strain.work / compliance, self.n_floppy)

    def cover(self, low: float, high: float) -> None:
        """Nothing: the model is exact for all s."""

    def extended(self, load: Array | None) -> Modes:
        """Modes without a response to any load."""
        size = self.system.rigidity.shape[1]
        return ThermalModes(np.zeros(0), np.zeros((size, 0)), np.zeros((3, 0)), self.n_floppy)

    def neglected_slopes(self, s: Array, kappa: Array) -> Array:
        """d/ds of n_1 and n_2, (..., 2), at temperature κ."""
        fluctuation = -self.n_floppy / (s * (2 * self.compliance * kappa * s**2 + self.n_floppy))
        return np.stack([fluctuation, self._slope * kappa], axis=-1)


def _band_slope(critical: CriticalConfiguration, strain: WeakStrain, rate: float, n_floppy: int) -> float:
    """dn_2/dτ by differences along the elastic response, τ = rate·γ > 0."""
    values = []
    for gamma in np.array([1.0, 2.0]) * np.copysign(_STRAIN, rate):
        x, F = moved(critical, strain.deformation, float(gamma), gamma * strain.motion)
        state = spring_state(critical.network.deformed(F), critical.lengths, x)
        pivots = state.factorize(state.pattern()).pivots
        values.append(0.5 * float(np.sum(np.log(np.abs(pivots)))) - 0.5 * n_floppy * np.log(rate * gamma))
    return (values[1] - values[0]) / (abs(rate) * _STRAIN)
