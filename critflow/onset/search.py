"""Cone programs for the onset of rigidity: a floppy start, and the largest strain on linearised boundaries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from critflow.networks.network import Array
from critflow.onset.boundary_path import BoundaryPath
from critflow.onset.taut_edges import OnsetState
from critflow.onset.tolerances import ROUGH_CONE
from critflow.result import InputError, Status
from critflow.solvers.cone import Reach, farthest, fit_lengths, nearest

# Tolerance of the program that shows the start to be floppy, by coordinates with all |L| < ℓ: up to N_v = 10,000 these
# are accurate to 1e-3, and a second program is rarely needed.
FLOPPY_CONE = 1e-7
ONSET_CONE = 1e-10  # tolerance of the last program: tensions and slack are then known to about its root
NEARBY = 0.01  # step of the strain, relative to 1 + |s|, after which the next program is the last one
MOST_PROGRAMS = 24  # linear programs on one path; smooth paths need two to four
FLAT_STEPS = 5  # programs in a row that end beyond a flat cell, after which the path counts as floppy to its end
FLAT = 1e-9  # relative distance from a flat cell, det F = 0, that counts as flat
INSIDE = 0.9  # part of the distance to a limit that a step uses, to stay inside

Interior = tuple[Array, Array]
SIDES_MEET = "cables stay floppy until the free sides of the cell meet: fix a side"


@dataclass(frozen=True, eq=False)
class Search:
    """The state of the last program, or None with the reason; programs and their interior-point iterations."""

    state: OnsetState | None
    status: Status = Status.ok
    note: str = ""
    programs: int = 0
    steps: int = 0


def floppy_start(path: BoundaryPath, lengths: Array) -> Interior | None:
    """Free components q and coordinates (n_free, d) at strain zero with all |L| < ℓ; None where they do not exist."""
    network, q = path.network, np.zeros(path.n_free)
    g, b = network.free_incidence, network.boundary_vectors

    def floppy(x: Array, b: Array) -> bool:
        return bool((np.linalg.norm(g @ x + b, axis=1) < lengths).all())

    if network.positions is not None:
        x = network.positions if network.pins else network.positions - network.positions[0]
        if floppy(x[network.free], b):
            return q, x[network.free]
    for tolerance in (FLOPPY_CONE, ONSET_CONE):
        x = fit_lengths(g, b, lengths, tolerance).coordinates
        if floppy(x, b):
            return q, x
    if path.n_free:
        rates = np.einsum("mij,aj->mai", path.free_strains, b)
        fit = fit_lengths(g, b, lengths, ONSET_CONE, rates)
        if floppy(fit.coordinates, b + np.einsum("mai,m->ai", rates, fit.parameters)):
            return fit.parameters, fit.coordinates
    return None


def search_onset(path: BoundaryPath, lengths: Array) -> Search:
    """Programs at linearised boundaries, Newton's method for the strain; the last one is accurate."""
    s, q = 0.0, np.zeros(path.n_free)
    steps, flat, near = 0, 0, path.linear
    for program in range(1, MOST_PROGRAMS + 1):
        reach = _program(path, lengths, s, q, ONSET_CONE if near else ROUGH_CONE)
        steps += reach.steps
        if reach.outcome == "unbounded":
            note = "no strain makes an edge taut, because the edges do not span the cell: choose another deformation"
            return Search(None, Status.floppy, note, program, steps)
        if reach.outcome == "infeasible" or not np.isfinite(reach.parameters).all():
            if s == 0.0:
                return Search(None, Status.stalled, "the cone program did not converge", program, steps)
            s *= 0.5
            continue
        step, limit = float(reach.parameters[-1]), path.flat_strain(s, q)
        flat = flat + 1 if step >= (1 - FLAT) * limit else 0
        if flat and (path.linear or flat == FLAT_STEPS):
            return Search(None, Status.floppy, _flat_note(path, s + limit), program, steps)
        if path.linear or (near and not flat and abs(step) < NEARBY * (1 + s)):
            return _finished(path, lengths, s, q, reach, program, steps)
        before, s = s, _valid(path, s, max(s + min(step, INSIDE * limit), 0.0))
        near = abs(s - before) < NEARBY * (1 + s)
        if not path.has_free_sides:
            q = q + reach.parameters[:-1]
    note = f"no onset was found up to strain {path.direction * s:.3g}: follow the path in another direction"
    return Search(None, Status.floppy, note, MOST_PROGRAMS, steps)


def _program(path: BoundaryPath, lengths: Array, s: float, q: Array, tolerance: float) -> Reach:
    network = path.network
    b, offsets = network.boundary_vectors, path.boundary_vectors(path.gradient(s, q))
    rates = np.einsum("mij,aj->mai", path.rates(s, q), b)
    return farthest(network.free_incidence, offsets, rates, lengths, tolerance)


def _valid(path: BoundaryPath, s: float, trial: float) -> float:
    """The strain nearest to a trial, by halving the step from s, that preserves the orientation of the cell."""
    for _ in range(60):
        try:
            path.deformation.gradient(path.direction * trial)
        except InputError:
            trial = 0.5 * (s + trial)
        else:
            return trial
    return s


def _flat_note(path: BoundaryPath, strain: float) -> str:
    return (
        f"the network stays floppy until the cell is flat, at strain {path.direction * strain:.3g}: "
        "choose a deformation that extends it"
    )


def _finished(
    path: BoundaryPath, lengths: Array, s: float, q: Array, reach: Reach, programs: int, steps: int
) -> Search:
    """The state of the last program; where sides are free, with the cell changed as little as the strain permits."""
    strain, q_new, x = s + float(reach.parameters[-1]), q + reach.parameters[:-1], reach.coordinates
    if path.has_free_sides:
        b = path.boundary_vectors(path.gradient(s, q)) + (strain - s) * path.boundary_vectors(path.rates(s, q)[-1])
        rates = np.einsum("mij,aj->mai", path.rates(s, q)[:-1], path.network.boundary_vectors)
        least = nearest(path.network.free_incidence, b, rates, lengths * (1 + ROUGH_CONE), ROUGH_CONE)
        steps, programs = steps + least.steps, programs + 1
        if least.outcome == "solved":
            q_new = INSIDE * (q + least.parameters) + (1 - INSIDE) * q_new
            x = INSIDE * least.coordinates + (1 - INSIDE) * x
        if not np.linalg.det(path.gradient(strain, q_new)) > FLAT:
            return Search(None, Status.floppy, SIDES_MEET, programs, steps)
    # Taut edges are as long as their rest lengths.
    state = OnsetState(strain, q_new, x, np.where(reach.taut, reach.tensions / lengths, 0.0), reach.taut)
    return Search(state, programs=programs, steps=steps)
