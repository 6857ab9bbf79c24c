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

Status, note and accuracy are those of `critflow.lengths`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.lapack import dgelss

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.checks import edge_values
from critflow.cones import fit_lengths
from critflow.double_double import divide, dot, extended, multiply, scaled, subtract, total, two_product
from critflow.equilibria import newton
from critflow.manifold import COLLAPSED, Balance, CriticalConfiguration, CriticalManifold
from critflow.networks import Array, Network
from critflow.numerics import norms, power_of_two
from critflow.result import Solution, Stats, Status
from critflow.springs import Cable, SpringState
from critflow.taut_edges import (
    EXACT_CONE,
    FITTED,
    Expansion,
    OnsetState,
    newton_taut,
    polish_taut,
    resolved,
    stressed,
    unknown_configuration,
)

# Stresses for lengths in given ratios by a fixed-point iteration, where every edge is stressed.
#
# A critical configuration has lengths |L| ∝ ℓ if log σ = θ is a fixed point of θ → θ + f(θ), f = ω log(|L|/ℓ) without
# its mean: an edge that is too long receives more stress.  Each step is one factorisation of P(σ), without gradients:
#
# 1. Solve P(σ) x = −gᵀ(σ ∘ b) for the lengths of σ = exp θ.
# 2. Find the c that minimises |f − Σ_j c_j Δf_j| over the differences of the last steps (Anderson, 1965).
# 3. θ ← θ + f − Σ_j c_j (Δθ_j + Δf_j).
#
# The iteration converges linearly, three steps a digit, if lengths in these ratios exist with σ > 0; else f stays
# finite.

# A stress changes the length of its own edge by −N_v/N_b of its relative change on average: 2/3 with three edges a
# vertex.  The inverse is the best step without acceleration.
STEP = 1.5
REMEMBERED = 8  # differences in the acceleration; 15 and 30 save no step down to deviations of 1e-9
LARGEST = 50.0  # |log σ| at which it ends: stresses of networks without slack edges span a few decades
PATIENCE = 6  # steps within which the largest deviation halves; networks with slack edges need more
NEAR = 0.1  # largest deviation of log(|L|/ℓ) from which Newton's method converges, also where one edge is short


def iterate_lengths(
    manifold: CriticalManifold, lengths: Array, deformed: Callable[[Array], Array] | None = None
) -> Iterator[tuple[Balance, float]]:
    """Balances, Σσ² = N_b, with the largest |log(|L|/ℓ) − mean| of each, from σ = 1; ends where it no longer halves.

    It also ends where an edge has no length, as one that hangs, or stresses become huge or vanish.

    lengths   ℓ up to a factor, (N_b,)
    deformed  bond vectors L (N_b, d) → F L: a network on a deformed boundary is in balance under the same stresses
    """
    n = manifold.network.n_edges
    theta, deviations = np.zeros(n), [np.inf] * PATIENCE
    thetas: list[Array] = []
    steps: list[Array] = []
    while True:
        # Sums over n are the bits of means, which take longer for small networks.
        theta = theta - theta.sum() / n
        if not np.abs(theta).max() < LARGEST:
            return
        sigma = np.exp(theta)
        balance = manifold.balance(sigma * np.sqrt(n / (sigma**2).sum()))
        ratios = norms(deformed(balance.bond_vectors) if deformed else balance.bond_vectors) / lengths
        if not (np.isfinite(ratios).all() and ratios.all()):
            return
        stretch = np.log(ratios)
        stretch -= stretch.sum() / n
        deviations.append(float(np.abs(stretch).max()))
        if not deviations[-1] < 0.5 * deviations[-1 - PATIENCE]:
            return
        yield balance, deviations[-1]
        f = STEP * stretch
        thetas, steps = [*thetas, theta][-REMEMBERED - 1 :], [*steps, f][-REMEMBERED - 1 :]
        theta = theta + f
        if len(steps) > 1:
            places, ahead = np.array(thetas), np.array(steps)
            changes = ahead[1:] - ahead[:-1]
            weights = dgelss(changes @ changes.T, changes @ f, cond=1e-14)[1]
            theta -= weights @ (places[1:] - places[:-1] + changes)


# How the search for given lengths ends: its status, the condition, and what is returned.
#
#     status       condition                                                     value
#     -----------  ------------------------------------------------------------  ------------------------------
#     ok           Newton's method and the balance converge, σ > 0 everywhere    the configuration, and its error
#     slack_edges  they converge on the stressed edges, and no other is longer   the configuration, σ = 0 on slack edges
#     stalled      a length is below the rounding of coordinates                 NaN
#     stalled      the only taut edges join pins                                 NaN
#     stalled      the stressed edges are not separated from slack ones          NaN
#
# The error of the coordinates is that of one more step of Newton's method, from residuals in extended precision.

SOLVED = 1e-6  # relative residual of a Newton step that determines the error of its start
NEAR_END = 1e-4  # error of the state of a matrix up to which its step has two digits

