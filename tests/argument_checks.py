"""Wrong arguments to each function of a table: the machinery of `test_arguments.py` in both suites."""

from __future__ import annotations

import inspect
import itertools
import re
from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np
import pytest
from problems import square_octagon
from refusals import of_bounded_length
from sources import modules_of

import critflow
from critflow import CritflowError, CriticalManifold, calls, lattice, spring_state

NAMES = sorted(critflow.__all__)
"""The names at the top level of the scene."""

NETWORK = square_octagon()
MANIFOLD = CriticalManifold(NETWORK)
CRITICAL = MANIFOLD.configuration(np.ones(6))
HEXAGONS = lattice("honeycomb", 2, 2)

# Right arguments by the name of the parameter.
RIGHT = {
    "network": NETWORK,
    "manifold": MANIFOLD,
    "critical": CRITICAL,
    "coordinates": CRITICAL.coordinates,
    "sigma": np.ones(6),
    "signs": np.ones(6),
    "rest_lengths": CRITICAL.lengths,
    "strains": [0.001, 0.002],
    "start": CRITICAL,
    "strain": np.eye(2),
    "objective": "B_0",
    "state": spring_state(NETWORK, CRITICAL.lengths, CRITICAL.coordinates),
    "springs": spring_state(NETWORK, CRITICAL.lengths, CRITICAL.coordinates),
    "edges": NETWORK.edges,
    "offsets": NETWORK.offsets,
    "bond_vectors": CRITICAL.bond_vectors,
    "cell": NETWORK.cell,
    "n_points": 4,
    "distance": 0.1,
    "rng": np.random.default_rng(0),
    "points": np.random.default_rng(1).random((12, 2)),
    "dimension": 2,
    "n_vertices": 60,
    "n": 4,
    "deformation": "dilation",
}
# Values that are wrong for most parameters.
WRONG = {
    "a word": "soft",
    "nothing": None,
    "a ragged list": [[1.0, 2.0], [3.0]],
    "a solution": MANIFOLD.solve(np.ones(6)),
    "an object": object(),
    "a complex number": 1j,
    "no entries": [],
    "a negative number": -1,
    "not a number": float("nan"),
    "zero": 0,
    "a matrix": np.ones((2, 3)),
}


def called_by_the_scene() -> set[str]:
    """Public names of the extras that the scene imports, whose arguments its own functions check."""
    sources = "".join(path.read_text(encoding="utf-8") for path in modules_of("critflow").values())
    return set(re.findall(r'from_extras\("(\w+)"', sources)) - {"network_from"}


def wrong_arguments_raise(
    functions: Mapping[str, Callable],
    of_function: Mapping[str, dict],
    more: Mapping[str, Any] | None = None,
    slow: Collection[tuple[str, str, str]] = (),
):
    """The test that every wrong argument of every function of a table raises one sentence, or is accepted.

    of_function  right arguments by name, where a function gives the name of a parameter another meaning
    more         right arguments by the name of the parameter, besides `RIGHT`
    slow         function, parameter and wrong argument of calls that may take long
    """

    def arguments_of(name: str) -> dict[str, Any]:
        known = RIGHT | (more or {}) | of_function.get(name, {})
        variable = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD
        parameters = [p for p in inspect.signature(functions[name]).parameters.values() if p.kind not in variable]
        unknown = [p.name for p in parameters if p.default is p.empty and p.name not in known]
        assert not unknown, f"add right arguments {unknown} of {name}"
        return {p.name: known[p.name] if p.default is p.empty or p.name in known else p.default for p in parameters}

    @pytest.mark.parametrize("name", functions)
    def test(name):
        arguments = arguments_of(name)
        for key, wrong in itertools.product(arguments, WRONG):
            if (name, key, wrong) in slow:
                continue
            try:
                functions[name](**(arguments | {key: WRONG[wrong]}))
            except CritflowError as error:
                assert of_bounded_length(error)
            except Exception as error:
                raise AssertionError(f"{name}({key} = {wrong}) raised {type(error).__name__}: {error}") from error

    return test


class Computing(Exception):
    """Raised where a call begins to compute."""


def shows_its_name_and_sets_the_threads(functions: Mapping[str, Callable], quick: Collection[str]):
    """The test that every function of a table, but the quick ones, is one that `calls.running` wraps."""

    @pytest.mark.parametrize("name", [name for name in functions if name not in quick])
    def test(name, monkeypatch):
        names = []

        def controller():
            names.append("threads")
            raise Computing

        monkeypatch.setattr(calls, "_visible", lambda: True)
        monkeypatch.setattr(calls._LINE, "begin", names.append)
        monkeypatch.setattr(calls, "_controller", controller)
        with pytest.raises(Computing):
            functions[name]()
        assert names == [name, "threads"]

    return test
