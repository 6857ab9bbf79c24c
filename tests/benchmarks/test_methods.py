"""Benchmarks of springs: methods against references, with errors that fall with the level."""

import numpy as np
import pytest

from critflow import Status
from workflows.benchmarks import moduli as modulus_tasks
from workflows.benchmarks import references
from workflows.benchmarks import strain as strain_tasks
from workflows.benchmarks.springs import StrainedSprings
from workflows.benchmarks.strain import peer_error

TASKS = {task.word: task for m in (strain_tasks, modulus_tasks) for task in m.TASKS}


@pytest.fixture(scope="module")
def methods():
    return {word: {c.name: c for c in task.methods(40, 1, 1e-3)} for word, task in TASKS.items()}


# Errors of rounding, over the error of the start.
ROUNDING = 1e-12
# Levels until rounding takes over, and the error that the last of them must reach.
EXPECTED = {
    ("strain_step", "Newton"): (7, 1e-10),
    ("strain_step", "FIRE"): (6, 1e-3),
    ("strain_step", "L-BFGS"): (4, 1e-1),
    ("strain_step", "SciPy L-BFGS-B"): (4, 1e-1),
    ("strain_step", "SciPy trust-krylov"): (1, 1e-1),
    ("moduli", "linear response"): (1, 1e-12),
    ("moduli", "differences of stress"): (4, 1e-6),
    ("moduli", "differences of energy"): (4, 1e-6),
}


@pytest.mark.parametrize("word, name", EXPECTED)
def test_errors_fall_with_the_levels(methods, word, name):
    method = methods[word][name]
    n_levels, reached = EXPECTED[word, name]
    run = method.prepare()
    answers = [run(level) for level in method.levels[:n_levels]]
    # A rough answer may say that it knows no bound on its error.
    assert {answer.status for answer in answers} <= {Status.ok, Status.ill_conditioned}
    assert answers[-1].status is Status.ok
    errors = np.array([method.error(answer.values) for answer in answers])
    assert errors[-1] < reached
    # A step of Newton's method may serve several tolerances, and one to the exact equilibrium all of them.
    assert (errors[1:] <= np.maximum(1.01 * errors[:-1], ROUNDING)).all()
    assert n_levels == 1 or errors[-1] < max(3e-2 * errors[0], ROUNDING)


def test_answers_off_by_a_known_amount_have_that_error():
    springs = StrainedSprings.of(40, 1, 1e-3)
    network = springs.start.network
    exact = springs.start.coordinates.copy()
    exact[network.free] = springs.exact[0].x.high
    # A drift and a wrap are no errors, an odd displacement is.
    wrapped = np.mod(exact + np.array([0.3, -0.2]), network.cell[0, 0])
    assert peer_error(springs, wrapped) < 1e-11
    wrapped[[3, 5], 0] += np.array([1e-5, -1e-5])
    away = np.abs(springs.start.coordinates - exact).max()
    assert peer_error(springs, wrapped) == pytest.approx(1e-5 / away, rel=1e-9)
    (judge,) = {method.error.__code__: method.error for method in modulus_tasks.TASKS[0].methods(40, 1, 1e-3)}.values()
    bulk, shear = (modulus.high[0] for modulus in references.moduli(*springs.exact))
    assert judge((bulk, shear)) < 1.2e-16
    assert judge((bulk, shear * (1 + 1e-6))) == pytest.approx(1e-6, rel=1e-9)
