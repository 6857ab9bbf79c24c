"""Design of force densities under loads: inversions with known answers, gradients, refusals."""

import numpy as np
import pytest
from derivatives import assert_derivative
from loaded_nets import catenary, net, rope
from refusals import refused

from critflow import CriticalManifold, Network, quantity, spring_state, voronoi_network
from critflow_extras import design, loaded
from critflow_extras.loads.force_densities import ForceDensities
from critflow_extras.loads.quantities import with_loads
from critflow_extras.targets.problem import DesignOptions

NETWORK = net(4, lambda x, y: 0.1 * x * y)[0]
HANGING = loaded(NETWORK, np.ones(NETWORK.n_edges), (0, 0, -0.3), weight=(0, 0, -0.05)).value
CHANGE = {"change": "force_densities"}
MIDDLE = NETWORK.free[len(NETWORK.free) // 2]
PIN = min(NETWORK.pins)


@pytest.mark.parametrize("k", [3.0, 100.0, 1e5])
def test_springs_of_given_lengths_hang_in_the_catenary(k):
    sigma, x = catenary(20, 14, k, 0.1)
    start = loaded(rope(20, 14, k), np.ones(20), weight=(0, -0.1), lengths=np.ones(20)).value
    found = design(start, {"rest_lengths": 1.0}, **CHANGE)
    assert found.reached
    np.testing.assert_allclose(found.value.sigma, sigma, rtol=1e-9)
    np.testing.assert_allclose(found.value.coordinates, x, rtol=0, atol=1e-10)


def test_one_factor_of_the_stress_is_an_unknown():
    """Sag and thrust of a parabola: y = −w n²/8σ, H = σ times the length of an edge."""
    start = loaded(rope(12, 12), np.ones(12), (0, -0.2)).value
    lower = design(start, {"position[6,y]": -7.2}, **CHANGE)
    assert lower.value.coordinates[6, 1] == pytest.approx(-7.2, abs=1e-10)
    assert lower.distance == pytest.approx(np.sqrt(np.mean(np.log(lower.value.sigma) ** 2)), rel=1e-12)
    thrust = design(start, {"reaction[0,x]": -2.0, "lengths": start.lengths}, throw=False, **CHANGE)
    assert not thrust.reached  # lengths fix the force densities, with their scale
    thrust = design(start, {"reaction[0,x]": -2.0}, **CHANGE)
    assert thrust.value.reactions[0, 0] == pytest.approx(-2.0, abs=1e-11)
    # All edges have the same thrust; the least change of log σ keeps it.
    assert thrust.value.sigma * thrust.value.bond_vectors[:, 0] == pytest.approx(2.0, abs=1e-10)


def test_what_is_there_already_changes_nothing():
    start = loaded(NETWORK, np.full(NETWORK.n_edges, 3.0), (0, 0, -0.3)).value
    found = design(start, {"length[3]": start.lengths[3]}, **CHANGE)
    assert found.distance < 1e-12
    np.testing.assert_allclose(found.value.sigma, 3.0, rtol=1e-12)


def test_positions_of_all_vertices():
    torus = voronoi_network(20, seed=1)
    held = Network(torus.edges, torus.offsets, torus.cell, pins={i: torus.positions[i] for i in (0, 7)})
    value = loaded(held, np.ones(30), (0.1, -0.2)).value
    targets = with_loads(held, {f"position[{i},{axis}]": 0.0 for i in held.free for axis in "xy"})
    found = [target.evaluate(value)[0] for target in targets]
    np.testing.assert_allclose(found, value.coordinates[held.free].ravel(), rtol=0, atol=1e-13)


def test_positions_reactions_lengths_and_tensions_are_reached():
    targets = {f"position[{MIDDLE},z]": -0.4, f"reaction[{PIN},2]": 0.45, "tension[3]": (0.5, 0.6), "length[5]": 1.1}
    found = design(HANGING, targets, within={"lengths": (0.5, 1.4)}, **CHANGE)
    value = found.value
    assert found.reached and value.lengths.max() <= 1.4 + 1e-9 and value.lengths.min() >= 0.5 - 1e-9
    assert value.coordinates[MIDDLE, 2] == pytest.approx(-0.4, abs=1e-10)
    assert value.reactions[PIN, 2] == pytest.approx(0.45, abs=1e-10)
    assert 0.5 - 1e-9 < value.tensions[3] < 0.6 + 1e-9
    assert value.lengths[5] == pytest.approx(1.1, abs=1e-10)
    assert found.targets["length[5]"].error < 1e-12


def test_a_planted_net_is_found_from_its_tensions():
    sigma = np.exp(0.2 * np.random.default_rng(0).standard_normal(NETWORK.n_edges))
    planted = loaded(NETWORK, 0.7 * sigma, HANGING.forces, HANGING.weight).value
    found = design(HANGING, {"tensions": planted.tensions}, **CHANGE)
    assert found.reached
    np.testing.assert_allclose(found.value.coordinates, planted.coordinates, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.value.sigma, planted.sigma, rtol=1e-9)


@pytest.mark.parametrize("unit", [1.0, 1e-9])
def test_the_smallest_reaction_within_limits(unit):
    start = loaded(NETWORK, np.full(NETWORK.n_edges, unit), (0, 0, -0.3 * unit)).value
    targets = {f"reaction[{PIN},z]": "smallest", f"position[{MIDDLE},z]": -0.6}
    found = design(start, targets, within={"lengths": (0.8, 1.3)}, throw=False, max_steps=60, **CHANGE)
    assert found.reached and found.value.reactions[PIN, 2] < start.reactions[PIN, 2] - 0.1 * unit


def test_nearest_to_given_coordinates():
    start = loaded(NETWORK, np.ones(NETWORK.n_edges), (0, 0, -0.3)).value
    goal = loaded(NETWORK, np.full(NETWORK.n_edges, 0.6), (0, 0, -0.3)).value.coordinates
    found = design(start, {"length[0]": (0.1, 9.0)}, prefer=goal, throw=False, **CHANGE)
    apart = [np.abs(one.coordinates - goal).max() for one in (found.value, start)]
    assert found.reached and apart[0] < 1e-3 * apart[1]


def test_gradients_of_all_quantities():
    names = [f"position[{MIDDLE},z]", f"position[{MIDDLE},0]", f"reaction[{PIN},x]", f"reaction[{PIN},z]"]
    names += ["tension[3]", "rest_length[4]", "length[2]", "V_L"]
    quantities = [quantity(NETWORK, key) for key in with_loads(NETWORK, dict.fromkeys(names, 0.0))]
    variables = ForceDensities.of(HANGING, DesignOptions(NETWORK, "force_densities"))
    rows = variables.values(variables.at(variables.origin), quantities)[1]
    values = lambda z: variables.values(variables.at(z), quantities)[0]  # noqa: E731
    step = np.random.default_rng(1).standard_normal(len(variables.origin))
    assert_derivative(values, lambda u: rows @ u, variables.origin, [step], 1e-3, 1e-7)
    x, reactions = HANGING.coordinates[MIDDLE], HANGING.reactions[PIN]
    assert values(variables.origin)[:4] == pytest.approx([x[2], x[0], reactions[0], reactions[2]], abs=1e-13)


def refuse(targets, start=HANGING, **options):
    return lambda: design(start, targets, **(CHANGE | options))


PLAIN = CriticalManifold(NETWORK).configuration(np.ones(NETWORK.n_edges))
BAD = {
    "a modulus": (refuse({"modulus[uniaxial]": 0.1}), "self-stress"),
    "a change of stress": (refuse({"length[0]": 1.0}, change="stress"), "force_densities"),
    "a start without loads": (refuse({"length[0]": 1.0}, PLAIN), "under loads"),
    "a state": (refuse({"length[0]": 1.0}, spring_state(NETWORK, PLAIN.lengths, PLAIN.coordinates)), "under loads"),
    "signs": (refuse({"length[0]": 1.0}, signs="any"), "signs does not apply"),
    "a zero": (refuse({"length[0]": 1.0}, initial=np.eye(1, NETWORK.n_edges)[0]), "is zero"),
    "nearness": (refuse({"length[0]": (0.1, 9)}, prefer=PLAIN.coordinates), "stay as they are"),
    "position of a pin": (refuse({f"position[{PIN},z]": 0.0}), "is a pin"),
    "reaction elsewhere": (refuse({f"reaction[{MIDDLE},z]": 0.0}), "only pins"),
    "no such edge": (refuse({"tension[999]": 1.0}), "counted from 0"),
    "no such vertex": (refuse({"position[999,z]": 1.0}), "counted from 0"),
    "no such axis": (refuse({"position[1,z]": 1.0}, loaded(rope(2, 2), [1, 1], (0, -1)).value), "2 dimensions"),
    "too few lengths": (refuse({"lengths": [1.0, 2.0]}), "one value per edge"),
}
test_bad_input_raises_one_sentence = refused(BAD)
