"""The set of taut edges at an onset of rigidity: an active set, corrected between attempts of Newton's method.

A set is right where Newton's method converges on it with σ > 0 and no other edge is longer than ℓ.  From a cone
program, which tells taut from slack edges to about the root of its tolerance:

1. Leave out edges that end at a vertex without another one, since they cannot carry tension.
2. Newton's method; if it fails, once more from the end of a damped attempt.
3. If it failed, leave out the weakest edges, σ < w ⟨σ⟩ in the program; w grows from attempt to attempt.
4. If it converged, release edges with σ ≤ 0 and add those with |L| > ℓ, each at most once; end where there are none.

Programs end with relative errors of about 1e-10, which hide stresses below 1e-5 of the mean, as those of straight
fibres whose crossings hardly deflect them.  The central path separates them: the onset is the largest strain s with
½|L_α|² + h_α = ½ℓ_α², h ≥ 0, whose multipliers are the stresses σ ≥ 0 in balance, and Newton's method on σ_α h_α = μ,
with refined factors, follows decreasing μ (`follow_central_path`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from critflow.lengths.boundary_path import BoundaryPath
from critflow.lengths.cone import fit_lengths
from critflow.lengths.taut_edges import FITTED, Mask, OnsetState, newton_taut, taut_part
from critflow.networks.network import Array, Network
from critflow.result import InputError

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
CENTRAL_START = 1e-9  # σ h of an edge at the start of a central path, relative to ⟨σ⟩⟨ℓ²⟩: that where cone programs end
CENTRAL_END = 1e-17  # the same at its end: stresses above 1e-8 of the mean are separated from slack
CENTRAL_DECREASE = 0.1  # factor of the mean σ h in one step
CENTRAL_FITTED = 1e-13  # relative error of ½|L|² + h at which it ends
CENTRAL_STEPS = 30  # steps of Newton's method on it; ten to twenty are needed
TO_BOUNDARY = 0.95  # part of the step to a vanishing stress or slack


def polish_taut(path: BoundaryPath, lengths: Array, start: OnsetState) -> OnsetState:
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
        longer = _longer(path, lengths, end) & ~released
        if longer.any():
            end = settled(path, lengths, end)
            longer &= _longer(path, lengths, end)
        if not unstressed.any() and longer.sum() < least:
            best, least = end, longer.sum()
        if not (unstressed.any() or longer.any()):
            break
        # An edge that exceeds its rest length again after it was added carries no force.
        released |= longer
        sigma = np.where(longer, WEAK_STRESS * end.sigma[candidate].mean(), np.where(unstressed, 0.0, end.sigma))
        state = replace(end, taut=(candidate & ~unstressed) | longer, sigma=sigma)
    return replace(best, steps=steps)


def follow_central_path(path: BoundaryPath, lengths: Array, start: OnsetState) -> OnsetState | None:
    """The state at the end of the central path, σ > 0 on all edges, with those that are taut; None without an end."""
    everything = np.ones(path.network.n_edges, bool)
    part = taut_part(path, everything)
    if part is None or not start.taut.any():
        return None
    square = lengths**2
    unit = float(start.sigma[start.taut].mean() * square.mean())
    L = start.bond_vectors(path)
    h = np.maximum(0.5 * (square - np.einsum("ad,ad->a", L, L)), CENTRAL_START * square)
    state = replace(start, sigma=np.maximum(start.sigma, CENTRAL_START * unit / h), taut=everything)
    for _ in range(CENTRAL_STEPS):
        mean = float(np.mean(state.sigma * h))
        try:
            at = part.residuals(path, lengths, state)
            # At the end of the path steps remain until lengths are right.
            ended = mean < CENTRAL_END * unit
            if ended and float((np.abs(at.elongation - h) / square).max()) < CENTRAL_FITTED:
                break
            factor = part.saddle.factorize(state.sigma, at.L, compliance=h / state.sigma)
            target = (1.0 if ended else CENTRAL_DECREASE) * mean / state.sigma
            change = part.change(path, state, at, factor, at.elongation - target)
            h_change = target - h - h * change[1] / state.sigma
            fraction = min(_fraction(state.sigma, change[1]), _fraction(h, h_change))
            state, h = part.moved(path, state, change, fraction), h + fraction * h_change
        except (InputError, np.linalg.LinAlgError):
            return None
        if not (np.isfinite(state.strain) and np.isfinite(state.sigma).all()):
            return None
    return replace(state, taut=state.sigma / state.sigma.mean() > h / square.mean())


def _fraction(values: Array, change: Array) -> float:
    """The part of a change that leaves positive values positive, at most 1."""
    steepest = float((-change / values).max())
    return min(1.0, TO_BOUNDARY / steepest) if steepest > 0 else 1.0


def stressed(state: OnsetState) -> Mask:
    """Taut edges with more than the rounding of a stress, (N_b,)."""
    return state.taut & ~(state.sigma <= NO_STRESS * state.sigma[state.taut].mean())


def _longer(path: BoundaryPath, lengths: Array, state: OnsetState) -> Mask:
    """Slack edges that are longer than ℓ."""
    return ~state.taut & (state.ratios(path, lengths) > 1 + VIOLATED)


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
