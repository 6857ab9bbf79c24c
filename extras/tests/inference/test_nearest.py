"""The nearest critical configuration: exact recovery, first-order conditions, standard errors, bad input."""

import numpy as np
import pytest
from problems import random_stress
from refusals import refused_changes

from critflow import CriticalManifold, SolveError, Status, lattice, voronoi_network
from critflow_extras import foam_network, nearest_critical, network_from, rigidity
from critflow_extras.inference.nearest import _Fit, _inverse_without_scale


def pinned_network(n_vertices=100):
    whole = voronoi_network(n_vertices, seed=2)
    inner = (whole.offsets == 0).all(axis=1)
    return network_from(edges=whole.edges[inner], positions=whole.positions, pins="hull").network


NETWORKS = {
    "periodic": voronoi_network(n_vertices=60, seed=1),
    "sheared": voronoi_network(n_vertices=60, seed=2).deformed([[1.0, 0.7], [0.0, 1.0]]),
    "pinned": pinned_network(),
}


@pytest.mark.parametrize("network", NETWORKS.values(), ids=NETWORKS)
@pytest.mark.parametrize("decimals", [None, 6])
def test_a_critical_configuration_is_restored_from_its_digits(network, decimals):
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, seed=3))
    x = critical.coordinates + (0 if network.pins else [0.3, -1.2])
    observed = x if decimals is None else np.round(x, decimals)
    found = nearest_critical(network, observed)
    assert found.ok and found.distance < (1e-13 if decimals is None else 4e-7)
    scale = np.exp(np.mean(np.log(critical.sigma / found.value.sigma)))
    accuracy = 1e-11 if decimals is None else 1e-4
    np.testing.assert_allclose(scale * found.value.sigma, critical.sigma, rtol=accuracy, atol=0)
    np.testing.assert_allclose(found.value.coordinates + found.translation, observed + found.displacement, atol=1e-12)


@pytest.mark.parametrize("network", NETWORKS.values(), ids=NETWORKS)
def test_no_small_change_of_the_stress_is_nearer(network):
    rng = np.random.default_rng(5)
    manifold = CriticalManifold(network)
    x = manifold.configuration(random_stress(network.n_edges, seed=3)).coordinates
    observed = x + 0.02 * rng.normal(size=x.shape)
    found = nearest_critical(manifold, observed)
    assert found.stats.residual < 1e-8

    def cost(sigma):
        apart = manifold.configuration(sigma).coordinates - observed
        apart[list(network.pins)] = 0
        return np.sum((apart - (0 if network.pins else apart.mean(axis=0))) ** 2)

    best = cost(found.value.sigma)
    assert best == pytest.approx(found.distance**2 * network.n_vertices, rel=1e-9)
    for _ in range(5):
        change = 1e-3 * rng.normal(size=network.n_edges)
        assert cost(found.value.sigma * np.exp(change)) > best


@pytest.mark.parametrize("pinned", [False, True])
def test_standard_errors_follow_from_differences_of_the_map(pinned):
    """s √diag((JᵀJ)⁺), with J = dx/dθ by differences at a fixed mean position; s from the degrees of freedom."""
    network = pinned_network(40) if pinned else voronoi_network(n_vertices=12, seed=1)
    manifold = CriticalManifold(network)
    x = manifold.configuration(random_stress(network.n_edges, seed=3)).coordinates
    observed = x + 1e-3 * np.random.default_rng(2).normal(size=x.shape)
    found = nearest_critical(manifold, observed)
    theta = np.log(found.value.sigma)

    def moved(change):
        there = manifold.configuration(np.exp(theta + change)).coordinates
        return (there if pinned else there - there.mean(axis=0)).ravel()

    J = np.stack([(moved(1e-5 * e) - moved(-1e-5 * e)) / 2e-5 for e in np.eye(network.n_edges)], axis=1)
    freedom = x.size - (0 if pinned else 2) - (network.n_edges - 1)
    error = np.sqrt(found.distance**2 * network.n_vertices / freedom) if freedom > 0 else np.nan
    assert found.error == pytest.approx(error, rel=1e-9, nan_ok=True)
    given = nearest_critical(manifold, observed, error=1e-3)
    expected = 1e-3 * np.sqrt(np.diag(np.linalg.pinv(J.T @ J, rcond=1e-9)))
    np.testing.assert_allclose(given.stress_error, expected, rtol=1e-4)
    assert np.linalg.norm(given.undetermined) == pytest.approx(1)


