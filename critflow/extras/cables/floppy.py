"""The floppy part of a path of cables: no stress at strains below the onset of rigidity, at which the branch begins."""

from __future__ import annotations

import numpy as np

from critflow.deformation import Deformation
from critflow.extras.cables.boundary_path import BoundaryPath
from critflow.extras.cables.critical_strain import critical_strain
from critflow.extras.cables.onset_start import cables_at_onset
from critflow.extras.cables.search import NotFloppy, floppy_start
from critflow.linear_response import Elasticity, Errors
from critflow.manifold import CriticalManifold
from critflow.networks import Array
from critflow.paths import (
    BALANCED_START,
    Attempt,
    Interval,
    PathPoint,
    PathProblem,
    Predictor,
    Tangent,
    balanced,
    begin,
    refused,
)
from critflow.result import Status
from critflow.springs import SpringState

_AT_ONSET = "this strain lies between the bounds on the onset of rigidity: choose another"


def unstressed_part(
    problem: PathProblem, springs: SpringState, gamma: Array
) -> tuple[list[Interval], PathPoint] | None:
    """The strains γ (n,) of a path up to its onset, and the point from which it goes on; None without a floppy part.

    Cables that are floppy at γ = 0 are so up to their onset (`critical_strain`), whatever coordinates are given.  A
    strain between the bounds on the onset is refused.
    """
    tense = springs.sigma.max() > BALANCED_START * springs.stiffness_scale
    if tense and balanced(springs):
        return None
    unknowns, direction = problem.unknowns, 1 if gamma[-1] > 0 else -1
    path, rest, cell = problem.deformation, springs.rest_lengths, unknowns.cell(0.0)
    solution = critical_strain(problem.reference, rest, path, direction=direction, throw=False)
    onset = solution.value
    point = PathPoint(cell, springs, Predictor.at(0.0, unknowns.point(springs, cell)))
    lower = upper = np.inf
    if solution.status is not Status.floppy:
        if not all(onset.proven):
            return None
        lower, upper = sorted((abs(onset.lower), abs(onset.upper)))
        critical, law = onset.configuration, springs.law
        assert critical.rest_lengths is not None
        cables = cables_at_onset(critical, critical.rest_lengths, law)
        point = begin(problem, cables.springs, cables.stress, unknowns.cell(onset.strain, onset.free)).point
    reached = [_unstressed(problem, point, springs, strain) for strain in gamma if abs(strain) < lower]
    if len(reached) < len(gamma) and abs(gamma[len(reached)]) <= upper:
        reached.append(refused(point, gamma[len(reached)], Status.undecided, _AT_ONSET))
    return reached, point


def _unstressed(problem: PathProblem, point: PathPoint, springs: SpringState, strain: float) -> Interval:
    """Cables below their onset: a configuration with all |L| < ℓ, without energy, stress or stiffness."""
    here = problem.reference.deformed(problem.deformation.gradient(strain))
    still = Deformation.linear(np.zeros((here.dimension,) * 2)).freeing(*problem.deformation.free)
    found = floppy_start(BoundaryPath(CriticalManifold(here), still), springs.rest_lengths)
    if isinstance(found, NotFloppy):
        return refused(point, strain, Status.undecided, _AT_ONSET)
    q, x = found
    cell = problem.unknowns.cell(strain, q)
    network = problem.reference.deformed(cell.gradient)
    L, d = network.free_incidence @ x + network.boundary_vectors, network.dimension
    state = SpringState(network, springs.rest_lengths, network.all_coordinates(x), L, springs.law)
    moduli, zero = None, np.zeros((d * (d + 1) // 2,) * 2)
    if problem.has_moduli:
        moduli = Elasticity(zero, zero, np.zeros((d, d)), network.volume, Errors(zero, 0.0, 0.0, 0.0))
    end = Attempt(cell, state, tangent=Tangent(np.zeros_like(x), np.zeros(len(q)), 0.0, 0.0), moduli=moduli)
    return Interval(point, strain, end, ended=True)
