"""The central path to an onset: separates tensions that are too weak for a cone program from slack edges.

Programs end with relative errors of about 1e-10, which hide stresses below 1e-5 of the mean, as those of straight
fibres whose crossings hardly deflect them.  The onset is the largest strain s with ½|L_α|² + h_α = ½ℓ_α², h ≥ 0, whose
multipliers are the stresses σ ≥ 0 in balance.  Newton's method on these equations and

    σ_α h_α = μ

for each edge, with refined factors, follows decreasing μ.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from critflow.networks import Array
from critflow.result import InputError
from critflow.taut_edges import OnsetState, taut_part
from critflow_extras.cables.boundary_path import BoundaryPath

CENTRAL_START = 1e-9  # σ h of an edge at the start of a central path, relative to ⟨σ⟩⟨ℓ²⟩: that where cone programs end
CENTRAL_END = 1e-17  # the same at its end: stresses above 1e-8 of the mean are separated from slack
CENTRAL_DECREASE = 0.1  # factor of the mean σ h in one step
CENTRAL_FITTED = 1e-13  # relative error of ½|L|² + h at which it ends
CENTRAL_STEPS = 30  # steps of Newton's method on it; ten to twenty are needed
TO_BOUNDARY = 0.95  # part of the step to a vanishing stress or slack


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
            _, L, (forces, elongation, borders, corner, sums) = part.equations(path, lengths, state)
            # At the end of the path steps remain until lengths are right.
            ended = mean < CENTRAL_END * unit
            if ended and float((np.abs(elongation - h) / square).max()) < CENTRAL_FITTED:
                break
            factor = part.saddle.factorize(state.sigma, L, compliance=h / state.sigma)
            target = (1.0 if ended else CENTRAL_DECREASE) * mean / state.sigma
            change = factor.solve_bordered(forces, elongation - target, borders, corner, sums)[:3]
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


def without_slack_stress(path: BoundaryPath, lengths: Array, state: OnsetState) -> OnsetState:
    """The state without the small stresses of its slack edges, with its error."""
    part = taut_part(path, state.taut)
    state = replace(state, sigma=np.where(state.taut, state.sigma, 0.0))
    return replace(state, error=np.inf if part is None else part.equations(path, lengths, state)[0])
