"""Rest lengths → critical configuration: by Newton's method from an iteration, relaxed cables or the cone program."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import NETWORKS, dense_free, voronoi_3d

from critflow import CriticalManifold, Network, SolveError, Status, critical_from_lengths, voronoi_network
from critflow import lengths as FROM_LENGTHS
from critflow.cones import fit_lengths
from critflow.engine import stable_rng

NETWORK = voronoi_network(100, seed=1)


def lengths(spread: float, seed: int = 0, n_edges: int = 150) -> np.ndarray:
    return 1 + spread * np.random.default_rng(seed).standard_normal(n_edges)


@settings(max_examples=settings.default.max_examples // 2)
@given(seed=st.integers(0, 100), n_cells=st.integers(10, 30))
def test_uniqueness_on_any_network(seed, n_cells):
    network = voronoi_network(2 * n_cells, seed=seed)
    sigma = np.exp(0.3 * np.random.default_rng(seed).standard_normal(network.n_edges))
    configuration = CriticalManifold(network).configuration(sigma)
    solution = critical_from_lengths(network, 5 * configuration.lengths)
    assert solution.status is Status.ok
    assert solution.value.residual < 1e-12
    # An all-tension configuration is the only one with its length ratios, and so is its stress.
    assert solution.ratio == pytest.approx(0.2, rel=1e-9)
    np.testing.assert_allclose(solution.value.sigma, configuration.sigma, rtol=1e-8)
    np.testing.assert_allclose(solution.value.lengths, configuration.lengths, rtol=1e-11)
    assert np.ptp(solution.value.lengths / configuration.lengths) < 1e-11 and not len(solution.slack_edges)


def test_a_solution_without_rounding_has_no_error():
    cross = Network([[0, 4], [1, 4], [2, 4], [3, 4]], pins={0: [1, 0], 1: [-1, 0], 2: [0, 1], 3: [0, -1]})
    found = critical_from_lengths(cross, np.ones(4))
    np.testing.assert_array_equal(found.value.coordinates[4], [0.0, 0.0])
    assert found.ok and found.stats.error_bound < 1e-15


SLACK = {
    "lengths 0": (NETWORK, lengths(0.3, 0)),
    "lengths 1": (NETWORK, lengths(0.3, 1)),
    "voronoi 3D": (voronoi_3d(), np.ones(voronoi_3d().n_edges)),
    "pinned grid": (NETWORKS["pinned grid"](), np.ones(NETWORKS["pinned grid"]().n_edges)),
}


@pytest.mark.parametrize("name", SLACK)
def test_slack_edges_are_reported(name):
    network, target = SLACK[name]
    solution = critical_from_lengths(network, target, throw=False)
    critical, slack, n = solution.value, solution.slack_edges, network.n_edges
    assert solution.status is Status.slack_edges and len(slack) > 0
    stressed = np.setdiff1d(np.arange(n), slack)
    assert (critical.sigma[slack] == 0).all() and (critical.sigma[stressed] > 0).all()
    ratio = critical.lengths / target
    np.testing.assert_allclose(ratio[stressed], ratio[stressed].mean(), rtol=1e-11)
    # A slack edge is shorter than its target, and its rest length is known.
    assert (ratio[slack] < ratio[stressed].mean() * (1 + 1e-9)).all()
    np.testing.assert_allclose(critical.rest_lengths, ratio[stressed].mean() * target, rtol=1e-9)
    force = dense_free(network)[0].T @ (critical.sigma[:, None] * critical.bond_vectors)
    assert np.abs(force).max() < 1e-12 * np.abs(critical.tensions).mean()
    np.testing.assert_allclose(network.bond_vectors(critical.coordinates), critical.bond_vectors, rtol=0, atol=1e-12)
    assert f"{len(slack)} of {n} edges are slack, edge {slack[0]}" in solution.note
    with pytest.raises(SolveError, match="slack"):
        critical_from_lengths(network, target)


@pytest.mark.parametrize(
    "n_vertices, spread, seed, slack, tolerances",
    [(100, 0.05, 0, False, []), (100, 0.1, 14, True, []), (100, 0.3, 0, True, [1e-12]), (30, 0.0, 4, True, [])],
)
def test_the_cone_program_is_solved_for_many_slack_edges_only(monkeypatch, n_vertices, spread, seed, slack, tolerances):
    requested = []

    def fit(incidence, offsets, target, tolerance):
        requested.append(tolerance)
        return fit_lengths(incidence, offsets, target, tolerance)

    monkeypatch.setattr(FROM_LENGTHS, "fit_lengths", fit)
    network = voronoi_network(n_vertices, seed=seed)
    target = np.exp(spread * np.random.default_rng(seed).standard_normal(network.n_edges))
    solution = critical_from_lengths(network, target, throw=False)
    assert requested == tolerances
    assert solution.status is (Status.slack_edges if slack else Status.ok)


# Two cables around the cell, joined by edges that are longer.
LADDER = Network(
    *([[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [1, 3], [2, 0], [3, 1]],),
    *([[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 0], [0, 1], [0, 1]], np.diag([2.0, 2.0])),
)
FANNED = Network([[0, 3], [1, 3], [2, 3], [0, 1]], pins={0: [0, 0], 1: [4, 0], 2: [1, 3]})


@pytest.mark.parametrize(
    ("network", "target", "word", "changed", "slack"),
    [
        pytest.param(FANNED, np.ones(4), "edge 3 joins two pins", {3: 2.0}, [3], id="an edge between pins"),
        pytest.param(
            LADDER, [1, 1, 1, 1, 3, 3, 3, 3], "several separate parts", {2: 1.1}, range(2, 8), id="two cables"
        ),
        pytest.param(
            voronoi_network(4, seed=0), np.ones(6), "several separate parts", {2: 1.1}, [0, 1, 2, 5], id="equal"
        ),
    ],
)
def test_what_is_taut_alone_is_named_with_its_remedy(network, target, word, changed, slack):
    solution = critical_from_lengths(network, target, throw=False)
    assert solution.status is Status.stalled and word in solution.note
    remedied = [changed.get(edge, length) for edge, length in enumerate(target)]
    found = critical_from_lengths(network, remedied, throw=False)
    assert found.status is Status.slack_edges and found.slack_edges.tolist() == list(slack)


@pytest.mark.parametrize("shortest", [1e-9, 1e-12, 1e-20, 1e-100])
@pytest.mark.parametrize("seed", [0, 1])
def test_lengths_below_the_rounding_of_coordinates(shortest, seed):
    """No warning, and no cone program."""
    network = voronoi_network(16, seed=seed)
    for edge in (0, 7):
        lengths = np.minimum(1, 1 / (0.5 + np.random.default_rng(seed).random(24)))
        lengths[edge] = shortest
        solution = critical_from_lengths(network, lengths, throw=False)
        assert solution.status is Status.stalled
        assert f"edge {edge} is below the rounding" in solution.note
        assert np.isnan(solution.value.coordinates).all()


def test_no_slack_edge_is_longer_than_its_rest_length():
    # The first program leaves out an edge that is needed: 16 % longer than its rest length without it.
    rng = stable_rng(14, "random_lengths_wide")
    lengths = 1 + 0.3 * rng.standard_normal(1500)
    lengths[lengths <= 0] = 1 + 0.3 * rng.standard_normal((lengths <= 0).sum())
    solution = critical_from_lengths(voronoi_network(1000, 14), lengths, throw=False)
    slack = solution.value.sigma == 0
    assert solution.status is Status.slack_edges and slack.sum() == 111
    assert (solution.value.lengths[slack] <= solution.ratio * lengths[slack]).all()


def uneven(network, spread, seed):
    return np.exp(spread * np.random.default_rng(seed + 50).standard_normal(network.n_edges))


def refuse(*_arguments):
    raise AssertionError("another guess is made")


@pytest.mark.parametrize(
    ("size", "seed", "spread", "unused"),
    [
        pytest.param(400, 2, 0.15, ["newton", "fit_lengths"], id="compressed edges"),
        pytest.param(400, 2, 0.2, ["fit_lengths"], id="relaxed cables"),
        pytest.param(400, 5, 0.2, ["fit_lengths"], id="relaxed cables, other network"),
        pytest.param(800, 5, 0.16, ["fit_lengths"], id="two edges that stretch each other only together"),
    ],
)
def test_few_slack_edges_need_no_cone_program_for_its_answer(monkeypatch, size, seed, spread, unused):
    network = voronoi_network(size, seed=seed)
    lengths = uneven(network, spread, seed)
    with monkeypatch.context() as patched:
        patched.setattr(FROM_LENGTHS, "EVEN", 0.0)
        expected = critical_from_lengths(network, lengths, throw=False)
    for name in unused:
        monkeypatch.setattr(FROM_LENGTHS, name, refuse)
    found = critical_from_lengths(network, lengths, throw=False)
    assert found.status is expected.status is Status.slack_edges
    assert found.slack_edges.tolist() == expected.slack_edges.tolist()
    assert found.ratio == pytest.approx(expected.ratio, rel=1e-14)
    np.testing.assert_allclose(found.value.sigma, expected.value.sigma, rtol=1e-11, atol=1e-13)
    slack = found.slack_edges
    held = found.value.lengths[slack] <= found.ratio * lengths[slack] * (1 + 1e-8)
    assert held.all()


@pytest.mark.parametrize(("few", "programs"), [(FROM_LENGTHS.FEW, 1), (1.0, 0)])
def test_many_slack_edges_are_left_to_the_cone_program(monkeypatch, few, programs):
    network, solved, few_edges = voronoi_network(n_vertices=400, seed=6), [], FROM_LENGTHS.FEW
    lengths = uneven(network, 0.245, 6)
    fit = FROM_LENGTHS.fit_lengths
    monkeypatch.setattr(FROM_LENGTHS, "FEW", few)
    monkeypatch.setattr(FROM_LENGTHS, "fit_lengths", lambda *arguments: solved.append(1) or fit(*arguments))
    found = critical_from_lengths(network, lengths, throw=False)
    assert len(solved) == programs and len(found.slack_edges) > few_edges * network.n_edges
