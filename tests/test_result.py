"""Statuses, solutions and their typed subclasses."""

import json
from dataclasses import FrozenInstanceError, dataclass

import numpy as np
import pytest

import critflow
from critflow import CriticalManifold, Solution, SolveError, Status, lattice
from critflow.result import CritflowError, Record, Stats


@dataclass(frozen=True, kw_only=True, repr=False)
class Root(Solution[float]):
    """A solution with a typed field."""

    bracket: tuple[float, float]


def test_a_status_prints_its_name_and_is_stored_as_its_number():
    assert (str(Status.singular), f"{Status.singular}", f"{int(Status.singular)}") == ("singular", "singular", "4")
    assert json.dumps(Status.singular) == "4"
    assert np.array([Status.singular, Status.ok], np.int8).tolist() == [4, 0]


def test_stored_integers_never_change():
    assert {status.name: int(status) for status in Status} == {
        "ok": 0,
        "floppy": 1,
        "step_limit": 2,
        "stalled": 3,
        "singular": 4,
        "edge_collapse": 5,
        "slack_edges": 6,
        "unstable": 7,
        "failed": 8,
        "missing": 9,
        "ill_conditioned": 10,
        "undecided": 11,
        "rigid": 12,
        "infeasible": 13,
        "not_reached": 14,
        "out_of_range": 15,
        "compressed_edges": 16,
    }
    assert all(status.message for status in Status)


def test_a_good_solution_is_returned_with_its_type():
    root = Root(2.0, Status.ok, Stats("bisection", 3), bracket=(1.0, 3.0))
    assert root.ok and root
    assert root.or_raise("no root") is root
    assert root.or_raise("no root").bracket == (1.0, 3.0)
    with pytest.raises(FrozenInstanceError):
        root.bracket = (0.0, 1.0)  # type: ignore[misc]


@pytest.mark.parametrize("note", ["", "the bracket has no change of sign"])
def test_a_failed_solution_raises_its_reason(note):
    root = Root(2.0, Status.stalled, Stats("bisection"), note, bracket=(1.0, 3.0))
    assert not root.ok and not root
    assert root.reason == (note or Status.stalled.message)
    with pytest.raises(SolveError) as caught:
        root.or_raise("no root")
    assert str(caught.value) == f"no root: {root.reason}"
    assert caught.value.solution is root
    assert isinstance(caught.value, CritflowError)


def records(kind):
    """The dataclasses of the package that derive from a class."""
    for derived in kind.__subclasses__():
        if derived.__module__.startswith(("critflow.", "critflow_extras.")) and "__dataclass_params__" in vars(derived):
            yield derived
        yield from records(derived)


def test_no_record_replaces_its_representation():
    assert all(hasattr(critflow, name) for name in critflow.__all__)  # with all modules imported
    assert len(list(records(Record))) > 15
    assert [kind.__name__ for kind in records(Record) if kind.__dataclass_params__.repr] == []


def test_results_print_in_one_line():
    root = Root(2.0, Status.stalled, Stats("bisection"), "no change of sign", bracket=(1.0, 3.0))
    assert repr(root) == "Root(stalled, 2, bracket=(1, 3), note='no change of sign')"
    manifold = CriticalManifold(lattice("honeycomb", 4, 4))
    network = "Network(32 vertices, 48 edges, 2 dimensions, periodic, z = 3)"
    assert repr(manifold) == f"CriticalManifold({network})"
    text = repr(manifold.solve(np.ones(48)))
    assert text.startswith(f"ForceBalance(ok, CriticalConfiguration(network={network}, sigma=array(48), ")
    assert "\n" not in text and len(text) < 300
