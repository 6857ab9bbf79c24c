"""Displacement of floppy motions by weak forces, for all tensions at once: a rational Krylov model.

With tension τ and weak energy κU the floppy motions see the stiffness τP + κH = κ(sP + H), s = τ/κ, so that
    v(s) = Z(sZᵀPZ + ZᵀHZ)⁻¹Zᵀ f,   Φ(s) = ½ vᵀP v
are functions of s alone.  Steps:
    1. the end of the branch, s_end = −(least eigenvalue of H against P on floppy motions), by inverse iteration
    2. bordered solutions v and dv/ds at nodes whose distances from s_end grow by a constant factor
    3. projection on the space of all of them, where P and H become diagonal: v = Y b/(s + θ), Φ = ½ Σ b²/(s + θ)²
The projection agrees with Φ and its first derivatives at every node, and between nodes to rounding, as a model on half
of the nodes tells.

Temperature T is another model (`ThermalModel`).  Floppy motions under the tension τ have the weight exp(−τ vᵀP v/2T),
so that
    ⟨½ vᵀP v⟩ = T ∂/∂τ ½ ln det τP = N_f T/2τ = Φ(s),   s = τ/T,   Φ(s) = N_f/2s
and the scalar equation of weak forces is D τ² − c γ τ − N_f T/2 = 0, with T in place of κ.  It takes τ at its most
probable value.  The first terms that it leaves out, as free energies in units of T:
    n_1 = ½ ln(D + N_f/(2 T s²))     the tension fluctuates; of relative order 1/N_f
    n_2 = ½ ln det H − ½ N_f ln τ    with the Hessian H of the strained springs: bands couple, and shapes change with τ
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.linalg
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from critflow.networks import Array
from critflow.numerics import quasi_random
from critflow.springs import spring_state
from critflow_extras.weak.weak_system import WeakFactor, WeakStrain, WeakSystem

NODE_RATIO = 2.0  # of the distances of nodes from the end of the branch: Φ then has ten digits between them
# Directions of the Krylov space below this part of the largest are rounding of its solutions.
_INDEPENDENT = 1e-11
# The first tension, in units of tr H/tr P, grows by this factor until it is on the branch, up to a limit.
_GROWTH, _LARGEST_START = 4.0, 1e9
_END_ACCURACY = 1e-9  # relative, of the end of the branch
_STRAIN = 1e-4  # of the differences of n_2: the tension is small, and H keeps ten digits of the soft band


class _Node(NamedTuple):
    """Solutions v and dv/ds (2·n_sources, d·n_free) at one s."""

    s: float
    vectors: Array


class WeakModel:
    """v(s) of loads (n_sources, d·n_free), of which the first is f.

    end  s_end, found here by default
    """

    def __init__(self, system: WeakSystem, loads: Array, end: float | None = None):
        self.system, self.loads = system, loads
        self._nodes: list[_Node] = []
        # The unit of s: without H, that of the forces, which move vertices by about a length there.
        displaced = float(np.abs(loads).max(initial=0.0)) / float(system.lengths.mean())
        self.scale = (system.scales[1] or displaced) / system.scales[0] or 1.0
        self.end = self._branch_end() if end is None else end

    def _branch_end(self) -> float:
        """s_end: the stiffness sP + H is positive on the floppy motions above it; NaN where it is not found."""
        if not self.system.hessian.count_nonzero():
            return 0.0
        start = self.scale
        while not (factor := self.system.factorize(start)).positive:
            start *= _GROWTH
            if start > _LARGEST_START * self.scale:
                return np.nan
        # With the weight of the constraints the stiffness is positive everywhere; motions that it resists have 1/w.
        size, whole = self.loads.shape[1], factor.factor
        stiffness = LinearOperator((size, size), matvec=lambda u: whole.multiply(np.ravel(u)))
        inverse = LinearOperator((size, size), matvec=lambda f: whole.solve(np.ravel(f)))
        first = factor.solve(self.system.prestress @ (quasi_random(size) - 0.5))[0]
        try:
            most = eigsh(
                self.system.prestress, 1, stiffness, which="LA", Minv=inverse, v0=first, tol=_END_ACCURACY,
                return_eigenvectors=False,
            )[0]  # fmt: skip
        except ArpackNoConvergence as stopped:
            most = stopped.eigenvalues[0] if len(stopped.eigenvalues) else np.nan
        return float(start - 1 / most)

    def cover(self, low: float, high: float) -> None:
        """Add nodes until they span the distances low … high from the end of the branch."""
        exponents = np.arange(np.floor(np.log(low) / np.log(NODE_RATIO)), np.log(high) / np.log(NODE_RATIO) + 1)
        known = {node.s for node in self._nodes}
        for distance in NODE_RATIO**exponents:
            s = self.end + float(distance)
            if s not in known:
                factor = self.system.factorize(s)
                if factor.positive:
                    self._nodes.append(self._node(s, factor))
        self._nodes.sort(key=lambda node: node.s)
        for outdated in ("modes", "coarse"):
            self.__dict__.pop(outdated, None)

    @property
    def covered(self) -> tuple[float, float]:
        """Least and largest distance of nodes from the end of the branch."""
        return self._nodes[0].s - self.end, self._nodes[-1].s - self.end

    def _node(self, s: float, factor: WeakFactor) -> _Node:
        solved = [factor.solve(load)[0] for load in self.loads]
        slopes = [factor.solve(self.system.prestress @ u)[0] for u in solved]
        return _Node(s, np.array([*solved, *slopes]))

    @cached_property
    def modes(self) -> Modes:
        """The model on all nodes."""
        return self._projected(self._nodes)

    @cached_property
    def coarse(self) -> Modes:
        """The model on every second node, to tell the error of the other."""
        return self._projected(self._nodes[::2])

    def _projected(self, nodes: list[_Node]) -> Modes:
        vectors = np.concatenate([node.vectors for node in nodes])
        sizes = np.linalg.norm(vectors, axis=1)
        vectors = (vectors[sizes > 0] / sizes[sizes > 0, None]).T
        U, values, _ = np.linalg.svd(vectors, full_matrices=False)
        Q = U[:, values > _INDEPENDENT * values.max(initial=0.0)]
        P, H = Q.T @ (self.system.prestress @ Q), Q.T @ (self.system.hessian @ Q)
        if not Q.shape[1]:
            return Modes(np.zeros(0), Q, self.loads @ Q)
        theta, Y = scipy.linalg.eigh(0.5 * (H + H.T), 0.5 * (P + P.T))
        return Modes(theta, Q @ Y, self.loads @ (Q @ Y))

    def leading(self) -> ExactModel:
        """The model without H: v = (1/s) Z(ZᵀPZ)⁻¹Zᵀf."""
        v = self.system.factorize(1.0, weak=0.0).solve(self.loads[0])[0]
        root = max(float(v @ self.loads[0]), 0.0) ** 0.5
        return ExactModel(
            self.system, Modes(np.zeros(1), v[:, None] / (root or 1.0), np.array([[root], [0.0]])), self.scale
        )

    def extended(self, load: Array) -> Modes:
        """Modes that contain the response to a further load (d·n_free,), at the same nodes."""
        larger = WeakModel(self.system, np.concatenate([self.loads, [load]]), self.end)
        larger.cover(*self.covered)
        return larger.modes


@dataclass(frozen=True, eq=False)
class Modes:
    """Motions Y (d·n_free, m) with YᵀPY = 1 and YᵀHY = diag θ (m,), and the loads on them, (n_sources, m)."""

    theta: Array
    vectors: Array
    loads: Array
    n_thermal: int = 0  # N_f of motions that temperature excites, of which none has a vector

    def amplitudes(self, s: Array, load: Array, power: int = 1) -> Array:
        """b/(s + θ)^power, (..., m), of loads b (..., m)."""
        return np.asarray(load / (s[..., None] + self.theta) ** power)

    def work(self, s: Array, load: Array) -> Array:
        """Φ(s) = ½ Σ b²/(s + θ)² + N_f/2s, (...)."""
        work = np.asarray(0.5 * np.sum(self.amplitudes(s, load) ** 2, axis=-1))
        return work + self.n_thermal / (2 * s) if self.n_thermal else work  # s may be zero without temperature

    def work_slope(self, s: Array, load: Array) -> Array:
        """−Φ'(s) = Σ b²/(s + θ)³ + N_f/2s², (...)."""
        slope = np.asarray(np.sum(load * self.amplitudes(s, load, 3), axis=-1))
        return slope + self.n_thermal / (2 * s**2) if self.n_thermal else slope