def test_the_limits_of_a_descent_have_a_status():
    network = lattice("honeycomb", 2, 2)
    collapsed = np.array(network.positions)
    i, j = network.edges[int(np.flatnonzero(~network.offsets.any(axis=1))[0])]
    collapsed[j] = collapsed[i]
    found = nearest_critical(network, collapsed, throw=False)
    assert found.status is Status.edge_collapse and "zero length" in found.note


@pytest.mark.parametrize("stress", [1e-8, 1e-4, 1e4])
def test_an_extreme_stress_is_found_where_positions_show_it(stress):
    found, sigma = from_noisy_positions(stress)
    assert found.ok and found.stats.steps <= 12
    np.testing.assert_allclose(found.value.sigma[7] / sigma[7], np.median(found.value.sigma / sigma), rtol=3e-3)


def test_a_stress_below_the_digits_of_the_positions_is_a_limit():
    assert not from_noisy_positions(1e-10)[0].ok


def from_noisy_positions(stress):
    """The answer for a configuration with this stress of one edge, positions of eleven digits, and its stresses."""
    network = NETWORKS["periodic"]
    sigma = random_stress(network.n_edges, seed=3)
    sigma[7] = stress
    x = CriticalManifold(network).configuration(sigma).coordinates
    observed = x + 1e-11 * np.random.default_rng(0).normal(size=x.shape)
    return nearest_critical(network, observed, throw=False), sigma


@pytest.mark.parametrize("seed", [1, 2])
def test_a_descent_towards_a_limit_ends_soon(seed):
    network = voronoi_network(400, seed=seed)
    observed = network.positions + 0.05 * np.random.default_rng(0).normal(size=network.positions.shape)
    found = nearest_critical(network, observed, throw=False)
    assert found.status is Status.edge_collapse and found.stats.steps <= 50
    assert found.distance < 0.0356


test_bad_input_is_one_sentence = refused_changes(
    lambda **changes: nearest_critical(NETWORKS["periodic"], **{"coordinates": np.zeros((60, 2))} | changes),
    ({"coordinates": np.zeros((3, 2))}, "shape"),
    ({"error": -1.0}, "positive"),
    ({"start": -np.ones(90)}, "positive"),
    ({"max_steps": -1}, "max_steps"),
)


def test_a_step_limit_is_a_status():
    network = NETWORKS["periodic"]
    observed = network.positions + 0.05 * np.random.default_rng(1).normal(size=network.positions.shape)
    limited = nearest_critical(network, observed, max_steps=1, throw=False)
    assert limited.status is Status.step_limit and limited.stats.residual > 1e-6
    with pytest.raises(SolveError, match="did not end in 1 steps"):
        nearest_critical(network, observed, max_steps=1)


@pytest.mark.parametrize("decades", [2, 10, 40])
def test_uncertainties_are_those_of_the_pseudoinverse(decades):
    # With equal changes of log σ as null vector; eigenvectors take over where a Cholesky factor does not exist.
    m, rng = 30, np.random.default_rng(1)
    basis = np.linalg.qr(np.column_stack([np.ones(m), rng.standard_normal((m, m - 1))]))[0][:, 1:]
    values = np.logspace(0, -decades, m - 1)
    variances, weakest = _inverse_without_scale((basis * values) @ basis.T)
    exact = np.sum(basis**2 / values, axis=1)
    assert np.isfinite(variances).all() and (variances > 0).all()
    if decades < 40:
        np.testing.assert_allclose(variances, exact, rtol=10.0 ** (decades - 14))
        assert abs(weakest @ basis[:, -1]) == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("make", [voronoi_network, foam_network])
def test_positions_in_balance_need_no_step(make, monkeypatch):
    network = make(200, seed=1)
    step, ridges = _Fit._step, []

    def observed(fit, here, damping, ridge):
        ridges.append(ridge)
        return step(fit, here, damping, ridge)

    # Positions close to balance need no regularisation.
    monkeypatch.setattr(_Fit, "_step", observed)
    noise = 1e-8 * np.random.default_rng(0).normal(size=network.positions.shape)
    assert nearest_critical(network, network.positions + noise).ok and ridges and not any(ridges)
    monkeypatch.setattr(_Fit, "_step", lambda *arguments: pytest.fail("a system was factorised"))
    found = nearest_critical(network, network.positions)
    assert found.stats.steps == 0 and found.distance < 1e-12


@pytest.mark.parametrize("decimals", [5, 6, 8, 10])
def test_a_configuration_that_a_file_has_rounded_is_restored(decimals):
    network = voronoi_network(100, seed=4)
    rounded = np.round(network.positions, decimals)
    assert "nearest_critical" in rigidity(network, rounded).reason
    restored = nearest_critical(network, rounded).value
    assert rigidity(network, restored.coordinates).ok
