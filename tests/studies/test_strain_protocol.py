"""The strain protocol of the paper against the cone program, and against itself in other units."""

import numpy as np
import pytest
from problems import random_stress

from critflow import CriticalManifold, Status, critical_from_lengths, stiffening, voronoi_network
from critflow.engine import stable_rng
from workflows.shared import strain_protocol
from workflows.shared.populations import POPULATIONS, random_lengths
from workflows.shared.strain_protocol import critical_by_strain, critical_in_printed_box

NETWORK = voronoi_network(100, seed=1)
MANIFOLD = CriticalManifold(NETWORK)


def lengths(spread: float, seed: int = 0, n_edges: int = 150) -> np.ndarray:
    return 1 + spread * np.random.default_rng(seed).standard_normal(n_edges)


def walked(manifold, lengths, strain_step, x):
    """In place of the strain steps that are skipped: none."""
    return 0, x


def test_straining_converges_to_the_cone_program():
    target = lengths(0.05)
    exact = critical_from_lengths(NETWORK, target).value
    distances = []
    for threshold in (1e-6, 1e-8, 1e-10):
        solution = critical_by_strain(MANIFOLD, target, 0.1 * np.sqrt(threshold), threshold)
        assert solution.status is Status.ok
        assert solution.energy >= threshold
        assert solution.value.residual < 1e-12
        distances.append(np.abs(solution.value.lengths - exact.lengths).max())
    # Energy ∝ (strain past the transition)², and lengths are off in proportion to that strain.
    assert np.array(distances[1:]) / distances[:-1] == pytest.approx([0.1, 0.1], rel=0.15)


def test_straining_through_slack_edges():
    solution = critical_by_strain(MANIFOLD, lengths(0.3))
    sigma = solution.value.sigma
    compressed = np.flatnonzero(sigma < 0)
    assert solution.status is (Status.slack_edges if (sigma == 0).any() else Status.compressed_edges)
    assert solution.value.residual < 1e-12
    assert solution.slack_edges.tolist() == np.flatnonzero(sigma == 0).tolist()
    by_cone = critical_from_lengths(NETWORK, lengths(0.3), throw=False).slack_edges
    # A little past the transition, springs that were slack there are slightly compressed or carry none.
    assert len(compressed) and {*compressed, *solution.slack_edges} <= set(by_cone)
    L = NETWORK.bond_vectors(solution.value.coordinates)
    np.testing.assert_allclose(L, solution.value.bond_vectors, rtol=0, atol=1e-12)


@pytest.mark.parametrize("spread", [0.2, 0.3])
def test_the_state_in_the_printed_box_is_an_equilibrium_of_its_springs(spread):
    """Springs of mean rest length 1 in the square of side √N_b, by forces and energy of their own."""
    target = lengths(spread, seed=2)
    solution = critical_in_printed_box(MANIFOLD, target)
    assert solution.strain == 0
    side = np.sqrt(NETWORK.n_edges)
    L = NETWORK.bond_vectors(solution.value.coordinates) * side / np.sqrt(NETWORK.volume)
    assert np.linalg.norm(np.diag(NETWORK.cell)) * side / np.sqrt(NETWORK.volume) == pytest.approx(side * np.sqrt(2))
    length = np.linalg.norm(L, axis=1)
    sigma = 1 - target / length
    force = np.zeros((100, 2))
    np.add.at(force, NETWORK.edges[:, 1], sigma[:, None] * L)
    np.add.at(force, NETWORK.edges[:, 0], -sigma[:, None] * L)
    assert np.abs(force).max() < 1e-11
    assert np.sum((length - target) ** 2) / 2 > 0.1  # rigid from the start: the protocol stops at 1e-4
    sigma *= np.sqrt(150 / np.sum(sigma**2))
    np.testing.assert_allclose(solution.value.sigma, sigma, rtol=0, atol=1e-10)
    assert np.abs(solution.value.coordinates[0]).max() == 0
    # Without compression the stress gives the configuration and bounds on its errors.
    assert solution.status is (Status.ok if (sigma > 0).all() else Status.compressed_edges)
    assert (sigma > 0).all() == np.isfinite(solution.value.error_bound)


def test_slack_parts_in_the_printed_box_carry_exactly_nothing():
    """Edges of a part at its rest lengths: the backbone leaves them out, and C_B is that of the stressed part."""
    manifold = CriticalManifold(voronoi_network(1000, seed=1))
    rest_lengths = random_lengths(stable_rng(1, POPULATIONS["random_lengths"].stream), 1500, 0.3)
    solution = critical_in_printed_box(manifold, rest_lengths)
    sigma = solution.value.sigma
    assert solution.status is Status.slack_edges and (sigma == 0).any()
    assert np.abs(sigma[sigma != 0]).min() > 1e-9
    assert np.isfinite(stiffening(solution.value).value.C_B)


def test_skipped_steps_do_not_change_the_end(monkeypatch):
    solution = critical_by_strain(MANIFOLD, lengths(0.1), energy_threshold=1e-6)
    monkeypatch.setattr(strain_protocol, "_skipped", walked)
    step_by_step = critical_by_strain(MANIFOLD, lengths(0.1), energy_threshold=1e-6)
    assert solution.strain == step_by_step.strain > 0.05
    np.testing.assert_allclose(solution.value.sigma, step_by_step.value.sigma, rtol=0, atol=1e-11)
    assert step_by_step.energy == pytest.approx(solution.energy, rel=1e-10)


def test_a_network_that_is_rigid_at_the_start_is_not_solved_at_the_transition(monkeypatch):
    monkeypatch.setattr(strain_protocol, "_skipped", lambda *_: pytest.fail("solved for steps that are not needed"))
    assert critical_in_printed_box(MANIFOLD, lengths(0.3)).strain == 0


@pytest.mark.parametrize("unit, k", [(1e-9, 1.0), (1e6, 1.0), (1.0, 1e-9), (1e-3, 1e4)])
def test_the_strain_protocol_ends_at_the_same_strain_in_any_units(unit, k):
    network = voronoi_network(12, seed=3)
    lengths = CriticalManifold(network).configuration(random_stress(18, 2)).lengths * 1.03
    one = critical_by_strain(CriticalManifold(network), lengths)
    scaled = CriticalManifold(network.deformed(unit * np.eye(2)).with_stiffness(k))
    other = critical_by_strain(scaled, unit * lengths)
    assert other.strain == one.strain
    assert other.energy == pytest.approx(k * unit**2 * one.energy, rel=1e-9)


def test_a_strain_protocol_of_too_many_steps_ends(monkeypatch):
    monkeypatch.setattr(strain_protocol, "STRAIN_STEPS", 3)
    monkeypatch.setattr(strain_protocol, "_skipped", walked)
    network = voronoi_network(12, seed=3)
    lengths = CriticalManifold(network).configuration(random_stress(18, 2)).lengths * 1.03
    solution = critical_by_strain(CriticalManifold(network), lengths, strain_step=1e-6)
    assert solution.status is Status.step_limit
    assert "steps" in solution.reason
