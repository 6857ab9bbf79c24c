"""C_B, C_G and the stiffening of a path as quantities: values, gradients, derivatives by k, extremes, least C_B."""

from functools import partial

import numpy as np
import pytest
from problems import with_random_stiffness
from quantity_checks import (
    KINDS,
    MANIFOLDS,
    assert_gradients_and_hessian_products,
    assert_no_stress_exceeds_the_extreme_values,
    stress,
)
from refusals import refused
from stiffness_checks import assert_derivatives_by_stiffness

from critflow import CriticalManifold, InputError, lattice, optimize, quantity, stiffening, upper_bound, voronoi_network
from critflow.quantities import names, require_exact_hessian
from critflow_extras import foam_network, properties


def spelled(network):
    """The names of this folder."""
    modules = {name: getattr(factory, "module", "") for name, factory in names(network).items()}
    own = [name for name, module in modules.items() if module.startswith("critflow_extras.design_growth.")]
    return [name for name in own if "uniaxial_free" not in name]


CASES = [(kind, name) for kind, network in KINDS.items() for name in spelled(network)]


@pytest.mark.parametrize("sign", [1.0, -0.3], ids=["positive", "signed"])
@pytest.mark.parametrize("kind, name", CASES, ids=str)
def test_gradients_and_hessian_products(kind, name, sign):
    assert_gradients_and_hessian_products(MANIFOLDS[kind], quantity(KINDS[kind], name), sign)


@pytest.mark.parametrize("kind, name", CASES, ids=str)
def test_derivatives_by_stiffness(kind, name):
    assert_derivatives_by_stiffness(kind, quantity(KINDS[kind], name))


@pytest.mark.parametrize("kind", KINDS)
def test_values_are_those_of_stiffening(kind):
    critical = MANIFOLDS[kind].configuration(stress(KINDS[kind]))
    exact = stiffening(critical).value
    assert properties(critical, ["C_B", "C_G"]).values == pytest.approx({"C_B": exact.C_B, "C_G": exact.C_G}, rel=1e-11)


@pytest.mark.parametrize("kind", KINDS)
def test_no_stress_exceeds_the_extreme_values(kind):
    goals = [quantity(KINDS[kind], name) for name in spelled(KINDS[kind])]
    assert_no_stress_exceeds_the_extreme_values(MANIFOLDS[kind], goals)


def test_the_least_growth_is_attained():
    network, manifold = KINDS["oblique"], MANIFOLDS["oblique"]
    best, least = optimize(network, "B_0").value, quantity(network, "C_B").extreme(manifold)[0]
    assert least == pytest.approx((3 / network.dimension - 2) * upper_bound(network, "B_0"), rel=1e-14)
    assert least == pytest.approx(properties(best, "C_B").values["C_B"], rel=1e-9)


SPRINGS = {
    "plane": lambda: voronoi_network(60, seed=1),
    "plane, other springs": lambda: with_random_stiffness(voronoi_network(40, seed=2), 3),
    "plane, stretched": lambda: voronoi_network(40, seed=2).deformed([[1.0, 0.6], [0.0, 3.0]]),
    "space": lambda: foam_network(52, seed=1),
}


@pytest.mark.parametrize("name", SPRINGS)
def test_the_least_growth_is_at_the_stiffest_from_every_start(name):
    manifold, random = CriticalManifold(SPRINGS[name]()), np.random.default_rng(0)
    network, d = manifold.network, manifold.network.dimension
    stiffest = optimize(manifold, "B_0")
    least = (3 / d - 2) * stiffest.objective
    for options in ({}, {"start": 0.1 + random.random(network.n_edges)}, {"starts": 3, "rng": random}):
        found = optimize(manifold, "C_B", **options)
        assert found.ok and found.stats.method == "closed_form"
        assert found.objective == pytest.approx(least, rel=1e-11)
        assert found.objective_error < 1e-11 * abs(least) and found.stats.residual < 1e-11
        np.testing.assert_allclose(found.value.sigma, stiffest.value.sigma, rtol=1e-13)
    assert optimize(manifold, "C_B", "closed_form").objective == found.objective
    for _ in range(5):
        sigma = network.stiffness * np.exp(random.uniform(0, 2) * random.standard_normal(network.n_edges))
        assert quantity(network, "C_B").evaluate(manifold.configuration(sigma))[0] > least


def test_other_extremes_of_growth_have_no_closed_form():
    network = voronoi_network(20, seed=1)
    for objective in ("C_G", "stiffening[dilation]"):
        with pytest.raises(InputError, match="closed form"):
            optimize(network, objective, "closed_form")
    assert optimize(network, "C_B", "lbfgs", max_steps=5, throw=False).stats.method == "lbfgs"


def test_softening_can_be_optimised():
    manifold = CriticalManifold(voronoi_network(n_vertices=20, seed=2))
    least = optimize(manifold, "C_B", "lbfgs", throw=False, max_steps=150, tolerance=1e-6)
    stiffest = optimize(manifold, "B_0")
    # No network was found to soften more than the stiffest one, C_B = −B_0/2.
    assert -0.5 * stiffest.objective - 1e-6 < least.objective < -0.45 * stiffest.objective


def test_stiffening_has_no_second_derivatives():
    network = lattice("honeycomb", 2, 2)
    with pytest.raises(InputError, match="C_B has none"):
        require_exact_hessian(CriticalManifold(network), quantity(network, "C_B"))
    with pytest.raises(InputError, match="C_B has none: choose method='lbfgs'"):
        optimize(voronoi_network(40, seed=1), "C_B", "newton")


WRONG = {"stiffening[uniaxial_free]": "free components", "C_b": "did you mean 'C_B'", "stiffening": "stiffening"}
test_unknown_names_are_one_sentence = refused(
    {name: (partial(quantity, voronoi_network(20, seed=1), name), word) for name, word in WRONG.items()}
)
