"""What the equation of weak forces leaves out, from the whole energy at the state that it predicts.

The equation is the first order of E = Σ ½k(|L| − ℓ)² + κU(x, F).  A few steps of Newton's method of E lead from its
state to equilibrium, for positions x and tensions t together:

    [[G(t) + κH, R̃ᵀ], [R̃, −1/k]] (dx, t') = (−κ ∂U/∂x, ℓ − |L|),   G(t) = gᵀ (t/|L|)(1 − n nᵀ) g,   R̃ = ∂|L|/∂x

or, without t', (G(t) + R̃ᵀ k R̃ + κH) dx = −∂E/∂x.  The tensions t of the last step enter G, not those of the springs:
floppy motions v change lengths by ½|g v|², which the equation compensates only in the sum with the self-stress, so that
k(|L| − ℓ) may exceed all tensions a thousand times.  The first step has t = τ σ|L|.  With the last values X_n of the
tension, the stress or the modulus, and X_0 of the equation,

    error = |X_n − X_0| + |X_n − X_{n−1}|

Each step costs one factorisation; steps end where the second term is a quarter of the first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from critflow.deformation import Deformation
from critflow.networks import Array
from critflow.numerics import dot, norms
from critflow.sparse import Factor, edge_blocks
from critflow_extras.weak.weak_energies import WeakFunction
from critflow_extras.weak.weak_pattern import WeakPattern
from critflow_extras.weak.weak_system import WeakStrain, WeakSystem

MOST_STEPS = 4
_CONVERGED = 0.25  # of the change of the tension by all steps, below which the last one ends them
_LONGEST_STEP = 0.5  # displacement in units of the mean length, beyond which the state is far from an equilibrium
# Step of differences along a strain, of second order: 1e-7 of second derivatives.
_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class _State:
    """Positions (N_v, d), changes of the bond vectors from those of the transition (N_b, d), and tensions t (N_b,)."""

    x: Array
    change: Array
    tension: Array


class WeakCorrection:
    """Newton's steps of the whole energy of a configuration, along one deformation.

    system, energy, strain, deformation  of `weak_forces`
    """

    def __init__(self, system: WeakSystem, energy: WeakFunction, strain: WeakStrain, deformation: Deformation):
        self._system, self._energy, self._strain, self._deformation = system, energy, strain, deformation
        self._pattern: WeakPattern | None = None

    def steps(
        self, quantity: str, gamma: float, kappa: float, tau: float, floppy: Array, along: Deformation | None = None
    ) -> Array:
        """Values after each step, (n_steps,), from the tension τ and motion v (d·n_free,) of the equation at strain γ.

        The last is infinite where there is no stable state nearby.

        quantity  "tension", "stress": dE/dγ, or "modulus": d²E/dε²
        along     the deformation of the modulus; None: the same
        """
        F = self._deformation.gradient(gamma)
        critical, network = self._system.critical, self._system.network
        moved = (gamma * self._strain.motion + floppy).reshape(-1, network.dimension)
        x = critical.coordinates @ F.T
        x[network.free] += moved
        change = critical.bond_vectors @ (F - np.eye(len(F))).T + network.free_incidence @ moved
        state = _State(x, change, tau * critical.sigma * critical.lengths)
        rates = _rates(self._deformation, gamma) if along is None else _rates(along, 0.0)
        values, tensions = [], [tau, tau]
        for _ in range(MOST_STEPS):
            factor, force = self._factor(state, kappa, F)
            dx = factor.solve(force)
            stable = factor.sound and not factor.n_negative
            if not stable or not np.abs(dx).max() < _LONGEST_STEP * float(self._system.lengths.mean()):
                values.append(np.inf)
                break
            if quantity == "modulus":
                values.append(self._modulus(state, kappa, F, factor, rates))
            state = self._moved(state, dx)
            tensions.append(self._tension(state))
            if quantity != "modulus":
                values.append(tensions[-1] if quantity == "tension" else self._stress(state, kappa, F, rates))
            if abs(tensions[-1] - tensions[-2]) <= _CONVERGED * abs(tensions[-1] - tau):
                break
        return np.array(values)

    def _bonds(self, state: _State) -> tuple[Array, Array, Array]:
        """L (N_b, d), |L| and |L| − ℓ (N_b,), which has the digits of the change of L."""
        start, lengths = self._system.critical.bond_vectors, self._system.lengths
        L = start + state.change
        length = norms(L)
        extension = dot(2 * start + state.change, state.change) / (length + lengths)
        return L, length, extension

    def _factor(self, state: _State, kappa: float, F: Array) -> tuple[Factor, Array]:
        """The factor of G(t) + R̃ᵀ k R̃ + κH, and −∂E/∂x (d·n_free,)."""
        network, k = self._system.network, self._system.network.stiffness
        L, length, extension = self._bonds(state)
        _, gradient, hessian = self._energy(state.x, F)
        rows = np.arange(gradient.size).reshape(gradient.shape)[network.free].ravel()
        H = sp.csr_array(kappa * sp.csr_array(hessian)[rows][:, rows])
        H.sum_duplicates()
        if self._pattern is None or not self._pattern.covers(H):
            self._pattern = WeakPattern(network, H)
        sigma = state.tension / length
        factor = self._pattern.factorize(self._pattern.values(edge_blocks((k - sigma) / length**2, L, sigma), H))
        pull = network.divergence @ ((k * extension / length)[:, None] * L)
        return factor, -np.asarray(pull).ravel() - kappa * gradient[network.free].ravel()

    def _moved(self, state: _State, dx: Array) -> _State:
        network = self._system.network
        L, length, extension = self._bonds(state)
        moved = dx.reshape(-1, network.dimension)
        turned = network.free_incidence @ moved
        x = state.x.copy()
        x[network.free] += moved
        tension = network.stiffness * (extension + dot(L, turned) / length)
        return _State(x, state.change + turned, tension)

    def _tension(self, state: _State) -> float:
        """Σ σ|L₀| t/k over D."""
        system = self._system
        weight = system.sigma * system.lengths / system.network.stiffness
        return float(weight @ state.tension) / system.compliance

    def _stress(self, state: _State, kappa: float, F: Array, rates: _Rates) -> float:
        """dE/dγ, of vertices that follow the strain."""
        L, length, _ = self._bonds(state)
        ahead, behind = (self._energy(state.x @ by.T, by @ F)[0] for by in (rates.ahead, rates.behind))
        springs = float((state.tension / length) @ dot(L, L @ rates.velocity.T))
        return springs + kappa * (ahead - behind) / (2 * _STEP)

    def _modulus(self, state: _State, kappa: float, F: Array, factor: Factor, rates: _Rates) -> float:
        """d²E/dγ² − qᵀ(∂²E/∂x∂x)⁻¹q, with q = ∂²E/∂x∂γ, of vertices that follow the strain."""
        network, k = self._system.network, self._system.network.stiffness
        L, length, _ = self._bonds(state)
        sigma, rate = state.tension / length, L @ rates.velocity.T
        stretched = (k - sigma) / length**2 * dot(L, rate)
        springs = float(stretched @ dot(L, rate) + sigma @ (dot(rate, rate) + dot(L, L @ rates.acceleration.T)))
        ahead, here, behind = (
            self._energy(state.x @ by.T, by @ F)[:2] for by in (rates.ahead, np.eye(len(F)), rates.behind)
        )
        weak = (ahead[0] - 2 * here[0] + behind[0]) / _STEP**2
        force = network.divergence @ (stretched[:, None] * L + sigma[:, None] * rate)
        q = np.asarray(force + kappa * (ahead[1] - behind[1])[network.free] / (2 * _STEP)).ravel()
        return springs + kappa * weak - float(q @ factor.solve(q))


class _Rates(NamedTuple):
    """Velocity and acceleration gradient of a strain (d, d), and the gradients of a step ahead and one behind."""

    velocity: Array
    acceleration: Array
    ahead: Array
    behind: Array


def _rates(path: Deformation, strain: float) -> _Rates:
    back = np.linalg.inv(path.gradient(strain))
    ahead, behind = (np.asarray(path.gradient(strain + h) @ back) for h in (_STEP, -_STEP))
    return _Rates(path.velocity(strain), path.acceleration(strain), ahead, behind)
