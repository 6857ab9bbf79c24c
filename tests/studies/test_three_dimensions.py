"""Foams in three dimensions: their moduli against closed forms and finite differences, and their study end to end."""

import json
from functools import cache

import numpy as np
import pytest

from critflow import (
    CriticalManifold,
    Network,
    Status,
    bulk_modulus_bound,
    critical_from_lengths,
    elastic_moduli,
    equilibrium,
    foam_network,
    optimize,
    rigidity,
    spring_state,
    stiffening,
    strain_path,
    transition_moduli,
    voronoi_network,
)
from critflow.cli import main

STUDY = "three_dimensions"
POPULATIONS = ("max B_0", "max G_0", "min V_τ", "random stress")


@cache
def foam():
    return foam_network(100, seed=1)


@cache
def manifold():
    return CriticalManifold(foam())


@cache
def population(name):
    """One configuration of a kind."""
    if name == "random stress":
        return manifold().configuration(np.abs(np.random.default_rng(1).standard_normal(foam().n_edges)))
    objective = {"max B_0": "bulk_modulus", "max G_0": "shear_modulus", "min V_τ": "tension_variance"}[name]
    return optimize(manifold(), objective, throw=False).value


@pytest.mark.parametrize("name", POPULATIONS)
def test_configurations_are_critical(name):
    critical = population(name)
    # Forces in units of the mean tension; edges of a hundredth of the mean length cost two digits.
    assert critical.residual < 1e-11
    found = rigidity(foam(), critical.coordinates).value
    assert found.n_self_stresses == 1
    # Maxwell–Calladine with N_b = 2 N_v in three dimensions: N_0 = N_v + 1.
    assert found.n_zero_modes == foam().n_vertices + 1
    assert found.prestress_stable
    assert transition_moduli(critical).bulk <= bulk_modulus_bound(manifold()) * (1 + 1e-12)