NOT_SEPARATED = "the stressed edges were not separated from slack ones: narrow the spread of the rest lengths"


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class FromLengths(Solution[CriticalConfiguration]):
    """The critical configuration of rest lengths ℓ.

    slack_edges  edges without tension
    ratio        |L|/ℓ of the stressed edges
    """

    slack_edges: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp))
    ratio: float = np.nan


def configuration_of(
    boundary: Expansion,
    lengths: Array,
    ratio: float,
    end: OnsetState,
    balance: Solution[CriticalConfiguration],
    steps: int,
) -> FromLengths:
    """The configuration in balance at the end of Newton's method for the lengths t ℓ, t the ratio; steps before it."""
    network = boundary.network
    slack, status, note = np.flatnonzero(~end.taut), Status.ok, ""
    mean_ratio = float(end.ratios(boundary, lengths)[end.taut].mean()) / (1 + end.strain)
    if len(slack):
        status = Status.slack_edges
        note = f"{len(slack)} of {network.n_edges} edges are slack, edge {slack[0]} among them; narrow the lengths"

    rest = np.where(end.taut, balance.value.lengths, mean_ratio * lengths)
    value, error = replace(balance.value, rest_lengths=rest), np.nan
    if not len(slack):
        error = 2 * newton_error(boundary.manifold, lengths, value, end)
        # An edge far shorter than the others turns in the last step, so that its error needs the matrix of the end.
        if np.isnan(error) and (again := newton_taut(boundary, ratio * lengths, end)) is not None:
            error = 2 * newton_error(boundary.manifold, lengths, value, again)
    return FromLengths(
        value=value,
        status=status,
        stats=Stats("conic", steps, end.error, balance.stats.condition, error),
        note=note,
        slack_edges=slack,
        ratio=mean_ratio,
    )


def too_short(network: Network, lengths: Array) -> FromLengths:
    """The end for lengths of which one cannot be told from zero."""
    note = f"the target length of edge {lengths.argmin()} is below the rounding of coordinates: lengthen it"
    return FromLengths(unknown_configuration(network), Status.stalled, Stats("conic"), note)


def not_separated(network: Network, lengths: Array, end: OnsetState | None, steps: int) -> FromLengths:
    """The end where every attempt fails, with the last; no stress changes the lengths of edges that join pins."""
    note, fixed = NOT_SEPARATED, np.flatnonzero(~np.isin(network.edges, network.free).any(axis=1))
    if end is not None and len(fixed) and np.isin(np.flatnonzero(end.taut), fixed).all():
        longest = fixed[(np.linalg.norm(network.boundary_vectors[fixed], axis=1) / lengths[fixed]).argmax()]
        note = f"edge {longest} joins two pins and is taut before all others: remove it, or lengthen its rest length"
    return FromLengths(unknown_configuration(network), Status.stalled, Stats("conic", steps), note)


def newton_error(manifold: CriticalManifold, lengths: Array, value: CriticalConfiguration, end: OnsetState) -> float:
    """Largest component of the difference from the coordinates in exact balance with lengths ∝ ℓ.

    Error bound (estimate): one more step of Newton's method with its last matrix, at (1 + s) x, from residuals in
    extended precision.  All edges are stressed.  NaN where the matrix is rough or the step is not determined.
    """
    network, geometry, stress = manifold.network, manifold.refinement.geometry, extended(value.sigma)
    if end.factor is None or not end.factor_error < NEAR_END:
        return np.nan
    # Squares of lengths are compared with lengths, in a unit of their own.
    unit = power_of_two(network.spacing)
    x, b = value.coordinates[network.free] / unit, network.boundary_vectors
    lengths = lengths / power_of_two(lengths.mean())
    L = geometry.bond_vectors(extended(x), b / unit)
    twice_h, target = dot(L, L), two_product(lengths, lengths)
    # The equation of the lengths is consistent for one ratio only, which needs the same number of digits.
    ratio = divide(total(multiply(stress, twice_h)), total(multiply(stress, target)))
    left = 0.5 * subtract(multiply(ratio, target), twice_h).high
    force = geometry.divergence(scaled(stress, L)).high
    # The solver expects residuals of order one: divide by their own scale, that of rounding.
    size = float(max(np.abs(left).max(), np.abs(force).max()))
    if size == 0.0:
        return 0.0
    force *= np.linalg.norm(end.sigma) / np.linalg.norm(value.sigma) * unit / size
    left *= (1 + end.strain) * unit * unit / size
    u, _, residual = end.factor.solve(-force, left)
    return size * float(np.abs(u).max()) if residual < SOLVED else np.nan


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
    end, _ = newton(cables, CABLE_TOLERANCE * CABLE_STRAIN, CABLE_STEPS, boundary.manifold.hessian, CABLE_SHIFT)
    sigma = end.value.sigma
    if (sigma <= 0).mean() <= FEW:
        scale = np.sqrt(len(sigma) / (sigma @ sigma))
        start = OnsetState(0.0, np.zeros(0), end.value.coordinates[network.free], scale * sigma, sigma > 0)
        yield Attempt(polish_taut(boundary, ratio * lengths, start), ratio, steps + end.stats.steps)


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
