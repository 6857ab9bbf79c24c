"""How the search for given lengths ends: its status, the condition, and what is returned.

    status       condition                                                     value
    -----------  ------------------------------------------------------------  ------------------------------
    ok           Newton's method and the balance converge, σ > 0 everywhere    the configuration, and its error
    slack_edges  they converge on the stressed edges, and no other is longer   the configuration, σ = 0 on slack edges
    stalled      a length is below the rounding of coordinates                 NaN
    stalled      the only taut edges join pins                                 NaN
    stalled      the stressed edges are not separated from slack ones          NaN

The error of the coordinates is that of one more step of Newton's method, from residuals in extended precision.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.lengths.boundary import Expansion
from critflow.lengths.taut_edges import OnsetState, newton_taut, unknown_configuration
from critflow.linalg.vectors import power_of_two
from critflow.networks.network import Array, Network
from critflow.precision.double_double import divide, dot, extended, multiply, scaled, subtract, total, two_product
from critflow.result import Solution, Stats, Status

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
