"""Displacement of floppy motions by weak forces, for all tensions at once: a rational Krylov model.

With tension τ and weak energy κU the floppy motions see the stiffness τP + κH = κ(sP + H), s = τ/κ, so that
    v(s) = Z(sZᵀPZ + ZᵀHZ)⁻¹Zᵀ f,   Φ(s) = ½ vᵀP v
are functions of s alone.  Steps:
    1. the end of the branch, s_end = −(least eigenvalue of H against P on floppy motions), by inverse iteration
    2. bordered solutions v and dv/ds at nodes whose distances from s_end grow by a constant factor
    3. projection on the space of all of them, where P and H become diagonal: v = Y b/(s + θ), Φ = ½ Σ b²/(s + θ)²
The projection agrees with Φ and its first derivatives at every node, and between nodes to rounding, as a model on half
of the nodes tells.

At the nodes the first terms that the equation of weak forces leaves out are found too (`neglected`), as energies in
units of κ: with N_v = gᵀ(λ ∘ g v), N_λ = ½|g v|²
    n_1 = ½ Σ λ|g v|²                         the tensions λ of weak forces turn with their edges
    n_2 = ½ N·δz,  M δz = −N                  floppy motions change lengths to second order, with M the bordered matrix
    n_3 = U(x + v) − U + f·v − ½ vᵀH v        the weak energy beyond its Hessian
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
import scipy.linalg
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from critflow.linalg.vectors import quasi_random
from critflow.networks.network import Array
from critflow.response.weak_system import WeakFactor, WeakSystem

NODE_RATIO = 2.0  # of the distances of nodes from the end of the branch: Φ then has ten digits between them
# Directions of the Krylov space below this part of the largest are rounding of its solutions.
_INDEPENDENT = 1e-11
# The first tension, in units of tr H/tr P, grows by this factor until it is on the branch, up to a limit.
_GROWTH, _LARGEST_START = 4.0, 1e9
_END_ACCURACY = 1e-9  # relative, of the end of the branch


@dataclass(frozen=True, eq=False)
class _Node:
    """Solutions v and dv/ds (2·n_sources, d·n_free) at one s, and the neglected energies (3,) of the first source."""

    s: float
    vectors: Array
    neglected: Array


class WeakModel:
    """v(s) of loads (n_sources, d·n_free), of which the first is f.

    system     the bordered systems
    remainder  v (d·n_free,) → U(x + v) − U + f·v − ½ vᵀH v
    end        s_end, found here by default
    """

    def __init__(self, system: WeakSystem, loads: Array, remainder: Callable[[Array], float], end: float | None = None):
        self.system, self.loads, self.remainder = system, loads, remainder
        self._nodes: list[_Node] = []
        self.scale = system.scales[1] / system.scales[0] or 1.0
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
        for outdated in ("modes", "coarse", "_splines"):
            self.__dict__.pop(outdated, None)

    @property
    def covered(self) -> tuple[float, float]:
        """Least and largest distance of nodes from the end of the branch."""
        return self._nodes[0].s - self.end, self._nodes[-1].s - self.end

    def _node(self, s: float, factor: WeakFactor) -> _Node:
        solved = [factor.solve(load) for load in self.loads]
        slopes = [factor.solve(self.system.prestress @ u)[0] for u, _ in solved]
        return _Node(s, np.array([*(u for u, _ in solved), *slopes]), self._neglected(factor, *solved[0]))

    def _neglected(self, factor: WeakFactor, v: Array, multipliers: Array) -> Array:
        network, system = self.system.network, self.system
        compliance = system.sigma * system.lengths**2 / network.stiffness
        # Tensions along the self-stress belong to τ: what remains does no work on its elongations.
        multipliers = multipliers - (compliance @ multipliers) / (compliance @ system.sigma) * system.sigma
        turning = np.asarray(network.free_incidence @ v.reshape(-1, network.dimension))
        stretch = 0.5 * np.einsum("ad,ad->a", turning, turning)
        force = np.asarray(network.divergence @ (multipliers[:, None] * turning)).ravel()
        missing = stretch - (system.sigma @ stretch) / (system.sigma @ compliance) * compliance
        change, correction = factor.solve(-force, -missing)
        correction = correction - (compliance @ correction) / (compliance @ system.sigma) * system.sigma
        second = 0.5 * (float(force @ change) + float(stretch @ correction))
        return np.array([float(multipliers @ stretch), second, self.remainder(v)])

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
        theta, Y = (
            scipy.linalg.eigh(0.5 * (H + H.T), 0.5 * (P + P.T)) if Q.shape[1] else (np.zeros(0), np.zeros((0, 0)))
        )
        Y = Q @ Y
        return Modes(theta, Y, self.loads @ Y)

    @cached_property
    def _splines(self) -> scipy.interpolate.CubicSpline:
        distance = np.array([node.s - self.end for node in self._nodes])
        return scipy.interpolate.CubicSpline(np.log(distance), np.array([node.neglected for node in self._nodes]))

    @cached_property
    def leading(self) -> Modes:
        """The model without H: v = (1/s) Z(ZᵀPZ)⁻¹Zᵀf."""
        v = self.system.factorize(1.0, weak=0.0).solve(self.loads[0])[0]
        root = max(float(v @ self.loads[0]), 0.0) ** 0.5
        return Modes(np.zeros(1), v[:, None] / (root or 1.0), np.array([[root], [0.0]]))

    def extended(self, load: Array) -> Modes:
        """Modes that contain the response to a further load (d·n_free,), at the same nodes."""
        larger = WeakModel(self.system, np.concatenate([self.loads, [load]]), self.remainder, self.end)
        larger.cover(*self.covered)
        return larger.modes

    def neglected_slopes(self, s: Array, kappa: Array) -> Array:
        """d/ds of the neglected energies, (..., 3), the same for all κ."""
        distance = np.clip(s - self.end, *self.covered)
        return np.asarray(self._splines(np.log(distance), 1) / distance[..., None])


@dataclass(frozen=True, eq=False)
class Modes:
    """Motions Y (d·n_free, m) with YᵀPY = 1 and YᵀHY = diag θ (m,), and the loads on them, (n_sources, m)."""

    theta: Array
    vectors: Array
    loads: Array

    def amplitudes(self, s: Array, load: Array, power: int = 1) -> Array:
        """b/(s + θ)^power, (..., m), of loads b (..., m)."""
        return np.asarray(load / (s[..., None] + self.theta) ** power)

    def work(self, s: Array, load: Array) -> Array:
        """Φ(s) = ½ Σ b²/(s + θ)², (...)."""
        return 0.5 * np.sum(self.amplitudes(s, load) ** 2, axis=-1)

    def work_slope(self, s: Array, load: Array) -> Array:
        """−Φ'(s) = Σ b²/(s + θ)³, (...)."""
        return np.sum(load * self.amplitudes(s, load, 3), axis=-1)
