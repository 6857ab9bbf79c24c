"""Multigrid: configurations and bounds as by elimination; refusals or another solver where it cannot serve."""

import numpy as np
import pytest
import scipy.sparse as sp
from eliminating import ELIMINATING
from problems import random_stress

from critflow import CriticalManifold, InputError, Status, sparse, voronoi_network
from critflow.sparse import available_backends, block_laplacian, choose_backend
from critflow_extras.large import choice, multigrid, pardiso

pytest.importorskip("pyamg")

FOAM = voronoi_network(points=np.random.default_rng(1).random((400, 3)))
STRESS = random_stress(FOAM.n_edges, 2)
WEAK = np.where(np.random.default_rng(3).random(FOAM.n_edges) < 0.3, 1e-6, 1.0)
HOPELESS = 10 ** np.random.default_rng(3).uniform(-9, 9, FOAM.n_edges)
SIGNED = STRESS * np.where(np.arange(FOAM.n_edges) % 7, 1.0, -0.3)


@pytest.fixture
def chosen(monkeypatch):
    """Let "auto" choose multigrid at this size."""
    monkeypatch.setattr(sparse, "LARGE", (0, 0))
    monkeypatch.setattr(choice, "MULTIGRID", dict.fromkeys(ELIMINATING, 0))


@pytest.mark.parametrize("sigma", [np.ones(FOAM.n_edges), STRESS, WEAK], ids=["equal", "random", "weak bonds"])
def test_configurations_and_bounds_are_those_of_elimination(sigma):
    manifold, other = CriticalManifold(FOAM, "pyamg"), CriticalManifold(FOAM, "qdldl")
    balance, expected = manifold.balance(sigma), other.balance(sigma)
    assert balance.factor.iterates
    np.testing.assert_allclose(balance.coordinates, expected.coordinates, rtol=0, atol=1e-9)
    found, true = manifold.solve(sigma), other.solve(sigma)
    assert found.status is Status.ok and found.negative_pivots == 0
    np.testing.assert_allclose(found.value.coordinates, true.value.coordinates, rtol=0, atol=2e-14)
    assert found.stats.error_bound == pytest.approx(true.stats.error_bound, rel=0.01)
    np.testing.assert_allclose(found.value.bond_errors, true.value.bond_errors, rtol=0.5)


def test_equal_matrices_have_equal_levels():
    """Random numbers in their making would give other bits in every run."""
    network = voronoi_network(points=np.random.default_rng(4).random((2000, 3)))
    sigma = random_stress(network.n_edges, 5)
    balances = [CriticalManifold(network, "pyamg").balance(sigma) for _ in range(2)]
    np.testing.assert_array_equal(balances[0].coordinates, balances[1].coordinates)


def test_what_multigrid_cannot_serve_is_refused():
    manifold = CriticalManifold(FOAM, "pyamg")
    for call in (
        lambda: manifold.solve(SIGNED),
        lambda: manifold.balance(STRESS).factor.pivots,
        lambda: block_laplacian(FOAM, "pyamg").factorize(np.ones(6 * FOAM.n_edges)),
    ):
        with pytest.raises(InputError, match=r"pyamg.*positive stresses.*'(qdldl|superlu|pardiso)'"):
            call()
    assert manifold.solve(HOPELESS).status is Status.ill_conditioned


@pytest.mark.parametrize(
    "sigma, iterates",
    [(STRESS, True), (SIGNED, False), (HOPELESS, False)],
    ids=["positive", "signed", "not convergent"],
)
def test_the_automatic_choice_serves_every_call(chosen, sigma, iterates):
    manifold = CriticalManifold(FOAM)
    other = CriticalManifold(FOAM, manifold.prestress.elimination)
    found, true = manifold.solve(sigma), other.solve(sigma)
    assert found.status is true.status is Status.ok
    assert found.negative_pivots == true.negative_pivots
    assert found.stats.error_bound == pytest.approx(true.stats.error_bound, rel=0.5)
    factor, expected = manifold.balance(sigma).factor, other.balance(sigma).factor
    assert factor.iterates is iterates
    np.testing.assert_allclose(np.log(np.abs(factor.pivots)).sum(), np.log(np.abs(expected.pivots)).sum(), rtol=1e-12)


