"""Rest lengths → critical configuration, by a fixed-point iteration or the cone program, and Newton's method.

Given rest lengths ℓ, shrinking them uniformly (the same as expanding the box) leads the network to a critical
configuration, which is unique.

1. Where few edges or none may be slack, the iteration of `length_iteration` gives σ and t = ⟨|L|/ℓ⟩ roughly.
2. Newton's method on all edges solves |L| = (1 + s) t ℓ and gᵀ(σ ∘ L) = 0 for x, σ and s → 0 (`taut_edges`).  Positive
   tensions in balance at the right lengths prove that every edge is stressed.  Compressed edges are the first guess of
   the slack ones: Newton's method decides which edges are stressed (`taut_set`).  Where the others are not longer,
   |L| ≤ t ℓ, that is the solution of the cone program.
3. If that fails, cables of the lengths t ℓ/(1 + γ) at a small strain γ, relaxed by Newton's method, give another guess:
   those without tension.
4. Else, or if that fails, the cone program min t, |L| ≤ t ℓ, gives t, σ and the guess (`cone`), as in 2.
5. The exact balance of the stress of the last step is the configuration.

Status, note and accuracy are those of `critflow.lengths.lengths_end`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.critical.edge_lengths import COLLAPSED
from critflow.critical.manifold import Balance, CriticalConfiguration, CriticalManifold
from critflow.lengths.boundary import Expansion
from critflow.lengths.cone import fit_lengths
from critflow.lengths.length_iteration import NEAR, iterate_lengths
from critflow.lengths.lengths_end import FromLengths, configuration_of, not_separated, too_short
from critflow.lengths.taut_edges import FITTED, OnsetState, newton_taut
from critflow.lengths.taut_set import EXACT_CONE, polish_taut, resolved, stressed
from critflow.linalg.vectors import norms, power_of_two
from critflow.networks.checks import edge_values
from critflow.networks.network import Array, Network
from critflow.result import Solution
from critflow.springs.laws import Cable
from critflow.springs.newton import newton
from critflow.springs.state import SpringState

# Spread of log ℓ, and part of slack edges, above which a program takes less time than cables.
EVEN, FEW = 0.25, 0.02
# Strain of the cables: at larger ones fewer are slack, at smaller ones relaxations take more steps.  Forces left, in
# units of the strain, most steps, and the shift of their Hessian, which is singular where cables are slack.
CABLE_STRAIN, CABLE_TOLERANCE, CABLE_STEPS, CABLE_SHIFT = 0.005, 1e-3, 100, 1e-4
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


class Attempt(NamedTuple):
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
        if balance is not None:
            yield from _with_few_slack(boundary, lengths, balance, steps)
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


def _with_few_slack(boundary: Expansion, lengths: Array, balance: Balance, steps: int) -> Iterator[Attempt]:
    """The end from cables at a small strain, relaxed from a balance (3); none where many of them are slack."""
    network, L = boundary.network, balance.bond_vectors
    size = norms(L)
    # The logarithm weighted by tension: slack edges count less.
    ratio = float(np.exp(np.average(np.log(size / lengths), weights=balance.sigma * size)))
    alike, x = network.with_stiffness(1.0), network.all_coordinates(balance.coordinates)
    cables = SpringState(alike, ratio / (1 + CABLE_STRAIN) * lengths, x, L, Cable())
    end = newton(cables, CABLE_TOLERANCE * CABLE_STRAIN, CABLE_STEPS, boundary.manifold.hessian, CABLE_SHIFT)
    sigma = end.state.sigma
    if (sigma <= 0).mean() <= FEW:
        scale = np.sqrt(len(sigma) / (sigma @ sigma))
        start = OnsetState(0.0, np.zeros(0), end.state.coordinates[network.free], scale * sigma, sigma > 0)
        yield Attempt(polish_taut(boundary, ratio * lengths, start), ratio, steps + end.steps)


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
