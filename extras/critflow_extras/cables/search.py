"""Cone programs for the onset of rigidity: a floppy start, and the largest strain on linearised boundaries.

The onset on a path F(s, q) is the largest s for which some q and coordinates x have |F b_α + (g x)_α| ≤ ℓ_α on every
edge.  Where F is linear in (s, q) that is one cone program; elsewhere Newton's method linearises F again and again:

1. Begin at s = 0, q = 0, where `floppy_start` has shown that coordinates with all |L| < ℓ exist.
2. Linearise at (s, q):  F ≈ F(s, q) + r ∂F/∂s + Σ_m p_m ∂F/∂q_m.
3. The program  max r  subject to  |F b + g x| ≤ ℓ  for the unknowns (r, p, x): roughly, or accurately where the last
   step was short.  On a linear path it is accurate and its answer is the onset.
4. Without a solution: any r is possible where no edge resists, and the path is floppy; if none is, s was too large and
   is halved.
5. Compare r with the distance r_0 to a flat cell, det F = 0.  A path on which several programs in a row end beyond it
   is floppy to its end.
6. If the program was accurate and |r| < 0.01 (1 + s), its answer is the start of Newton's method on the taut edges.
7. Otherwise s → s + min(r, 0.9 r_0), at which F must preserve the orientation of the cell, q → q + p, and back to 2.

Where normal components of the cell are free, q stays 0 up to the last program, since cables resist no compression and
leave q open; of all cells with the largest strain `_least_changed` then takes one of small q.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from critflow.cones import ConeSolution, fit_lengths
from critflow.deformation import Deformation
from critflow.lengths import iterate_lengths
from critflow.networks import Array
from critflow.numerics import norms
from critflow.result import InputError, Status
from critflow.taut_edges import OnsetState, polish_taut, settled
from critflow_extras.cables.boundary_path import BoundaryPath
from critflow_extras.cables.bounds import Forces, admissible
from critflow_extras.cables.onset_end import (
    AT_TRANSITION,
    FLAT_CELL,
    HIDDEN,
    NO_ONSET,
    NO_RESISTANCE,
    NOT_CONVERGED,
    RIGID,
    SIDES_MEET,
)
from critflow_extras.cables.programs import farthest, nearest

# Tolerance of the program that shows the start to be floppy, by coordinates with all |L| < ℓ: up to N_v = 10,000 these
# are accurate to 1e-3, and a second program is rarely needed.
FLOPPY_CONE = 1e-5
# From a program of this tolerance Newton's method, which is far cheaper, converges if every edge is stressed.
ROUGH_CONE = 1e-6
ONSET_CONE = 1e-10  # tolerance of the last program: tensions and slack are then known to about its root
NEARBY = 0.01  # step of the strain, relative to 1 + |s|, after which the next program is the last one
MOST_PROGRAMS = 24  # linear programs on one path; smooth paths need two to four
FREE = 1e-9  # part of the rates of a boundary that is left where displacements cancel them: rounding leaves 1e-13
FLAT_STEPS = 5  # programs in a row that end beyond a flat cell, after which the path counts as floppy to its end
FLAT = 1e-9  # relative distance from a flat cell, det F = 0, that counts as flat
INSIDE = 0.9  # part of the distance to a limit that a step uses, to stay inside
MOST_HALVINGS = 60  # of a step to a strain that preserves the orientation of the cell

# Relative changes of the rest lengths that are tried as limits of what is known of a network at its transition.
WITHIN = (1e-14, 1e-13, 1e-12, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7)

Interior = tuple[Array, Array]


class NotFloppy(NamedTuple):
    """The verdict on a network that no configuration shows to be floppy, `rigid` or `undecided`, and the reason."""

    status: Status
    note: str


@dataclass(frozen=True, eq=False)
class Search:
    """One state of the search: the boundary at which the next program is linearised, or its end.

    strain, free  s and q (m,)
    tolerance     of accurate programs
    accurate      whether the next program is solved accurately
    beyond_flat   programs in a row that ended beyond a flat cell
    programs      cone programs so far
    steps         their interior-point iterations
    ended         whether the search is over, with the state of the last program, or None for the reason of its status
    """

    strain: float
    free: Array
    tolerance: float
    accurate: bool
    beyond_flat: int = 0
    programs: int = 0
    steps: int = 0
    ended: bool = False
    state: OnsetState | None = None
    status: Status = Status.ok
    note: str = ""

    def without_onset(self, status: Status, note: str) -> Search:
        """The end of a search that found no onset."""
        return replace(self, ended=True, status=status, note=note)


def floppy_start(path: BoundaryPath, lengths: Array) -> Interior | NotFloppy:
    """Free components q and coordinates (n_free, d) at strain zero with all |L| < ℓ, beyond rounding.

    Else `rigid` where balanced forces prove that there are none, or `undecided`: with the relative change of ℓ that
    would decide, where that is proved.
    """
    network, q = path.network, np.zeros(path.n_free)
    g, b = network.free_incidence, network.boundary_vectors
    if network.positions is not None:
        x = (network.positions if network.pins else network.positions - network.positions[0])[network.free]
        if admissible(path, lengths, 0.0, q, x):
            return q, x
    for balance, _ in iterate_lengths(path.manifold, lengths):
        longest = float((norms(balance.bond_vectors) / lengths).max())
        if longest < 1 and admissible(path, lengths, 0.0, q, balance.coordinates):
            return q, balance.coordinates
    for tolerance in (FLOPPY_CONE, ONSET_CONE):
        fit = fit_lengths(g, b, lengths, tolerance)
        if admissible(path, lengths, 0.0, q, fit.coordinates):
            return q, fit.coordinates
    if path.n_free:
        fit = fit_lengths(g, b, lengths, ONSET_CONE, np.einsum("mij,aj->mai", path.free_strains, b))
        q = fit.parameters
        if admissible(path, lengths, 0.0, q, fit.coordinates):
            return q, fit.coordinates
    state = OnsetState(0.0, q, fit.coordinates, fit.sigma, fit.stressed)
    if Forces(path, lengths, state).excess(0.0) > 0:
        return NotFloppy(Status.rigid, RIGID)
    return _at_least_ratio(path, lengths, replace(state, sigma=np.where(fit.stressed, fit.sigma, 0.0)), fit.ratio)


def _at_least_ratio(path: BoundaryPath, lengths: Array, state: OnsetState, ratio: float) -> Interior | NotFloppy:
    """Decide floppy or rigid from t = min max |L|/ℓ, computed to rounding as the onset of t ℓ on F = 1 + s."""
    expansion = Deformation.linear(np.eye(path.network.dimension)).freeing(*path.deformation.free)
    scaling = BoundaryPath(path.manifold, expansion)
    end = settled(scaling, ratio * lengths, polish_taut(scaling, ratio * lengths, state))
    there = replace(end, strain=0.0, coordinates=end.coordinates / (1 + end.strain))
    if admissible(path, lengths, 0.0, there.free, there.coordinates):
        return there.free, there.coordinates
    if Forces(path, lengths, there).excess(0.0) > 0:
        return NotFloppy(Status.rigid, RIGID)
    for change in WITHIN:
        floppy = admissible(path, (1 + change) * lengths, 0.0, there.free, there.coordinates)
        if floppy and Forces(path, (1 - change) * lengths, there).excess(0.0) > 0:
            return NotFloppy(Status.undecided, AT_TRANSITION.format(change))
    return NotFloppy(Status.undecided, HIDDEN)


def search_onset(path: BoundaryPath, lengths: Array, tolerance: float = ONSET_CONE) -> Search:
    """The onset of a network that is floppy at s = 0, to the tolerance of the last cone program."""
    search = Search(0.0, np.zeros(path.n_free), tolerance, accurate=path.linear)
    if path.linear and not path.n_free and _is_free(path):
        return search.without_onset(Status.floppy, NO_RESISTANCE)
    while not search.ended and search.programs < MOST_PROGRAMS:
        search = step(path, lengths, search)
    if search.ended:
        return search
    strain = path.direction * search.strain
    return search.without_onset(Status.floppy, NO_ONSET.format(strain))


def _is_free(path: BoundaryPath) -> bool:
    """Whether displacements u cancel the rates b' of the boundary, g u + b' = 0, so that no edge has to change.

    The program of the onset is then unbounded, which an interior-point method may not notice.
    """
    network = path.network
    rates = path.rates(0.0, np.zeros(0))[-1] @ network.boundary_vectors.T
    factor = path.manifold.prestress.factorize(np.ones(network.n_edges))
    left = rates.T - network.free_incidence @ factor.solve(network.divergence @ rates.T)
    return bool(np.abs(left).max() <= FREE * np.abs(rates).max())


def step(path: BoundaryPath, lengths: Array, search: Search) -> Search:
    """One program at the boundary of a search, and the boundary of the next one or the end (steps 2 to 7)."""
    s, q = search.strain, search.free
    reach = _program(path, lengths, search)
    search = replace(search, programs=search.programs + 1, steps=search.steps + reach.steps)
    if reach.outcome == "unbounded":
        return search.without_onset(Status.floppy, NO_RESISTANCE)
    if reach.outcome == "infeasible" or not np.isfinite(reach.parameters).all():
        if s == 0.0:
            return search.without_onset(Status.stalled, NOT_CONVERGED)
        return replace(search, strain=0.5 * s)
    r, flat = float(reach.parameters[-1]), path.flat_strain(s, q)
    beyond_flat = search.beyond_flat + 1 if r >= (1 - FLAT) * flat else 0
    if beyond_flat and (path.linear or beyond_flat == FLAT_STEPS):
        return search.without_onset(Status.floppy, FLAT_CELL.format(path.direction * (s + flat)))
    if path.linear or (search.accurate and not beyond_flat and abs(r) < NEARBY * (1 + s)):
        return _ended(path, lengths, search, reach)
    strain = _oriented(path, s, max(s + min(r, INSIDE * flat), 0.0))
    free = q if path.has_free_sides else q + reach.parameters[:-1]
    accurate = abs(strain - s) < NEARBY * (1 + strain)
    return replace(search, strain=strain, free=free, accurate=accurate, beyond_flat=beyond_flat)


def _program(path: BoundaryPath, lengths: Array, search: Search) -> ConeSolution:
    network, s, q = path.network, search.strain, search.free
    offsets = path.boundary_vectors(path.gradient(s, q))
    rates = np.einsum("mij,aj->mai", path.rates(s, q), network.boundary_vectors)
    tolerance = search.tolerance if search.accurate else ROUGH_CONE
    return farthest(network.free_incidence, offsets, rates, lengths, tolerance)


def _oriented(path: BoundaryPath, s: float, trial: float) -> float:
    """The strain nearest to a trial, by halving the step from s, that preserves the orientation of the cell."""
    for _ in range(MOST_HALVINGS):
        try:
            path.deformation.gradient(path.direction * trial)
        except InputError:
            trial = 0.5 * (s + trial)
        else:
            return trial
    return s


def _ended(path: BoundaryPath, lengths: Array, search: Search, reach: ConeSolution) -> Search:
    """The end of a search at the answer of its last program."""
    strain = search.strain + float(reach.parameters[-1])
    q, x = search.free + reach.parameters[:-1], reach.coordinates
    if path.has_free_sides:
        search, q, x = _least_changed(path, lengths, search, strain, (q, x))
        if not np.linalg.det(path.gradient(strain, q)) > FLAT:
            return search.without_onset(Status.floppy, SIDES_MEET)
    # Taut edges are as long as their rest lengths.
    sigma = np.where(reach.stressed, reach.multipliers / lengths, 0.0)
    return replace(search, ended=True, state=OnsetState(strain, q, x, sigma, reach.stressed))


def _least_changed(
    path: BoundaryPath, lengths: Array, search: Search, strain: float, answer: Interior
) -> tuple[Search, Array, Array]:
    """Free components and coordinates with the cell changed as little as the strain permits, and a little inside."""
    s, q = search.strain, search.free
    b = path.boundary_vectors(path.gradient(s, q)) + (strain - s) * path.boundary_vectors(path.rates(s, q)[-1])
    rates = np.einsum("mij,aj->mai", path.rates(s, q)[:-1], path.network.boundary_vectors)
    least = nearest(path.network.free_incidence, b, rates, lengths * (1 + ROUGH_CONE), ROUGH_CONE)
    search = replace(search, steps=search.steps + least.steps, programs=search.programs + 1)
    if not least.solved:
        return search, *answer
    q, x = q + least.parameters, least.coordinates
    return search, INSIDE * q + (1 - INSIDE) * answer[0], INSIDE * x + (1 - INSIDE) * answer[1]
