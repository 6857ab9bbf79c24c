"""Rest lengths → critical configuration, by a fixed-point iteration or the cone program, and Newton's method.

Given rest lengths ℓ, shrinking them uniformly (the same as expanding the box) leads the network to a critical
configuration, which is unique.

1. Where few edges or none may be slack, a fixed-point iteration of the stresses gives σ and t = ⟨|L|/ℓ⟩ roughly.
2. Newton's method on all edges solves |L| = (1 + s) t ℓ and gᵀ(σ ∘ L) = 0 for x, σ and s → 0 (`taut_edges`).  Positive
   tensions in balance at the right lengths prove that every edge is stressed.  Compressed edges are the first guess of
   the slack ones: Newton's method decides which edges are stressed.  Where the others are not longer, |L| ≤ t ℓ, that
   is the solution of the cone program.
3. If that fails, cables of the lengths t ℓ/(1 + γ) at a small strain γ, relaxed by Newton's method, give another guess:
   those without tension.
4. Else, or if that fails, the cone program min t, |L| ≤ t ℓ, gives t, σ and the guess (`cones`), as in 2.
5. The exact balance of the stress of the last step is the configuration.

    status       condition                                                     value
    -----------  ------------------------------------------------------------  ------------------------------
    ok           Newton's method and the balance converge, σ > 0 everywhere    the configuration, and its error
    slack_edges  they converge on the stressed edges, and no other is longer   the configuration, σ = 0 on slack edges
    stalled      a length is below the rounding of coordinates                 NaN
    stalled      the only taut edges join pins                                 NaN
    stalled      several separate parts become taut at once                    NaN
    stalled      the stressed edges are not separated from slack ones          NaN

The error of the coordinates is that of one more step of Newton's method, from residuals in extended precision.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg.lapack import dgelss

from critflow.arguments import edge_values, of_kind
from critflow.calls import running
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
    Boundary,
    OnsetState,
    newton_taut,
    polish_taut,
    resolved,
    stressed,
    unknown_configuration,
)

# The iteration of stresses.
#
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

    A critical configuration has |L| ∝ ℓ if log σ = θ is a fixed point of θ → θ + f(θ), f = ω log(|L|/ℓ) without its
    mean: an edge that is too long receives more stress.  Each step is one factorisation of P(σ), without gradients.
    The iteration converges linearly, three steps a digit, if lengths in these ratios exist with σ > 0.  It also ends
    where an edge has no length, as one that hangs, or stresses become huge or vanish.

    lengths   ℓ up to a factor, (N_b,)
    deformed  bond vectors L (N_b, d) → F L: a network on a deformed boundary is in balance under the same stresses
    """
    n = manifold.network.n_edges
    theta, deviations = np.zeros(n), [np.inf] * PATIENCE
    thetas: list[Array] = []
    steps: list[Array] = []
    while True:
        # 1. Solve P(σ) x = −gᵀ(σ ∘ b) for the lengths of σ = exp θ.  Sums over n are the bits of means, which take
        # longer for small networks.
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
        balance.factor.release()  # its solver serves the next balance
        # 2. The c that minimises |f − Σ_j c_j Δf_j| over the differences of the last steps (Anderson, 1965).
        # 3. θ ← θ + f − Σ_j c_j (Δθ_j + Δf_j).
        f = STEP * stretch
        thetas, steps = [*thetas, theta][-REMEMBERED - 1 :], [*steps, f][-REMEMBERED - 1 :]
        theta = theta + f
        if len(steps) > 1:
            places, ahead = np.array(thetas), np.array(steps)
            changes = ahead[1:] - ahead[:-1]
            weights = dgelss(changes @ changes.T, changes @ f, cond=1e-14)[1]
            theta -= weights @ (places[1:] - places[:-1] + changes)


SOLVED = 1e-6  # relative residual of a Newton step that determines the error of its start
NEAR_END = 1e-4  # error of the state of a matrix up to which its step has two digits

NOT_SEPARATED = "the stressed edges were not separated from slack ones: narrow the spread of the rest lengths"
SEVERAL = "several separate parts become taut at once, so the ratio of their stresses is open: change some rest lengths"


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class FromLengths(Solution[CriticalConfiguration]):
    """The critical configuration of rest lengths ℓ.

    slack_edges  edges without tension
    ratio        |L|/ℓ of the stressed edges
    """

    slack_edges: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp))
    ratio: float = np.nan


def newton_error(manifold: CriticalManifold, lengths: Array, value: CriticalConfiguration, end: OnsetState) -> float:
    """Largest component of the difference from the coordinates in exact balance with lengths ∝ ℓ.

    Error bound (estimate): one more step of Newton's method with its last matrix, at (1 + s) x, from residuals in
    extended precision.  All edges are stressed.  NaN where the matrix is rough or the step is not determined.
    """
    network, geometry, stress = manifold.network, manifold.geometry, extended(value.sigma)
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
    manifold = CriticalManifold.of(network)
    of_kind(np.ndarray, rest_lengths=rest_lengths)
    of_kind(bool, throw=throw)
    lengths = edge_values(rest_lengths, manifold.network.n_edges, "rest_lengths")
    # Only ratios of the lengths count, and the program has absolute tolerances: in a unit near that of the network.
    unit = power_of_two(float(lengths.mean()) / manifold.network.spacing, COARSE)
    lengths = lengths / unit
    network, boundary, steps = manifold.network, Boundary(manifold), 0
    note, end, balance = NOT_SEPARATED, None, None
    if lengths.min() <= COLLAPSED * lengths.mean():
        note = f"the target length of edge {lengths.argmin()} is below the rounding of coordinates: lengthen it"
    else:
        for end, ratio, taken in _attempts(boundary, lengths):
            steps += taken
            balance = None if end is None else _balanced(boundary, ratio * lengths, end)
            if balance is not None:
                break
            if end and end.part and end.part.several and resolved(boundary, ratio * lengths, end):
                note = SEVERAL
    if end is not None and balance is not None:
        solution = _configuration(boundary, lengths, ratio, end, balance, steps)
    else:
        fixed = np.flatnonzero(~np.isin(network.edges, network.free).any(axis=1))
        # No stress changes the lengths of edges that join pins.
        if end is not None and len(fixed) and np.isin(np.flatnonzero(end.taut), fixed).all():
            longest = fixed[(np.linalg.norm(network.boundary_vectors[fixed], axis=1) / lengths[fixed]).argmax()]
            note = (
                f"edge {longest} joins two pins and is taut before all others: remove it, or lengthen its rest length"
            )
        solution = FromLengths(unknown_configuration(network), Status.stalled, Stats("conic", steps), note)
    solution = replace(solution, ratio=solution.ratio / unit)
    return solution.or_raise("these rest lengths have no all-tension critical configuration") if throw else solution


