"""Descents over stress: optima that are not attained, saddles, inertia, observers and limits."""

import numpy as np
import pytest
from problems import (
    Analytic,
    dense_bond_vectors,
    foam_network,
    modulus_by_formula,
    quadratic,
    random_start,
    square_octagon,
)
from scipy.optimize import minimize

from critflow import (
    CriticalManifold,
    Network,
    Quantity,
    SolveError,
    Status,
    optimize,
    quantity,
    voronoi_network,
)
from critflow.descent import Descent, improves, negative_curvature_direction, optimum_at, step_off_saddle
from critflow.minimisers import Point, lbfgs, minimise
from critflow.optima import objective_of
from critflow.quantities import evaluate, pure_shear, transition_modulus

NETWORK = voronoi_network(100, seed=1)


TWINS = Network([[0, 3], [1, 3], [2, 3], [0, 4], [1, 4], [2, 4], [3, 4]], pins={0: [0, 0], 1: [4, 0], 2: [1, 3]})


def test_vertices_that_coincide_at_equal_stresses_part():
    # Vertices 3 and 4 have the same neighbours: at σ = 1 the edge between them has neither length nor gradient.
    def variance(theta):
        length = np.linalg.norm(dense_bond_vectors(TWINS, np.exp(theta)), axis=1)
        return np.var(length) / length.mean() ** 2

    start = [0.5, 0, -0.5, -0.3, 0.4, 0.1, -1.0]
    to_the_end = {"ftol": 1e-16, "gtol": 1e-10}  # towards the infimum the gradient fades
    best = minimize(variance, start, method="L-BFGS-B", jac="3-point", bounds=[(-30, 30)] * 7, options=to_the_end).fun
    solution = optimize(TWINS, "length_variance", throw=False)
    assert solution.status is Status.slack_edges
    assert solution.objective == pytest.approx(best, abs=1e-9)


@pytest.mark.parametrize("method", ["auto", pytest.param("newton", marks=pytest.mark.sweep)])
def test_all_edges_that_fall_slack_are_listed(method):
    # Two edges of this foam fall slack, the second far more slowly.
    network = foam_network(60, seed=0)
    manifold, variance = CriticalManifold(network), quantity(network, "V_L")

    def scaled(sigma):
        there = evaluate(manifold.balance(sigma), variance)
        return 1e5 * there.value, 1e5 * there.gradient

    # The reference has stresses of zero, which their logarithms exclude.
    options = {"maxiter": 3000, "maxfun": 9000, "ftol": 1e-15, "gtol": 1e-12, "maxcor": 30}
    ones, limits = np.ones(network.n_edges), [(0, None)] * network.n_edges
    best = minimize(scaled, ones, jac=True, method="L-BFGS-B", bounds=limits, options=options)
    found = optimize(network, "V_L", method, throw=False)
    assert found.status is Status.slack_edges
    assert found.slack_edges.tolist() == np.flatnonzero(best.x == 0).tolist() and len(found.slack_edges) == 2
    assert abs(found.objective - best.fun / 1e5) <= found.uncertainty


def contracted(network: Network, collapsed: np.ndarray, centre: int) -> tuple[Network, np.ndarray]:
    """The network with edges of zero length around one vertex contracted, and +1 where an edge leaves such a leaf."""
    edges, offsets = network.edges.copy(), network.offsets.copy()
    kept = np.setdiff1d(np.arange(network.n_edges), collapsed)
    outward = []
    for edge in collapsed:
        tail, head = network.edges[edge]
        leaf, shift = (tail, network.offsets[edge]) if head == centre else (head, -network.offsets[edge])
        # x_leaf = x_centre + shift, in cells.
        outward.append(1.0 * (network.edges[kept, 0] == leaf) - 1.0 * (network.edges[kept, 1] == leaf))
        offsets[network.edges[:, 1] == leaf] += shift
        offsets[network.edges[:, 0] == leaf] -= shift
        edges[edges == leaf] = centre
    index = np.unique(edges[kept], return_inverse=True)[1].reshape(-1, 2)
    return Network(index, offsets[kept], network.cell), np.array(outward)


COLLAPSING = voronoi_network(40, seed=47, hard_core=0.65)


