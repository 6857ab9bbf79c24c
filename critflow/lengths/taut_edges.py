"""Newton's method for the onset of rigidity, restricted to a given set of taut edges; slack edges are ignored.

The unknowns are coordinates x, stresses σ of the taut edges, the strain s and the determined free components q of the
boundary.  With bond vectors L = F(s, q) b + g x they solve

    gᵀ(σ ∘ L) = 0,    |L|² = ℓ² on taut edges,    S_m = Σ σ L·E_m (1 + Σ q E)⁻¹ L = 0.

One step, from a state at which these equations leave forces f, elongations e and free stresses S:

1. Vertices move with the boundary, so that forces change by second order only.  Changes of |L|²/2 by y = (q, s) are
   c_k = L·A_k L with the velocities A_k = (∂F/∂y_k) F⁻¹.
2. Solve the bordered saddle system for displacements u on top of that motion, changes of σ, and changes of y:

       P u + Rᵀ σ̇ = f,    R u + cᵀ ẏ = e,    c_m·σ̇ + Σ_k (∂S_m/∂y_k) ẏ_k = −S_m.

3. Move boundary and vertices; stop where the largest relative error no longer halves, and keep the best state.  The
   factor of an earlier state leaves the product of the errors of both states: it serves again where that is rounding.

Lengths in given ratios are the same problem on the path F = (1 + s) 1, whose strain is a common factor of all lengths.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from critflow.critical.backbone import connected_parts
from critflow.critical.manifold import CriticalConfiguration
from critflow.lengths.boundary import Boundary
from critflow.linalg.saddle import Saddle, SaddleFactor
from critflow.linalg.tolerances import EPS, MOST_REFINEMENTS, REGULARISATION
from critflow.linalg.vectors import dot, norms
from critflow.networks.network import Array, IntArray, Network
from critflow.result import InputError, NetworkError

FITTED = 1e-9  # relative error of the lengths of a solution of Newton's method; short edges limit it by rounding
ONSET_STEPS = 16  # steps of Newton's method in one attempt; convergence is quadratic

Mask = NDArray[np.bool_]
Change = tuple[Array, Array, Array]


@dataclass(frozen=True, eq=False)
class OnsetState:
    """A boundary (s, q), coordinates and stresses."""

    strain: float  # s ≥ 0
    free: Array  # q of the free components, (m,)
    coordinates: Array  # of the free vertices, (n_free, d)
    sigma: Array  # σ (N_b,), zero on slack edges
    taut: Mask  # (N_b,)
    error: float = np.inf  # largest relative error of lengths, forces and free stresses; infinite where it is unknown
    steps: int = 0  # steps of Newton's method so far
    part: TautPart | None = None  # the taut edges as a network, where Newton's method made it
    factor: SaddleFactor | None = None  # of the last step of Newton's method
    factor_error: float = np.inf  # that of the state at which the factor was made

    def bond_vectors(self, path: Boundary) -> Array:
        """L = F b + g x, (N_b, d)."""
        return path.bond_vectors(self.strain, self.free, self.coordinates)

    def ratios(self, path: Boundary, lengths: Array) -> Array:
        """|L|/ℓ, (N_b,)."""
        return norms(self.bond_vectors(path)) / lengths


def newton_taut(path: Boundary, lengths: Array, start: OnsetState, damping: float = 0.0) -> OnsetState | None:
    """Newton's method with the given taut edges, to the smallest residual; None where they cannot be in balance.

    damping  compliance of the edges, relative to their stress, for parts with several self-stresses: far from the
             solution their equations of lengths contradict each other, and stresses would grow without bound
    """
    part = start.part
    if part is None or not np.array_equal(part.taut, start.taut):
        part = taut_part(path, start.taut)
    if part is None:
        return None
    misses = 0
    best = state = replace(start, sigma=np.where(start.taut, start.sigma, 0.0), error=np.inf, part=part, factor=None)
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
    return replace(best, steps=state.steps, factor=state.factor, factor_error=state.factor_error)


@dataclass(frozen=True, eq=False)
class Residuals:
    """The equations at a state, of the taut edges."""

    velocities: Array  # A_k of (q, s), (k, d, d)
    L: Array  # bond vectors
    force: Array  # gᵀ(σ ∘ L)
    elongation: Array  # ½(ℓ² − |L|²)
    changes: Array  # c_k, of |L|²/2 by (q, s)
    error: float  # the largest relative error


@dataclass(frozen=True, eq=False)
class TautPart:
    """The taut edges as a network whose components are grounded at one vertex each."""

    network: Network
    saddle: Saddle
    taut: Mask  # its edges in the whole network, (N_b,)
    vertices: IntArray  # its vertices in the whole network
    rows: IntArray  # of its free vertices among the free vertices of the whole network
    several: bool  # whether they fall into several components

    def residuals(self, path: Boundary, lengths: Array, state: OnsetState) -> Residuals:
        """The equations at a state."""
        L, sigma = state.bond_vectors(path)[self.taut], state.sigma[self.taut]
        velocities = path.velocities(state.strain, state.free)
        changes = np.einsum("ai,kij,aj->ka", L, velocities, L)
        target, h = 0.5 * lengths[self.taut] ** 2, 0.5 * dot(L, L)
        force = self.network.divergence @ (sigma[:, None] * L)
        tension = np.abs(sigma) * np.sqrt(2 * h)
        with np.errstate(invalid="ignore", divide="ignore"):
            error = max(
                float(np.abs(h / target - 1).max()) / 2,
                float(np.abs(force).max(initial=0.0) / tension.mean()),
                float(np.abs(changes[:-1] @ sigma).max(initial=0.0) / (np.abs(sigma) @ (2 * h))),
            )
        return Residuals(velocities, L, force, target - h, changes, error if np.isfinite(error) else np.inf)

    def step(self, path: Boundary, state: OnsetState, at: Residuals, damping: float) -> OnsetState:
        """One step of Newton's method."""
        factor, error = state.factor, state.factor_error
        if factor is None or damping or not error * at.error < EPS:
            factor, error = self.saddle.factorize(state.sigma[self.taut], at.L, damping or REGULARISATION), at.error
        change = self.change(path, state, at, factor, at.elongation, 1 if damping else MOST_REFINEMENTS)
        return replace(self.moved(path, state, change), factor=factor, factor_error=error)

    def change(
        self,
        path: Boundary,
        state: OnsetState,
        at: Residuals,
        factor: SaddleFactor,
        elongation: Array,
        max_refinements: int = MOST_REFINEMENTS,
    ) -> Change:
        """The change for which forces balance and the taut edges have these changes of |L|²/2.

        Displacements (n, d) on top of the affine motion with the boundary, changes of σ and of (q, s).
        """
        sigma = state.sigma[self.taut]
        corner = path.stress_rates(state.strain, state.free, sigma, at.L, at.velocities)
        sums = np.append(-at.changes[:-1] @ sigma, 0.0)
        solved = factor.solve_bordered(-at.force, elongation, at.changes, corner, sums, max_refinements=max_refinements)
        return solved[:3]

    def moved(self, path: Boundary, state: OnsetState, change: Change, fraction: float = 1.0) -> OnsetState:
        """The state after a fraction of a change."""
        displacements, stresses, boundary = change
        s, q = state.strain + fraction * float(boundary[-1]), state.free.copy()
        q[path.determined] += fraction * boundary[:-1]
        before = path.gradient(state.strain, state.free)
        x = state.coordinates @ np.linalg.solve(before.T, path.gradient(s, q).T)
        x[self.rows] += fraction * displacements
        sigma = state.sigma.copy()
        sigma[self.taut] += fraction * stresses
        return replace(state, strain=s, free=q, coordinates=x, sigma=sigma, steps=state.steps + 1)