def _attempts(boundary: Boundary, lengths: Array) -> Iterator[tuple[OnsetState | None, float, int]]:
    """Ends of Newton's method for t ℓ, None where it fails; the ratio t, and the steps to its start."""
    network, manifold, taut = boundary.network, boundary.manifold, np.ones(len(lengths), bool)
    # 1. A balance under the stresses of the iteration
    steps, balance, near = 0, None, False
    if float(np.std(np.log(lengths))) < EVEN:
        for step in iterate_lengths(manifold, lengths):
            balance, near, steps = step[0], step[1] < NEAR, steps + 1
            if near:
                break

    # 2. Near these lengths all edges, and those that are not compressed there
    if balance is not None and near:
        ratio = float((np.linalg.norm(balance.bond_vectors, axis=1) / lengths).mean())
        start = OnsetState(0.0, np.zeros(0), balance.coordinates, balance.sigma, taut)
        end = newton_taut(boundary, ratio * lengths, start)
        yield end, ratio, steps
        steps = 0
        if end is not None and end.error < FITTED:
            end = replace(end, taut=stressed(end), sigma=np.maximum(end.sigma, 0.0))
            yield polish_taut(boundary, ratio * lengths, end), ratio, 0

    # 3. Cables at a small strain, where few of them are slack; slack edges count less in the mean of |L|/ℓ
    if balance is not None:
        L, size = balance.bond_vectors, norms(balance.bond_vectors)
        ratio = float(np.exp(np.average(np.log(size / lengths), weights=balance.sigma * size)))
        alike, x = network.with_stiffness(1.0), network.all_coordinates(balance.coordinates)
        cables = SpringState(alike, ratio / (1 + CABLE_STRAIN) * lengths, x, L, Cable(), backend=manifold.backend)
        relaxed, _ = newton(cables, CABLE_TOLERANCE * CABLE_STRAIN, CABLE_STEPS, CABLE_SHIFT)
        sigma = relaxed.value.sigma
        if (sigma <= 0).mean() <= FEW:
            scale = np.sqrt(len(sigma) / (sigma @ sigma))
            start = OnsetState(0.0, np.zeros(0), relaxed.value.coordinates[network.free], scale * sigma, sigma > 0)
            yield polish_taut(boundary, ratio * lengths, start), ratio, steps + relaxed.stats.steps

    # 4. The cone program
    for tolerance in EXACT_CONE:
        cone = fit_lengths(network.free_incidence, network.boundary_vectors, lengths, tolerance)
        if not cone.solved:
            return
        start = OnsetState(0.0, np.zeros(0), cone.coordinates, cone.sigma, cone.stressed)
        yield polish_taut(boundary, cone.ratio * lengths, start), cone.ratio, cone.steps


def _balanced(boundary: Boundary, lengths: Array, end: OnsetState) -> Solution[CriticalConfiguration] | None:
    """The configuration in exact balance under the stress of the taut edges (5); None where it is no solution.

    Newton's method reduces the errors of lengths and forces together.  Vertices off the taut edges keep their
    coordinates.
    """
    # A slack edge that is longer than its rest length shows a wrong set of taut edges.
    if not resolved(boundary, lengths, end) or not (stressed(end) == end.taut).all():
        return None
    network, taut, part = boundary.network, end.taut, end.part
    if taut.all():
        balance = boundary.manifold.solve(end.sigma)
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


def _configuration(
    boundary: Boundary,
    lengths: Array,
    ratio: float,
    end: OnsetState,
    balance: Solution[CriticalConfiguration],
    steps: int,
) -> FromLengths:
    """The configuration in balance at the end of Newton's method for t ℓ, t the ratio, after these steps."""
    network = boundary.network
    slack, status, note = np.flatnonzero(~end.taut), Status.ok, ""
    mean_ratio = float(end.ratios(boundary, lengths)[end.taut].mean()) / (1 + end.strain)
    rest = np.where(end.taut, balance.value.lengths, mean_ratio * lengths)
    value, error = replace(balance.value, rest_lengths=rest), np.nan
    if len(slack):
        status = Status.slack_edges
        note = f"{len(slack)} of {network.n_edges} edges are slack, edge {slack[0]} among them; narrow the lengths"
    else:
        error = 2 * newton_error(boundary.manifold, lengths, value, end)
        # An edge far shorter than the others turns in the last step, so that its error needs the matrix of the end.
        if np.isnan(error) and (again := newton_taut(boundary, ratio * lengths, end)) is not None:
            error = 2 * newton_error(boundary.manifold, lengths, value, again)
    stats = Stats("conic", steps, end.error, balance.stats.condition, error)
    return FromLengths(value, status, stats, note, slack_edges=slack, ratio=mean_ratio)
