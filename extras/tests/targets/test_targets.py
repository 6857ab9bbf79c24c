"""Design for targets: reached to rounding, infeasible ones refused by bounds, multipliers against differences."""

import re

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
    elasticity,
    lattice,
    optimize,
    stiffening,
    upper_bound,
    voronoi_network,
)
from critflow_extras import design, properties
from critflow_extras.targets.problem import POWERS, EdgeLimits, parse_targets
from critflow_extras.targets.refusals import refusal_of
from critflow_extras.targets.targets import cosines

MANIFOLD = CriticalManifold(voronoi_network(n_vertices=60, seed=1))
NETWORK = MANIFOLD.network


def stress_of(critical):
    S = (critical.sigma[:, None] * critical.bond_vectors).T @ critical.bond_vectors
    return S / np.sqrt(np.sum(critical.sigma**2 * critical.lengths**2 / critical.network.stiffness))


def measured(critical):
    """B_0, C_B, C_G and the components of S/√D."""
    exact, S = stiffening(critical, throw=False).value, stress_of(critical)
    return {"B_0": exact.bulk_0, "C_B": exact.C_B, "C_G": exact.C_G, "S_xx": S[0, 0], "S_yy": S[1, 1], "S_xy": S[0, 1]}


def response_of(sigma, scale=1.0):
    """The components of S/√D of a stress as targets."""
    return {name: scale * x for name, x in measured(MANIFOLD.configuration(sigma)).items() if name.startswith("S_")}


# Targets, and the signs of the stresses.
REACHED = {
    "a linear response": (response_of(np.exp(0.3 * np.random.default_rng(1).normal(size=90))), "positive"),
    "a signed response": ({"S_xx": 3.0, "S_yy": -1.0, "S_xy": 0.0}, "any"),
    "moduli and growth": ({"B_0": 0.25, "C_B": 0.1, "C_G": 0.3}, "positive"),
    "stresses of both signs": ({"B_0": 0.25}, "any"),
}


@pytest.mark.parametrize("name", REACHED)
def test_targets_are_reached(name):
    targets, signs = REACHED[name]
    found = design(MANIFOLD, targets, signs=signs)
    values = measured(found.value)
    assert {name: values[name] for name in targets} == pytest.approx(targets, rel=1e-9, abs=1e-10)
    assert {name: one.value for name, one in found.targets.items()} == pytest.approx(targets, rel=1e-10, abs=1e-10)
    assert found.independent and found.stats.residual < 1e-10


SOFT = CriticalManifold(NETWORK.with_stiffness(1e-8 * NETWORK.stiffness))
SMALL = CriticalManifold(voronoi_network(8, seed=0))
BOUND = upper_bound(MANIFOLD, "B_0")
FORTH, BACK = "local[3-30,5-20]", "local[5-20,3-30]"
# Targets that no stress has, and the word of the sentence.
EXCLUDED = {
    "a bound": (MANIFOLD, {"bulk_modulus": 1.001 * BOUND}, f"{BOUND:.8g}"),
    "a bound of soft springs": (SOFT, {"B_0": 1.001 * upper_bound(SOFT, "B_0")}, "bound for every stress"),
    # Each is below its bound, their ellipse is left by a third.
    "an ellipse": (MANIFOLD, {"B_0": 0.27, "G_0": 0.2}, "together"),
    "a response": (MANIFOLD, response_of(np.ones(90), 1.01), "factor of 1.01"),
    "a response of compression": (MANIFOLD, REACHED["a signed response"][0], "signs='any'"),
    "the stiffest": (MANIFOLD, {"B_0": BOUND, "C_B": 0.0}, "every configuration"),
    "two responses of the same pairs": (MANIFOLD, {FORTH: 2.0, BACK: 2.0}, "product"),
    "two responses of opposite signs": (MANIFOLD, {FORTH: (0.1, 3.0), "local[20-5,3-30]": (-2.0, -0.1)}, "product"),
    "one response alone that vanishes": (MANIFOLD, {FORTH: 0.0, BACK: 2.0}, "vanish together"),
    "a negative modulus": (MANIFOLD, {"B_0": -0.1}, "never negative"),
    "softening": (MANIFOLD, {"B_0": 0.27, "C_B": -0.135}, "largest B_0"),
    "softening in shear": (MANIFOLD, {"B_0": 0.25, "G_0": (0.0, 0.01), "C_B": 0.1, "C_G": -0.05}, "C_G is at least"),
    "the largest softening": (SMALL, {"C_B": -0.5005 * upper_bound(SMALL, "B_0")}, "at least"),
}


@pytest.mark.parametrize("signs", [(1, 1), (-1, -1)])
def test_responses_of_two_pairs_that_a_stress_may_have_are_not_refused(signs):
    for limits in ((0.5, (1.0, 3.0)), ((0.5, 3.0), 1.9), (0.0, 0.0), (1.0, 1.0)):
        sides = [tuple(sorted(sign * np.broadcast_to(one, 2))) for sign, one in zip(signs, limits, strict=True)]
        found = parse_targets(NETWORK, dict(zip((FORTH, BACK), sides, strict=True)))
        assert refusal_of(MANIFOLD, found, True) == ""


@pytest.mark.parametrize("name", EXCLUDED)
def test_targets_that_no_stress_has_are_refused(name):
    manifold, targets, word = EXCLUDED[name]
    found = design(manifold, targets, throw=False)
    assert found.status is Status.infeasible and word in found.note
    with pytest.raises(SolveError, match=re.escape(word)):
        design(manifold, targets)


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


def test_a_preference_selects():
    even = design(MANIFOLD, {"B_0": 0.25}, prefer="length_variance")
    near = design(MANIFOLD, {"B_0": 0.25}, prefer=MANIFOLD.configuration(np.exp(np.linspace(-0.5, 0.5, 90))))
    assert even.preference == pytest.approx(np.var(even.value.lengths) / np.mean(even.value.lengths) ** 2, rel=1e-6)
    assert even.preference < 0.1 * np.var(near.value.lengths) / np.mean(near.value.lengths) ** 2


@pytest.mark.parametrize("n_vertices", [40, 200])
def test_the_nearest_design_is_near_in_networks_of_any_size(n_vertices):
    manifold = CriticalManifold(voronoi_network(n_vertices, seed=1))
    network = manifold.network
    stresses = np.exp(0.5 * np.random.default_rng(0).standard_normal((2, network.n_edges)))
    goal, far = map(manifold.configuration, stresses)
    # Every B_0 is allowed, so that the coordinates themselves are.
    found = design(manifold, {"B_0": (0.0, 1.0)}, prefer=goal, initial=far.sigma)
    assert found.ok and found.stats.steps > 0
    assert np.sqrt(2 * found.preference) < 5e-3 * network.spacing


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