class ExactModel:
    """Modes that hold for all s > 0, without nodes."""

    end, covered = 0.0, (0.0, np.inf)

    def __init__(self, system: WeakSystem, modes: Modes, scale: float):
        self.system, self.modes, self.coarse, self.scale = system, modes, modes, scale

    def cover(self, low: float, high: float) -> None:
        """Nothing: there are no nodes."""


class ThermalModel(ExactModel):
    """Φ(s) of temperature in place of a `WeakModel`, for a system without a weak Hessian."""

    def __init__(self, system: WeakSystem, strain: WeakStrain):
        size = system.rigidity.shape[1]
        modes = Modes(np.zeros(0), np.zeros((size, 0)), np.zeros((3, 0)), system.n_floppy)
        super().__init__(system, modes, system.n_floppy / abs(strain.work))  # s at strains of order one below
        self._slope = self._band_slope(strain)

    def leading(self) -> ExactModel:
        """The same: temperature has no other Hessian."""
        return self

    def extended(self, load: Array) -> Modes:
        """Modes that no load moves."""
        return self.modes

    def neglected_slopes(self, s: Array, kappa: Array) -> Array:
        """d/ds of n_1 and n_2, (..., 2), at temperature κ."""
        n_floppy = self.system.n_floppy
        fluctuation = -n_floppy / (s * (2 * self.system.compliance * kappa * s**2 + n_floppy))
        return np.stack([fluctuation, self._slope * kappa], axis=-1)

    def _band_slope(self, strain: WeakStrain) -> float:
        """dn_2/dτ by differences along the elastic response, τ = rate·γ > 0."""
        rate, values = strain.work / self.system.compliance, []
        for gamma in np.array([1.0, 2.0]) * np.copysign(_STRAIN, rate):
            x, F = strain.moved(float(gamma))
            state = spring_state(self.system.network.deformed(F), self.system.lengths, x)
            pivots = state.factorize().pivots
            half_log = 0.5 * float(np.sum(np.log(np.abs(pivots))))
            values.append(half_log - 0.5 * self.system.n_floppy * np.log(rate * gamma))
        return (values[1] - values[0]) / (abs(rate) * _STRAIN)
