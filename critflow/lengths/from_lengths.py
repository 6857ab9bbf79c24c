"""Rest lengths → critical configuration, by a fixed-point iteration or the cone program, and Newton's method.

Given rest lengths ℓ, shrinking them uniformly (the same as expanding the box) leads the network to a critical
configuration, which is unique.  The cone program lists the slack edges.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import checked
from critflow.critical.manifold import COLLAPSED, CriticalConfiguration, CriticalManifold
from critflow.lengths.boundary_path import BoundaryPath
from critflow.lengths.cone import fit_lengths
from critflow.lengths.length_iteration import NEAR, iterate_lengths
from critflow.lengths.taut_edges import OnsetState, newton_taut, unknown_configuration
from critflow.lengths.taut_set import EXACT_CONE, polish_taut, resolved, stressed
from critflow.linalg.saddle import Saddle
from critflow.networks.checks import edge_values
from critflow.networks.deformation import Deformation
from critflow.networks.network import Array, Network
from critflow.precision.double_double import divide, dot, extended, multiply, scaled, subtract, total, two_product
from critflow.precision.geometry import ExtendedGeometry
from critflow.result import Solution, Stats, Status

# Spread of log ℓ above which most networks of 1,000 vertices have slack edges (study `percolation`).
EVEN = 0.16
SOLVED = 1e-6  # relative residual of a Newton step that determines the error of its start


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class FromLengths(Solution[CriticalConfiguration]):
    """The critical configuration of rest lengths ℓ.

    slack_edges   edges without tension
    ratio         |L|/ℓ of the stressed edges
    polish_steps  steps of Newton's method after the cone program
    """

    slack_edges: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp))
    ratio: float = np.nan
    polish_steps: int = 0


@checked
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
    lengths = edge_values(rest_lengths, manifold.network.n_edges, "rest_lengths")
    solution = _configuration_of(manifold, lengths)
    return solution.or_raise("these rest lengths have no all-tension critical configuration") if throw else solution


def _configuration_of(manifold: CriticalManifold, lengths: Array) -> FromLengths:
    """The critical configuration by the iteration or the cone program, and Newton's method on the stressed edges.

    1. Where all edges may be stressed, the iteration of `length_iteration`; else, or if the next step fails from
       there, the program min t, |L| ≤ t ℓ.
    2. Newton's method for |L| = (1 + s) t ℓ on the stressed edges, s → 0, which also decides which are stressed.
       Positive tensions in balance at the right lengths prove that every edge is.
    3. The exact balance of the stress of the last step.
    """
    network, steps = manifold.network, 0
    nothing = FromLengths(unknown_configuration(network), Status.stalled, Stats("conic"))
    if lengths.min() <= COLLAPSED * lengths.mean():
        note = f"the target length of edge {lengths.argmin()} is below the rounding of coordinates: lengthen it"
        return replace(nothing, note=note)
    path = BoundaryPath(manifold, Deformation.linear(np.eye(network.dimension)))
    for end, ratio, n in _attempts(manifold, path, lengths):
        steps += n
        # A slack edge that is longer than its rest length shows a wrong set of taut edges.
        fits = end is not None and resolved(path, ratio * lengths, end)
        balanced = None
        if end is not None and fits and np.array_equal(stressed(end), end.taut):
            balanced = _balanced(manifold, path, end)
        if balanced is not None:
            break
    else:
        return replace(nothing, stats=Stats("conic", steps), note=_fixed_edge(network, lengths, end))
    assert end is not None
    slack, status, note = np.flatnonzero(~end.taut), Status.ok, ""
    ratio = float(end.ratios(path, lengths)[end.taut].mean()) / (1 + end.strain)
    if len(slack):
        status = Status.slack_edges
        note = f"{len(slack)} of {network.n_edges} edges are slack, edge {slack[0]} among them; narrow the lengths"
    value = replace(balanced.value, rest_lengths=np.where(end.taut, balanced.value.lengths, ratio * lengths))
    error = np.nan
    if not len(slack):
        error = 2 * newton_error(manifold.saddle, network, lengths, value.coordinates, value.sigma)
    return FromLengths(
        value=value,
        status=status,
        stats=Stats("conic", steps, end.error, balanced.stats.condition, error),
        note=note,
        slack_edges=slack,
        ratio=ratio,
        polish_steps=end.steps,
    )


def _fixed_edge(network: Network, lengths: Array, end: OnsetState | None) -> str:
    """The reason of a failure where the only taut edges join pins, so that no stress changes their lengths."""
    fixed = np.flatnonzero(~np.isin(network.edges, network.free).any(axis=1))
    if end is None or not len(fixed) or not np.isin(np.flatnonzero(end.taut), fixed).all():
        return ""
    longest = fixed[(np.linalg.norm(network.boundary_vectors[fixed], axis=1) / lengths[fixed]).argmax()]
    return f"edge {longest} joins two pins and is taut before all others: remove it, or lengthen its rest length"


def _attempts(
    manifold: CriticalManifold, path: BoundaryPath, lengths: Array
) -> Iterator[tuple[OnsetState | None, float, int]]:
    """Ends of Newton's method from one start after another, with the ratio t of their lengths and the steps so far."""
    network = manifold.network
    if float(np.std(np.log(lengths))) < EVEN:
        steps = 0
        for steps, (balance, deviation) in enumerate(iterate_lengths(manifold, lengths), 1):
            if deviation < NEAR:
                ratio = float((np.linalg.norm(balance.bond_vectors, axis=1) / lengths).mean())
                taut = np.ones(network.n_edges, bool)
                start = OnsetState(0.0, np.zeros(0), balance.coordinates, balance.sigma, taut)
                yield newton_taut(path, ratio * lengths, start), ratio, steps
                break
    for tolerance in EXACT_CONE:
        cone = fit_lengths(network.free_incidence, network.boundary_vectors, lengths, tolerance)
        if not cone.solved:
            return
        start = OnsetState(0.0, np.zeros(0), cone.coordinates, cone.sigma, cone.stressed)
        yield polish_taut(path, cone.ratio * lengths, start), cone.ratio, cone.steps