def taut_part(path: Boundary, taut: Mask) -> TautPart | None:
    """The taut edges as a network; None where they cannot be in balance."""
    network = path.network
    components = [] if taut.all() else connected_parts(network, taut)
    try:
        if not components:
            part, vertices = network, np.arange(network.n_vertices)
        elif len(components) == 1:
            part, vertices = network.part(taut)
        else:
            part, vertices = _grounded(network, taut, components)
    except NetworkError:
        return None
    row = np.full(network.n_vertices, -1)
    row[network.free] = np.arange(len(network.free))
    saddle = path.manifold.saddle if part is network else Saddle(part)
    return TautPart(part, saddle, taut, vertices, row[vertices[part.free]], len(components) > 1)


def _grounded(network: Network, taut: Mask, components: list[Mask]) -> tuple[Network, IntArray]:
    """The taut edges as a network with a pin in each component, and its vertices; positions of pins are not used."""
    edges, fixed = network.edges[taut], set(network.pins)
    for component in components:
        ends = network.edges[component]
        if fixed.isdisjoint(ends.ravel().tolist()):
            fixed.add(int(ends.min()))
    vertices = np.unique(edges)
    pinned = np.flatnonzero(np.isin(vertices, list(fixed)))
    pins = {int(i): np.zeros(network.dimension) for i in pinned}
    index = np.searchsorted(vertices, edges)
    return Network(index, network.offsets[taut], network.cell, pins=pins, n_vertices=len(vertices)), vertices


def unknown_configuration(network: Network) -> CriticalConfiguration:
    """A configuration of NaN, in place of one that was not found."""
    shape = (network.n_edges, network.dimension)
    coordinates = np.full((network.n_vertices, network.dimension), np.nan)
    return CriticalConfiguration(network, np.full(network.n_edges, np.nan), coordinates, np.full(shape, np.nan))
