"""Equilibria of springs in a cell with free components: zero conjugate stress, as in a tensile test with free sides.

The boundary is b → (1 + Σ_m q_m E_m) F b with unknown q.  With A_m = E_m (1 + Σ q E)⁻¹ the first derivatives are the
unbalanced forces f on the vertices and r_m = −Σ σ L·A_m L; a Newton step solves
    H u + X δq = f,  Xᵀ u + C δq = r,   X_m = gᵀ T(A_m L),  C_mn = Σ A_m L·T(A_n L),  T(v) = K L (L·v) + σ v,
by the factor of H and the Schur complement C − Xᵀ H⁻¹ X, which has a row for each free component.  The unknowns are
p = s q with s = √N_b ⟨ℓ⟩, so that all entries have similar magnitude.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from critflow.equilibria import (
    FLOPPY_SHIFT,
    NEWTON_STEPS,
    ROUNDING_COMPRESSION,
    Equilibrium,
    as_minimum,
    newton,
    stability_of,
    with_bounds,
)
from critflow.networks import Array, Network
from critflow.numerics import EPS
from critflow.result import Status
from critflow.sparse import Factor
from critflow.springs import TAUT, EdgeMatrix, SpringState

# Strain of the cell by the stress that is left, above which nothing fixes its free components.  In a cell that cables
# pull flat the remaining step is the whole of what is left, 1; where they are fixed it is rounding over a stiffness.
UNFIXED_STRAIN = 0.1
# Roundings of the Schur complement in units of its terms, below which a stiffness of the cell is zero.
SCHUR_ROUNDING = 64 * EPS
NO_TENSION = 1e-9  # σ of a cable, in units of the largest, up to which it may be slack
# Gauss-Newton steps to a state without stress, each of which leaves a quarter of the extension at worst, and the
# stiffness that regularises floppy modes in them, near the rounding of a factor.
_REST_STEPS, _REST_SHIFT = 8, 1e-3 * FLOPPY_SHIFT
UNFIXED = (
    "no stress fixes the free components of the cell: the springs are floppy in it, or pull its sides together until "
    "it is flat; fix a component"
)


@dataclass(frozen=True, eq=False)
class FreeCellState:
    """Springs in a cell with free components, all in the units of the module.

    springs  of any kind
    stretch  q (m,)
    strains  E (m, d, d)

    `forces` and displacements are vectors (n_free·d + m,): those of the vertices, then those of p.
    """

    springs: SpringState
    stretch: Array
    strains: Array

    @cached_property
    def rates(self) -> Array:
        """A_m = E_m (1 + Σ q E)⁻¹, (m, d, d)."""
        return np.asarray(self.strains @ np.linalg.inv(stretched(self.stretch, self.strains)))

    @property
    def unit(self) -> float:
        """s = √N_b ⟨ℓ⟩."""
        return float(np.sqrt(len(self.springs.rest_lengths))) * self.springs.length_scale

    @property
    def energy(self) -> float:
        """E; infinite where the cell is inverted."""
        energy = self.springs.energy
        return energy if np.isfinite(energy) else np.inf

    @cached_property
    def forces(self) -> Array:
        """The unbalanced forces on the vertices and on p, (n_free·d + m,)."""
        return np.concatenate([self.springs.forces.ravel(), self.conjugate_forces / self.unit])

    @cached_property
    def max_force(self) -> float:
        """Largest component of the unbalanced forces."""
        return float(np.abs(self.forces).max(initial=0.0))

    # What Newton's method and the test for a minimum ask of the springs.

    @property
    def sigma(self) -> Array:
        return self.springs.sigma

    @property
    def lengths(self) -> Array:
        return self.springs.lengths

    @property
    def edge_stiffness(self) -> Array:
        return self.springs.edge_stiffness

    @property
    def stress_rounding(self) -> Array:
        return self.springs.stress_rounding

    @property
    def stiffness_scale(self) -> float:
        return self.springs.stiffness_scale

    @property
    def length_scale(self) -> float:
        return self.springs.length_scale

    @property
    def largest_stiffness(self) -> float:
        return self.springs.largest_stiffness

    def taut(self, least: float = TAUT) -> bool:
        return self.springs.taut(least)

    @property
    def conjugate_forces(self) -> Array:
        """r_m = −Σ σ L·A_m L = −∂E/∂q_m, (m,)."""
        springs = self.springs
        return -np.asarray(np.einsum("ad,mad,a->m", springs.bond_vectors, self._stretches(), springs.sigma))

    @property
    def conjugate_rounding(self) -> Array:
        """Rounding errors of r, (m,): proofs to first order, in σ, products and sum."""
        springs, speed = self.springs, np.linalg.norm(self._stretches(), axis=2)
        return np.asarray(speed @ ((springs.stress_rounding + 4 * EPS * np.abs(springs.sigma)) * springs.lengths))

    def moved(self, displacement: Array) -> FreeCellState:
        """The state after displacing the vertices and p by a vector (n_free·d + m,)."""
        springs, m, d = self.springs, len(self.stretch), self.springs.network.dimension
        change = displacement[-m:] / self.unit
        stretch = self.stretch + change
        step = np.eye(d) + np.tensordot(change, self.rates, 1)
        if not (np.linalg.det(step) > 0 and np.linalg.det(stretched(stretch, self.strains)) > 0):
            # A step that inverts the cell is refused by its energy.
            return replace(self, springs=replace(springs, bond_vectors=np.full_like(springs.bond_vectors, np.nan)))
        springs = springs.deformed(step).moved(displacement[:-m].reshape(-1, d))
        return replace(self, springs=springs, stretch=stretch)

    def near_rest(self) -> FreeCellState:
        """A state near by without stress, where there is one, by Gauss-Newton steps to the rest lengths."""
        state = self
        for _ in range(_REST_STEPS):
            # The stiffness without the softening of compressed edges, which is not small against that of nearly floppy
            # modes: a fibre that is not quite straight lengthens by the square of its deflection.
            springs = state.springs
            rest = np.where(springs.tension == 0, springs.rest_lengths, springs.spring_lengths)
            bare = replace(state, springs=replace(springs, rest_lengths=rest))
            factor = bare.factorize(_REST_SHIFT * state.stiffness_scale)
            state = state.moved(factor.solve(state.forces))
        return state

    def edge_rates(self, motion: Array) -> Array:
        """Changes (N_b, d) of the bond vectors by a motion (n_free·d + m,)."""
        m = len(self.stretch)
        return self.springs.edge_rates(motion[:-m]) + np.tensordot(motion[-m:] / self.unit, self._stretches(), 1)

    def factorize(self, shift: float = 0.0) -> BorderedFactor:
        """Factorise the second derivatives in vertices and p, plus shift·1."""
        springs = self.springs
        return self.bordered(springs.factorize(shift), springs.modified_stiffness, springs.sigma, shift)

    def factorize_convex(self, shift: float) -> BorderedFactor:
        """Factorise their convex part plus shift·1."""
        springs = self.springs
        return self.bordered(springs.factorize_convex(shift), *springs.convex_parts(), shift)

    def bordered(self, vertices: Factor, axial: EdgeMatrix, isotropic: Array, shift: float = 0.0) -> BorderedFactor:
        """The factor for vertices and cell, from one for the vertices, of the stiffness c L Lᵀ + t 1 of the edges."""
        L, V, divergence = self.springs.bond_vectors, self._stretches() / self.unit, self.springs.network.divergence
        hdot = np.einsum("ad,mad->ma", L, V)
        resisted = axial * hdot if isinstance(axial, np.ndarray) else np.asarray((axial @ hdot.T).T)
        TV = resisted[:, :, None] * L + isotropic[:, None] * V
        X = np.stack([(divergence @ one).ravel() for one in TV], axis=1)
        C = np.einsum("mad,nad->mn", V, TV) + shift * np.eye(len(V))
        return BorderedFactor(vertices, X, C, float(np.sum(np.abs(V) * np.abs(TV))))

    def stretch_errors(self, border: BorderedFactor) -> Array:
        """Bound of the changes of p (m,) by the conjugate stress that is left; infinite where nothing resists them."""
        return border.schur_bound((np.abs(self.conjugate_forces) + self.conjugate_rounding) / self.unit)

    def fixes_cell(self, left: Array) -> bool:
        """Whether tension resists the free components, of whose p (m,) a change is left.

        Cables at their rest length resist extension but no contraction: they are judged as slack.
        """
        springs = self.springs
        if springs.law.one_sided:
            tension = np.maximum(NO_TENSION * springs.sigma.max(), ROUNDING_COMPRESSION * springs.stress_rounding)
            longer = np.maximum(springs.rest_lengths, 2 * springs.lengths)
            rest = np.where(springs.sigma > tension, springs.rest_lengths, longer)
            tense = replace(self, springs=replace(springs, rest_lengths=rest))
            vertices = tense.factorize(FLOPPY_SHIFT * springs.stiffness_scale).vertices
            border = tense.bordered(vertices, tense.springs.modified_stiffness, tense.springs.sigma)
            left = np.maximum(left, tense.stretch_errors(border) * (self.unit / tense.unit))
        with np.errstate(invalid="ignore"):
            strain = np.abs(np.tensordot(left / self.unit, np.abs(self.rates), 1)).max()
        return bool(strain < UNFIXED_STRAIN)

    def _stretches(self) -> Array:
        """A_m L, (m, N_b, d)."""
        return np.einsum("mij,aj->mai", self.rates, self.springs.bond_vectors)


def stretched(stretch: Array, strains: Array) -> Array:
    """1 + Σ_m q_m E_m, (d, d)."""
    return np.eye(strains.shape[-1]) + np.tensordot(stretch, strains, 1)


class BorderedFactor(Factor):
    """The factor of [[H, X], [Xᵀ, C]] for one right side (n + m,), from a factor of H, X (n, m) and C (m, m).

    size  of the terms of which C is the sum
    """

    __slots__ = ("_coupling", "_modes", "_rounding", "_values", "response", "vertices")

    def __init__(self, vertices: Factor, coupling: Array, corner: Array, size: float):
        self.vertices, self._coupling = vertices, coupling
        self._shift, self._singular, self._pivots = 0.0, False, None
        m = len(corner)
        # H⁻¹ X, (n, m).
        self.response = np.full_like(coupling, np.nan)
        self._values, self._modes = np.full(m, np.nan), np.eye(m)
        self._rounding = 0.0
        if vertices.sound:
            self.response = vertices.solve(coupling)
            schur = corner - coupling.T @ self.response
            self._values, self._modes = np.linalg.eigh(0.5 * (schur + schur.T))
            self._rounding = SCHUR_ROUNDING * (size + float(np.sum(np.abs(coupling) * np.abs(self.response))))

    def solve(self, right_side: Array) -> Array:
        m = len(self._values)
        u = self.vertices.solve(right_side[:-m])
        p = self.solve_schur(right_side[-m:] - self._coupling.T @ u)
        return np.concatenate([u - self.response @ p, p])

    def solve_schur(self, right_side: Array) -> Array:
        """S⁻¹ r (m,) by the Schur complement S; nothing along its null directions."""
        inverse = np.divide(1.0, self._values, out=np.zeros_like(self._values), where=self._values != 0)
        return np.asarray(self._modes @ (inverse * (self._modes.T @ right_side)))

    def schur_bound(self, size: Array) -> Array:
        """Bound of |S⁻¹ r| (m,) for |r| below a size (m,); infinite where an eigenvalue of S is rounding."""
        stiffness = np.abs(self._values)
        loads = np.abs(self._modes.T) @ size
        changes = np.divide(loads, stiffness, out=np.full_like(loads, np.inf), where=stiffness > self._rounding)
        with np.errstate(invalid="ignore"):
            return np.asarray(np.abs(self._modes) @ changes)

    @property
    def pivots(self) -> Array:
        return np.concatenate([self.vertices.pivots, self._values])


def relaxed_with_cell(
    state: FreeCellState, reference: Network, gradient: Array, tolerance: float
) -> tuple[Equilibrium[SpringState], Factor | None, Array]:
    """As `relaxed` by Newton's method, with the free components q (m,) of the cell (1 + Σ q E) F of a reference.

    Error bound (estimate): that of the equilibrium in this cell, and its change by the remaining error of q.
    """
    # To these functions the state is one of springs: it has their energy, forces, stress and factors.
    unknowns: Any = state
    end, known = newton(unknowns, tolerance, NEWTON_STEPS)
    q = end.value.stretch
    # The cell has the rounding of one deformation, not of many.
    network = reference.deformed(stretched(q, state.strains) @ gradient)
    solution: Equilibrium[SpringState] = replace(end, value=replace(end.value.springs, network=network))
    if not solution.ok:
        return solution, None, q
    vertices = (known if isinstance(known, BorderedFactor) else end.value.factorize()).vertices
    solution, factor = with_bounds(solution, vertices, corrected=True, judged=False)
    there: Any = FreeCellState(solution.value, q, state.strains)
    # Of this state and without a shift, which resists every motion of the cell.
    border = there.bordered(vertices, solution.value.modified_stiffness, solution.value.sigma)
    left = there.stretch_errors(border)
    affine = np.einsum("mij,vj->mvi", there.rates, solution.value.coordinates[network.free]) / there.unit
    moved = np.abs(affine.reshape(len(q), -1)).T + np.abs(border.response)
    with np.errstate(invalid="ignore"):
        bound = solution.stats.error_bound + float((moved @ left).max(initial=0.0))
    if solution.ok and not (np.isfinite(bound) and there.fixes_cell(left)):
        solution = replace(solution, status=Status.floppy, note=UNFIXED)
    solution = replace(solution, stats=replace(solution.stats, error_bound=bound))
    return as_minimum(solution, *stability_of(there)), factor, q