def _balanced(
    manifold: CriticalManifold, path: BoundaryPath, end: OnsetState
) -> Solution[CriticalConfiguration] | None:
    """The configuration in exact balance under the stress of the taut edges.

    Newton's method reduces the errors of lengths and forces together.  Vertices off the taut edges keep their
    coordinates.  None where the balance fails.
    """
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
    whole = CriticalConfiguration(network, sigma, x, network.bond_vectors(x))
    # Short edges would lose digits in the rounding of the coordinates.
    whole.bond_vectors[taut], errors[taut] = balance.value.bond_vectors, balance.value.bond_errors
    return replace(balance, value=replace(whole, bond_errors=errors))


def newton_error(saddle: Saddle, network: Network, lengths: Array, coordinates: Array, sigma: Array) -> float:
    """Largest component of the difference from the coordinates in exact balance with lengths ∝ ℓ.

    Error bound (estimate): one more step of Newton's method, from residuals in extended precision.  All edges are
    stressed.  NaN where the step is not determined.
    """
    geometry, stress = ExtendedGeometry(network), extended(sigma)
    L = geometry.bond_vectors(extended(coordinates[network.free]), network.boundary_vectors)
    twice_h, target = dot(L, L), two_product(lengths, lengths)
    # The equation of the lengths is consistent for one ratio only, which needs the same number of digits.
    ratio = divide(total(multiply(stress, twice_h)), total(multiply(stress, target)))
    left = 0.5 * subtract(multiply(ratio, target), twice_h).high
    force = geometry.divergence(scaled(stress, L)).high
    # The solver expects residuals of order one: divide by their own scale, that of rounding.
    size = float(max(np.abs(left).max(), np.abs(force).max()))
    if size == 0.0:
        return 0.0
    u, _, residual = saddle.factorize(sigma, L.high).solve(-force / size, left / size)
    return size * float(np.abs(u).max()) if residual < SOLVED else np.nan
