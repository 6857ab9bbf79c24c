"""Newton's method for the onset of rigidity on the taut edges of a network, whatever the others do.

The unknowns are coordinates x, stresses σ of the taut edges, the strain s and the determined free components q of
the boundary:  gᵀ(σ ∘ L) = 0,  |L| = ℓ on taut edges,  Σ σ L·E_m L = 0,  with L = F(s, q) b + g x.  Coordinates move
with the boundary, so that forces change by second order only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from critflow.critical.backbone import connected_parts
from critflow.linalg.saddle import Saddle, SaddleFactor
from critflow.linalg.tolerances import MOST_REFINEMENTS, REGULARISATION
from critflow.networks.network import Array, IntArray, Network
from critflow.onset.boundary_path import BoundaryPath
from critflow.onset.tolerances import EXACT_CONE, FITTED, NO_STRESS, WEAK_STRESS
from critflow.result import InputError, NetworkError
from critflow.solvers.cone import fit_lengths

ONSET_ROUNDS = 16  # attempts to separate taut from slack edges; standard networks need one, diluted lattices up to four
WEAK_GROWTH = 3.0  # factor between the stresses below which edges are released when Newton's method fails again
DAMPING = 1e-3  # compliance of taut edges with several self-stresses, relative to their stress, far from the solution
ONSET_STEPS = 16  # steps of Newton's method in one attempt; convergence is quadratic
VIOLATED = 1e-8  # excess of |L|/ℓ over 1 of a slack edge that becomes a candidate; errors of the program are smaller

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class OnsetState:
    """A boundary (s, q), coordinates and stresses.

    strain       s ≥ 0
    free         q of the free components, (m,)
    coordinates  of the free vertices, (n_free, d)
    sigma        σ (N_b,), zero on slack edges
    taut         (N_b,)
    error        largest relative error of lengths, forces and free stresses; infinite where it is unknown
    steps        steps of Newton's method so far
    """

    strain: float
    free: Array
    coordinates: Array
    sigma: Array
    taut: Mask
    error: float = np.inf
    steps: int = 0

    def bond_vectors(self, path: BoundaryPath) -> Array:
        """L = F b + g x, (N_b, d)."""
        F = path.gradient(self.strain, self.free)
        return path.boundary_vectors(F) + path.network.free_incidence @ self.coordinates


def polish_taut(path: BoundaryPath, lengths: Array, start: OnsetState) -> OnsetState:
    """The onset on the taut edges, to rounding, from a solution of the cone program with a guess of those edges.

    After each attempt edges without stress are released, other edges longer than ℓ become candidates, and where
    Newton's method fails the weakest edges are released.  The error is infinite where no attempt succeeds.
    """
    network, state, best, weak_below, least = path.network, start, start, WEAK_STRESS, np.inf
    released, steps = np.zeros(network.n_edges, bool), 0
    for _ in range(ONSET_ROUNDS):
        candidate = without_hanging(network, state.taut)
        if not candidate.any():
            break
        found = newton_taut(path, lengths, replace(state, taut=candidate))
        if found is not None and not found.error < FITTED:
            damped = newton_taut(path, lengths, replace(state, taut=candidate), damping=DAMPING)
            found = damped and newton_taut(path, lengths, damped)
        steps = steps if found is None else found.steps
        if found is None or not found.error < FITTED:
            mean = float(start.sigma[candidate].mean())
            weak = candidate & (start.sigma < weak_below * mean)
            weak_below *= WEAK_GROWTH
            state = replace(start, taut=candidate & ~weak, steps=steps)
            continue
        unstressed = candidate & (found.sigma <= NO_STRESS * found.sigma[candidate].mean())
        released |= unstressed
        longer = _longer(path, lengths, found) & ~released
        if longer.any():
            found = settled(path, lengths, found)
            longer &= _longer(path, lengths, found)
        if not unstressed.any() and longer.sum() < least:
            best, least = found, longer.sum()
        if not (unstressed.any() or longer.any()):
            break
        # An edge that is longer once more after its trial is not part of the balance.
        released |= longer
        sigma = np.where(longer, WEAK_STRESS * found.sigma[candidate].mean(), np.where(unstressed, 0.0, found.sigma))
        state = replace(found, taut=(candidate & ~unstressed) | longer, sigma=sigma)
    return replace(best, steps=steps)


def _longer(path: BoundaryPath, lengths: Array, state: OnsetState) -> Mask:
    """Slack edges that are longer than ℓ."""
    return ~state.taut & (np.linalg.norm(state.bond_vectors(path), axis=1) > (1 + VIOLATED) * lengths)


def resolved(path: BoundaryPath, lengths: Array, state: OnsetState) -> bool:
    """Whether Newton's method converged to a state without longer slack edges."""
    return state.error < FITTED and not _longer(path, lengths, state).any()


