"""Whether an equilibrium is a minimum of the energy or a saddle, by the inertia of the Hessian on both sides of zero.

Without compressed edges no eigenvalue is negative.  With them the Hessian H is compared with its convex part H_c, which
leaves out their softening: modes that are floppy in H_c and feel no compression resist nothing and decide nothing.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.vectors import quasi_random
from critflow.networks.network import Array
from critflow.result import Status
from critflow.springs.newton import Elastic

ROUNDING_COMPRESSION = 16  # a stress −σ below this number of its roundings may be rounding
HESSIAN_ROUNDING = 1e-14  # eigenvalues of the Hessian that rounding may change in sign, over the largest stiffness

SADDLE = "the equilibrium is a saddle of the energy: perturb it, or take smaller strain steps"
UNDECIDED = "rounding hides whether this equilibrium is a minimum or a saddle of the energy: perturb it"

# Inverse iterations towards the modes of the smallest eigenvalues, which are separated by many orders from the others.
_ITERATIONS = 3
# Number of floppy modes that are examined.
_MOST_MODES = 4


class Stressed(Elastic, Protocol):
    """What decides about a minimum: also the stress, stiffnesses and rates of edges."""

    @property
    def sigma(self) -> Array: ...
    @property
    def stress_rounding(self) -> Array: ...
    @property
    def edge_stiffness(self) -> Array: ...
    @property
    def largest_stiffness(self) -> float: ...
    def edge_rates(self, motion: Array) -> Array: ...


def compressed_edges(state: Stressed) -> Array:
    """|σ| (N_b,) of edges that are compressed by more than rounding, 0 for all others."""
    if state.sigma.min() >= 0:
        return np.zeros_like(state.sigma)
    return np.where(state.sigma < -ROUNDING_COMPRESSION * state.stress_rounding, -state.sigma, 0.0)


def minimum_factor(state: Stressed, pattern: FixedPattern) -> Factor | None:
    """A factor of H − δ, if that is positive definite: the state is then a minimum."""
    factor = state.factorize(pattern, -HESSIAN_ROUNDING * state.largest_stiffness)
    return factor if factor.sound and not factor.n_negative else None


def stability_of(state: Stressed, pattern: FixedPattern) -> tuple[Status, str]:
    """`ok` for a minimum, `unstable` for a saddle, `undecided` where rounding hides which, with the reason.

    Eigenvalues within rounding of zero count as zero if they are floppy modes, which no compressed edge softens.
    """
    softening = compressed_edges(state)
    if not softening.any() and (state.edge_stiffness >= 0).all():
        return Status.ok, ""
    delta = HESSIAN_ROUNDING * state.largest_stiffness
    below = state.factorize(pattern, -delta)
    near_zero = below.n_negative
    if below.sound and not near_zero:
        return Status.ok, ""
    above = state.factorize(pattern, delta)
    if above.sound and above.n_negative:
        return Status.unstable, SADDLE
    if near_zero > state.factorize_convex(pattern, -delta).n_negative:
        return Status.undecided, UNDECIDED
    modes = _soft_modes(state.factorize(pattern, delta), state.forces.size, min(near_zero, _MOST_MODES))
    softened = max(float(softening @ np.sum(state.edge_rates(mode) ** 2, axis=1)) for mode in modes)
    return (Status.undecided, UNDECIDED) if softened > state.stress_rounding.max() else (Status.ok, "")


def _soft_modes(factor: Factor, size: int, count: int) -> Array:
    """Orthonormal modes (count, size) near the smallest eigenvalues of a positive definite matrix, by iteration."""
    modes = quasi_random(size * count).reshape(count, size) - 0.5
    for _ in range(_ITERATIONS):
        solved = np.stack([factor.solve(mode) for mode in modes], axis=1)
        modes = np.ascontiguousarray(np.linalg.qr(solved)[0].T)
    return modes
