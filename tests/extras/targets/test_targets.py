"""Design for targets: reached to rounding, infeasible ones refused by bounds, multipliers against differences."""

import numpy as np
import pytest
from derivatives import assert_derivative
from refusals import refused_changes

from critflow import (
    CriticalManifold,
    InputError,
    Network,
    SolveError,
    Status,
    design,
    elasticity,
    lattice,
    optimize,
    properties,
    quantity,
    stiffening,
    upper_bound,
    voronoi_network,
)
from critflow.extras.targets.problem import POWERS, EdgeLimits
from critflow.extras.targets.targets import cosines

MANIFOLD = CriticalManifold(voronoi_network(n_vertices=60, seed=1))
NETWORK = MANIFOLD.network


def stress_of(critical):
    S = (critical.sigma[:, None] * critical.bond_vectors).T @ critical.bond_vectors
    return S / np.sqrt(np.sum(critical.sigma**2 * critical.lengths**2 / critical.network.stiffness))


def test_a_linear_response_is_reached():
    S = stress_of(MANIFOLD.configuration(np.exp(0.3 * np.random.default_rng(1).normal(size=90))))
    found = design(MANIFOLD, {"S_xx": S[0, 0], "S_yy": S[1, 1], "S_xy": S[0, 1]})
    np.testing.assert_allclose(stress_of(found.value), S, rtol=0, atol=1e-10)
    assert found.independent and found.stats.residual < 1e-11


def test_moduli_and_growth_are_reached_together():
    targets = {"bulk_modulus": 0.25, "C_B": 0.1, "C_G": 0.3}
    found = design(MANIFOLD, targets)
    exact = stiffening(found.value).value
    assert (exact.bulk_0, exact.C_B, exact.C_G) == pytest.approx(tuple(targets.values()), rel=1e-9)
    assert {name: one.value for name, one in found.targets.items()} == pytest.approx(targets, rel=1e-10)


def test_a_satisfied_interval_changes_nothing():
    start = MANIFOLD.configuration(np.ones(90))
    found = design(MANIFOLD, {"bulk_modulus": (0.1, 1.0)})
    assert found.distance == 0 and found.targets["bulk_modulus"].value == pytest.approx(elasticity(start).value.bulk)
    nearer = design(MANIFOLD, {"bulk_modulus": (0.0, 0.26)})
    assert nearer.targets["bulk_modulus"].value == pytest.approx(0.26, rel=2e-3)


def test_the_multiplier_is_the_cost_of_a_target():
    def cost(value):
        found = design(MANIFOLD, {"C_B": value})
        return 0.5 * 90 * found.distance**2, found.targets["C_B"].multiplier

    (low, _), (_, mu), (high, _) = (cost(value) for value in (0.19, 0.2, 0.21))
    # The distance is least to 1e-3 only.
    assert (high - low) / 0.02 == pytest.approx(mu, rel=0.02)


def test_targets_beyond_a_bound_are_refused():
    bound = upper_bound(MANIFOLD, "B_0")
    found = design(MANIFOLD, {"bulk_modulus": 1.001 * bound}, throw=False)
    assert found.status is Status.infeasible and f"{bound:.8g}" in found.note
    # Each is below its bound, their ellipse is left by a third.
    found = design(MANIFOLD, {"B_0": 0.27, "G_0": 0.2}, throw=False)
    assert found.status is Status.infeasible and "together" in found.note
    S = 1.01 * stress_of(MANIFOLD.configuration(np.ones(90)))
    found = design(MANIFOLD, {"S_xx": S[0, 0], "S_yy": S[1, 1], "S_xy": S[0, 1]}, throw=False)
    assert found.status is Status.infeasible and "factor of 1.01" in found.note
    with pytest.raises(SolveError):
        design(MANIFOLD, {"bulk_modulus": 2.0})


