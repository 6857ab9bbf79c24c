"""Every installed sparse solver against dense algebra: solutions, inertia and verdicts are the same whoever solves."""

import numpy as np
import pytest
from eliminating import ELIMINATING
from problems import random_stress

from critflow import CriticalManifold, InputError, voronoi_network
from critflow import sparse as backends
from critflow.sparse import BACKENDS, CROSSOVER, FixedPattern, available_backends, block_laplacian, choose_backend

INSTALLED = tuple(ELIMINATING)


def sparse_symmetric(size, seed):
    """About five entries a row, of both signs."""
    rng = np.random.default_rng(seed)
    A = np.where(rng.random((size, size)) < 2.5 / size, rng.standard_normal((size, size)), 0.0)
    return A + A.T


definite = sparse_symmetric(60, 1)
REGULAR = {
    "one number": np.array([[-2.0]]),
    "diagonal": np.diag([3.0, -1.0, 2.0, 5.0]),
    "small pivot": np.diag([1.0, 1e-10]),
    "dense and definite": definite[:8, :8] @ definite[:8, :8] + np.eye(8),
    "sparse and definite": definite + np.diag(1.0 + np.abs(definite).sum(axis=1)),
    "indefinite, dominant": definite + np.diag((-1.0) ** np.arange(60) * (1.0 + np.abs(definite).sum(axis=1))),
    "indefinite": sparse_symmetric(80, 2) + np.diag(np.random.default_rng(6).standard_normal(80)),
    "quasi-definite": np.block([[np.eye(20), definite[:20, 20:60]], [definite[20:60, :20], -0.1 * np.eye(40)]]),
}
# All of them have a vanishing or lost pivot on every ordering; the second and the third are not singular.
WITHOUT_PIVOTS = {
    "ones": np.ones((2, 2)),
    "zero diagonal": np.array([[0.0, 1.0], [1.0, 0.0]]),
    "zero diagonal of three": np.array([[0.0, 1.0, 2.0], [1.0, 0.0, 3.0], [2.0, 3.0, 0.0]]),
    "zero": np.zeros((3, 3)),
    "a row of zeros": np.diag([1.0, 0.0, 2.0]),
    "lost in rounding": np.array([[1.0, 1.0], [1.0, 1.0 + 1e-16]]),
    "below rounding": np.diag([1.0, -1e-20]),
    "low rank": np.outer(np.arange(1.0, 5), np.arange(1.0, 5)) + np.ones((4, 4)),
    "ring of springs, free to move": 2 * np.eye(9) - np.roll(np.eye(9), 1, 0) - np.roll(np.eye(9), -1, 0),
    "not a number": np.array([[1.0, np.nan], [np.nan, 1.0]]),
    "infinite": np.diag([1.0, np.inf]),
}


def pattern_of(A, backend):
    """The pattern of a dense symmetric matrix, and its values."""
    rows, cols = np.nonzero(np.triu(A != 0))
    pattern = FixedPattern(len(A), len(rows), [(rows, cols, np.arange(len(rows)), 1.0)], backend)
    return pattern, A[rows, cols]


def factor_of(A, backend):
    pattern, values = pattern_of(A, backend)
    return pattern.factorize(values)


@pytest.mark.parametrize("matrix", REGULAR)
@pytest.mark.parametrize("backend", INSTALLED)
def test_solutions_and_inertia(backend, matrix):
    A = REGULAR[matrix]
    pattern, values = pattern_of(A, backend)
    factor = pattern.factorize(values)
    assert pattern.backend == backend
    assert factor.sound and not factor.singular
    assert factor.n_negative == np.count_nonzero(np.linalg.eigvalsh(A) < 0)
    assert factor.indefinite == (factor.n_negative > 0)
    assert len(factor.pivots) == len(A)
    # |det A| is the product of the pivots, in any order.
    assert np.sum(np.log(np.abs(factor.pivots))) == pytest.approx(np.linalg.slogdet(A)[1], rel=1e-9, abs=1e-9)
    right = np.random.default_rng(7).standard_normal((len(A), 3))
    x = np.linalg.solve(A, right)
    # Without pivoting an indefinite matrix loses what its elimination grows, here below a factor of 1000.
    atol = 1e3 * np.linalg.cond(A) * np.finfo(float).eps * np.abs(x).max()
    np.testing.assert_allclose(factor.solve(right), x, rtol=0, atol=atol)
    np.testing.assert_allclose(factor.multiply(x), right, rtol=0, atol=atol * np.abs(A).sum(axis=1).max())
    for column in range(3):
        np.testing.assert_array_equal(factor.solve(right[:, column]), factor.solve(right)[:, column])


