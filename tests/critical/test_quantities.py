"""Every quantity of the scene on every kind of network: values, gradients, Hessian products, extremes."""

import numpy as np
import pytest
from problems import HONEYCOMB_BULK_MODULUS, NETWORKS, at, dense_bond_vectors, modulus_by_formula
from quantity_checks import (
    KINDS,
    MANIFOLDS,
    assert_gradients_and_hessian_products,
    assert_no_stress_exceeds_the_extreme_values,
    stress,
)
from refusals import refused

from critflow import (
    CriticalManifold,
    InputError,
    Quantity,
    lattice,
    optimize,
    quantity,
    upper_bound,
    voronoi_network,
)
from critflow.quantities import (
    ALIASES,
    PenalisedModulus,
    TransitionModulus,
    evaluate,
    names,
    pure_shear,
    require_exact_hessian,
    transition_modulus,
)


def spelled(network):
    """The names of all quantities of the scene."""
    own = [name for name, factory in names(network).items() if callable(factory)]
    return [name for name in own if "uniaxial_free" not in name]


CASES = [(kind, name) for kind, network in KINDS.items() for name in spelled(network)]
PENALISED = PenalisedModulus(TransitionModulus(pure_shear(2), "G_0"), 0.2)


def of(kind, name):
    return PENALISED if name == "penalised" else quantity(KINDS[kind], name)


@pytest.mark.parametrize("sign", [1.0, -0.3], ids=["positive", "signed"])
@pytest.mark.parametrize("kind, name", [*CASES, ("oblique", "penalised")], ids=str)
def test_gradients_and_hessian_products(kind, name, sign):
    assert_gradients_and_hessian_products(MANIFOLDS[kind], of(kind, name), sign)


@pytest.mark.parametrize("kind", KINDS)
def test_values_by_their_formulas(kind):
    network = KINDS[kind]
    d, sigma = network.dimension, stress(network)
    L = dense_bond_vectors(network, sigma)
    length = np.sqrt(np.sum(L**2, axis=1))
    tension = sigma * length
    A = np.zeros((d, d))
    A[0, 1], A[1, 0] = 0.7, 0.3
    expected = {
        "V_L": np.mean(length**2) / np.mean(length) ** 2 - 1,
        "V_tau": np.mean(tension**2) / np.mean(tension) ** 2 - 1,
        "B_0": modulus_by_formula(network, sigma, L, np.eye(d) / d),
        "G_0": modulus_by_formula(network, sigma, L, A),
        "modulus[uniaxial]": modulus_by_formula(network, sigma, L, np.diag([1.0, *[0.0] * (d - 1)])),
    }
    found = {name: quantity(network, name).evaluate(at(network, sigma, L))[0] for name in expected}
    assert found == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("kind", KINDS)
def test_no_stress_exceeds_the_extreme_values(kind):
    goals = [quantity(KINDS[kind], name) for name in spelled(KINDS[kind])]
    goals += [PenalisedModulus(goal) for goal in goals if goal.name == "G_0"]
    assert_no_stress_exceeds_the_extreme_values(MANIFOLDS[kind], goals)


def test_extreme_values_are_attained():
    network = lattice("honeycomb", 3, 4, edge_length=0.7).with_stiffness(2.5)
    assert upper_bound(network, "B_0") == pytest.approx(2.5 * HONEYCOMB_BULK_MODULUS, rel=1e-13)
    network = KINDS["oblique"]
    best = optimize(network, "B_0").value
    assert upper_bound(network, "B_0") == pytest.approx(quantity(network, "B_0").evaluate(best)[0], rel=1e-12)


@pytest.mark.parametrize("name", ["V_L", "V_tau"])
def test_variances_need_no_cell(name):
    network = NETWORKS["pinned grid"]()
    found = evaluate(CriticalManifold(network).balance(np.ones(network.n_edges)), quantity(network, name))
    assert found.value > 0 and np.isfinite(found.gradient).all()


def test_names_and_aliases():
    network = voronoi_network(20, seed=1)
    for long, symbol in ALIASES.items():
        assert quantity(network, long).name == quantity(CriticalManifold(network), symbol).name == symbol
    goal = quantity(network, "G_0")
    assert quantity(network, goal) is goal


UNKNOWN = {
    "bulk_modulu": "did you mean 'bulk_modulus'",
    "B_1": "B_0",
    "b_0": "did you mean 'B_0'",
    "colour": "V_tau",
    "modulus[twist]": "modulus",
    "modulus[uniaxial_free]": "free",
    "nu": r"poisson\(direction\) has it",
    "E": r"young\(direction\) has it",
}
test_unknown_names_are_one_sentence = refused(
    {name: (lambda name=name: quantity(voronoi_network(20, seed=1), name), word) for name, word in UNKNOWN.items()}
    | {"a strain in space": (lambda: transition_modulus(lattice("honeycomb", 2, 2), np.eye(3)), "dimensions")},
    InputError,
)


def test_an_analytic_quantity_has_an_exact_hessian():
    network = lattice("honeycomb", 2, 2)
    require_exact_hessian(CriticalManifold(network), quantity(network, "B_0"))


class Mean(Quantity):
    """A quantity of a user, not a dataclass."""

    def __init__(self, power):
        self.power = power

    def evaluate(self, balance):
        raise NotImplementedError


def test_a_quantity_that_is_no_dataclass_prints_its_name():
    assert repr(Mean(2)) == str(Mean(2)) == "Mean()"
    assert repr(PENALISED) == "PenalisedModulus(modulus=TransitionModulus(...), threshold=0.2)"
