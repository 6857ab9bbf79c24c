"""The stressed part of a network: its balance at given lengths, and the stress that balances at given coordinates."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from critflow.critical.manifold import CriticalConfiguration, CriticalManifold, critical_configuration
from critflow.networks.network import Array, Network
from critflow.onset.proportional_lengths import polish
from critflow.onset.taut_edges import without_hanging
from critflow.onset.tolerances import FITTED, NO_STRESS, WEAK_STRESS
from critflow.result import NetworkError

Mask = NDArray[np.bool_]


class StressedPart(NamedTuple):
    """Stressed edges (N_b,), the configuration, its relative error of the lengths, condition number, Newton steps."""

    stressed: Mask
    value: CriticalConfiguration
    error: float
    condition: float
    steps: int


def polish_stressed(
    manifold: CriticalManifold, lengths: Array, guess: Mask, coordinates: Array, sigma: Array, rounds: int
) -> StressedPart:
    """The configuration with lengths ∝ ℓ on the stressed edges, from a solution of the cone program.

    guess   edges that appear stressed, (N_b,)
    rounds  attempts; after each, edges without stress are released, or the weakest ones where Newton's method fails

    The error is infinite where no attempt succeeds.
    """
    network, candidate, weak_below, steps = manifold.network, guess, WEAK_STRESS, 0
    for _ in range(rounds):
        candidate = without_hanging(network, candidate)
        fit = _fit(manifold, lengths, candidate, coordinates, sigma)
        steps += fit.steps
        if fit.value is not None:
            return StressedPart(candidate, fit.value, fit.error, fit.condition, steps)
        released = fit.without_stress
        if not released.any():
            released, weak_below = sigma[candidate] < weak_below * sigma.mean(), 10 * weak_below
        candidate = candidate.copy()
        candidate[np.flatnonzero(candidate)[released]] = False
        if not candidate.any():
            break
    return StressedPart(guess, unknown_configuration(network), np.inf, np.nan, steps)


class _Fit(NamedTuple):
    """One attempt: the configuration or None, the candidates found to be without stress, and its accuracy."""

    value: CriticalConfiguration | None
    without_stress: Mask
    error: float = np.inf
    condition: float = np.nan
    steps: int = 0


def _fit(manifold: CriticalManifold, lengths: Array, candidate: Mask, coordinates: Array, sigma: Array) -> _Fit:
    """Newton's method on the network of the candidate edges."""
    network, none = manifold.network, np.zeros(int(candidate.sum()), bool)
    try:
        if candidate.all():
            part, vertices = manifold, np.arange(network.n_vertices)
        else:
            cut, vertices = network.part(candidate)
            part = CriticalManifold(cut)
    except NetworkError:
        return _Fit(None, none)
    # A part without pins is grounded at its first vertex, which lies at the origin there.
    origin = 0.0 if part.network.pins else coordinates[vertices[0]]
    start = coordinates[vertices] - origin
    _, s, error, steps = polish(part.saddle, part.network, lengths[candidate], start, sigma[candidate])
    if not error < FITTED:
        return _Fit(None, none, steps=steps)
    without_stress = s <= NO_STRESS * s.mean()
    if without_stress.any():
        return _Fit(None, without_stress, steps=steps)
    # Newton's method reduces the errors of lengths and forces together; here the forces become exact.
    balanced = part.solve(s)
    if not balanced.ok:
        return _Fit(None, none, steps=steps)
    value = _with_slack(network, balanced.value, candidate, vertices, coordinates, origin)
    return _Fit(value, none, error, balanced.stats.condition, steps)


def unknown_configuration(network: Network) -> CriticalConfiguration:
    """A configuration of NaN, in place of one that was not found."""
    shape = (network.n_edges, network.dimension)
    coordinates = np.full((network.n_vertices, network.dimension), np.nan)
    return CriticalConfiguration(network, np.full(network.n_edges, np.nan), coordinates, np.full(shape, np.nan))


def _with_slack(
    network: Network,
    part: CriticalConfiguration,
    stressed: Mask,
    vertices: NDArray[np.int64],
    coordinates: Array,
    origin: Array | float,
) -> CriticalConfiguration:
    """The configuration of a network from that of its stressed part; the other vertices keep their coordinates."""
    if stressed.all():
        return part
    x, sigma, errors = coordinates.copy(), np.zeros(network.n_edges), np.full(network.n_edges, np.nan)
    x[vertices], sigma[stressed] = part.coordinates + origin, part.sigma
    x = x if network.pins else x - x[0]
    whole = critical_configuration(network, sigma, x)
    # Short edges would lose digits in the rounding of the coordinates.
    whole.bond_vectors[stressed], errors[stressed] = part.bond_vectors, part.bond_errors
    return replace(whole, bond_errors=errors)