@pytest.mark.sweep
def test_an_infimum_with_collapsed_edges_has_their_names_and_its_value():
    solution = optimize(COLLAPSING, "tension_variance", throw=False)
    assert solution.status is Status.edge_collapse
    collapsed = solution.collapsed_edges
    np.testing.assert_array_equal(collapsed, [33, 38])
    assert "edges 33, 38 shrink to zero length" in solution.note
    # The limit: three vertices become one, and an edge without length carries the sum of the other forces on its leaf.
    centre = int(np.intersect1d(*COLLAPSING.edges[collapsed])[0])
    point, outward = contracted(COLLAPSING, collapsed, centre)

    def variance(theta):
        sigma = np.exp(theta)
        force = sigma[:, None] * dense_bond_vectors(point, sigma)
        tension = np.concatenate([np.linalg.norm(force, axis=1), np.linalg.norm(outward @ force, axis=1)])
        return np.mean(tension**2) / np.mean(tension) ** 2 - 1

    start = np.log(np.delete(solution.value.sigma, collapsed))
    found = minimize(variance, start, method="L-BFGS-B", options={"ftol": 1e-14, "gtol": 1e-9, "maxfun": 20000})
    limit = solution.objective
    # Descent by finite differences, and a collapse stopped at 1e-4 of the mean length, agree to 1e-7.
    assert limit == pytest.approx(found.fun, abs=1e-7)
    assert abs(limit - found.fun) < solution.uncertainty < 1e-4
    # The configuration returned is the last accurate one, slightly above the infimum.
    assert solution.value.residual < 1e-12
    tension = solution.value.tensions
    assert limit < np.mean(tension**2) / np.mean(tension) ** 2 - 1 < limit + 1e-3
    with pytest.raises(SolveError, match="edges 33, 38 shrink to zero length"):
        optimize(COLLAPSING, "tension_variance")


@pytest.mark.parametrize("method", ["lbfgs", pytest.param("newton", marks=pytest.mark.sweep)])
def test_a_collapse_has_one_value_and_its_edges_by_every_method_and_start(method):
    expected = optimize(COLLAPSING, "tension_variance", throw=False).objective
    solution = optimize(COLLAPSING, "tension_variance", method, start=random_start(1, 60) + 0.1, throw=False)
    assert solution.status is Status.edge_collapse
    assert solution.objective == pytest.approx(expected, abs=1e-7)
    # An edge that still grows to an ordinary length may be named in addition.
    assert {33, 38} <= set(solution.collapsed_edges.tolist()) and not len(solution.slack_edges)
    assert 0 < solution.uncertainty < 1e-4 and np.isnan(solution.gap) and solution.saddles is None
    assert "other starts may have a better one" in solution.note


ORDINARY = voronoi_network(20, seed=3)


@pytest.mark.parametrize("first", [1e13, 1e6, 1e4, 1e-13, 1e-300])
@pytest.mark.parametrize("method", ["lbfgs", "newton"])
@pytest.mark.parametrize("goal, best", [("tension_variance", 0.014889722112887), ("length_variance", 0.0)])
def test_a_start_with_a_stress_far_from_the_others_reaches_the_minimum(goal, best, method, first):
    start = np.ones(ORDINARY.n_edges)
    start[0] = first
    assert optimize(ORDINARY, goal, method, start=start).objective == pytest.approx(best, abs=1e-14)


@pytest.mark.parametrize("first", [1e13, 1e6, 1e-13, 1e-300])
def test_a_start_beyond_the_barrier_of_the_shear_modulus_returns(first):
    start = np.ones(ORDINARY.n_edges)
    start[0] = first
    # Two local optima.
    value = optimize(ORDINARY, "shear_modulus", "newton", start=start).objective
    assert min(abs(value - 0.071178054), abs(value - 0.066534946)) < 1e-8


def test_a_long_step_from_an_ordinary_start_leads_to_no_infimum():
    network = voronoi_network(16, seed=3, hard_core=0.65)
    start = np.abs(np.random.default_rng([16, 3]).standard_normal(network.n_edges))
    solution = optimize(network, "tension_variance", start=start, throw=False)
    # The descent reaches the value of the start σ = 1; rounding may end it before the tolerance.
    assert solution.status in (Status.ok, Status.stalled)
    assert solution.objective == pytest.approx(optimize(network, "tension_variance").objective, abs=1e-12)


