"""The floppy part of a path of cables: no stress at strains below the onset of rigidity, at which the branch begins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from critflow.deformation import Deformation
from critflow.linear_response import Elasticity, Errors
from critflow.manifold import CriticalManifold
from critflow.paths import BALANCED_START, Path, PathPoint, balanced
from critflow.result import Status
from critflow.springs import SpringState
from critflow_extras.cables.boundary_path import BoundaryPath
from critflow_extras.cables.critical_strain import critical_strain
from critflow_extras.cables.onset_start import cables_at_onset
from critflow_extras.cables.search import NotFloppy, floppy_start

_AT_ONSET = "this strain lies between the bounds on the onset of rigidity: choose another"


def unstressed_part(path: Path, springs: SpringState) -> list[PathPoint] | None:
    """The strains of a path up to its onset, and with that as its first point; None without a floppy part.

    Cables that are floppy at γ = 0 are so up to their onset (`critical_strain`), whatever coordinates are given.  A
    strain between the bounds on the onset is refused.
    """
    tense = springs.sigma.max() > BALANCED_START * springs.stiffness_scale
    if tense and balanced(springs):
        return None
    gamma = path.strains
    solution = critical_strain(
        path.network, springs.rest_lengths, path.deformation, direction=1 if gamma[-1] > 0 else -1, throw=False
    )
    onset, lower, upper = solution.value, np.inf, np.inf
    path.points = [path.point(0.0, springs)]
    if solution.status is not Status.floppy:
        if not all(onset.proven):
            return None
        lower, upper = sorted((abs(onset.lower), abs(onset.upper)))
        critical, law = onset.configuration, springs.law
        assert critical.rest_lengths is not None
        cables, path.stress, *_ = cables_at_onset(critical, critical.rest_lengths, law)
        path.points = [path.point(onset.strain, cables, onset.free)]
    reached = [_unstressed(path, springs, strain) for strain in gamma if abs(strain) < lower]
    if len(reached) < len(gamma) and abs(gamma[len(reached)]) <= upper:
        reached.append(replace(path.points[0].refused(Status.undecided, _AT_ONSET), strain=gamma[len(reached)]))
    return reached


def _unstressed(path: Path, springs: SpringState, strain: float) -> PathPoint:
    """Cables below their onset: a configuration with all |L| < ℓ, without energy, stress or stiffness."""
    here = path.network.deformed(path.deformation.gradient(strain))
    still = Deformation.linear(np.zeros((here.dimension,) * 2)).freeing(*path.deformation.free)
    interior = floppy_start(BoundaryPath(CriticalManifold(here), still), springs.rest_lengths)
    if isinstance(interior, NotFloppy):
        return replace(path.points[0].refused(Status.undecided, _AT_ONSET), strain=strain)
    q, x = interior
    network = path.network.deformed(path.gradient(strain, q))
    L, d = network.free_incidence @ x + network.boundary_vectors, network.dimension
    state = SpringState(network, springs.rest_lengths, network.all_coordinates(x), L, springs.law)
    moduli, zero = None, np.zeros((d * (d + 1) // 2,) * 2)
    if path.has_moduli:
        moduli = Elasticity(zero, zero, np.zeros((d, d)), network.volume, Errors(zero, 0.0, 0.0, 0.0), 0.0)
    return replace(path.point(strain, state, q), moduli=moduli, second=(0.0, 0.0))