test_bad_arguments_are_one_sentence = refused_changes(
    lambda **changes: design(MANIFOLD, **{"targets": {"B_0": 0.2}} | changes),
    ({"targets": {"B_0": 0.2, "bulk_modulus": 0.2}}, "same"),
    ({"targets": {"B_0": "largest", "G_0": "smallest"}}, "only one"),
    ({"targets": {"B_0": "great"}}, "largest"),
    ({"targets": {"B_0": 0.2, "modulus[dilation]": 0.25}}, "same"),
    ({"targets": {"S_xx": 3.0, "modulus[uniaxial]": 0.01}}, "contradict"),
    ({"targets": {}}, "at least one"),
    ({"targets": {"colour": 3}}, "colour"),
    ({"targets": {"C_B": (0.3, 0.2)}}, "low"),
    ({"targets": {"C_B": np.nan}}, "number"),
    ({"max_steps": -1}, "max_steps"),
    ({"targets": {"S_xx": 3.0, "S_yy": 1.0, "S_xy": 0.0, "B_0": 0.2}}, "contradict"),
    ({"prefer": "cheap"}, "preference"),
    ({"targets": {"B_0": "largest"}, "prefer": "length_variance"}, "omit prefer"),
    ({"prefer": np.zeros((3, 2))}, "shape"),
    ({"within": {"colours": (0, 1)}}, "quantity"),
    ({"within": {"lengths": (1.0, 0.5)}}, "lower limit"),
    ({"within": {"tensions": (2.0, 3.0)}}, "enclose 1"),
    ({"signs": "mixed"}, "signs"),
    ({"signs": np.zeros(90)}, "tension"),
    ({"free": [90]}, "edge 90"),
    ({"free": "stiffness"}, "free"),
    ({"initial": -np.ones(90)}, "sign"),
    ({"change": "colour"}, "change"),
    ({"change": "faces"}, "configuration"),
    ({"change": "stiffness"}, "spring_state"),
)


def test_a_signed_response_is_reached():
    targets = {"S_xx": 3.0, "S_yy": -1.0, "S_xy": 0.0}
    assert "signs='any'" in design(MANIFOLD, targets, throw=False).note
    found = design(MANIFOLD, targets, signs="any")
    np.testing.assert_allclose(stress_of(found.value), np.diag([3.0, -1.0]), rtol=0, atol=1e-9)


def test_several_self_stresses_are_refused():
    several = lattice("triangular", 4, 4)
    for refused in (
        lambda: design(several, {"B_0": 0.2}),
        lambda: optimize(several, "G_0"),
        lambda: properties(CriticalManifold(several).configuration(np.ones(48)), ["C_B"]),
    ):
        with pytest.raises(InputError, match=r"self-stress.*at least 18: prune_towards\("):
            refused()


def test_limits_of_edges_signs_and_free_edges_hold():
    found = design(MANIFOLD, {"B_0": 0.25}, within={"lengths": (0.6, 1.3)}).value
    assert found.lengths.min() > 0.6 - 1e-9 and found.lengths.max() < 1.3 + 1e-9
    some = design(MANIFOLD, {"B_0": 0.25}, free=np.arange(20)).value.sigma
    np.testing.assert_allclose(some[20:], some[20], rtol=1e-12)
    signed = design(MANIFOLD, {"B_0": 0.25}, signs="any").value
    assert elasticity(signed).value.bulk == pytest.approx(0.25, rel=1e-9)


def test_a_preference_selects():
    even = design(MANIFOLD, {"B_0": 0.25}, prefer="length_variance")
    near = design(MANIFOLD, {"B_0": 0.25}, prefer=MANIFOLD.configuration(np.exp(np.linspace(-0.5, 0.5, 90))))
    assert even.preference == pytest.approx(np.var(even.value.lengths) / np.mean(even.value.lengths) ** 2, rel=1e-6)
    assert even.preference < 0.1 * np.var(near.value.lengths) / np.mean(near.value.lengths) ** 2