@pytest.mark.parametrize("seed", [1, 3, 4])
def test_fire_does_not_cross_the_barrier(seed):
    # It has no line search; without a limit on its moves the first one crosses the barrier.
    start = random_start(seed) + 0.05
    by_fire = optimize(NETWORK, "shear_modulus", "fire", start=start, throw=False)
    assert by_fire.status is Status.ok
    expected = optimize(NETWORK, "shear_modulus", "lbfgs", start=start).objective
    assert by_fire.objective == pytest.approx(expected, rel=1e-12)


def largest_curvature(manifold, goal, x):
    """Largest curvature of the objective in log σ, relative to the largest magnitude, by differences of gradients."""
    sign = 1.0 if goal.maximise else -1.0

    def gradient(theta):
        sigma = np.exp(theta - theta.mean())
        return sigma * evaluate(manifold.balance(sigma), goal).gradient

    steps = 1e-5 * np.eye(len(x))
    hessian = np.array([gradient(x + step) - gradient(x - step) for step in steps]) / 2e-5
    curvatures = np.linalg.eigvalsh(sign * (hessian + hessian.T) / 2)
    return curvatures[-1] / np.abs(curvatures).max()


@pytest.mark.parametrize(
    "n_vertices, seed, threshold, method", [(20, 5, 0.03, "auto"), (20, 5, 0.03, "newton"), (16, 0, 0.03, "lbfgs")]
)
def test_a_descent_leaves_saddles(n_vertices, seed, threshold, method):
    manifold = CriticalManifold(voronoi_network(n_vertices, seed))
    goal = objective_of(manifold.network, "shear_modulus", 0.03)
    # The descent from σ = 1 ends where the modulus is stationary and has a direction of positive curvature.
    alone = minimise(Descent(manifold, goal), lbfgs, np.zeros(manifold.network.n_edges), 1e-12, 3_000)[0]
    assert alone.residual < 1e-12
    assert largest_curvature(manifold, goal, alone.x) > 1e-3
    solution = optimize(manifold, goal, method)
    assert solution.saddles == 1
    assert solution.objective > -alone.value * (1 + 1e-3)
    assert largest_curvature(manifold, goal, np.log(solution.value.sigma)) < 1e-6
    # Vertices with the same neighbours are a symmetry of the start, which leads to the saddle at rough tolerances too.
    assert optimize(manifold, goal, method, tolerance=1e-10).saddles == 1


@pytest.mark.parametrize("more", [0, 2])
def test_the_steps_to_a_saddle_count_in_the_limit(more):
    manifold = CriticalManifold(voronoi_network(16, 0))
    goal = objective_of(manifold.network, "shear_modulus", 0.03)
    there = minimise(Descent(manifold, goal), lbfgs, np.zeros(manifold.network.n_edges), 1e-12, 3_000)[2]
    seen = []
    limited = optimize(
        manifold,
        goal,
        "lbfgs",
        max_steps=there + more,
        observe=lambda step, value, sigma, L: seen.append(step),
        throw=False,
    )
    assert (limited.status, limited.stats.steps, limited.saddles) == (Status.step_limit, there + more, 1)
    assert seen == list(range(there + more))


def test_a_saddle_at_a_rough_tolerance_is_an_end():
    manifold = CriticalManifold(voronoi_network(16, 0))
    goal = objective_of(manifold.network, "shear_modulus", 0.03)
    rough = optimize(manifold, goal, "lbfgs", tolerance=1e-4)
    assert rough.ok and rough.saddles is None
    assert largest_curvature(manifold, goal, np.log(rough.value.sigma)) > 1e-3


# Saddles of functions with a known direction


def saddle(negative, n=12):
    """x⁴/4 − `negative` x²/2 in one hidden direction v, ½ x² to 50 x² in the others: a saddle at zero."""
    Q = np.linalg.qr(np.random.default_rng(2).standard_normal((n, n)))[0]
    v, curvatures = Q[:, 0], np.geomspace(1, 100, n)
    curvatures[0] = -negative
    A = Q @ np.diag(curvatures) @ Q.T
    A = 0.5 * (A + A.T)
    function = Analytic(
        lambda x: 0.5 * x @ A @ x + (v @ x) ** 4 / 4,
        lambda x: A @ x + (v @ x) ** 3 * v,
        lambda x: A + 3 * (v @ x) ** 2 * np.outer(v, v),
    )
    return function, v


