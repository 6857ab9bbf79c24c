"""Third derivatives of the relaxed energy of springs on perimeters at the transition, as `growth` for edges.

With perimeters p = A|L|, their balanced tensions T, σ = Aᵀ T/|L|, directions n = L/|L| and D = Σ T²/κ, the affine
change A_a L has the amplitude c_a = T·ṗ_a/D.  Perimeters do not determine single lengths, so that zero modes relax to
the minimum of the whole second variation of T·p,
    P̃ u + (A R)ᵀ λ = −gᵀ(σ (1 − n nᵀ) A_a L),   A R u = c_a T/κ − ṗ_a(affine),   P̃ = gᵀ σ (1 − n nᵀ) g.
With L̇_a = A_a L + g u the second and third derivatives of the energy are
    E_ab = c_a c_b D,   E_abc = Σ_cyc c_a Σ σ (L̇_b·(1 − n nᵀ) L̇_c + L·M_bc L).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from critflow.growth import StrainedEnergy, Term, Third
from critflow.linear_response import accumulated_rounding
from critflow.networks import Array
from critflow.numerics import EPS, dot, norms
from critflow.saddles import CONTRACTION, MOST_REFINEMENTS, REFINED
from critflow_extras.tissue.face_springs import FaceSprings
from critflow_extras.tissue.state import TissueState
from critflow_extras.tissue.tissue import CriticalTissue

_CORRECTIONS = 3  # of coordinates and tensions by one factor; each gains the accuracy of the cone program's answer
# Weight of a constraint in units of the stiffnesses: 3 refinements remove its compliance.
CONSTRAINT = 1e8


class PerimeterSystem:
    """The equations of the module for tensions T (N_f,) and bond vectors L (N_b, d), with stiff springs as constraints.

    soft  whether some motion changes no perimeter and no direction, so that no response is determined
    """

    def __init__(self, tissue: CriticalTissue, tensions: Array, bond_vectors: Array):
        self.tissue, self.tensions, self.bond_vectors = tissue, tensions, bond_vectors
        self.network, self.sides = tissue.network, tissue.faces.sides
        self.lengths = norms(bond_vectors)
        self.units, perimeters = bond_vectors / self.lengths[:, None], self.sides @ self.lengths
        self.sigma = (self.sides.T @ tensions) / self.lengths
        self._weight = np.full(len(tensions), CONSTRAINT * float(np.mean(tensions / perimeters)))
        faces = FaceSprings(self.sides, self._weight)
        self._constraints = faces.rates(self.network, bond_vectors)
        x = tissue.configuration.coordinates
        stiff = TissueState(self.network, perimeters, x, bond_vectors, faces=faces)
        self._factor = stiff.pattern.factorize(stiff.blocks(stiff.couplings(self.sigma), self.sigma))
        self.soft = self._factor.indefinite

    def bent(self, rates: Array) -> Array:
        """(1 − n nᵀ) L̇ of rates (N_b, d)."""
        return np.asarray(rates - dot(self.units, rates)[:, None] * self.units)

    def solve(self, forces: Array, elongations: Array) -> tuple[Array, Array, float]:
        """u (n_free, d), λ (N_f,) with P̃ u + (A R)ᵀ λ = forces, A R u = elongations, and the relative residual."""
        C, w, g = self._constraints, self._weight, self.network.free_incidence
        null = self.tensions / np.linalg.norm(self.tensions)
        elongations = elongations - (null @ elongations) * null
        scale = float(np.mean(self.sigma * self.lengths)), float(np.mean(self.lengths))
        u, multipliers, best = np.zeros_like(forces), np.zeros_like(elongations), np.inf
        force, elongation = forces, elongations
        for _ in range(MOST_REFINEMENTS):
            step = self._factor.solve(force.ravel() + C.T @ (w * elongation))
            new_u, new = u + step.reshape(forces.shape), multipliers + w * (C @ step - elongation)
            elongation = elongations - C @ new_u.ravel()
            stressed = self.network.divergence @ (self.sigma[:, None] * self.bent(g @ new_u))
            force = forces - stressed - (C.T @ new).reshape(forces.shape)
            error = max(float(np.abs(force).max()) / scale[0], float(np.abs(elongation).max()) / scale[1])
            if not error < CONTRACTION * best:
                break
            u, multipliers, best = new_u, new, error
            if error < REFINED:
                break
        return u, multipliers, best


def balanced_system(tissue: CriticalTissue) -> tuple[PerimeterSystem, Array]:
    """The system at the exact balance near a critical tissue, and relative errors (N_b,) of its bond vectors."""
    system = PerimeterSystem(tissue, tissue.face_tensions, tissue.configuration.bond_vectors)
    g, divergence = system.network.free_incidence, system.network.divergence
    L, tensions, change = system.bond_vectors, system.tensions, np.zeros_like(system.bond_vectors)
    for _ in range(_CORRECTIONS):
        pull = (system.sides.T @ tensions / norms(L))[:, None] * L
        u, multipliers, _ = system.solve(-(divergence @ pull), np.zeros_like(tensions))
        change = g @ u
        L, tensions = L + change, tensions + multipliers
    return PerimeterSystem(tissue, tensions, L), norms(change) / system.lengths + 2 * EPS


class _Response(NamedTuple):
    """Amplitude c, work |T·ṗ| with its rounding, rates L̇ (N_b, d) and relative residual of one strain."""

    amplitude: float
    work: tuple[float, float]
    rate: Array
    residual: float


class TissueEnergy(StrainedEnergy):
    """Third derivatives of the energy in strains A_a (d, d), without errors: `response` has samples."""

    def __init__(self, system: PerimeterSystem, strains: Sequence[Array]):
        self.system, self.flexibility = system, 1 / system.tissue.faces.stiffness
        self.D = float(system.tensions**2 @ self.flexibility)
        self.responses = [self._response(A) for A in strains]

    def _response(self, A: Array) -> _Response:
        system = self.system
        affine = system.bond_vectors @ A.T
        rates = np.asarray(system.sides @ dot(system.units, affine))
        c = float(system.tensions @ rates) / self.D
        pull = -(system.network.divergence @ (system.sigma[:, None] * system.bent(affine)))
        u, _, residual = system.solve(pull, c * system.tensions * self.flexibility - rates)
        rounding = float(accumulated_rounding(4 * EPS * system.tensions * (system.sides @ norms(affine))))
        rate = affine + system.network.free_incidence @ u
        return _Response(c, (abs(c) * self.D, rounding), rate, residual)

    def third(self, terms: Sequence[Term]) -> Third:
        """E_abc, without its derivatives."""
        system, L, value, unknown = self.system, self.system.bond_vectors, 0.0, np.array([np.nan])
        for times, a, i, j, curvature in terms:
            b, c = self.responses[i].rate, self.responses[j].rate
            stretch = dot(b, system.bent(c)) + dot(L, L @ curvature.T)
            value += times * self.responses[a].amplitude * float(system.sigma @ stretch)
        return Third(value, unknown, unknown, unknown, unknown)

    def third_error(self, terms: Sequence[Term], by_length: Array) -> float:
        return 0.0