def without_slack_stress(path: BoundaryPath, lengths: Array, state: OnsetState) -> OnsetState:
    """The state without the small stresses of its slack edges, with its error."""
    part = taut_part(path, state.taut)
    state = replace(state, sigma=np.where(state.taut, state.sigma, 0.0))
    return replace(state, error=np.inf if part is None else part.residuals(path, lengths, state).error)


def settled(path: BoundaryPath, lengths: Array, state: OnsetState) -> OnsetState:
    """The state with coordinates of the vertices off the taut edges that shorten the longest slack edge, |L|/ℓ > 1.

    They are those of a program that was less accurate than the taut part.
    """
    network = path.network
    L = state.bond_vectors(path)
    longest = float((np.linalg.norm(L, axis=1) / lengths)[~state.taut].max(initial=0.0))
    if longest <= 1 or not np.isfinite(state.error):
        return state
    on = np.zeros(network.n_vertices, bool)
    on[network.edges[state.taut]] = True
    columns = ~on[network.free]
    moving = sp.csr_array(network.free_incidence[:, columns])
    edges = np.diff(moving.indptr) > 0
    if not edges.any():
        return state
    g = sp.csr_array(moving[edges])
    fit = fit_lengths(g, L[edges] - g @ state.coordinates[columns], lengths[edges], EXACT_CONE[0])
    x = state.coordinates.copy()
    x[columns] = fit.coordinates
    return replace(state, coordinates=x) if fit.ratio < longest else state


def newton_taut(path: BoundaryPath, lengths: Array, start: OnsetState, damping: float = 0.0) -> OnsetState | None:
    """Newton's method with the given taut edges, to the smallest residual; None where they cannot be in balance.

    damping  compliance of the edges, relative to their stress, for parts with several self-stresses: far from the
             solution their equations of lengths contradict each other, and stresses would grow without bound
    """
    part = taut_part(path, start.taut)
    if part is None:
        return None
    misses = 0
    best = state = replace(start, sigma=np.where(start.taut, start.sigma, 0.0), error=np.inf)
    for _ in range(ONSET_STEPS):
        try:
            residuals = part.residuals(path, lengths, state)
        except InputError:
            break
        misses = 0 if residuals.error < 0.5 * best.error else misses + 1
        state = replace(state, error=residuals.error)
        # Of two iterates whose residuals are rounding the later is closer.
        if residuals.error < 2 * best.error:
            best = state
        if misses > (best.error > FITTED) or not np.isfinite(residuals.error):
            break
        try:
            state = part.step(path, state, residuals, damping)
        except (InputError, np.linalg.LinAlgError):
            break
    return replace(best, steps=state.steps)


@dataclass(frozen=True, eq=False)
class Residuals:
    """Bond vectors L, forces, ½(ℓ² − |L|²) and changes of |L|²/2 by (q, s) of the taut edges, and the largest error."""

    L: Array
    force: Array
    elongation: Array
    changes: Array
    error: float


class Change(NamedTuple):
    """Displacements (n, d) on top of the affine motion with the boundary, changes of σ and of (q, s)."""

    displacements: Array
    sigma: Array
    boundary: Array