@pytest.mark.parametrize("negative", [1.0, 0.1])
def test_a_direction_of_negative_curvature(negative):
    function, _ = saddle(negative)
    point = function.at(np.zeros(12))
    direction = negative_curvature_direction(function, point)
    curvature = direction @ function.hessian_product(point, direction) / (direction @ direction)
    # Twelve products resolve the whole spectrum.
    assert curvature == pytest.approx(-negative, rel=1e-6)
    assert step_off_saddle(function, point, direction).value < point.value


def test_minima_and_flat_directions_have_none():
    function, _, minimum = quadratic()
    assert negative_curvature_direction(function, function.at(minimum)) is None
    # Twenty products decide, however many unknowns there are.
    large, (_, _, centre), taken = quadratic(60)[0], quadratic(60), []
    product = large.hessian_product
    large.hessian_product = lambda point, direction: taken.append(point) or product(point, direction)
    assert negative_curvature_direction(large, large.at(centre)) is None and len(taken) == 20
    # Curvatures below 1e-6 of the largest are rounding, and those below ten times the gradient too.
    for negative, distance in ((0.0, 0.0), (1e-6, 0.0), (1e-3, 1e-3)):
        flat, direction = saddle(negative)
        x = distance * np.linalg.qr(np.column_stack([direction, np.ones(12)]))[0][:, 1]
        assert negative_curvature_direction(flat, flat.at(x)) is None


def test_the_known_diagonal_does_not_hide_a_direction():
    # A diagonal of 1e8 on all but one coordinate: twenty products of H alone see nothing else.
    n = 40
    diagonal = np.full(n, 1e8)
    diagonal[7] = 0.0
    H = np.diag(diagonal + np.where(np.arange(n) == 7, -1.0, 1.0))
    function = Analytic(lambda x: 0.5 * x @ H @ x, lambda x: H @ x, lambda x: H, diagonal)
    direction = negative_curvature_direction(function, function.at(np.zeros(n)))
    assert direction is not None
    assert direction @ H @ direction < 0


# Of two ends, the better


@pytest.mark.parametrize(
    "first, value, again, other, better",
    [
        (Status.stalled, 1.0, Status.ok, 2.0, True),
        (Status.ok, 1.0, Status.stalled, 0.5, False),
        (Status.stalled, 1.0, Status.stalled, 0.5, True),
        (Status.stalled, 1.0, Status.stalled, 2.0, False),
        (Status.singular, np.inf, Status.stalled, np.inf, True),
        # An infimum that is only approached: within the sum of the gradient, 0.3, a minimum is no worse, another
        # approach no better.
        (Status.edge_collapse, 1.0, Status.ok, 1.2, True),
        (Status.edge_collapse, 1.0, Status.ok, 1.4, False),
        (Status.edge_collapse, 1.0, Status.slack_edges, 0.8, False),
        (Status.edge_collapse, 1.0, Status.slack_edges, 0.6, True),
    ],
)
def test_the_better_of_two_ends(first, value, again, other, better):
    def end(status, value):
        return Point(np.zeros(3), value, np.array([0.1, -0.1, 0.1]), 0.1), status, 1

    assert improves(end(again, other), end(first, value)) == better


def test_the_stress_that_fades_before_others_have_converged_is_named():
    descent = Descent(CriticalManifold(NETWORK), quantity(NETWORK, "V_tau"))
    x = descent.unknowns(np.ones(NETWORK.n_edges))
    x[7] = np.log(1e-14)
    found = optimum_at(descent, (descent.at(x), Status.stalled, 3), None, "lbfgs")
    assert found.status is Status.stalled and "that of edge 7 first" in found.reason


