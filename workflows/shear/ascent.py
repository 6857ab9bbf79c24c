"""The unconstrained ascent of the shear modulus, recorded at chosen steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from critflow import Solution, optimize, upper_bound
from critflow.critical.transition import pure_shear, transition_modulus

MEASURES = {
    "shear_modulus": "shear modulus at the transition, in units of k",
    "longest_edge": "length of the longest edge over the side of the box",
    "least_tension": "least tension over the largest magnitude of a tension",
    "compressed_edges": "number of edges under compression",
    "compressed_length": "total length of the edges under compression",
}


def measures(network, value, sigma, L):
    """The numbers of `MEASURES`, in their order."""
    length = np.linalg.norm(L, axis=1)
    tension, compressed = sigma * length, sigma < 0
    longest, least = length.max() / np.sqrt(network.volume), tension.min() / np.abs(tension).max()
    return value, longest, least, np.count_nonzero(compressed), length[compressed].sum()


@dataclass(frozen=True)
class Ascent:
    """An ascent from σ = 1: its solution, the bound, and the five measures of `MEASURES`.

    recorded  (5, n_steps) at the recorded steps, NaN beyond the end
    sigmas    (n_steps, N_b), stresses at the recorded steps up to the end
    reached   (5, n_fractions) at the first step beyond each part of the bound
    first     (n_fractions,), that step; −1 if it is not reached
    end       (5,) at the last step
    """

    solution: Solution
    bound: float
    recorded: np.ndarray
    sigmas: np.ndarray
    reached: np.ndarray
    first: np.ndarray
    end: np.ndarray


def ascend(manifold, method, steps, fractions, stop_at_last=False):
    """Climb from σ = 1 through `steps[-1]` steps, or with `stop_at_last` to the largest part of the bound."""
    network = manifold.network
    bound = upper_bound(manifold, transition_modulus(manifold.network, pure_shear(2)))
    place = {step: n for n, step in enumerate(steps)}
    recorded, reached = np.full((5, len(steps)), np.nan), np.full((5, len(fractions)), np.nan)
    first, end, sigmas = np.full(len(fractions), -1), np.full(5, np.nan), []

    def observe(step, value, sigma, L):
        end[:] = measures(network, value, sigma, L)
        newly = (first < 0) & (value >= np.array(fractions) * bound)
        reached[:, newly] = end[:, None]
        first[newly] = step
        if step in place:
            recorded[:, place[step]] = end
            sigmas.append(sigma.copy())
        return step >= steps[-1] or (stop_at_last and (first >= 0).all())

    solution = optimize(
        manifold, "shear_modulus", method, signs="any", max_steps=max(steps) + 1, observe=observe, throw=False
    )
    return Ascent(solution, bound, recorded, np.array(sigmas), reached, first, end)
