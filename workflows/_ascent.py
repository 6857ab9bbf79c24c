"""The unconstrained ascent of the shear modulus, recorded on its way."""

from __future__ import annotations

import numpy as np

from critflow import StudyError, modulus_bound, optimize
from critflow.objectives import pure_shear

MEASURES = ("shear_modulus", "longest_edge", "least_tension", "compressed_edges", "compressed_length")


def measures(network, value, sigma, L):
    """The modulus, the longest edge and least tension in their units, and how much is compressed."""
    length = np.linalg.norm(L, axis=1)
    tension = sigma * length
    compressed = sigma < 0
    return (
        value,
        length.max() / np.sqrt(network.volume),
        tension.min() / np.abs(tension).max(),
        np.count_nonzero(compressed),
        length[compressed].sum(),
    )


def ascend(manifold, method, steps, fractions, stop_at_last=False):
    """Climb from σ = 1 through `steps[-1]` steps; what was measured at the steps, and where parts of the bound lie.

    Returns the solution, the bound, measures (5, n_steps), measures (5, n_fractions) at the first step that reached
    each part of the bound, those steps, and the stresses at the recorded steps.  With `stop_at_last` the largest part
    of the bound ends the ascent.
    """
    network = manifold.network
    bound = modulus_bound(manifold, pure_shear(2))
    place = {step: n for n, step in enumerate(steps)}
    along, reached = np.full((5, len(steps)), np.nan), np.full((5, len(fractions)), np.nan)
    first = np.full(len(fractions), -1)
    sigmas = []

    def observe(step, value, sigma, L):
        newly = (first < 0) & (value >= np.array(fractions) * bound)
        if step in place or newly.any():
            now = measures(network, value, sigma, L)
            reached[:, newly] = np.array(now)[:, None]
            first[newly] = step
            if step in place:
                along[:, place[step]] = now
                sigmas.append(sigma.copy())
        return step >= steps[-1] or (stop_at_last and (first >= 0).all())

    solution = optimize(
        manifold, "shear_modulus", method, signs="any", max_steps=max(steps) + 1, observe=observe, throw=False
    )
    return solution, bound, along, reached, first, np.array(sigmas)


def check_ascent(parameters):
    """Refuse settings that could only fail."""
    if parameters["method"] not in ("lbfgs", "fire", "newton"):
        raise StudyError(f"method={parameters['method']} must be lbfgs, fire (the paper's) or newton")
    if "fractions" in parameters and not all(0 < part < 1 for part in parameters["fractions"]):
        raise StudyError("fractions are parts of the bound: numbers between 0 and 1")
