"""The onset where every edge is taut, by the iteration for lengths in given ratios: no program, one solve a step.

Stresses determine a network on any boundary, L → F(s) L, so that the iteration of `critflow.lengths`
finds all lengths up to a factor; at each step the strain is that at which the mean of log(|L|/ℓ) vanishes.  Newton's
method on all edges confirms the onset.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from critflow.lengths import NEAR, iterate_lengths
from critflow.networks import Array
from critflow.numerics import dot, power_of_two
from critflow.result import InputError
from critflow.taut_edges import FITTED, OnsetState, newton_taut, stressed
from critflow_extras.cables.boundary_path import BoundaryPath

FLAT = 1e-9  # distance of the strain to that of a flat cell at which it ends too
MEAN, MEAN_STEPS = 1e-4, 20  # relative error of the strain of the mean, and Newton's steps; three or four are needed
FIRST_STRAIN, LAST_STRAIN = 0.01, 1e3  # strains at which the search for that of the mean begins and ends


class TautOnset(NamedTuple):
    """The end of the iteration, and the onset that Newton's method reaches from it."""

    start: OnsetState
    state: OnsetState


def all_taut_onset(path: BoundaryPath, lengths: Array) -> TautOnset | None:
    """The onset where every edge is taut; None where Newton's method rejects it, or components of the cell are free."""
    if path.n_free:
        return None
    strain, q = 0.0, np.zeros(0)

    def deformed(L: Array) -> Array:
        nonlocal strain
        strain = mean_strain(path, lengths, L, strain)
        return L @ path.gradient(strain, q).T if np.isfinite(strain) else np.full_like(L, np.nan)

    for balance, deviation in iterate_lengths(path.manifold, lengths, deformed):
        if deviation < NEAR:
            x = balance.coordinates @ path.gradient(strain, q).T
            start = OnsetState(strain, q, x, balance.sigma, np.ones(len(lengths), bool))
            state = newton_taut(path, lengths, start)
            confirmed = state and state.error < FITTED and state.strain > 0 and stressed(state).all()
            return TautOnset(start, state) if state and confirmed else None
    return None


def mean_strain(path: BoundaryPath, lengths: Array, L: Array, near: float) -> float:
    """The strain s > 0 at which the mean of log(|F(s) L|/ℓ) vanishes, from s = 0 or a strain near it; NaN without one.

    A strain beyond it is searched for in growing steps, and Newton's method returns from there.

    L  bond vectors at s = 0, (N_b, d)
    """
    # Logarithms have the same bits in all units of 2ⁿ.
    unit = power_of_two(float(lengths.mean()))
    q, L, target = np.zeros(0), L / unit, float(np.mean(np.log(lengths / unit)))

    def excess(s: float) -> tuple[float, float]:
        """The mean and its derivative by s."""
        deformed, rate = L @ path.gradient(s, q).T, L @ path.rates(s, q)[-1].T
        square = dot(deformed, deformed)
        with np.errstate(divide="ignore", invalid="ignore"):  # an edge without length
            slope = np.mean(dot(deformed, rate) / square)
            return float(0.5 * np.mean(np.log(square))) - target, float(slope)

    try:
        if not excess(0.0)[0] < 0:
            return np.nan
        s, step = near, 0.1 * near or FIRST_STRAIN
        while s < LAST_STRAIN and step > FLAT and excess(s)[0] < 0:
            s += min(step, 0.9 * path.flat_strain(s, q))
            step = min(2 * step, path.flat_strain(s, q))
        for _ in range(MEAN_STEPS):
            value, slope = excess(s)
            if not (np.isfinite(value) and slope > 0):
                return np.nan
            s -= value / slope
            if abs(value) < MEAN * slope * s:
                return s
    except InputError:  # a flat cell
        pass
    return np.nan
