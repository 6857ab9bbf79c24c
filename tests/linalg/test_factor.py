"""Factors of matrices with a fixed pattern: each owns its numbers, and tells a singular matrix from a lost pivot."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from eliminating import ELIMINATING
from problems import random_stress

from critflow import CriticalManifold, strain_path, voronoi_network
from critflow.sparse import QDLDL, laplacian

NETWORK = voronoi_network(300, seed=2)
RIGHT = np.random.default_rng(3).standard_normal((len(NETWORK.free), 2))


def stresses(count):
    """Stresses of both signs."""
    sigmas = [random_stress(NETWORK.n_edges, seed) for seed in range(count)]
    for sigma in sigmas:
        sigma[::9] *= -0.5
    return sigmas


@pytest.mark.parametrize("backend", ELIMINATING)
def test_every_live_factor_keeps_its_numbers(backend):
    pattern, sigmas = laplacian(NETWORK, backend), stresses(4)
    factors = [pattern.factorize(sigma) for sigma in sigmas[:2]]
    answers = [factor.solve(RIGHT) for factor in factors]
    factors += [pattern.factorize(sigma) for sigma in sigmas[2:]]
    # In turn, so that no factor is the last one.
    for _ in range(2):
        for sigma, factor in zip(sigmas, factors, strict=True):
            alone = laplacian(NETWORK, backend).factorize(sigma)
            np.testing.assert_array_equal(factor.solve(RIGHT), alone.solve(RIGHT))
            np.testing.assert_array_equal(factor.multiply(RIGHT), alone.multiply(RIGHT))
            np.testing.assert_array_equal(factor.pivots, alone.pivots)
    for factor, answer in zip(factors, answers, strict=False):
        np.testing.assert_array_equal(factor.solve(RIGHT), answer)


@pytest.mark.parametrize("backend", ELIMINATING)
def test_a_solver_serves_the_next_factor_when_its_own_is_gone(monkeypatch, backend):
    kind, further = ELIMINATING[backend], []
    another = kind.another
    monkeypatch.setattr(kind, "another", lambda *arguments: further.append(1) or another(*arguments))
    pattern, factor = laplacian(NETWORK, backend), None
    for sigma in stresses(6):
        # The last factor is there until this one is.
        factor = pattern.factorize(sigma)
    assert len(further) == 1 and factor.sound


@pytest.mark.parametrize("backend", ELIMINATING)
def test_a_released_factor_leaves_its_solver_and_eliminates_again_for_a_later_solve(monkeypatch, backend):
    kind, further = ELIMINATING[backend], []
    another = kind.another
    monkeypatch.setattr(kind, "another", lambda *arguments: further.append(1) or another(*arguments))
    pattern = laplacian(NETWORK, backend)
    first, second = stresses(2)
    factor = pattern.factorize(first)
    answer = factor.solve(RIGHT)
    factor.release()
    following = pattern.factorize(second)
    assert not further and following.sound
    np.testing.assert_array_equal(factor.solve(RIGHT), answer)
    assert len(further) == 1


def test_a_path_holds_the_numbers_of_one_hessian_at_a_time(monkeypatch):
    """Those of a network of 100,000 vertices are 230 MB."""
    further, another = [], QDLDL.another
    monkeypatch.setattr(QDLDL, "another", lambda *arguments: further.append(1) or another(*arguments))
    critical = CriticalManifold(NETWORK).configuration(random_stress(NETWORK.n_edges, 1))
    for strains in ([1e-3], [0.3]):
        assert strain_path(critical, strains).ok
    assert not further


@pytest.mark.parametrize("backend", ELIMINATING)
def test_threads_share_a_pattern(backend):
    pattern, sigmas = laplacian(NETWORK, backend), stresses(24)
    expected = [laplacian(NETWORK, backend).factorize(sigma).solve(RIGHT) for sigma in sigmas]
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda sigma: pattern.factorize(sigma).solve(RIGHT), sigmas))
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("backend", ELIMINATING)
def test_a_factor_is_sent_to_another_process_without_its_solver(backend):
    factor = laplacian(NETWORK, backend).factorize(stresses(1)[0])
    sent = pickle.loads(pickle.dumps(factor))
    np.testing.assert_array_equal(sent.solve(RIGHT), factor.solve(RIGHT))
    np.testing.assert_array_equal(sent.multiply(RIGHT), factor.multiply(RIGHT))


@pytest.mark.parametrize("backend", ELIMINATING)
def test_a_vertex_without_stress_leaves_the_others_their_answers(backend):
    # Every edge of one free vertex is slack: P has a row of zeros, and forces elsewhere have one answer up to it.
    sigma = random_stress(NETWORK.n_edges, 1)
    loose = NETWORK.free[70]
    sigma[(NETWORK.edges == loose).any(axis=1)] = 0.0
    factor = laplacian(NETWORK, backend).factorize_signed(sigma)
    assert factor.singular and factor.indefinite
    right = RIGHT.copy()
    right[70] = 0.0
    x = factor.solve(right)
    np.testing.assert_allclose(factor.multiply(x), right, rtol=0, atol=1e-12)
    assert not x[70].any()


def test_the_matrix_of_the_analysis_is_positive_definite():
    # Its elimination meets no zero, whatever the order.
    model = laplacian(NETWORK)._model().toarray()
    whole = model + np.triu(model, 1).T
    assert np.linalg.eigvalsh(whole)[0] == pytest.approx(0.01, rel=0.1)
