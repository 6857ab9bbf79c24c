"""Rest lengths → critical configuration, by a fixed-point iteration or the cone program, and Newton's method.

Given rest lengths ℓ, shrinking them uniformly (the same as expanding the box) leads the network to a critical
configuration, which is unique.

1. Where few edges or none may be slack, the iteration of `length_iteration` gives σ and t = ⟨|L|/ℓ⟩ roughly.
2. Newton's method on all edges solves |L| = (1 + s) t ℓ and gᵀ(σ ∘ L) = 0 for x, σ and s → 0 (`taut_edges`).  Positive
   tensions in balance at the right lengths prove that every edge is stressed.  Compressed edges are the first guess of
   the slack ones: Newton's method decides which edges are stressed (`taut_set`).  Where the others are not longer,
   |L| ≤ t ℓ, that is the solution of the cone program.
3. If that fails, further steps give another guess (`few_slack`).
4. Else, or if that fails, the cone program min t, |L| ≤ t ℓ, gives t, σ and the guess (`cone`), as in 3.
5. The exact balance of the stress of the last step is the configuration.

Status, note and accuracy are those of `critflow.lengths.lengths_end`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.critical.edge_lengths import COLLAPSED
from critflow.critical.manifold import Balance, CriticalConfiguration, CriticalManifold
from critflow.lengths.boundary import Expansion
from critflow.lengths.cone import fit_lengths
from critflow.lengths.length_iteration import NEAR, few_slack, iterate_lengths
from critflow.lengths.lengths_end import FromLengths, configuration_of, not_separated, too_short
from critflow.lengths.taut_edges import FITTED, OnsetState, newton_taut
from critflow.lengths.taut_set import EXACT_CONE, polish_taut, resolved, stressed
from critflow.linalg.vectors import power_of_two
from critflow.networks.checks import edge_values
from critflow.networks.network import Array, Network
from critflow.result import Solution

# Spread of log ℓ above which more edges of most networks are slack than `few_slack` serves.
EVEN = 0.25
# Exponents of the unit of lengths, so that one is the unit of lengths of the size of the network.
COARSE = 8


@running("critical_from_lengths")
def critical_from_lengths(
    network: Network | CriticalManifold, rest_lengths: ArrayLike, *, throw: bool = True
) -> FromLengths:
    """The critical configuration reached from rest lengths ℓ (N_b,) when the box expands.

    Lengths are proportional to ℓ on every stressed edge, exactly at the transition.  `slack_edges` lists the edges
    without tension; they have σ = 0 and set `Status.slack_edges`.  The configuration keeps its rest lengths at the
    transition, so that `strain_path` follows all edges from there.
    `stats.error_bound` (estimate) is that of every coordinate against the exact configuration with these ratios; where
    edges are slack, coordinates are not determined and it is NaN.  The bounds of the configuration itself are against
    the exact one of its stress.

    >>> import critflow as cf
    >>> import numpy as np
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> solution = cf.critical_from_lengths(network, np.ones(30))
    >>> solution.ok, bool(np.ptp(solution.value.lengths) < 1e-12)
    (True, True)
    """
    network = of_kind(Network, CriticalManifold, network=network)
    of_kind(np.ndarray, rest_lengths=rest_lengths)
    of_kind(bool, throw=throw)
    manifold = CriticalManifold.of(network)
    lengths = edge_values(rest_lengths, manifold.network.n_edges, "rest_lengths")
    # Only ratios of the lengths count, and the program has absolute tolerances: in a unit near that of the network.
    unit = power_of_two(float(lengths.mean()) / manifold.network.spacing, COARSE)
    lengths = lengths / unit
    boundary, attempt, steps = Expansion(manifold), None, 0
    if lengths.min() <= COLLAPSED * lengths.mean():
        solution = too_short(manifold.network, lengths)
    else:
        for attempt in _attempts(boundary, lengths):
            steps += attempt.steps
            balance = _balanced(boundary, lengths, attempt)
            if attempt.end is not None and balance is not None:
                solution = configuration_of(boundary, lengths, attempt.ratio, attempt.end, balance, steps)
                break
        else:
            last = None if attempt is None else attempt.end
            solution = not_separated(manifold.network, lengths, last, steps)
    solution = replace(solution, ratio=solution.ratio / unit)
    return solution.or_raise("these rest lengths have no all-tension critical configuration") if throw else solution


@dataclass(frozen=True, eq=False)
class Attempt:
    """The end of Newton's method for the lengths t ℓ, None where it fails; the ratio t, and the steps to its start."""

    end: OnsetState | None
    ratio: float
    steps: int