def test_a_descent_that_stalls_at_an_edge_too_short_returns_the_last_sound_configuration():
    descent = Descent(CriticalManifold(NETWORK), quantity(NETWORK, "V_tau"))
    sound = descent.at(descent.unknowns(np.linspace(0.9, 1.1, NETWORK.n_edges)))
    assert descent.monitor(sound) is None
    # Its length is that of its tension over its stress; no stress has faded.
    end, short = (descent.at(np.where(np.arange(len(sound.x)) == 7, np.log(s), sound.x)) for s in (1e9, 1e3))
    assert np.argmin(np.linalg.norm(end.state.balance.bond_vectors, axis=1)) == 7
    found, other, early = (
        optimum_at(descent, (point, status, 3), None, "lbfgs")
        for point, status in ((end, Status.stalled), (short, Status.stalled), (end, Status.step_limit))
    )
    assert found.status is Status.stalled and found.objective == end.value
    np.testing.assert_array_equal(found.value.sigma, sound.state.balance.sigma)
    assert found.note == f"edges become too short to resolve as the value falls to {end.value:.6g}: try another start"
    # An edge that is only short, or a descent that has not stalled, says something else.
    assert "too short" not in other.note + early.note


@pytest.mark.parametrize("stress, status", [(1e-19, None), (1e-21, Status.stalled)])
def test_a_descent_ends_where_a_stress_is_not_resolved(stress, status):
    """Though the others have not converged, so that its limit is not known."""
    descent = Descent(CriticalManifold(NETWORK), quantity(NETWORK, "V_tau"))
    assert descent.monitor(descent.at(np.where(np.arange(NETWORK.n_edges) == 7, np.log(stress), 0.0))) is status


def test_ends_that_rough_tolerances_leave_untested():
    network = voronoi_network(40, seed=1)
    assert [optimize(network, "V_tau", tolerance=t).saddles for t in (1e-4, 1e-10, 1e-12)] == [None, None, 0]


@pytest.mark.parametrize("method", ["auto", "lbfgs"])
def test_a_start_that_meets_a_rough_tolerance_is_left(method):
    # At equal stresses G_0 is nearly zero, its least value, where the gradient vanishes too.
    network = voronoi_network(100, seed=0)
    rough = optimize(network, "G_0", method, tolerance=1e-3)
    assert rough.objective > 0.9 * optimize(network, "G_0", method).objective


@pytest.mark.parametrize("method", ["fire", "lbfgs", "newton", "auto"])
@pytest.mark.parametrize("limit", [0, 1, 3])
def test_a_step_limit_is_that_of_all_parts_together(method, limit):
    solution = optimize(ORDINARY, "tension_variance", method, max_steps=limit, throw=False)
    assert (solution.status, solution.stats.steps) == (Status.step_limit, limit)
    assert solution.value.residual < 1e-12 and "raise max_steps" in solution.reason


def test_an_observer_ends_every_part_of_a_method():
    seen = []

    def once(step, value, sigma, L):
        seen.append(step)
        return step == 2

    solution = optimize(ORDINARY, "tension_variance", "auto", observe=once, throw=False)
    assert solution.status is Status.step_limit and seen == [0, 1, 2]


def ring(n_edges):
    """Edges in line, which resist no shear."""
    edges = [[edge, (edge + 1) % n_edges] for edge in range(n_edges)]
    offsets = np.zeros((n_edges, 2), int)
    offsets[-1, 0] = 1
    return Network(edges, offsets, np.eye(2))


@pytest.mark.parametrize("method", ["auto", "lbfgs", "newton"])
@pytest.mark.parametrize(
    "network, goal",
    [(ring(2), "shear_modulus"), (ring(3), "shear_modulus")]
    + [
        (ORDINARY, transition_modulus(ORDINARY, strain)) for strain in (np.zeros((2, 2)), np.array([[0.0, 1], [-1, 0]]))
    ],
    ids=["ring of two", "ring of three", "no strain", "rotation"],
)
def test_a_modulus_that_is_always_zero_is_an_optimum(network, goal, method):
    assert optimize(network, goal, method, signs="any").objective == pytest.approx(0.0, abs=1e-30)


