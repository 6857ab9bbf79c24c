"""Other methods and programs on the same strained springs, each with the tolerance that is usual for it.

Minimisers of the energy are to stop where no force exceeds 1e-10, in units of k times the mean length; matscipy's
conjugate gradients have their default tolerance.  The error of coordinates is the largest one over that of the affine
start, that of moduli the larger relative one.  An answer that is reported as converged with an error above one percent
is silently wrong.
"""

from dataclasses import replace

import numpy as np

from critflow import CritflowError, Status, equilibrium
from critflow.springs import SpringState

from .. import reference
from ..lammps import representable
from ..moduli import NEARLY_EXACT, by_matscipy
from ..reference import Unknown
from ..strain import MINIMISERS, apart, relaxer
from ..timing import TALLY, Answer, counting, installed
from .outcomes import Finding, Outcome, Violation

# Largest force, in units of k times the mean length; residual of matscipy; error of an answer that is right.
FORCE, RESIDUAL, RIGHT = 1e-10, 1e-5, 1e-2
RELAXERS = tuple(name for name in MINIMISERS if name != "L-BFGS")
RESPONSES = {"matscipy": None, "matscipy LU": NEARLY_EXACT}
PEERS = (*RELAXERS, *RESPONSES)


def peer_finding(name, problem, exact_near) -> Finding:
    """The finding on one peer; absent where its package is not installed.

    exact_near  (problem, state, coordinates) -> the exact equilibrium near a state
    """
    package = "matscipy" if name in RESPONSES else MINIMISERS[name][0]
    if not installed(package):
        return Finding(Outcome.absent)
    try:
        state = problem.strained
        if name in RESPONSES:
            state = equilibrium(state).value
        if name.startswith("LAMMPS") and not representable(state):
            return Finding(Outcome.refused)
        run = by_matscipy(state, RESPONSES[name]) if name in RESPONSES else relaxer(state, name)
        exact = exact_near(problem, state, state.coordinates)
        with counting():
            answer = run(RESIDUAL if name in RESPONSES else FORCE * state.stiffness_scale * state.length_scale)
            calls = sum(TALLY.values())
    except (CritflowError, Unknown):  # there is no such state, or no reference
        return Finding(Outcome.unknown)
    except Exception:  # other packages may raise any exception
        return Finding(Outcome.refused)
    error = (_moduli_error if name in RESPONSES else _error)(state, exact, answer)
    return replace(judged(answer.status, error), calls=calls)


def judged(status: Status, error: float) -> Finding:
    """Right, reported or silently wrong."""
    if status is not Status.ok:
        return Finding(Outcome.reported, error, status=status)
    if error <= RIGHT:
        return Finding(Outcome.tolerated, error, status=status)
    return Finding(Outcome.violation, error, status=status, violation=Violation.above_tolerance)


def _error(state: SpringState, exact, answer: Answer) -> float:
    x, side = exact.coordinates.astype(float), state.network.cell[0, 0]
    return apart(answer.values, x, side) / apart(state.coordinates, x, side)


def _moduli_error(state: SpringState, exact, answer: Answer) -> float:
    truth = reference.linear_response(state.network, exact.bond_vectors, state.rest_lengths)[:2].astype(float)
    return float(np.max(np.abs(answer.values - truth) / np.abs(truth)))
