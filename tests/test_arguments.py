"""Arguments of the wrong kind raise one sentence, in every public function and for every parameter."""

from __future__ import annotations

import inspect
import itertools
import tempfile
from pathlib import Path

import numpy as np
import pytest
from problems import square_octagon
from public import NAMES, checked_functions

import critflow
import critflow_extras as ce
from critflow import CritflowError, CriticalManifold, InputError, Network, calls, lattice, spring_state
from critflow.arguments import generator, of_kind

NETWORK = square_octagon()
MANIFOLD = CriticalManifold(NETWORK)
CRITICAL = MANIFOLD.configuration(np.ones(6))
HEXAGONS = lattice("honeycomb", 2, 2)

# Right arguments by the name of the parameter, and where a function gives a name another meaning.
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
    "kappa": 0.001,
    "objective": "B_0",
    "state": spring_state(NETWORK, CRITICAL.lengths, CRITICAL.coordinates),
    "springs": spring_state(NETWORK, CRITICAL.lengths, CRITICAL.coordinates),
    "targets": np.full(4, 5.0),
    "perimeters": np.full(4, 5.0),
    "moduli": [1.0, 2.0],
    "edges": NETWORK.edges,
    "offsets": NETWORK.offsets,
    "bond_vectors": CRITICAL.bond_vectors,
    "cell": NETWORK.cell,
    "n_points": 4,
    "distance": 0.1,
    "rng": np.random.default_rng(0),
    "points": np.random.default_rng(1).random((12, 2)),
    "z": 2.9,
    "dimension": 2,
    "n_vertices": 60,
    "directions": np.eye(2)[None],
    "first": np.eye(2),
    "second": np.diag([1.0, -1.0]),
    "n": 4,
    "edge": 0,
    "tail": 0,
    "head": 1,
    "s": np.zeros(5),
    "deformation": "dilation",
    "thing": CRITICAL,
    "path": Path(tempfile.mkdtemp()) / "page.md",
}
# Arguments that an extra makes.
OF_EXTRAS = {
    "local": lambda: {"response": ce.local_response(CRITICAL, (0, 2, (1, 1)), (1, 3, (0, 0))).value},
    "weak": lambda: {"energy": ce.AngleSprings(2.0)},
    "examine": lambda: {"examination": ce.examine(NETWORK, CRITICAL.coordinates, deformations=())},
}
for extra, made in OF_EXTRAS.items():
    RIGHT |= {} if missing("", extra) else made()
OF_FUNCTION = {
    "tissue": {"network": HEXAGONS, "coordinates": HEXAGONS.positions},
    "critical_from_perimeters": {"network": HEXAGONS},
    "design": {"targets": {"B_0": 0.1}, "initial": np.ones(6), "signs": "positive"},
    "isotropic_targets": {"youngs_modulus": 1.0, "poissons_ratio": 0.2},
    "prune_towards": {"targets": {"B_0": 0.1}},
    "local_response": {"springs": CRITICAL, "source": (0, 2, (0, 0)), "targets": [(1, 3, (0, 0))]},
    "face_diagonals": {"network": HEXAGONS},
    "response_name": {"source": (0, 2, (0, 0)), "target": (1, 3, (0, 0))},
    "properties": {"quantities": ["B_0"]},
    "quantity": {"name": "B_0"},
    "upper_bound": {"name": "B_0"},
    "pareto": {"objectives": {"B_0": "largest", "V_L": "smallest"}, "start": np.ones(6), "n": 2},
    "optimize": {"start": np.ones(6), "signs": "positive"},
    "planar_faces": {"edges": HEXAGONS.edges, "bond_vectors": HEXAGONS.bond_vectors(HEXAGONS.positions)},
    "voronoi_network": {"n_vertices": 8, "points": None},
    "delaunay_network": {"n_vertices": 8, "points": None},
    "lattice": {"name": "square"},
    "fibre_network": {"kind": "mikado", "z": 3.6},
    "deformation_of": {"value": "dilation"},
    "diluted": {"network": lattice("honeycomb", 4, 4)},
    "packing_network": {"n_vertices": 24, "z": 4.2},
}
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
PUBLIC = checked_functions()
# Functions of files and foreign objects judge these themselves.
FUNCTIONS = {name: function for name, function in PUBLIC.items() if "exchange" not in function.__module__}
# Random points take long for some seeds.
SLOW = {("foam_network", "seed", "zero")}