@pytest.mark.parametrize("method", ["lbfgs", pytest.param("newton", marks=pytest.mark.sweep), "fire"])
def test_an_ascent_over_both_signs_reports_its_path(method):
    network = voronoi_network(100, seed=1)
    path = []
    solution = optimize(
        network,
        "shear_modulus",
        method,
        signs="any",
        max_steps=300,
        observe=lambda step, value, sigma, L: path.append((step, value, sigma.copy(), L.copy())),
        throw=False,
    )
    assert solution.status is Status.step_limit
    steps, values = np.array([point[0] for point in path]), np.array([point[1] for point in path])
    np.testing.assert_array_equal(steps, np.arange(len(path)))
    if method != "fire":  # which is a dynamics with inertia
        assert (np.diff(values) >= -1e-12).all()
    assert values[-1] > 50 * values[0]
    # The reported values, stresses, bond vectors and inertias are consistent.
    negative = []
    for _, value, sigma, L in path[::20]:
        assert np.sum(sigma**2) == pytest.approx(network.n_edges, rel=1e-12)
        np.testing.assert_allclose(dense_bond_vectors(network, sigma), L, rtol=0, atol=1e-9)
        assert modulus_by_formula(network, sigma, L, pure_shear(2)) == pytest.approx(value, rel=1e-9)
    for _, _, sigma, _ in path:
        g = network.free_incidence.toarray()
        negative.append(np.count_nonzero(np.linalg.eigvalsh(g.T @ (sigma[:, None] * g)) < 0))
    assert solution.crossings == tuple(np.flatnonzero(np.diff(negative)) + 1)
    assert solution.negative_pivots == negative[-1]
    assert 0 < solution.nearest_singular < 1
    # Values grow by long edges and compressed ones.
    assert (path[-1][2] < 0).any()


class Extent(Quantity):
    """1 − (1 + Σ|L|²)^(−1/20): it grows, ever more slowly, with lengths that have no largest."""

    maximise = True

    def evaluate(self, balance):
        sigma, L = balance.sigma, balance.bond_vectors
        size = 1 + np.sum(L**2)
        return 1 - size**-0.05, (np.zeros_like(sigma), 0.1 * L * size**-1.05)


@pytest.mark.parametrize("seed", range(5))
def test_an_ascent_to_a_singular_matrix_has_a_limit(seed):
    # The square opens without end as a link's stress comes to minus that of the sides.
    network = square_octagon()
    start = np.array([1.0, 1.1, 0.9, 1.0, -0.5, 0.5]) * (1 + 1e-3 * np.random.default_rng(seed).standard_normal(6))
    values = []
    solution = optimize(
        network,
        Extent(),
        "lbfgs",
        signs="any",
        start=start,
        observe=lambda step, value, sigma, L: values.append((value, np.linalg.norm(L, axis=1).max())),
        throw=False,
    )
    assert solution.status is Status.singular
    assert solution.nearest_singular < 1e-9
    # Lengths grow by orders of magnitude while the value converges, and its limit is returned.
    (_, before), (late, after) = values[len(values) // 2], values[-1]
    assert after > 10 * before > 100 * np.sqrt(network.volume)
    assert solution.objective == late < 1
    assert "without end" in solution.note
    # The configuration is accurate and has a smaller value.
    assert solution.value.residual < 1e-6
    assert 0 < Extent().evaluate(solution.value)[0] < late


def test_a_singular_start_is_a_status():
    network = square_octagon()
    # Sides and links that pull against each other, t_x = −s: the matrix has no inverse.
    sigma = np.array([1.0, 1.0, 1.0, 1.0, -1.0, 0.5])
    solution = optimize(
        network, transition_modulus(network, np.diag([1.0, 0.0])), "lbfgs", signs="any", start=sigma, throw=False
    )
    assert solution.status is Status.singular
    assert np.isnan(solution.value.coordinates).all()
    with pytest.raises(SolveError, match="singular"):
        optimize(network, transition_modulus(network, np.diag([1.0, 0.0])), "lbfgs", signs="any", start=sigma)


class Spread(Quantity):
    """The length variance, by formulas that divide by lengths."""

    def evaluate(self, balance):
        L = balance.bond_vectors
        length = np.sqrt(np.sum(L * L, axis=1))
        mean = length.mean()
        value = np.mean((length / mean - 1) ** 2)
        by_length = 2 / (len(L) * mean) * (length / mean - 1 - value)
        return value, (np.zeros_like(length), (by_length / length)[:, None] * L)


def test_a_quantity_without_derivatives_at_an_edge_without_length_is_no_mistake():
    # At equal stresses one edge has no length; a descent starts elsewhere then.
    found = optimize(TWINS, Spread(), throw=False)
    known = optimize(TWINS, "length_variance", throw=False)
    assert found.status is known.status is Status.slack_edges
    assert found.objective == pytest.approx(known.objective, abs=1e-9)