@pytest.mark.parametrize("matrix", WITHOUT_PIVOTS)
@pytest.mark.parametrize("backend", INSTALLED)
def test_a_lost_pivot_is_told(backend, matrix):
    A = WITHOUT_PIVOTS[matrix]
    factor = factor_of(A, backend)
    assert factor.singular and factor.indefinite
    if matrix in {"zero diagonal", "zero", "a row of zeros", "not a number"}:
        assert not factor.sound
    if matrix in {"zero", "ones", "not a number", "infinite"} and backend != "qdldl":
        # It stops without a word, and leaves the verdict to its pivots.
        assert np.isnan(factor.solve(np.ones(len(A)))).all()


@pytest.mark.parametrize("backend", INSTALLED)
def test_a_vanishing_pivot_of_a_regular_matrix(backend):
    pattern, values = pattern_of(WITHOUT_PIVOTS["zero diagonal"], backend)
    factor = pattern.factorize_signed(values)
    assert not factor.singular and factor.n_negative == 1
    np.testing.assert_allclose(factor.solve(np.array([2.0, 3.0])), [3.0, 2.0], rtol=0, atol=1e-14)


@pytest.mark.parametrize("backend", INSTALLED)
def test_a_failed_factorisation_is_forgotten(backend):
    pattern, values = pattern_of(REGULAR["sparse and definite"], backend)
    right = np.arange(float(pattern.size))
    expected = pattern.factorize(values).solve(right)
    assert pattern.factorize(np.full_like(values, np.nan)).singular
    assert pattern.factorize(0.0 * values).singular
    again = pattern.factorize(values)
    assert again.sound and not again.singular
    np.testing.assert_array_equal(again.solve(right), expected)


@pytest.mark.parametrize("sign", [1.0, -0.6], ids=["positive", "signed"])
@pytest.mark.parametrize("backend", INSTALLED)
def test_configurations_do_not_depend_on_the_solver(backend, sign):
    network = voronoi_network(500, seed=8)
    sigma = random_stress(network.n_edges, 9)
    sigma[::11] *= sign
    manifold = CriticalManifold(network, backend)
    assert CriticalManifold.of(manifold) is manifold
    assert block_laplacian(network, backend).backend == backend
    expected, solution = CriticalManifold(network, "qdldl").solve(sigma), manifold.solve(sigma)
    assert solution.status is expected.status
    assert solution.negative_pivots == expected.negative_pivots
    # Mixed signs make P ill-conditioned (10⁴ here); residuals are at rounding for both.
    np.testing.assert_allclose(solution.value.coordinates, expected.value.coordinates, rtol=0, atol=1e-9)
    assert solution.value.residual < 1e-11


@pytest.fixture
def alone(monkeypatch):
    """Without the solvers of critflow-extras."""
    monkeypatch.setattr(backends, "has_extras", bool)


@pytest.mark.parametrize("in_space", [False, True])
def test_the_choice_by_size(alone, in_space):
    assert set(available_backends()) == {"qdldl", "superlu"}
    for n_entries in np.logspace(0, 8, 200).astype(int):
        best = "qdldl" if n_entries <= CROSSOVER[in_space] else "superlu"
        assert choose_backend("auto", n_entries, in_space) == best
    for name in BACKENDS:
        assert choose_backend(name, 5) == choose_backend(name, 10**8) == name


def test_what_is_missing_is_said(alone):
    for name in ("pardiso", "pyamg", "umfpack"):
        with pytest.raises(InputError, match=rf"'{name}' is installed.*'auto' or one of qdldl.*critflow-extras\[fast,"):
            CriticalManifold(voronoi_network(20, seed=1), name)
