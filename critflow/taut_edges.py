"""Newton's method for the onset of rigidity on a set of taut edges, and the search for that set.

Slack edges are ignored.  The unknowns are coordinates x, stresses σ of the taut edges, the strain s and the determined
free components q of the boundary.  With bond vectors L = F(s, q) b + g x they solve

    gᵀ(σ ∘ L) = 0,    |L|² = ℓ² on taut edges,    S_m = Σ σ L·E_m (1 + Σ q E)⁻¹ L = 0.

One step, from a state at which these equations leave forces f, elongations e and free stresses S:

1. Vertices move with the boundary, so that forces change by second order only.  Changes of |L|²/2 by y = (q, s) are
   c_k = L·A_k L with the velocities A_k = (∂F/∂y_k) F⁻¹.
2. Solve the bordered saddle system for displacements u on top of that motion, changes of σ, and changes of y:

       P u + Rᵀ σ̇ = f,    R u + cᵀ ẏ = e,    c_m·σ̇ + Σ_k (∂S_m/∂y_k) ẏ_k = −S_m.

3. Move boundary and vertices; stop where the largest relative error no longer halves, and keep the best state.  The
   factor of an earlier state leaves the product of the errors of both states: it serves again where that is rounding.

Lengths in given ratios are the same problem on the path F = (1 + s) 1, whose strain is a common factor of all lengths.
`polish_taut` corrects the set of taut edges between attempts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from critflow.arguments import Mask
from critflow.cones import fit_lengths
from critflow.manifold import CriticalConfiguration, CriticalManifold
from critflow.networks import Array, IntArray, Network
from critflow.numerics import EPS, dot, norms
from critflow.result import InputError, NetworkError
from critflow.saddles import MOST_REFINEMENTS, REGULARISATION, Saddle, SaddleFactor
from critflow.taut_part import connected_parts


@dataclass(frozen=True, eq=False)
class Boundary:
    """The boundary of one network that moves with the unknowns of Newton's method: b → F(s, q) b.

    The strain s is one unknown.  Here it is a common factor of all lengths, F = (1 + s) 1; other paths, and free
    components q of the cell, override `gradient` and `rates`.  Derivatives are by (q, s), the strain last.
    """

    manifold: CriticalManifold

    @property
    def network(self) -> Network:
        return self.manifold.network

    @property
    def determined(self) -> IntArray:
        """Indices of the components of q that the balance of forces determines."""
        return np.zeros(0, np.int64)

    def gradient(self, s: float, q: Array) -> Array:
        """F(s, q), (d, d); raises `InputError` where det F ≤ 0."""
        F = (1 + s) * np.eye(self.network.dimension)
        if not (np.isfinite(s) and np.linalg.det(F) > 0):
            raise InputError(f"a strain of {s:g} inverts or flattens the cell")
        return F

    def rates(self, s: float, q: Array) -> Array:
        """Derivatives of F(s, q) by (q, s), (n_q + 1, d, d)."""
        return np.eye(self.network.dimension)[None]

    def velocities(self, s: float, q: Array) -> Array:
        """A_k = (∂F/∂y_k) F⁻¹ of the determined components of q, and of the strain last, (k, d, d)."""
        return self.rates(s, q)[[*self.determined, -1]] @ np.linalg.inv(self.gradient(s, q))

    def stress_rates(self, s: float, q: Array, sigma: Array, L: Array, velocities: Array) -> Array:
        """∂S_m/∂y_k at affine motion of the stresses S_m of the determined components, (k, k) with a last row of zeros.

        sigma, L, velocities  of the stressed edges, and A_k
        """
        return np.zeros((1, 1))

    def boundary_vectors(self, F: Array) -> Array:
        """F b, (N_b, d)."""
        return self.network.boundary_vectors @ F.T

    def bond_vectors(self, s: float, q: Array, x: Array) -> Array:
        """L = F(s, q) b + g x, (N_b, d), for coordinates x (n_free, d)."""
        return self.boundary_vectors(self.gradient(s, q)) + self.network.free_incidence @ x


FITTED = 1e-9  # relative error of the lengths of a solution of Newton's method; short edges limit it by rounding
ONSET_STEPS = 16  # steps of Newton's method in one attempt; convergence is quadratic

Change = tuple[Array, Array, Array]
System = tuple[Array, Array, Array, Array, Array]


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
    factor, factor_error, misses = None, start.factor_error, 0
    best = state = replace(start, sigma=np.where(start.taut, start.sigma, 0.0), error=np.inf, part=part, factor=None)
    for _ in range(ONSET_STEPS):
        # 1. What the equations leave at the state; of two states whose residuals are rounding the later is closer
        try:
            error, L, system = part.equations(path, lengths, state)
        except InputError:
            break
        misses = 0 if error < 0.5 * best.error else misses + 1
        state = replace(state, error=error)
        if error < 2 * best.error:
            best = state
        if misses > (best.error > FITTED) or not np.isfinite(error):
            break
        try:
            # 2. A factor; that of an earlier state leaves the product of the errors of both states
            if factor is None or damping or not factor_error * error < EPS:
                factor, factor_error = None, error  # its solver serves the next one
                factor = part.saddle.factorize(state.sigma[part.taut], L, damping or REGULARISATION)
            # 3. Displacements, changes of σ and of (q, s), and the state after them
            change = factor.solve_bordered(*system, max_refinements=1 if damping else MOST_REFINEMENTS)[:3]
            state = part.moved(path, state, change)
        except (InputError, np.linalg.LinAlgError):
            break
    return replace(best, steps=state.steps, factor=factor, factor_error=factor_error)


@dataclass(frozen=True, eq=False)
class TautPart:
    """The taut edges as a network whose components are grounded at one vertex each."""

    network: Network
    saddle: Saddle
    taut: Mask  # its edges in the whole network, (N_b,)
    vertices: IntArray  # its vertices in the whole network
    rows: IntArray  # of its free vertices among the free vertices of the whole network
    several: bool  # whether they fall into several components

    def equations(self, path: Boundary, lengths: Array, state: OnsetState) -> tuple[float, Array, System]:
        """The largest relative error of the equations at a state, L of the taut edges, and the system of the next step.

        The system is the arguments of `solve_bordered`: f, e, c, ∂S/∂y and −S.
        """
        L, sigma = state.bond_vectors(path)[self.taut], state.sigma[self.taut]
        velocities = path.velocities(state.strain, state.free)
        changes = np.einsum("ai,kij,aj->ka", L, velocities, L)
        target, h = 0.5 * lengths[self.taut] ** 2, 0.5 * dot(L, L)
        force = self.network.divergence @ (sigma[:, None] * L)
        free, tension = changes[:-1] @ sigma, np.abs(sigma) * np.sqrt(2 * h)
        with np.errstate(invalid="ignore", divide="ignore"):
            error = max(
                float(np.abs(h / target - 1).max()) / 2,
                float(np.abs(force).max(initial=0.0) / tension.mean()),
                float(np.abs(free).max(initial=0.0) / (np.abs(sigma) @ (2 * h))),
            )
        corner = path.stress_rates(state.strain, state.free, sigma, L, velocities)
        system = -force, target - h, changes, corner, np.append(-free, 0.0)
        return error if np.isfinite(error) else np.inf, L, system

    def moved(self, path: Boundary, state: OnsetState, change: Change, fraction: float = 1.0) -> OnsetState:
        """The state after a fraction of a change.

        change  displacements (n, d) on top of the affine motion with the boundary, changes of σ and of (q, s)
        """
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
    """The taut edges as a network with a fixed vertex in each component; None where they cannot be in balance."""
    network = path.network
    components = [] if taut.all() else connected_parts(network, taut)
    try:
        if not components:
            part, vertices = network, np.arange(network.n_vertices)
        elif len(components) == 1:
            part, vertices = network.part(taut)
        else:
            # Each component has a pin, whose position is not used.
            edges, fixed = network.edges[taut], set(network.pins)
            for component in components:
                ends = network.edges[component]
                if fixed.isdisjoint(ends.ravel().tolist()):
                    fixed.add(int(ends.min()))
            vertices = np.unique(edges)
            pinned = np.flatnonzero(np.isin(vertices, list(fixed)))
            pins = {int(i): np.zeros(network.dimension) for i in pinned}
            index = np.searchsorted(vertices, edges)
            part = Network(index, network.offsets[taut], network.cell, pins=pins, n_vertices=len(vertices))
    except NetworkError:
        return None
    row = np.full(network.n_vertices, -1)
    row[network.free] = np.arange(len(network.free))
    saddle = path.manifold.saddle if part is network else Saddle(part)
    return TautPart(part, saddle, taut, vertices, row[vertices[part.free]], len(components) > 1)


def unknown_configuration(network: Network) -> CriticalConfiguration:
    """A configuration of NaN, in place of one that was not found."""
    shape = (network.n_edges, network.dimension)
    coordinates = np.full((network.n_vertices, network.dimension), np.nan)
    return CriticalConfiguration(network, np.full(network.n_edges, np.nan), coordinates, np.full(shape, np.nan))


ONSET_ROUNDS = 16  # attempts to separate taut from slack edges; standard networks need one, diluted lattices up to four
# σ below which the weakest edges are left out after Newton's method failed once, in units of ⟨σ⟩, and the factor by
# which it grows.
WEAK_STRESS, WEAK_GROWTH = 1e-5, 3.0
NO_STRESS = 1e-9  # σ of an edge without tension, in units of ⟨|σ|⟩: rounding of a stress of order one
# Tolerances of programs that distinguish slack edges from weakly stressed ones: nearly always, and always in tests.
EXACT_CONE = (1e-12, 1e-13)
DAMPING = 1e-3  # compliance of taut edges with several self-stresses, relative to their stress, far from the solution
SHORTENING_STEPS = 20  # least motions that shorten slack edges; chains of equal edges need one to four
VIOLATED = 1e-8  # excess of |L|/ℓ over 1 of a slack edge that becomes a candidate; errors of the program are smaller


def polish_taut(path: Boundary, lengths: Array, start: OnsetState) -> OnsetState:
    """The onset on the taut edges, to rounding, from a solution of the cone program with a guess of those edges.

    An active set, corrected between attempts of Newton's method.  A set is right where the method converges on it with
    σ > 0 and no other edge is longer than ℓ.  The program tells taut from slack edges to about the root of its
    tolerance.  The error is infinite where no attempt succeeds.
    """
    network, state, best, weak_below, least = path.network, start, start, WEAK_STRESS, np.inf
    released, steps = np.zeros(network.n_edges, bool), 0
    for _ in range(ONSET_ROUNDS):
        # 1. Without edges that end at a vertex without another one, which cannot carry tension
        candidate = without_hanging(network, state.taut)
        if not candidate.any():
            break
        # 2. Newton's method; if it fails, once more from the end of a damped attempt
        begin = replace(state, taut=candidate)
        end = newton_taut(path, lengths, begin)
        if end is not None and not end.error < FITTED:
            damped = newton_taut(path, lengths, begin, damping=DAMPING)
            end = damped and newton_taut(path, lengths, damped)
        steps = steps if end is None else end.steps
        if end is None or not end.error < FITTED:
            # 3. It failed: without the weakest edges, σ < w ⟨σ⟩ in the program; w grows from attempt to attempt
            mean = float(start.sigma[candidate].mean())
            weak = candidate & (start.sigma < weak_below * mean)
            weak_below *= WEAK_GROWTH
            state = replace(start, taut=candidate & ~weak, steps=steps)
            continue
        # 4. It converged: release edges with σ ≤ 0 and add those with |L| > ℓ, each at most once
        unstressed = candidate & ~stressed(end)
        released |= unstressed
        longer = _longer(path, lengths, end)
        if longer.any():
            end = settled(path, lengths, end)
            longer &= _longer(path, lengths, end) & ~released
        if not unstressed.any() and longer.sum() < least:
            best, least = end, longer.sum()
        if not (unstressed.any() or longer.any()):
            break
        # An edge that exceeds its rest length again after it was added carries no force.
        released |= longer & without_hanging(network, (candidate & ~unstressed) | longer)
        sigma = np.where(longer, WEAK_STRESS * end.sigma[candidate].mean(), np.where(unstressed, 0.0, end.sigma))
        state = replace(end, taut=(candidate & ~unstressed) | longer, sigma=sigma)
    return replace(best, steps=steps)


def stressed(state: OnsetState) -> Mask:
    """Taut edges with more than the rounding of a stress, (N_b,)."""
    return state.taut & ~(state.sigma <= NO_STRESS * state.sigma[state.taut].mean())


def _longer(path: Boundary, lengths: Array, state: OnsetState) -> Mask:
    """Slack edges that are longer than ℓ."""
    return ~state.taut & (state.ratios(path, lengths) > 1 + VIOLATED)


def resolved(path: Boundary, lengths: Array, state: OnsetState) -> bool:
    """Whether Newton's method converged to a state without longer slack edges."""
    return state.error < FITTED and not _longer(path, lengths, state).any()