def test_parts_without_a_fixed_vertex_are_singular(chosen):
    sigma = STRESS.copy()
    sigma[(FOAM.edges == 5).any(axis=1)] = 0.0
    assert CriticalManifold(FOAM).solve(sigma).status is Status.singular


def test_the_choice_by_dimension_and_size():
    for elimination in {"superlu", "pardiso"} & ELIMINATING.keys():
        assert choice.fastest_solver(elimination, 10**7, True, True) == "pyamg"
        assert choice.fastest_solver(elimination, 10**3, True, True) == elimination
    assert choose_backend("auto", 10**7, True, True) == "pyamg"
    for in_space, laplacian in ((True, False), (False, True)):
        assert choose_backend("auto", 10**7, in_space, laplacian) in ELIMINATING
    assert CriticalManifold(FOAM).prestress.backend != "pyamg"


def test_planar_laplacians_and_other_matrices_are_eliminated(chosen):
    assert CriticalManifold(FOAM).prestress.backend == "pyamg"
    assert block_laplacian(FOAM).backend != "pyamg"
    assert CriticalManifold(voronoi_network(30, seed=1)).prestress.backend != "pyamg"


def test_what_is_missing_is_said(monkeypatch):
    monkeypatch.setattr(multigrid, "INSTALLED", False)
    assert choose_backend("auto", 10**7, True, True) in ELIMINATING
    with pytest.raises(InputError, match=r"'pyamg' is installed: .* pip install 'critflow-extras\[fast,multigrid\]'"):
        CriticalManifold(FOAM, "pyamg")


def test_what_is_not_there_is_not_installed(monkeypatch):
    monkeypatch.setattr(multigrid, "INSTALLED", False)
    monkeypatch.setattr(pardiso, "MKL", None)
    assert tuple(available_backends()) == ("qdldl", "superlu")


@pytest.mark.parametrize(("in_space", "size"), [(False, 20_000), (True, 3_000)])
def test_pardiso_takes_matrices_above_its_size(monkeypatch, in_space, size):
    monkeypatch.setattr(choice, "installed_solvers", lambda: {"pardiso": pardiso.Pardiso})
    assert choose_backend("auto", size, in_space) == "qdldl"
    assert choose_backend("auto", size + 1, in_space) == "pardiso"
    assert choose_backend("auto", 10**8, in_space) == "pardiso"


def test_vertices_without_strong_connections_join_no_aggregate():
    upper = sp.eye_array(3000, format="csc") - 1e-6 * sp.eye_array(3000, k=1, format="csc")
    right = np.arange(3000.0)
    x = multigrid.Multigrid(upper).solve(right)
    np.testing.assert_allclose(upper @ x + upper.T @ x - x, right, rtol=0, atol=1e-8)


def test_stresses_of_four_decades_need_few_steps(monkeypatch):
    network = voronoi_network(points=np.random.default_rng(6).random((2000, 3)))
    manifold, cycle, steps = CriticalManifold(network, "pyamg"), multigrid.Multigrid._cycle, []

    def counted(solver, right, level=0):
        steps.extend([level] * (level == 0))
        return cycle(solver, right, level)

    monkeypatch.setattr(multigrid.Multigrid, "_cycle", counted)
    manifold.balance(10 ** np.random.default_rng(7).uniform(-2, 2, network.n_edges))
    assert len(steps) < 3 * 60


def test_pairs_without_a_fixed_vertex_have_no_solution():
    pair = sp.csc_array([[1.0, -1.0], [0.0, 1.0]])
    upper = sp.block_diag([pair] * 500, format="csc")
    assert multigrid.serves(upper)
    assert np.isnan(multigrid.Multigrid(upper).solve(np.ones(1000))).all()


@pytest.mark.parametrize("x", [np.arange(10.0), np.arange(20.0)[::2], np.arange(40.0).reshape(20, 2)[::2]])
@pytest.mark.parametrize("kind", [sp.csr_array, sp.csc_array])
def test_a_product_is_added_in_place(kind, x):
    matrix = kind(sp.random_array((7, 10), density=0.5, rng=1))
    y = np.ones((7, *x.shape[1:]))
    assert multigrid.add_product(matrix, x, y) is y
    np.testing.assert_allclose(y, 1 + matrix @ x, rtol=1e-14)
