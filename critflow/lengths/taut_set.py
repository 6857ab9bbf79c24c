"""The set of taut edges at an onset of rigidity: an active set, corrected between attempts of Newton's method.

A set is right where Newton's method converges on it with σ > 0 and no other edge is longer than ℓ.  From a cone
program, which tells taut from slack edges to about the root of its tolerance:

1. Leave out edges that end at a vertex without another one, since they cannot carry tension.
2. Newton's method; if it fails, once more from the end of a damped attempt.
3. If it failed, leave out the weakest edges, σ < w ⟨σ⟩ in the program; w grows from attempt to attempt.
4. If it converged, release edges with σ ≤ 0 and add those with |L| > ℓ, each at most once; end where there are none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from critflow.lengths.boundary import Boundary
from critflow.lengths.cone import fit_lengths
from critflow.lengths.taut_edges import FITTED, Mask, OnsetState, newton_taut
from critflow.networks.network import Array, Network

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

    The error is infinite where no attempt succeeds.
    """
    network, state, best, weak_below, least = path.network, start, start, WEAK_STRESS, np.inf
    released, steps = np.zeros(network.n_edges, bool), 0
    for _ in range(ONSET_ROUNDS):
        candidate = without_hanging(network, state.taut)
        if not candidate.any():
            break
        begin = replace(state, taut=candidate)
        end = newton_taut(path, lengths, begin)
        if end is not None and not end.error < FITTED:
            damped = newton_taut(path, lengths, begin, damping=DAMPING)
            end = damped and newton_taut(path, lengths, damped)
        steps = steps if end is None else end.steps
        if end is None or not end.error < FITTED:
            mean = float(start.sigma[candidate].mean())
            weak = candidate & (start.sigma < weak_below * mean)
            weak_below *= WEAK_GROWTH
            state = replace(start, taut=candidate & ~weak, steps=steps)
            continue
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
    pinned[list(network.pins or {})] = True
    while True:
        degree = np.bincount(network.edges[kept].ravel(), minlength=network.n_vertices)
        hanging = kept & ((degree == 1) & ~pinned)[network.edges].any(axis=1)
        if not hanging.any():
            return kept
        kept &= ~hanging