def settled(path: Boundary, lengths: Array, state: OnsetState) -> OnsetState:
    """The state with coordinates of the vertices off the taut edges that shorten the longest slack edge, |L|/ℓ > 1.

    They are those of a program that was less accurate than the taut part.
    """
    longest = float(state.ratios(path, lengths)[~state.taut].max(initial=0.0))
    if longest <= 1 or not np.isfinite(state.error):
        return state
    L = state.bond_vectors(path)
    return replace(state, coordinates=placed(path.network, state.taut, lengths, L, state.coordinates, EXACT_CONE[0]))


def placed(network: Network, taut: Mask, lengths: Array, L: Array, x: Array, tolerance: float) -> Array:
    """Coordinates (n_free, d) whose vertices off the taut edges are at min max |L|/ℓ of the edges that meet them.

    L, x  bond vectors (N_b, d) and coordinates (n_free, d), which are kept where no edge becomes shorter
    """
    held = np.zeros(network.n_vertices, bool)
    held[network.edges[taut]] = True
    columns = ~held[network.free]
    moving = sp.csr_array(network.free_incidence[:, columns])
    edges = np.diff(moving.indptr) > 0
    if not edges.any():
        return x
    g, ratio = sp.csr_array(moving[edges]), float((np.linalg.norm(L[edges], axis=1) / lengths[edges]).max())
    fit = fit_lengths(g, L[edges] - g @ x[columns], lengths[edges], tolerance)
    if fit.ratio < ratio:
        x = x.copy()
        L = L[edges] + g @ (fit.coordinates - x[columns])
        x[columns] = fit.coordinates + _shortening(g, L, lengths[edges], fit.ratio)
    return x