@pytest.mark.parametrize("name", POPULATIONS)
def test_moduli_at_the_transition_are_those_of_the_self_stress(name):
    critical = population(name)
    found, other = transition_moduli(critical), elastic_moduli(foam(), critical.coordinates).value
    assert found.bulk == pytest.approx(other.bulk, rel=1e-7)
    assert found.shear == pytest.approx(other.shear, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("name", ["max B_0", "max G_0", "random stress"])
def test_moduli_under_strain_are_second_derivatives_of_the_energy(name):
    critical, gamma = population(name), 0.05
    path = strain_path(foam(), critical, [gamma])
    state, volume = path.value.states[0], foam().volume
    step = 1e-3
    shear = np.array([[0, 0.5, 0], [0.5, 0, 0], [0, 0, 0]])

    def energy(F):
        return equilibrium(state.deformed(F), tolerance=1e-14).value.energy

    def second(deform):
        values = [energy(deform(n * step)) for n in (-2, -1, 0, 1, 2)]
        return np.array([-1, 16, -30, 16, -1]) @ values / (12 * step**2)

    # B = V d²E/dV²: V(1 + e) of the state, whose volume is (1 + γ) V(0).
    bulk = second(lambda e: (1 + e) ** (1 / 3) * np.eye(3)) / ((1 + gamma) * volume)
    assert path.value.bulk_modulus[0] == pytest.approx(bulk, rel=2e-6)
    found = second(lambda e: np.eye(3) + e * shear) / ((1 + gamma) * volume)
    assert path.value.shear_modulus[0] == pytest.approx(found, rel=2e-6)


@pytest.mark.parametrize("name", POPULATIONS)
def test_exact_coefficients_are_the_slopes_of_the_path(name):
    critical = population(name)
    exact = stiffening(foam(), critical).value
    # A parabola over a window w misses the slope by O(w²): a quarter of the error for half the window.
    wanted = exact.C_B, exact.C_G, exact.C_G_stress_corrected
    errors = []
    for window in (4e-4, 2e-4):
        gamma = np.linspace(0.125, 1, 8) * window
        path = strain_path(foam(), critical, gamma).value
        curves = path.bulk_modulus, path.shear_modulus, path.shear_modulus_stress_corrected
        fits = [np.polyfit(gamma, moduli, 2) for moduli in curves]
        errors.append([abs(fit[1] - C) for fit, C in zip(fits, wanted, strict=True)])
        assert fits[0][2] == pytest.approx(exact.bulk_0, rel=1e-5)
    wide, narrow = np.array(errors)
    np.testing.assert_allclose(narrow / wide, 0.25, atol=0.02)
    assert narrow.max() < 1e-5


@pytest.mark.parametrize("make", [lambda: voronoi_network(60, seed=2), foam], ids=["2D", "3D"])
def test_the_largest_bulk_modulus_falls_as_springs_that_stretch_alike(make):
    """At σ ∝ k the network expands affinely, E ∝ ((1 + γ)^{1/d} − 1)², so that C_B = (3/d − 2) B_0."""
    network = make()
    critical = optimize(network, "bulk_modulus").value
    found = stiffening(network, critical).value
    assert found.C_B == pytest.approx((3 / network.dimension - 2) * found.bulk_0, rel=1e-10)
    path = strain_path(network, critical, [0.1]).value
    d, strain = network.dimension, 0.1
    energy = 0.5 * np.sum(critical.lengths**2) * ((1 + strain) ** (1 / d) - 1) ** 2
    assert path.energy[0] == pytest.approx(energy, rel=1e-12)
    np.testing.assert_allclose(path.states[0].lengths, (1.1) ** (1 / d) * critical.lengths, rtol=1e-10)


def test_directions_are_alike():
    # The same network seen along other axes has the same bulk modulus and growth; only G, of the x–y shear, changes.
    turned = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    network = Network(foam().edges, foam().offsets @ turned, foam().cell)
    critical = population("max G_0")
    other = CriticalManifold(network).configuration(critical.sigma)
    np.testing.assert_allclose(other.bond_vectors, critical.bond_vectors @ turned, atol=1e-11)
    one, two = stiffening(foam(), critical).value, stiffening(network, other).value
    assert (two.bulk_0, two.C_B) == pytest.approx((one.bulk_0, one.C_B), rel=1e-9)
    assert two.shear_0 < 0.5 * one.shear_0


def shortest_chain_along_x(network):
    """Edges of a shortest chain from vertex 0 to its image in the next cell along x, breadth first."""
    goal, start = (0, (1, 0, 0)), (0, (0, 0, 0))
    chains, frontier = {start: []}, [start]
    while goal not in chains:
        vertex, image = frontier.pop(0)
        for edge, (tail, head) in enumerate(network.edges.tolist()):
            for here, there, sign in ((tail, head, 1), (head, tail, -1)):
                place = there, tuple((image + sign * network.offsets[edge]).tolist())
                if here == vertex and place not in chains:
                    chains[place] = [*chains[vertex, image], edge]
                    frontier.append(place)
    return np.sort(chains[goal])


def test_a_chain_around_the_cell_can_be_taut_before_all_else():
    # With much shorter rest lengths than the rest it alone is stressed, straight, so that B_0 = side²/(9 V n).
    chain = shortest_chain_along_x(foam())
    lengths = np.ones(foam().n_edges)
    lengths[chain] = 0.2
    solution = critical_from_lengths(manifold(), lengths, throw=False)
    assert solution.status is Status.slack_edges
    np.testing.assert_array_equal(np.flatnonzero(solution.value.sigma > 0), chain)
    side = foam().cell[0, 0]
    np.testing.assert_allclose(solution.value.lengths[chain], side / len(chain), rtol=1e-8)
    bulk = side**2 / (9 * foam().volume * len(chain))
    assert transition_moduli(solution.value).bulk == pytest.approx(bulk, rel=1e-8)


def test_springs_past_the_transition_hold():
    critical = population("random stress")
    state = spring_state(foam(), critical.lengths, critical.coordinates).deformed(1.02 * np.eye(3))
    solution = equilibrium(state)
    assert solution.status is Status.ok and solution.value.max_force < 1e-13


# The study


def test_the_dataset_is_labelled_as_the_ensemble_is(dataset):
    assert {"seed": 2, "population": 6, "strain": 10, "edge": 120, "vertex": 60, "axis": 3}.items() <= dict(
        dataset.sizes
    ).items()
    for name in ("sigma", "coordinates", "bulk_modulus", "C_B_exact", "C_G", "C_G_error", "status"):
        assert dataset[name].attrs["long_name"] and dataset[name].attrs["units"] == "1"
    assert "anisotropy_physical" not in dataset


def test_stored_numbers_follow_from_stored_arrays(dataset):
    for population in dataset.population.values:
        for seed in dataset.seed.values:
            one = dataset.sel(population=population, seed=seed)
            network = Network(one.edges.values, one.offsets.values, one.cell.values)
            np.testing.assert_array_equal(network.edges, foam_network(60, seed=int(seed)).edges)
            L, sigma = network.bond_vectors(one.coordinates.values), one.sigma.values
            squared = np.sum(L**2, axis=1)
            force = network.incidence.T @ (sigma[:, None] * L)
            assert np.abs(force).max() <= 1e-11 * np.mean(np.abs(sigma) * np.sqrt(squared))
            cost = 60 * (sigma**2 @ squared)
            assert one.bulk_modulus_0 == pytest.approx((sigma @ squared) ** 2 / (9 * cost), rel=1e-11)
            assert one.shear_modulus_0 == pytest.approx((sigma @ (L[:, 0] * L[:, 1])) ** 2 / cost, rel=1e-8, abs=1e-18)
            assert one.bulk_modulus_0 <= bulk_modulus_bound(network) * (1 + 1e-12)


def test_statuses_are_those_that_foams_have(dataset):
    status = dataset.status.transpose("population", "seed")
    for population in ("bulk_modulus", "shear_modulus", "random_stress"):
        assert (status.sel(population=population) == Status.ok).all(), population
    # Of some foams several edges shrink together, and rounding ends the descent before its infimum is shown.
    assert np.isin(status, [Status.ok, Status.slack_edges, Status.edge_collapse, Status.stalled]).all()


def test_claims_figure_and_checks(folder, capsys, assert_picture):
    assert_picture(folder / "figures" / "response.png")
    claims = {claim["key"]: claim for claim in json.loads((folder / "claims.json").read_text())}
    assert len(claims) == 14
    assert claims["ResponseMetrics-A"]["verdict"] == claims["ResponseMetrics-C"]["verdict"] == "holds"
    assert all(claim["because"] for claim in claims.values() if claim["verdict"] == "differs")
    assert main(["verify", str(folder)]) == 0
    assert "12 stored cases" in capsys.readouterr().out


def test_one_configuration_is_shown(folder, tmp_path, capsys, assert_picture):
    picture = tmp_path / "one.png"
    words = ["--set", "seed=1", "--set", "population=bulk_modulus", "--out", str(picture)]
    assert main(["show", str(folder / "three_dimensions.nc"), *words]) == 0
    text = capsys.readouterr().out
    assert "rigid to second order" in text and "100.000000 % of its bound" in text
    assert_picture(picture)


def test_some_populations_alone(dataset, run_study, tmp_path):
    alone = run_study(STUDY, tmp_path, "seeds=1", "populations=random_lengths,shear_modulus")
    for population in alone.population.values:
        one, other = (ds.sel(seed=1, population=population) for ds in (alone, dataset))
        np.testing.assert_array_equal(one.sigma, other.sigma)
    assert json.loads((tmp_path / "claims.json").read_text()) == []


@pytest.mark.parametrize("setting", ["n_vertices=40", "hard_core=1.2", "strains=0", "threshold=0.0", "spread=-0.1"])
def test_settings_that_could_only_fail_are_refused(setting, tmp_path, capsys):
    assert main(["run", "three_dimensions", "--workers", "0", "--out", str(tmp_path / "out"), "--set", setting]) == 2
    message = capsys.readouterr().err.strip()
    assert message.startswith("critflow: ") and "\n" not in message
