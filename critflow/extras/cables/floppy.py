"""The floppy part of a path of cables: no stress at strains below the onset of rigidity, at which the branch begins."""

from __future__ import annotations

import numpy as np

from critflow.critical.manifold import CriticalManifold
from critflow.extras.cables.boundary_path import BoundaryPath
from critflow.extras.cables.critical_strain import critical_strain
from critflow.extras.cables.search import NotFloppy, floppy_start
from critflow.networks.deformation import Deformation
from critflow.networks.network import Array
from critflow.paths.continuation import Course, Point, Progress, Step, begin, refused
from critflow.paths.predictor import Predictor
from critflow.paths.start import BALANCED_START, balanced, start_of
from critflow.paths.tangent import Tangent
from critflow.response.tensor import Elasticity, Errors
from critflow.result import Status
from critflow.springs.state import SpringState

_AT_ONSET = "this strain lies between the bounds on the onset of rigidity: choose another"


def unstressed_part(course: Course, springs: SpringState, gamma: Array) -> tuple[list[Progress], Point] | None:
    """The strains γ (n,) of a path up to its onset, and the point from which it goes on; None without a floppy part.

    Cables that are floppy at γ = 0 are so up to their onset (`critical_strain`), whatever coordinates are given.  A
    strain between the bounds on the onset is refused.
    """
    direction, cell = 1 if gamma[-1] > 0 else -1, course.cell(0.0, np.zeros(len(course.free_strains)))
    tense = springs.sigma.max() > BALANCED_START * springs.stiffness_scale
    if not springs.law.one_sided or (tense and balanced(springs)):
        return None
    rest, path = springs.rest_lengths, course.deformation
    solution = critical_strain(course.reference, rest, path, direction=direction, throw=False)
    onset = solution.value
    point = Point(cell, springs, Predictor.at(0.0, cell.point(springs)))
    lower = upper = np.inf
    if solution.status is not Status.floppy:
        if not all(onset.proven):
            return None
        lower, upper = sorted((abs(onset.lower), abs(onset.upper)))
        cables = start_of(onset.configuration, springs.law, taut_only=False)
        point = begin(course, cables.springs, cables.stress, course.cell(onset.strain, onset.free)).point
    reached = [_unstressed(course, point, springs, strain) for strain in gamma if abs(strain) < lower]
    if len(reached) < len(gamma) and abs(gamma[len(reached)]) <= upper:
        reached.append(refused(point, gamma[len(reached)], Status.undecided, _AT_ONSET))
    return reached, point


def _unstressed(course: Course, point: Point, springs: SpringState, strain: float) -> Progress:
    """Cables below their onset: a configuration with all |L| < ℓ, without energy, stress or stiffness."""
    here = course.reference.deformed(course.deformation.gradient(strain))
    still = Deformation.linear(np.zeros((here.dimension,) * 2)).freeing(*course.deformation.free)
    found = floppy_start(BoundaryPath(CriticalManifold(here), still), springs.rest_lengths)
    if isinstance(found, NotFloppy):
        return refused(point, strain, Status.undecided, _AT_ONSET)
    q, x = found
    cell = course.cell(strain, q)
    network = course.reference.deformed(cell.gradient)
    L, d = network.free_incidence @ x + network.boundary_vectors, network.dimension
    state = SpringState(network, springs.rest_lengths, network.all_coordinates(x), L, springs.law)
    moduli, zero = None, np.zeros((d * (d + 1) // 2,) * 2)
    if course.has_moduli:
        moduli = Elasticity(zero, zero, np.zeros((d, d)), network.volume, Errors(zero, 0.0, 0.0, 0.0))
    end = Step(
        *(cell, state, np.zeros((1, 0))),
        tangent=Tangent(np.zeros_like(x), np.zeros(len(q)), 0.0, 0.0),
        moduli=moduli,
    )
    return Progress(point, strain, end, ended=True)
