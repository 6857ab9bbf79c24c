"""Bordered systems of weak forces, and with them the response of a critical configuration to a strain.

Floppy motions u, R u = e, under the stiffness sP + H of tension and weak forces:
    [[sP + H, Rᵀ], [R, 0]] (u, λ) = (f, e),   P = gᵀ diag(σ) g ⊗ 1,   R = L·g
Elimination of the multipliers with a small compliance gives sP + H + Rᵀ w R, the sum of three constant matrices: one
symbolic analysis serves all s.  Iteration on the residuals removes the compliance (Hestenes; Powell, 1969).  Without
negative pivots the stiffness is positive on the floppy motions, up to 1/w.

Along F(ε) the vertices follow x = F(ε) x_c + ε u, where u lets every edge gain tension in proportion to the self-stress
and is least in the energy of turning edges (`growth`): R u = (c/D) K⁻¹σ − ḣ with c = Σ σ ḣ, D = Σ σ²|L|²/k.  The
weak energy U and its forces change along that motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from critflow.deformation import Deformation
from critflow.manifold import CriticalConfiguration
from critflow.networks import Array
from critflow.numerics import dot
from critflow.saddles import CONTRACTION, MOST_REFINEMENTS, REFINED
from critflow.sparse import Factor, FixedPattern, spread_columns
from critflow_extras.weak.weak_energies import WeakFunction

# Step of differences of fourth order along a strain: their errors are 1e-12 and, of second derivatives, 1e-9.
_STEP = 1e-3
# Weight of a constraint in units of the stiffnesses: 3 refinements remove its compliance.
CONSTRAINT = 1e8
_PLACES = (-2, -1, 1, 2)


class WeakSystem:
    """The systems of one configuration with a weak Hessian H, sparse (d·n_free)²."""

    def __init__(self, critical: CriticalConfiguration, hessian: sp.sparray):
        network, sigma, self.lengths = critical.network, critical.sigma, critical.lengths
        g, d = network.free_incidence, network.dimension
        self.critical, self.network, self.sigma = critical, network, sigma
        # P, H and R, sparse; K⁻¹σ, (N_b,), and D = σᵀK⁻¹σ.
        self.prestress = sp.csr_array(sp.kron(g.T @ sp.diags_array(sigma) @ g, sp.eye_array(d)))
        self.hessian = sp.csr_array(hessian)
        self.rigidity = spread_columns(network, critical.bond_vectors)
        self.flexible_stress = sigma * self.lengths**2 / network.stiffness
        self.compliance = float(sigma @ self.flexible_stress)
        unit = sp.csr_array(sp.diags_array(1 / self.lengths) @ self.rigidity)
        parts = [sp.coo_array(part) for part in (self.prestress, self.hessian, unit.T @ unit)]
        entries = [(part.row, part.col, np.full(part.nnz, n), part.data) for n, part in enumerate(parts)]
        self._pattern = FixedPattern(self.rigidity.shape[1], 3, entries, in_space=d > 2)
        self.scales = [float(np.abs(part.diagonal()).mean()) for part in parts[:2]]

    @property
    def n_floppy(self) -> int:
        """Number of floppy motions."""
        return int(self.rigidity.shape[1]) - self.network.n_edges + 1

    def factorize(self, s: float, weak: float = 1.0) -> WeakFactor:
        """The factor at sP + weak·H."""
        weight = CONSTRAINT * (abs(s) * self.scales[0] + weak * self.scales[1])
        return WeakFactor(self, s, weak, weight, self._pattern.factorize(np.array([s, weak, weight])))


@dataclass(frozen=True, eq=False)
class WeakFactor:
    """A factorised system at sP + weak·H, with the weight w of the constraints."""

    system: WeakSystem
    s: float
    weak: float
    weight: float
    factor: Factor

    @property
    def positive(self) -> bool:
        """Whether the stiffness is positive on all floppy motions."""
        return self.factor.sound and not self.factor.n_negative

    def solve(self, forces: Array, elongations: Array | None = None) -> tuple[Array, Array]:
        """u (d·n_free,) and λ (N_b,) of forces (d·n_free,) and elongations (N_b,), whose part along σ is ignored."""
        system, R = self.system, self.system.rigidity
        w = self.weight / system.lengths**2
        null = system.sigma / np.linalg.norm(system.sigma)
        e = np.zeros(len(null)) if elongations is None else elongations - (null @ elongations) * null
        u, multipliers = np.zeros_like(forces), np.zeros_like(e)
        force, elongation, best = forces, e, np.inf
        # Scales of the terms that cancel: the load, and the lengths that it would move without constraints.
        force_scale = float(np.abs(forces).max(initial=0.0)) + float(np.abs(R.T @ (w * e)).max()) / CONSTRAINT
        for _ in range(MOST_REFINEMENTS):
            step = self.factor.solve(force + R.T @ (w * elongation))
            new_u = u + step
            new_multipliers = multipliers + w * (R @ step - elongation)
            new_elongation = e - R @ new_u
            resisted = self.s * (system.prestress @ new_u) + self.weak * (system.hessian @ new_u)
            new_force = forces - resisted - R.T @ new_multipliers
            length_scale = float(np.abs(new_u).max(initial=0.0)) * float(system.lengths.mean())
            error = max(
                float(np.abs(new_force).max()) / max(force_scale, 1e-300),
                float(np.abs(new_elongation).max()) / max(length_scale, 1e-300),
            )
            if not error < CONTRACTION * best:
                break
            u, multipliers, force, elongation, best = new_u, new_multipliers, new_force, new_elongation, error
            if error < REFINED:
                break
        return u, multipliers


class WeakStrain:
    """The elastic response of a configuration to a strain A = F'(0), and the rates of the weak energy along it."""

    def __init__(self, system: WeakSystem, energy: WeakFunction, deformation: Deformation):
        network, sigma, L = system.network, system.sigma, system.critical.bond_vectors
        self._critical, self.deformation, self.strain = system.critical, deformation, deformation.rate(0.0)
        affine = L @ self.strain.T
        hdot = dot(L, affine)
        self.work = float(sigma @ hdot)  # c
        pull = -np.asarray(network.divergence @ (sigma[:, None] * affine)).ravel()
        stretched = self.work / system.compliance * system.flexible_stress
        # u (d·n_free,) and its multipliers μ (N_b,)
        self.motion, self.multipliers = system.factorize(1.0, weak=0.0).solve(pull, stretched - hdot)
        # L̇ = A L + g u, (N_b, d)
        self.rate = affine + network.free_incidence @ self.motion.reshape(-1, network.dimension)

        def along(strain: float) -> tuple[float, Array]:
            value, gradient, _ = energy(*self.moved(strain))
            return value, gradient[network.free].ravel()

        here = along(0.0)[0]
        values, gradients = (np.array(each) for each in zip(*(along(n * _STEP) for n in _PLACES), strict=True))
        slope, curve = np.array([1, -8, 8, -1]) / (12 * _STEP), np.array([-1, 16, 16, -1]) / (12 * _STEP**2)
        # Along the motion: dU/dε, d²U/dε² and d(∂U/∂x)/dε (d·n_free,).
        self.weak_rate, self.weak_curvature = float(slope @ values), float(curve @ (values - here))
        self.weak_load = np.asarray(slope @ gradients)

    def moved(self, strain: float) -> tuple[Array, Array]:
        """Coordinates F x_c + ε u (N_v, d) after a strain, and F (d, d)."""
        network, F = self._critical.network, self.deformation.gradient(strain)
        x = self._critical.coordinates @ F.T
        x[network.free] += strain * self.motion.reshape(-1, network.dimension)
        return x, F

    def turning(self, other: WeakStrain, curvature: Array) -> float:
        """Σ σ (L̇_a·L̇_b + L·M L) of two strains, with M = ∂²F/∂a∂b (d, d): geometric stiffness per tension."""
        L = self._critical.bond_vectors
        turned = dot(self.rate, other.rate) + dot(L, L @ curvature.T)
        return float(self._critical.sigma @ turned)