def arguments_of(name):
    """Arguments of a public function by name."""
    right = RIGHT | OF_FUNCTION.get(name, {})
    variable = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD
    parameters = [p for p in inspect.signature(FUNCTIONS[name]).parameters.values() if p.kind not in variable]
    unknown = [p.name for p in parameters if p.default is p.empty and p.name not in right]
    assert not unknown, f"add right arguments {unknown} of {name} to RIGHT"
    return {p.name: right[p.name] if p.default is p.empty or p.name in right else p.default for p in parameters}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_wrong_arguments_of_every_public_function_raise_one_sentence(name):
    right = arguments_of(name)
    for key, wrong in itertools.product(right, WRONG):
        if (name, key, wrong) in SLOW:
            continue
        try:
            FUNCTIONS[name](**(right | {key: WRONG[wrong]}))
        except CritflowError as error:
            assert "\n" not in str(error)
            assert 10 < len(str(error)) < 300
        except Exception as error:
            raise AssertionError(f"{name}({key} = {wrong}) raised {type(error).__name__}: {error}") from error


# Functions of the top level that compute next to nothing, or wait for the disk.
QUICK = {"lattice", "network_from", "quantity", "spring_state", "three_bar_linkage", "tissue", "write_network"}


class Computing(Exception):
    """Raised where a call begins to compute."""


@pytest.mark.parametrize("name", sorted(name for name in FUNCTIONS if name in NAMES and name not in QUICK))
def test_a_function_that_may_take_long_shows_its_name_and_sets_the_threads(name, monkeypatch):
    names = []

    def controller():
        names.append("threads")
        raise Computing

    monkeypatch.setattr(calls, "_visible", lambda: True)
    monkeypatch.setattr(calls._LINE, "begin", names.append)
    monkeypatch.setattr(calls, "_controller", controller)
    with pytest.raises(Computing):
        FUNCTIONS[name]()
    assert names == [name, "threads"]


def example(network, number, count=1, rng=None, flag=True):
    network = of_kind(Network, network=network)
    of_kind(float, number=number)
    of_kind(np.random.Generator, None, rng=rng)
    of_kind(bool, flag=flag)
    return network, number, of_kind(int, count=count)


def test_the_sentence_names_the_argument_its_kind_and_the_way_out():
    for arguments, sentence in (
        ((CRITICAL.coordinates, 1.0), "network must be a Network, not an array of shape (4, 2) and type float64"),
        ((NETWORK, "soft"), "number must be a number, not 'soft'"),
        ((NETWORK, 1.0, 2.5), "count must be a whole number, not 2.5"),
        ((NETWORK, 1.0, True), "count must be a whole number, not True"),
        ((NETWORK, 1.0, 1, 3), "rng must be a Generator, not 3: use numpy.random.default_rng(3)"),
        ((NETWORK, 1.0, 1, None, 2), "flag must be True or False, not 2"),
    ):
        with pytest.raises(InputError) as caught:
            example(*arguments)
        assert str(caught.value) == sentence


def test_what_holds_a_network_stands_for_it():
    state = spring_state(NETWORK, CRITICAL.lengths, CRITICAL.coordinates)
    for holder in (NETWORK, MANIFOLD, CRITICAL, state, MANIFOLD.solve(np.ones(6))):
        assert example(holder, 1.0)[0] is NETWORK
    with pytest.raises(InputError, match=r"failed.*\.value"):
        example(MANIFOLD.solve([0, 0, 0, 0, 1, 1]), 1.0)
    solved = MANIFOLD.solve(np.ones(6))
    assert critflow.elasticity(solved).value.bulk == critflow.elasticity(solved.value).value.bulk


def test_numbers_of_every_kind_are_accepted():
    for number in (2, 2.0, np.float32(2), np.int8(2), np.array(2.0)):
        assert example(NETWORK, number, number)[2] == 2
        assert isinstance(example(NETWORK, number, number)[2], int)
    with pytest.raises(TypeError, match="missing"):
        example(NETWORK)


def test_seeds():
    rng = np.random.default_rng(1)
    assert generator(rng) is rng
    assert generator(np.int64(5)).random() == generator(5).random()
    with pytest.raises(InputError, match="-1"):
        generator(-1)
