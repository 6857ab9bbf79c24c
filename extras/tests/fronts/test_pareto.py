"""Fronts: certificates checked independently, points that an epsilon-constraint finds too, even spread, refusals."""

import numpy as np
import pytest
from units import UNITS, in_units

from critflow import CriticalManifold, InputError, SolveError, Status, lattice, quantity, voronoi_network
from critflow.quantities import evaluate
from critflow_extras import design, pareto, properties
from critflow_extras.fronts.pareto import dominated

MANIFOLD = CriticalManifold(voronoi_network(16, seed=1))


@pytest.fixture(scope="module")
def stiff_and_equal():
    return pareto(MANIFOLD, {"B_0": "largest", "V_L": "smallest"}, 4)


def test_every_point_satisfies_its_first_order_conditions(stiff_and_equal):
    front = stiff_and_equal
    assert front.ok and front.statuses == (Status.ok,) * 4 and (front.weights >= 0).all()
    size = np.abs(front.units)
    goals = [quantity(MANIFOLD, name) for name in ("B_0", "V_L")]
    for critical, weights, values in zip(front.value, front.weights, front.achieved, strict=True):
        stiff, equal = (evaluate(MANIFOLD.balance(critical.sigma), goal) for goal in goals)
        assert values == pytest.approx((stiff.value, equal.value), rel=1e-9)
        parts = np.array([-weights[0] / size[0] * stiff.gradient, weights[1] / size[1] * equal.gradient])
        assert np.abs(parts.sum(axis=0) * critical.sigma).max() < 1e-5 * np.abs(parts * critical.sigma).max()


def test_points_are_evenly_spread_and_none_dominates_another(stiff_and_equal):
    stiff, unequal = stiff_and_equal.achieved.T
    assert (np.diff(stiff) < 0).all() and (np.diff(unequal) < 0).all()
    size = np.abs(stiff_and_equal.units)
    steps = np.diff(stiff / size[0] + unequal / size[1])
    np.testing.assert_allclose(steps, steps.mean(), rtol=1e-6)


def test_the_same_points_follow_from_a_limit_on_one_objective(stiff_and_equal):
    stiffness, variance = stiff_and_equal.achieved[2]
    other = design(stiff_and_equal.value[2], {"B_0": (stiffness, np.inf)}, prefer="V_L")
    assert other.preference == pytest.approx(variance, rel=1e-6)


def test_a_point_of_a_worse_branch_is_found_on_the_better_one():
    network, objectives = voronoi_network(12, seed=3), {"B_0": "largest", "C_G": "largest"}
    front = pareto(network, objectives, 4, within={"force_densities": (0.2, None)})
    assert not front.dominated.any() and (np.diff(front.achieved[:, 1]) > 0).all()
    np.testing.assert_array_equal(dominated(np.array([[0, 3], [1, 1], [2, 2], [3, 0]])), [0, 0, 1, 0])


@pytest.mark.sweep
def test_a_better_end_that_a_front_contains_begins_another_front():
    network, objectives = voronoi_network(18, seed=4), {"B_0": "largest", "C_B": "largest"}
    # The end without cost of C_B stalls at a residual of 2e-5 on some processors: its place is what is tested.
    front = pareto(network, objectives, 5, within={"force_densities": (0.2, None)}, throw=False)
    assert all(status is Status.ok for status in front.statuses[1:]) and front.residuals[0] < 1e-4
    # The first front has 8.0 at its end and 8.3 before it.
    assert not front.dominated.any() and front.achieved[-1, 1] > 12


def test_limits_of_edges_bound_a_front():
    network = voronoi_network(8, seed=1)
    front = pareto(network, {"V_tau": "smallest", "B_0": "smallest"}, 2, within={"force_densities": (0.7, None)})
    for critical in front.value:
        assert critical.sigma.min() >= 0.7 * critical.sigma.mean() * (1 - 1e-9)
    assert front.n_limited[1] > 0
    assert front.achieved[0, 0] == pytest.approx(properties(front.value[0], "V_tau").values["V_tau"], rel=1e-12)