@pytest.mark.parametrize(
    ("targets", "word"),
    [
        ({"B_0": 0.27, "C_B": -0.135}, "largest B_0"),
        ({"B_0": 0.25, "G_0": (0.0, 0.01), "C_B": 0.1, "C_G": -0.05}, "C_G is at least"),
        ({"B_0": upper_bound(MANIFOLD, "B_0"), "C_B": 0.0}, "every configuration"),
        ({"B_0": -0.1}, "never negative"),
    ],
)
def test_targets_that_the_theorem_of_softening_excludes_are_refused(targets, word):
    found = design(MANIFOLD, targets, throw=False)
    assert found.status is Status.infeasible and word in found.note


def test_a_search_that_ends_too_early_is_not_ok():
    few = design(MANIFOLD, {"B_0": 0.25, "C_B": 0.1}, max_steps=2, throw=False)
    assert few.status is Status.step_limit and "raise max_steps" in few.note
    few = design(MANIFOLD, {"B_0": 0.25}, prefer="length_variance", max_steps=8, throw=False)
    assert few.reached and few.status is Status.step_limit and abs(few.targets["B_0"].value - 0.25) < 1e-9


@pytest.mark.parametrize("name", POWERS)
def test_gradients_of_limits_of_edges_agree_with_differences(name):
    rng, edges = np.random.default_rng(4), np.array([3, 17, 40])
    sigma, change, limits = np.exp(0.3 * rng.normal(size=90)), rng.normal(size=90), EdgeLimits.of(name, (0.1, None), 90)
    rows = limits.rows(MANIFOLD.balance(sigma), edges)
    values = lambda s: limits.values(MANIFOLD.balance(s))[edges]  # noqa: E731
    assert_derivative(values, lambda direction: rows @ direction, sigma, [change], 1e-4, 1e-9, 1e-11)


def test_a_gradient_of_zero_is_independent_of_none():
    gram, sine = cosines(np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0], [4.0, 3.0, 0.0]]))
    np.testing.assert_allclose(gram, [[1.0, 0.0, 0.96], [0.0, 0.0, 0.0], [0.96, 0.0, 1.0]], rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(sine, [0.28, 0.0, 0.28], rtol=1e-12)


def test_bounds_exclude_targets_of_soft_networks():
    soft = CriticalManifold(NETWORK.with_stiffness(1e-8 * NETWORK.stiffness))
    largest = upper_bound(soft, "B_0")
    assert largest < 1e-8
    found = design(soft, {"B_0": 1.001 * largest}, throw=False)
    assert found.status is Status.infeasible and "bound for every stress" in found.note


@pytest.mark.parametrize(("part", "refused"), [(0.98, False), (1.02, True)])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_modulus_leaves_the_sign_of_its_stress_free(axis, part, refused):
    """The modulus of pure shear and S_xx or S_yy of the largest stress along one axis: S_xx − S_yy has either sign."""
    form = np.diag([upper_bound(MANIFOLD, "C_xxxx"), upper_bound(MANIFOLD, "C_yyyy")])
    form[0, 1] = form[1, 0] = 2 * upper_bound(MANIFOLD, "B_0") - 0.5 * np.trace(form)
    S = part * form[axis] / np.sqrt(form[axis, axis])
    along = ("S_xx", "S_yy")[axis]
    values = {"modulus[pure_shear]": (S[0] - S[1]) ** 2, along: 0.999 * S[axis] * np.sqrt(NETWORK.volume)}
    note = design(MANIFOLD, values, max_steps=0, throw=False).note
    assert ("bound" in note) is refused


def test_networks_without_moduli_have_designs_that_are_not_reached():
    """The last starts of a search need no volume, which a network of pins has only where it is named."""
    network = Network([[0, 3], [1, 3], [2, 3], [0, 4], [1, 4], [2, 4], [3, 4]], pins={0: [0, 0], 1: [4, 0], 2: [1, 3]})
    found = design(network, {"length[0]": 0.1, "length[6]": 9.0}, throw=False)
    assert found.status in (Status.not_reached, Status.step_limit) and not found.reached


def test_no_softening_beyond_that_of_the_stiffest_network_is_designed():
    network = voronoi_network(8, seed=0)
    with pytest.raises(SolveError, match="at least"):
        design(network, {"C_B": 1.001 * quantity(network, "C_B").extreme(CriticalManifold(network))[0]})
