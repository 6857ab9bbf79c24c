"""Cost: no more factorisations, and no other solvers, than each result needs."""

import sys

import numpy as np
import pytest
from problems import Factorisations, foam_network, forbidden

from critflow import (
    CriticalManifold,
    Status,
    critical_from_lengths,
    elasticity,
    optimize,
    stiffening,
    strain_path,
    upper_bound,
    voronoi_network,
)
from critflow.linear_response import strains_of
from critflow.refinement import Refinement

NETWORKS = {"planar": voronoi_network, "foam": foam_network}
SPRINGS, STRAIN = "Hessian", [0.001, 0.002, 0.003]
# The package calls functions by the names of these modules.
OPTIMIZE, PATH = sys.modules["critflow.optima"], sys.modules["critflow.paths"]


@pytest.fixture(scope="module", params=NETWORKS)
def network(request):
    return NETWORKS[request.param](60, seed=1)


@pytest.fixture
def manifold(network):
    return CriticalManifold(network)


@pytest.fixture
def critical(manifold):
    """The configuration of a random stress."""
    return manifold.configuration(np.abs(np.random.default_rng(0).standard_normal(manifold.network.n_edges)))


@pytest.fixture
def factorised(monkeypatch):
    return Factorisations(monkeypatch)


@pytest.fixture
def refined(monkeypatch):
    """One entry for each configuration that is refined."""
    calls, refine = [], Refinement.__init__
    monkeypatch.setattr(Refinement, "__init__", lambda *arguments: calls.append(1) or refine(*arguments))
    return calls


def test_moduli_at_the_transition_factorise_nothing(factorised, network, critical):
    assert factorised(network, lambda: elasticity(critical).value.errors.tensor) == {}


@pytest.mark.parametrize("name, tolerance", [("V_tau", 1e-9), ("V_L", 1e-4)])
def test_a_descent_refines_one_configuration(refined, name, tolerance):
    manifold = CriticalManifold(NETWORKS["planar"](60, seed=1))
    found = optimize(manifold, name, tolerance=tolerance)
    assert found.ok and found.value.sigma.min() > 0 and len(refined) == 1
    exact = manifold.solve(found.value.sigma)
    np.testing.assert_array_equal(found.value.coordinates, exact.value.coordinates)
    assert (found.stats.condition, found.stats.error_bound) == (exact.stats.condition, exact.stats.error_bound)
    assert found.stats.residual < tolerance


def test_lengths_refine_one_configuration(refined):
    network = NETWORKS["planar"](60, seed=1)
    lengths = np.exp(0.05 * np.random.default_rng(0).standard_normal(network.n_edges))
    found, equal = critical_from_lengths(network, lengths), optimize(network, "V_L")
    assert found.ok and equal.ok and found.value.sigma.min() > 0 and len(refined) == 2
    np.testing.assert_allclose(found.value.lengths, found.ratio * lengths, rtol=1e-13)
    np.testing.assert_array_equal(found.value.rest_lengths, found.value.lengths)
    assert found.value.error_bound < 1e-14 and found.stats.error_bound < 1e-13
    assert equal.value.rest_lengths is None and np.ptp(equal.value.lengths) < 1e-13


def test_a_closed_form_has_no_descent(factorised, monkeypatch, network, manifold):
    """No step of any method; only the configuration at σ = k is solved."""
    monkeypatch.setattr(OPTIMIZE, "descend", forbidden)
    counts = factorised(network, lambda: optimize(manifold, "bulk_modulus"))
    assert set(counts) == {"P"} and counts["P"] <= 2  # P(k) for bound and configuration, and for the residual
    assert factorised.answer.stats.steps == 0 and factorised.answer.stats.method == "closed_form"
    assert factorised(network, lambda: upper_bound(manifold, "B_0")) == {"P": 1}


def test_coefficients_need_one_system_and_no_path(factorised, monkeypatch, network, manifold, critical):
    monkeypatch.setattr(sys.modules["critflow.paths"], "relaxed", forbidden)
    # P(σ) refines the coordinates.
    assert factorised(network, lambda: stiffening(critical, manifold=manifold)) == {"saddle": 1, "P": 1}
    assert factorised.answer.ok


def test_a_path_without_moduli_has_no_linear_response(factorised, monkeypatch, network, critical):
    monkeypatch.setattr(PATH, "linear_response", forbidden)
    without = factorised(network, lambda: strain_path(critical, STRAIN, measure="energy"))
    assert set(without) == {SPRINGS}


@pytest.mark.parametrize("measure", ["energy", "moduli", "tensors"])
@pytest.mark.parametrize("deformation", ["dilation", "simple_shear"])
def test_a_strain_of_a_path_is_one_factorisation(factorised, deformation, measure):
    """And one for the velocity at the transition; only the first strain, a long step, takes a few more."""
    network = NETWORKS["planar"](200, seed=3)
    critical = CriticalManifold(network).configuration(np.ones(network.n_edges))
    side = 1 if strain_path(critical, [1e-3], deformation, throw=False).ok else -1
    strains = side * 1e-3 * np.arange(1, 11)
    counts = factorised(network, lambda: strain_path(critical, strains, deformation, measure=measure).value)
    assert counts[SPRINGS] <= len(strains) + 4
    path = factorised.answer
    assert path.steps[0] <= 3 and not path.steps[2:].any() and not path.inserted.any()


def test_a_departure_with_the_affine_motion_factorises_nothing(factorised):
    """At σ = k all edges stretch alike."""
    network = NETWORKS["planar"](60, seed=1)
    critical = CriticalManifold(network).configuration(network.stiffness)
    assert factorised(network, lambda: strain_path(critical, STRAIN)) == {SPRINGS: len(STRAIN)}


@pytest.mark.parametrize("deformation, solved", [("dilation", 2), ("simple_shear", 2), ("uniaxial", 3)])
def test_a_path_without_tensors_solves_for_its_strains_alone(monkeypatch, deformation, solved):
    network = NETWORKS["planar"](60, seed=1)
    critical, rows = CriticalManifold(network).configuration(np.ones(network.n_edges)), []
    monkeypatch.setattr(PATH, "strains_of", lambda rates: rows.append(strains_of(rates)) or rows[-1])
    for strain in (0.001, -0.001):  # one of them tightens
        strain_path(critical, [strain], deformation=deformation, measure="moduli", throw=False)
    assert {len(row) for row in rows} == {solved}


def test_lengths_determine_the_transition_without_springs(factorised):
    """A few steps of the iteration, Newton's method on the stressed edges, and one balance of the resulting stress."""
    network = NETWORKS["planar"](60, seed=1)
    lengths = 1 + 0.02 * np.sin(1.0 + np.arange(network.n_edges))
    counts = factorised(network, lambda: critical_from_lengths(network, lengths))
    assert factorised.answer.status is Status.ok
    assert set(counts) == {"P", "saddle"} and counts["P"] <= 6
