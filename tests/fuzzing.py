"""Random valid networks through functions: what every answer must satisfy.

Nothing but a `CritflowError` is raised, no warning is given, no number of an `ok` answer is NaN, and no call exceeds
its number of factorisations.  The tables of calls are in `test_fuzz.py`, and in the folders of the extras' tests.
"""

from __future__ import annotations

import dataclasses
import warnings
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from random_problems import a_problem, numbers
from scipy.sparse.linalg import LinearOperator

import critflow
from critflow import CritflowError, CriticalManifold, Hookean, Network, PowerLaw, Solution, WormLike
from critflow.sparse import FixedPattern

# Factorisations of one call on at most eight vertices; the largest number seen is a third of it.
BUDGET = 3000
# Draws of Hypothesis are near their simplest value, of which no network with a bound results.
randoms = st.randoms(use_true_random=True)
# The networks are made by draws, many of which are refused.
fuzzed = settings(suppress_health_check=list(HealthCheck), max_examples=max(settings.default.max_examples // 2, 1))


def critical_of(problem):
    return CriticalManifold(problem.network).solve(problem.sigma).or_raise("fuzz").value


def geometry(problem):
    """Network, coordinates and lengths of the critical configuration."""
    critical = critical_of(problem)
    return problem.network, critical.coordinates, critical.lengths


def springs(problem, random, strain=1e-3):
    """Springs of the critical lengths, a little out of balance."""
    network, x, lengths = geometry(problem)
    moved = x + 1e-3 * float(lengths.min()) * numbers(random, *x.shape)
    law = random.choice([Hookean(), PowerLaw(1.5 + random.randint(0, 3)), WormLike(0.5)])
    return critflow.spring_state(network.deformed((1 + strain) * np.eye(network.dimension)), lengths, moved, law)


def relaxed(problem, random):
    return critflow.equilibrium(springs(problem, random))


def strain_of(problem, random):
    return numbers(random, problem.network.dimension, problem.network.dimension)


def measured(problem):
    """What a path measures: no moduli without a cell."""
    return "energy" if problem.network.cell is None else "tensors"


def a_deformation(problem, random):
    return random.choice(["dilation", "simple_shear", "pure_shear", "uniaxial", strain_of(problem, random)])


def slack_of(problem, random):
    """A critical configuration with edges that carry nothing, if it is one."""
    lengths = geometry(problem)[2] * (1.0 + 0.5 * abs(numbers(random, len(problem.sigma))))
    return critflow.critical_from_lengths(problem.network, lengths, throw=False).value


def optimise(objective, **options):
    return lambda p, r: critflow.optimize(p.network, objective, max_steps=60, **options)


# Fields that are NaN where a quantity is unknown or does not apply, by the documentation.
MAY_BE_NAN = set(
    """
    error_bound condition residual bond_errors ratio uncertainty nearest_singular least_stiffness gap
    smallest_nonzero largest_zero objective_error bound error stress_error undetermined cuts weights after
    amplification chi_squared
    """.split()
)


def nan_fields(value, name="value", seen=()):
    """Names of numbers that are NaN in an answer, except those that may be."""
    if name in MAY_BE_NAN or id(value) in seen or "modulus" in name:
        return []
    if isinstance(value, Solution) and not value.ok:
        return []
    seen = (*seen, id(value))
    if isinstance(value, LinearOperator):
        return nan_fields(value.matmat(np.eye(value.shape[1])), name)
    if isinstance(value, float | np.ndarray | np.floating):
        array = np.asarray(value)
        return [name] if array.dtype.kind == "f" and np.isnan(array).any() else []
    if dataclasses.is_dataclass(value) and not isinstance(value, Network):
        return [found for f in dataclasses.fields(value) for found in nan_fields(getattr(value, f.name), f.name, seen)]
    if isinstance(value, tuple | list):
        return [found for part in value for found in nan_fields(part, name, seen)]
    return []


def complaint(result) -> str:
    """What is wrong with an answer, or nothing."""
    found = nan_fields(result)
    return f"NaN in {sorted(set(found))}" if found else ""


class BudgetExceeded(BaseException):
    """Not an error that a call could catch."""


@contextmanager
def budget(most):
    """Stop a call after a number of factorisations."""
    factorize, count = FixedPattern.factorize, 0

    def counted(*arguments, **options):
        nonlocal count
        count += 1
        if count > most:
            raise BudgetExceeded(f"more than {most} factorisations")
        return factorize(*arguments, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FixedPattern, "factorize", counted)
        yield


def answers_or_explains(calls):
    """The test that every call of a table, name -> (problem, random) -> answer, gives a sound answer or a sentence."""

    @pytest.mark.parametrize("name", calls)
    @fuzzed
    @given(random=randoms)
    def test(name, random):
        problem = a_problem(random)
        assume(problem is not None)
        with budget(BUDGET), warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                result = calls[name](problem, random)
            except CritflowError as error:
                assert 10 < len(str(error)) < 400 and "\n" not in str(error)
                return
        assert complaint(result) == ""

    return test