def _attempts(boundary: Expansion, lengths: Array) -> Iterator[Attempt]:
    """Ends of Newton's method from one start after another (1 to 4)."""
    network, manifold = boundary.network, boundary.manifold
    if float(np.std(np.log(lengths))) < EVEN:
        steps, balance = 0, None
        for steps, (balance, deviation) in enumerate(iterate_lengths(manifold, lengths), 1):
            if deviation < NEAR:
                yield from _near(boundary, lengths, balance, steps)
                steps = 0
                break
        guess = balance and few_slack(manifold, lengths, balance)
        if guess:
            balance, ratio, slack, more = guess
            sigma = np.where(slack, 0.0, balance.sigma)
            start = OnsetState(0.0, np.zeros(0), balance.coordinates, sigma, ~slack)
            yield Attempt(polish_taut(boundary, ratio * lengths, start), ratio, steps + more)
    for tolerance in EXACT_CONE:
        cone = fit_lengths(network.free_incidence, network.boundary_vectors, lengths, tolerance)
        if not cone.solved:
            return
        start = OnsetState(0.0, np.zeros(0), cone.coordinates, cone.sigma, cone.stressed)
        yield Attempt(polish_taut(boundary, cone.ratio * lengths, start), cone.ratio, cone.steps)


def _near(boundary: Expansion, lengths: Array, balance: Balance, steps: int) -> Iterator[Attempt]:
    """Ends from a balance near these lengths (2): with all edges, and without those that are compressed there."""
    ratio = float((np.linalg.norm(balance.bond_vectors, axis=1) / lengths).mean())
    taut = np.ones(len(lengths), bool)
    end = newton_taut(boundary, ratio * lengths, OnsetState(0.0, np.zeros(0), balance.coordinates, balance.sigma, taut))
    yield Attempt(end, ratio, steps)
    if end is not None and end.error < FITTED:
        end = replace(end, taut=stressed(end), sigma=np.maximum(end.sigma, 0.0))
        yield Attempt(polish_taut(boundary, ratio * lengths, end), ratio, 0)


def _balanced(boundary: Expansion, lengths: Array, attempt: Attempt) -> Solution[CriticalConfiguration] | None:
    """The configuration in exact balance under the stress of the taut edges (5); None where it is no solution.

    Newton's method reduces the errors of lengths and forces together.  Vertices off the taut edges keep their
    coordinates.
    """
    end, manifold = attempt.end, boundary.manifold
    # A slack edge that is longer than its rest length shows a wrong set of taut edges.
    if end is None or not resolved(boundary, attempt.ratio * lengths, end) or not (stressed(end) == end.taut).all():
        return None
    network, taut, part = manifold.network, end.taut, end.part
    if taut.all():
        balance = manifold.solve(end.sigma)
        return balance if balance.ok else None
    if part is None or part.several:
        return None
    # With the scale of the whole, so that its bounds are those of the stress as stored.
    balance = CriticalManifold(part.network).solve(end.sigma[taut], squares=network.n_edges)
    if not balance.ok:
        return None
    x = network.all_coordinates(end.coordinates / (1 + end.strain))
    # A part without pins is grounded at its first vertex, which lies at the origin there.
    x[part.vertices] = balance.value.coordinates + (0.0 if part.network.pins else x[part.vertices[0]])
    sigma, errors = np.zeros(network.n_edges), np.full(network.n_edges, np.nan)
    sigma[taut] = balance.value.sigma
    x = x if network.pins else x - x[0]
    L = network.bond_vectors(x)
    # Short edges would lose digits in the rounding of the coordinates.
    L[taut], errors[taut] = balance.value.bond_vectors, balance.value.bond_errors
    return replace(balance, value=CriticalConfiguration(network, sigma, x, L, bond_errors=errors))