def _shortening(g: sp.csr_array, L: Array, lengths: Array, ratio: float) -> Array:
    """Displacements (n, d) after which |L|/ℓ is at most halfway from a reachable ratio to 1, or at a ratio above 1.

    Programs reach their ratio to 1e-9 only, where edges form straight chains.  Each step is the least motion that to
    first order shortens all edges that are too long.
    """
    longest = max(ratio, 0.5 * (1 + ratio)) * lengths
    u = np.zeros((g.shape[1], L.shape[1]))
    for _ in range(SHORTENING_STEPS):
        here = L + g @ u
        size = np.linalg.norm(here, axis=1)
        long = size > longest
        if not long.any():
            break
        n, rows = here[long] / size[long, None], g[long]
        overlaps = (n @ n.T) * (rows @ rows.T).toarray()
        tension = np.linalg.lstsq(overlaps, (size - longest)[long], rcond=None)[0]
        u -= rows.T @ (tension[:, None] * n)
    return u


def without_hanging(network: Network, kept: Mask) -> Mask:
    """Remove edges that end at a free vertex with no other edge, repeatedly: they cannot carry tension."""
    kept = kept.copy()
    pinned = np.zeros(network.n_vertices, bool)
    pinned[list(network.pins)] = True
    while True:
        degree = np.bincount(network.edges[kept].ravel(), minlength=network.n_vertices)
        hanging = kept & ((degree == 1) & ~pinned)[network.edges].any(axis=1)
        if not hanging.any():
            return kept
        kept &= ~hanging
