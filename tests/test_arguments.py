"""Arguments of the wrong kind raise one sentence, in every public function and for every parameter."""

from __future__ import annotations

import inspect
from tempfile import mkdtemp

import numpy as np
import pytest
from argument_checks import (
    CRITICAL,
    HEXAGONS,
    MANIFOLD,
    NAMES,
    NETWORK,
    shows_its_name_and_sets_the_threads,
    wrong_arguments_raise,
)

import critflow
from critflow import (
    InputError,
    Network,
    deformation,
    faces,
    growth,
    isogonal,
    points,
    quantities,
    spring_state,
    taut_part,
)
from critflow.arguments import generator, of_kind

PUBLIC = {name: function for name in NAMES if inspect.isfunction(function := getattr(critflow, name))}
# Functions of modules that the reference of the documents lists.
IN_MODULES = (
    *(taut_part.backbone, isogonal.face_modes, isogonal.length_shares, growth.shear_growth),
    *(quantities.transition_modulus, quantities.stress_hessian),
    *(quantities.flat_directions, points.random_sequential_addition, deformation.deformation_of, faces.planar_faces),
)
OF_FUNCTION = {
    "quantity": {"name": "B_0"},
    "upper_bound": {"name": "B_0"},
    "optimize": {"start": np.ones(6), "signs": "positive"},
    "planar_faces": {"edges": HEXAGONS.edges, "bond_vectors": HEXAGONS.bond_vectors(HEXAGONS.positions)},
    "voronoi_network": {"n_vertices": 8, "points": None},
    "delaunay_network": {"n_vertices": 8, "points": None},
    "lattice": {"name": "square"},
    "deformation_of": {"value": "dilation"},
    **{key: {"source": critflow.to_tables(CRITICAL)} for key in ("read_network", "read_critical")},
    **{key: {"thing": CRITICAL} for key in ("to_tables", "to_graph")},
    "write_network": {"thing": CRITICAL, "path": f"{mkdtemp()}/n.csv"},
}
# Functions that compute next to nothing.
QUICK = {
    *("lattice", "quantity", "spring_state", "three_bar_linkage"),
    *("read_critical", "read_network", "to_graph", "to_tables", "write_network"),
}

test_wrong_arguments_of_every_public_function_raise_one_sentence = wrong_arguments_raise(
    PUBLIC | {function.__name__: function for function in IN_MODULES}, OF_FUNCTION
)
test_a_function_that_may_take_long_shows_its_name_and_sets_the_threads = shows_its_name_and_sets_the_threads(
    PUBLIC, QUICK
)


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


def test_a_name_of_numpy_is_a_name():
    assert critflow.optimize(MANIFOLD, np.str_("B_0")).ok


def test_seeds():
    rng = np.random.default_rng(1)
    assert generator(rng) is rng
    assert generator(np.int64(5)).random() == generator(5).random()
    with pytest.raises(InputError, match="-1"):
        generator(-1)
