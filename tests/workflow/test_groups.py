"""Batches put together: every one handed out once, in tasks that are long enough and end together."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from critflow.workflow.groups import LEAST_SECONDS, TASK_SECONDS, Groups


def handed_out(sizes, case_seconds, workers):
    """The tasks as lists of batches, when every case takes that long."""
    batches = [[{"seed": seed, "part": part} for part in range(size)] for seed, size in enumerate(sizes)]
    groups, tasks = Groups(batches), []
    while task := groups.next(workers):
        tasks.append(task)
        cases = sum(map(len, task))
        groups.note(cases, cases * case_seconds)
    assert groups.cases_left == 0
    return batches, tasks


@given(st.lists(st.integers(1, 9), max_size=60), st.floats(0.0, 10.0), st.integers(0, 9))
def test_every_batch_is_handed_out_once_and_in_order(sizes, case_seconds, workers):
    batches, tasks = handed_out(sizes, case_seconds, workers)
    assert [batch for task in tasks for batch in task] == batches


@pytest.mark.parametrize("case_seconds", [1e-4, 1e-3, 1e-2])
def test_short_cases_make_tasks_of_the_right_length(case_seconds):
    _, tasks = handed_out([2] * 50_000, case_seconds, 2)
    seconds = [sum(map(len, task)) * case_seconds for task in tasks]
    assert seconds[0] == 2 * case_seconds  # a single batch, to learn how long one takes
    full = [s for s in seconds[1:] if s >= 1.0]
    assert max(seconds) <= TASK_SECONDS * 1.001
    assert sum(full) > 0.9 * sum(seconds) or sum(seconds) < 20
    assert min(seconds[1:-1]) > LEAST_SECONDS / 2
    assert seconds[-1] <= LEAST_SECONDS  # nothing long runs alone at the end


def test_long_batches_stay_alone():
    _, tasks = handed_out([7] * 20, 5.0, 4)
    assert all(len(task) == 1 for task in tasks)


def test_nothing_done_says_nothing_of_the_time():
    groups = Groups([[{"seed": 0}], [{"seed": 1}]])
    groups.note(0, 5.0)
    assert groups.case_seconds is None
