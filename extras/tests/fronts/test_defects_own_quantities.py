"""Every call says in a sentence, with the name of the class, where `evaluate` of a user's quantity is wrong."""

import numpy as np
import pytest

from critflow import CriticalManifold, InputError, Quantity, delaunay_network, optimize, spring_state, voronoi_network
from critflow.quantities import flat_directions, stress_hessian
from critflow_extras import design, edge_leverage, pareto, properties, prune_towards

MANIFOLD = CriticalManifold(voronoi_network(20, seed=1))
CRITICAL = MANIFOLD.configuration(np.linspace(0.5, 1.5, 30))


class MeanSquare(Quantity):
    """⟨|L|²⟩, of which `changed` makes something wrong."""

    def __init__(self, changed=lambda value, by_sigma, by_L: (value, (by_sigma, by_L))):
        self.changed, self.calls = changed, 0

    def evaluate(self, balance):
        self.calls += 1
        L = balance.bond_vectors
        return self.changed(np.sum(L**2) / len(L), np.zeros(len(L)), 2 * L / len(L))


def with_nan(array):
    out = array.copy()
    out[(3, *[0] * (array.ndim - 1))] = np.nan
    return out


WRONG = {
    "a value of NaN": (lambda v, s, L: (np.nan, (s, L)), "finite number"),
    "an array for a value": (lambda v, s, L: (s, (s, L)), "finite number"),
    "no partials": (lambda v, s, L: v, "must return"),
    "one partial": (lambda v, s, L: (v, s), "must return"),
    "a number for a partial": (lambda v, s, L: (v, (0.0, L)), "shape"),
    "partials in the other order": (lambda v, s, L: (v, (L, s)), "shape"),
    "lengths for vectors": (lambda v, s, L: (v, (s, L[:, 0])), "shape"),
    "a partial of NaN": (lambda v, s, L: (v, (s, with_nan(L))), "edge 3"),
    "a partial by stress of NaN": (lambda v, s, L: (v, (with_nan(s), L)), "edge 3"),
}
CALLS = {
    "optimize": lambda own: optimize(MANIFOLD, own),
    "properties": lambda own: properties(CRITICAL, ["B_0", own]),
    "stress_hessian": lambda own: stress_hessian(CRITICAL, own),
    "flat_directions": lambda own: flat_directions(CRITICAL, own),
    "design": lambda own: design(MANIFOLD, {own: 0.5}),
    "design of faces": lambda own: design(CRITICAL, {own: 0.5}, change="faces"),
    "design of pressures": lambda own: design(MANIFOLD.network, {own: 0.5}, change="pressures"),
    "pareto": lambda own: pareto(MANIFOLD, {"B_0": "largest", own: "smallest"}, 2),
    "edge_leverage": lambda own: edge_leverage(CRITICAL, own),
    "prune_towards": lambda own: prune_towards(CRITICAL, {own: 0.5}),
}


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("call", CALLS)
def test_a_wrong_evaluate_is_one_sentence(call, wrong):
    changed, word = WRONG[wrong]
    with pytest.raises(InputError, match=f"^MeanSquare.evaluate .*{word}"):
        CALLS[call](MeanSquare(changed))


@pytest.mark.parametrize("call", [call for call in CALLS if call != "design of pressures"])
def test_a_wrong_derivative_is_one_sentence(call):
    with pytest.raises(InputError, match=r"^MeanSquare.evaluate .* dO/dσ of edge"):
        CALLS[call](MeanSquare(lambda v, s, L: (v, (s, 1.01 * L))))


def test_a_right_one_is_asked_once_more():
    right = MeanSquare()
    properties(CRITICAL, right)
    stated = right.calls
    # The value, its error and the derivatives by 30 stiffnesses from two sides; before them one question at this stress
    # and one at another, with twice that stress and both sides of it.
    assert stated == 1 + 1 + 2 * 30 + 1 + 1 + 1 + 2
    assert optimize(MANIFOLD, right, throw=False).objective < properties(CRITICAL, right).values["MeanSquare"]


def test_a_change_of_stiffness_still_says_what_it_can_set():
    network = delaunay_network(20, seed=1)
    state = spring_state(network, np.linalg.norm(network.bond_vectors(network.positions), axis=1), network.positions)
    with pytest.raises(InputError, match="not linear in the elasticity tensor"):
        design(state, {MeanSquare(): 0.5}, change="stiffness")