def test_an_end_that_is_not_attained_says_so():
    network = voronoi_network(12, seed=0)
    front = pareto(network, {"B_0": "largest", "C_B": "largest"}, 3, max_steps=100, throw=False)
    # C_B has no limit, so that the front has its two ends only.
    assert front.statuses == (Status.ok, Status.edge_collapse) and "within=" in front.note
    assert "the end of the largest C_B is not attained, edge" in front.note
    lengths = front.value[1].lengths
    assert lengths.min() < 0.01 * lengths.mean()
    limited = pareto(network, {"B_0": "largest", "C_B": "largest"}, 3, within={"force_densities": (0.2, None)})
    assert limited.ok and len(limited.value) == 3


def test_points_towards_which_edges_shrink_are_not_attained():
    front = pareto(voronoi_network(12, seed=0), {"B_0": "smallest", "C_B": "smallest"}, 4, throw=False)
    assert set(front.statuses) <= {Status.ok, Status.edge_collapse, Status.slack_edges}
    assert front.statuses[0] is Status.edge_collapse and front.statuses[-1] is Status.ok
    # The tension of a straight loop of five edges around the cell: W²/(4 V n), with V = W².
    assert front.achieved[0, 0] == pytest.approx(1 / 20, rel=1e-6) and "not attained" in front.note


def test_objectives_without_a_limit_need_limits_of_the_edges():
    with pytest.raises(InputError, match=r"no limit.*within="):
        pareto(voronoi_network(8, seed=2), {"G_0": "largest", "C_G": "largest"}, 3, max_steps=200)


def test_bad_input_raises_one_sentence():
    for objectives, n, word in (
        ({"B_0": "largest"}, 3, "two objectives"),
        ({"B_0": "largest", "V_L": "least"}, 3, "smallest"),
        ({"B_0": "largest", "stiffness": "smallest"}, 3, "stiffness"),
        ({"B_0": "largest", "bulk_modulus": "smallest"}, 3, "same quantity"),
        (["B_0", "B_0"], 3, "same quantity"),
        ({"B_0": "largest", "C_B": "smallest"}, 3, "same best"),
        ({"B_0": "largest", "V_L": "smallest"}, 1, "ends"),
    ):
        with pytest.raises(InputError, match=word):
            pareto(MANIFOLD, objectives, n)
    stopped = pareto(MANIFOLD, {"B_0": "largest", "V_L": "smallest"}, 3, max_steps=2, throw=False)
    assert stopped.status is Status.step_limit and not stopped.ok


def test_the_front_of_a_soft_network_is_that_of_a_stiff_one(stiff_and_equal):
    network = MANIFOLD.network
    soft = CriticalManifold(network.with_stiffness(1e-8 * network.stiffness))
    front = pareto(soft, {"B_0": "largest", "V_L": "smallest"}, 4)
    np.testing.assert_allclose(front.achieved, stiff_and_equal.achieved * [1e-8, 1.0], rtol=1e-6, atol=1e-15)


def test_the_reason_of_an_incomplete_front_names_its_own_arguments():
    with pytest.raises(SolveError, match=r"give another start|raise max_steps|within=") as caught:
        pareto(voronoi_network(100, seed=7), ["B_0", "G_0"], 2)
    assert "method" not in str(caught.value)


@pytest.mark.parametrize(("stiffness", "length"), UNITS)
def test_fronts_are_the_same(stiffness, length):
    planar, goals = voronoi_network(40, seed=3), {"B_0": "largest", "V_tau": "smallest"}
    plain, scaled = (pareto(one, goals, 4) for one in (planar, in_units(planar, stiffness, length)))
    np.testing.assert_allclose(scaled.achieved, plain.achieved * [stiffness, 1.0], rtol=1e-10)
    np.testing.assert_allclose(scaled.weights, plain.weights, rtol=1e-6)


def test_several_self_stresses_are_refused():
    with pytest.raises(InputError, match=r"self-stress.*prune_towards\("):
        pareto(lattice("triangular", 4, 4), ["B_0", "V_L"])
