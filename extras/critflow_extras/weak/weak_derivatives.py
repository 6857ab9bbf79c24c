"""Derivatives of the modulus under weak forces by the critical configuration, from the balance at nearby strains.

Tension τ and floppy motions v of `weak_forces` are stationary points of one energy, with T₂ the Taylor polynomial of
second order of U(F(γ)x_c + γu + v, F(γ)) in (γ, v) together, and L̇ = A L + g u:

    E(γ) = τ(cγ + ½gγ² + ½vᵀPv) − ½Dτ² − ½Qτ³ + κ T₂ + κ λ·R v,     V M = d²E/dγ²

so that a derivative dE/dp is that at constant τ, v and λ, and V dM/dp = d²/dγ² of it.  The elastic response u is no
stationary point of the weak energy: with q = ∂E/∂u and [[P, Rᵀ], [R, 0]] (a, ν) = (d²q/dγ², 0),

    V dM/dp = d²/dγ² ∂E/∂p − a·(gᵀ d(σ ∘ A L) + dP u + dRᵀ μ) + ν·d(c K⁻¹σ/D − ḣ) − ν·dR u .

Third derivatives of U along (γ, v) are all that T₂ needs.  They, and d²/dγ², are differences of sixth order of exact
forces and exact balances: changes of their steps move the gradient by 1e-7 to 5e-7 of its norm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from critflow.networks import Array
from critflow.numerics import dot
from critflow_extras.weak.weak_energies import WeakFunction
from critflow_extras.weak.weak_system import WeakStrain, WeakSystem

# Differences of sixth order, at `PLACES` steps: for the steps below truncation and rounding are alike, 1e-7.
PLACES = np.arange(-3, 4)
_SLOPE = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60
_CURVE = np.array([2, -27, 270, -490, 270, -27, 2]) / 180
STEP = 0.02  # of the strain, relative to that over which the tension changes by itself
_TURN = 0.02  # largest change of a bond vector in a step of T₂, relative to its length


class WeakDerivatives:
    """Sums over strains of the derivatives of E by σ (N_b,), L (N_b, d), free coordinates x, k (N_b,) and response u.

    system, path, energy  of the configuration
    kappa                 κ
    """

    def __init__(self, system: WeakSystem, path: WeakStrain, energy: WeakFunction, kappa: float):
        self._system, self._path, self._energy, self._kappa = system, path, energy, kappa
        self._force = -self._gradient(0.0, np.zeros_like(path.motion))

    def second(self, strains: Array, s: Array) -> tuple[Array, Array, Array, Array]:
        """d²/dγ² of the derivatives of E by σ, L, x (n_free, d) and k at the middle of `strains` (7,), equidistant.

        s  τ/κ there, (7,)
        """
        system, path, kappa = self._system, self._path, self._kappa
        sigma, L, k, g = system.sigma, system.critical.bond_vectors, system.network.stiffness, self._turn
        weights, tau = _CURVE / (strains[1] - strains[0]) ** 2, kappa * s
        linear, square = float(weights @ (tau * strains)), float(weights @ (0.5 * tau * strains**2))
        compliant, softened = float(weights @ tau**2), float(weights @ tau**3)
        A, curvature, flexible = path.strain, path.deformation.second_rate(0.0), system.lengths**2 / k
        hdot, turned = dot(L, L @ A.T), dot(path.rate, path.rate) + dot(L, L @ curvature.T)
        by_sigma = linear * hdot + square * turned - compliant * sigma * flexible
        by_sigma -= 1.5 * softened * sigma**2 * flexible / k
        by_k = (0.5 * compliant + softened * sigma / k) * sigma**2 * flexible / k
        by_L = linear * L @ (A + A.T) + square * (2 * path.rate @ A + L @ (curvature + curvature.T))
        by_L = sigma[:, None] * (by_L - (compliant * sigma / k + softened * (sigma / k) ** 2)[:, None] * L)
        by_u = 2 * square * np.asarray(system.network.divergence @ (sigma[:, None] * path.rate)).ravel()
        by_x = np.zeros_like(by_u)
        for weight, gamma, each, tension in zip(weights, strains, s, tau, strict=True):
            load = self._force - gamma * path.weak_load
            v, multipliers = system.factorize(float(each)).solve(load)
            turning = g(v)
            by_sigma += 0.5 * weight * tension * dot(turning, turning)
            by_L += weight * kappa * multipliers[:, None] * turning
            at_x, at_u = self._taylor(float(gamma), v)
            by_x, by_u = by_x + weight * kappa * at_x, by_u + weight * kappa * at_u
        changed = self._by_response(by_u)
        return by_sigma + changed[0], by_L + changed[1], by_x.reshape(-1, L.shape[1]), by_k + changed[2]

    def _by_response(self, by_u: Array) -> tuple[Array, Array, Array]:
        """The change of u with σ, L and k, times dE/du (d·n_free,)."""
        system, path = self._system, self._path
        sigma, L, k, A = system.sigma, system.critical.bond_vectors, system.network.stiffness, self._path.strain
        a, nu = system.factorize(1.0, weak=0.0).solve(by_u)
        moved, flexible = self._turn(a), system.lengths**2 / k
        hdot, twice, amplitude = dot(L, L @ A.T), L @ (A + A.T), path.work / system.compliance
        share = float(nu @ system.flexible_stress) / system.compliance
        by_sigma = share * (hdot - 2 * amplitude * sigma * flexible) + amplitude * nu * flexible - dot(moved, path.rate)
        by_L = (share * sigma - nu)[:, None] * twice - sigma[:, None] * (moved @ A)
        by_L += (2 * amplitude * sigma * (nu - share * sigma) / k)[:, None] * L
        by_L -= path.multipliers[:, None] * moved + nu[:, None] * self._turn(path.motion)
        return by_sigma, by_L, amplitude * sigma * flexible * (share * sigma - nu) / k

    def _taylor(self, gamma: float, v: Array) -> tuple[Array, Array]:
        """∂T₂/∂x and ∂T₂/∂u, (d·n_free,), at (γ, v): second-order polynomials of Fᵀ∂U/∂x and γ ∂U/∂x."""
        rate = self._turn(v) + gamma * self._path.rate
        step = _TURN / max(float((np.linalg.norm(rate, axis=1) / self._system.lengths).max()), _TURN)
        weights = (PLACES == 0) + _SLOPE / step + 0.5 * _CURVE / step**2
        by_x, by_u = np.zeros_like(v), np.zeros_like(v)
        for weight, t in zip(weights, step * PLACES, strict=True):
            pulled, F = self._gradient(t * gamma, t * v), self._path.deformation.gradient(t * gamma)
            by_x += weight * (pulled.reshape(-1, len(F)) @ F).ravel()
            by_u += weight * t * gamma * pulled
        return by_x, by_u

    def _gradient(self, strain: float, v: Array) -> Array:
        """∂U/∂x of the free vertices, (d·n_free,)."""
        network = self._system.network
        x, F = self._path.moved(strain)
        x[network.free] += v.reshape(-1, network.dimension)
        return np.asarray(self._energy(x, F)[1][network.free]).ravel()

    def _turn(self, motion: Array) -> NDArray[np.float64]:
        """g u, (N_b, d)."""
        network = self._system.network
        return np.asarray(network.free_incidence @ motion.reshape(-1, network.dimension))