@dataclass(frozen=True, eq=False)
class TautPart:
    """The taut edges as a network whose components are grounded at one vertex each.

    taut  its edges in the whole network, (N_b,)
    rows  of its free vertices among the free vertices of the whole network
    """

    network: Network
    saddle: Saddle
    taut: Mask
    rows: IntArray

    def residuals(self, path: BoundaryPath, lengths: Array, state: OnsetState) -> Residuals:
        """The equations at a state."""
        L, sigma = state.bond_vectors(path)[self.taut], state.sigma[self.taut]
        inverse = np.linalg.inv(path.gradient(state.strain, state.free))
        used = [*path.determined, path.n_free]
        velocities = path.rates(state.strain, state.free)[used] @ inverse
        changes = np.einsum("ai,kij,aj->ka", L, velocities, L)
        target, h = 0.5 * lengths[self.taut] ** 2, 0.5 * np.einsum("ad,ad->a", L, L)
        force = self.network.divergence @ (sigma[:, None] * L)
        tension = np.abs(sigma) * np.sqrt(2 * h)
        with np.errstate(invalid="ignore", divide="ignore"):
            error = max(
                float(np.abs(h / target - 1).max()) / 2,
                float(np.abs(force).max(initial=0.0) / tension.mean()),
                float(np.abs(changes[:-1] @ sigma).max(initial=0.0) / (np.abs(sigma) @ (2 * h))),
            )
        return Residuals(L, force, target - h, changes, error if np.isfinite(error) else np.inf)

    def step(self, path: BoundaryPath, state: OnsetState, at: Residuals, damping: float) -> OnsetState:
        """One step of Newton's method."""
        factor = self.saddle.factorize(state.sigma[self.taut], at.L, damping or REGULARISATION)
        change = self.change(path, state, at, factor, at.elongation, 1 if damping else MOST_REFINEMENTS)
        return self.moved(path, state, change)

    def change(
        self,
        path: BoundaryPath,
        state: OnsetState,
        at: Residuals,
        factor: SaddleFactor,
        elongation: Array,
        max_refinements: int = MOST_REFINEMENTS,
    ) -> Change:
        """The change for which forces balance and the taut edges have these changes of |L|²/2."""
        sigma, m = state.sigma[self.taut], len(path.determined)
        corner = np.zeros((m + 1, m + 1))
        corner[:-1] = self._corner(path, state, at.L, sigma)
        sums = np.append(-at.changes[:-1] @ sigma, 0.0)
        return Change(*factor.solve_bordered(-at.force, elongation, at.changes, corner, sums, max_refinements))

    def moved(self, path: BoundaryPath, state: OnsetState, change: Change, fraction: float = 1.0) -> OnsetState:
        """The state after a fraction of a change."""
        s, q = state.strain + fraction * float(change.boundary[-1]), state.free.copy()
        q[path.determined] += fraction * change.boundary[:-1]
        before = path.gradient(state.strain, state.free)
        x = state.coordinates @ np.linalg.solve(before.T, path.gradient(s, q).T)
        x[self.rows] += fraction * change.displacements
        sigma = state.sigma.copy()
        sigma[self.taut] += fraction * change.sigma
        return replace(state, strain=s, free=q, coordinates=x, sigma=sigma, steps=state.steps + 1)

    @staticmethod
    def _corner(path: BoundaryPath, state: OnsetState, L: Array, sigma: Array) -> Array:
        """Derivatives of the free stresses Σ σ L·A_m L by (q, s) at affine motion, (m, m + 1)."""
        inverse = np.linalg.inv(path.gradient(state.strain, state.free))
        used = [*path.determined, path.n_free]
        velocities = path.rates(state.strain, state.free)[used] @ inverse
        stress = np.einsum("a,ai,aj->ij", sigma, L, L)
        corner = np.einsum("mik,nil,kl->mn", velocities[:-1], velocities, stress)
        mixed = path.second_rates(state.strain)[path.determined] @ inverse
        corner[:, -1] += np.einsum("mij,ij->m", mixed, stress)
        return corner


def taut_part(path: BoundaryPath, taut: Mask) -> TautPart | None:
    """The taut edges as a network; None where they cannot be in balance."""
    network = path.network
    edges = network.edges[taut]
    vertices = np.unique(edges)
    fixed = set(network.pins)
    for component in connected_parts(network, taut):
        ends = np.unique(network.edges[component])
        if fixed.isdisjoint(ends.tolist()):
            fixed.add(int(ends[0]))
    index = np.full(network.n_vertices, -1)
    index[vertices] = np.arange(len(vertices))
    pins = {int(index[i]): np.zeros(network.dimension) for i in sorted(fixed) if index[i] >= 0}
    try:
        part = Network(index[edges], network.offsets[taut], network.cell, pins=pins, n_vertices=len(vertices))
    except NetworkError:
        return None
    row = np.full(network.n_vertices, -1)
    row[network.free] = np.arange(len(network.free))
    return TautPart(part, Saddle(part), taut, row[vertices[part.free]])


def without_hanging(network: Network, kept: Mask) -> Mask:
    """Remove edges that end at a free vertex with no other edge, repeatedly: they cannot carry tension."""
    kept = kept.copy()
    pinned = np.zeros(network.n_vertices, bool)
    pinned[list(network.pins or {})] = True
    while True:
        degree = np.bincount(network.edges[kept].ravel(), minlength=network.n_vertices)
        hanging = kept & ((degree == 1) & ~pinned)[network.edges].any(axis=1)
        if not hanging.any():
            return kept
        kept &= ~hanging
