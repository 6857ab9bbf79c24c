"""Strain paths of cables: floppy up to their onset, slack ones tighten along the path."""

from dataclasses import replace

import numpy as np
import pytest
from problems import (
    critical_of,
    slack_lattice,
    taut_rows,
    with_random_stiffness,
)
from scipy.optimize import minimize

from critflow import (
    Cable,
    Deformation,
    Hookean,
    InputError,
    Network,
    Status,
    critical_from_lengths,
    equilibrium,
    optimize,
    spring_state,
    strain_path,
)
from critflow import voronoi_network as voronoi
from critflow.manifold import critical_configuration
from critflow.paths import Path
from critflow.taut_part import backbone
from critflow_extras import critical_strain, fibre_network


@pytest.mark.parametrize("seed", [0, 5])
def test_soft_chains_next_to_slack_cables(seed):
    # Next to the onset the softest modes, of 1e-12, are softer than the shift that resists floppy vertices.
    network = fibre_network("mikado", 80, z=3.4, seed=seed)
    onset = critical_strain(network, np.linalg.norm(network.bond_vectors(network.positions), axis=1), "uniaxial")
    cables = strain_path(onset, [2e-8], "uniaxial").value
    taut = strain_path(onset, [2e-8], "uniaxial", taut_only=True).value
    assert cables.coordinate_error[0] < 1e-14
    for name in ("bulk_modulus", "modulus"):
        np.testing.assert_allclose(getattr(cables, name), getattr(taut, name), rtol=1e-6, err_msg=name)


@pytest.mark.parametrize(
    "deformation, sign", [("dilation", 1), ("simple_shear", -1), (Deformation.uniaxial(2).freeing("xy"), 1)], ids=str
)
def test_cables_are_followed_from_a_floppy_start_through_their_onset(deformation, sign):
    network = with_random_stiffness(voronoi(60, seed=1), 2)
    ratio = critical_from_lengths(network, np.ones(90)).ratio
    lengths = ratio * np.random.default_rng(1).uniform(1.05, 1.15, 90)
    start = spring_state(network, lengths, optimize(network, "length_variance").value.coordinates, Cable())
    onset = critical_strain(network, lengths, deformation, direction=sign)
    factors = np.array([0.0, 0.5, 1 - 1e-9, 1 + 1e-6, 1.01, 1.3])
    path = strain_path(start, factors * onset.value.strain, deformation).value
    for name in ("energy", "modulus", "bulk_modulus", "shear_modulus", "max_force", "modulus_error"):
        np.testing.assert_array_equal(getattr(path, name)[:3], 0.0)
    assert not path.stress[:3].any() and all((state.lengths <= lengths).all() for state in path.states[:3])
    assert (path.energy[3:] > 0).all() and path.coordinate_error[3:].max() < 1e-6
    # E = ½ V C (γ − γ_c)² past the onset, and the minimum of the energy far from it.
    ahead, volume = (factors[3] - 1) * onset.value.strain, path.states[3].network.volume
    assert path.energy[3] == pytest.approx(0.5 * volume * path.modulus[3] * ahead**2, rel=1e-3)
    last = path.states[-1]
    moved = replace(last, coordinates=start.coordinates @ np.linalg.solve(network.cell, last.network.cell))
    moved = spring_state(last.network, lengths, moved.coordinates, Cable())
    assert equilibrium(moved).value.energy == pytest.approx(last.energy, rel=1e-10)


def test_strains_between_the_bounds_on_an_onset_are_undecided():
    network, lengths = slack_lattice()[:2]
    start = spring_state(network, 1.2 * lengths, critical_of(network).coordinates, Cable())
    onset = critical_strain(network, 1.2 * lengths, "pure_shear")
    solution = strain_path(
        start, [0.5 * onset.value.strain, onset.value.strain, 2 * onset.value.strain], "pure_shear", throw=False
    )
    assert solution.status is Status.undecided and "bounds" in solution.note
    np.testing.assert_array_equal(solution.value.energy, [0.0, np.nan, np.nan])


def test_cables_that_never_tighten_have_no_stress():
    network = voronoi(20, seed=1)
    start = spring_state(network, np.full(30, 2.0), critical_of(network).coordinates, Cable())
    path = strain_path(start, [-0.1, -0.5]).value
    np.testing.assert_array_equal([path.energy, path.bulk_modulus, path.modulus], 0.0)


def test_a_slack_cable_becomes_taut_on_the_path():
    # Two cables between a vertex and its image: one taut, one slack until the strain reaches 0.02; k = 1, V = 1.
    network = Network([[0, 1], [1, 0], [0, 2], [2, 0]], [[0, 0], [1, 0], [0, 0], [1, 0]], np.eye(2))
    onset = critical_strain(network, [0.5, 0.5, 0.51, 0.51], "uniaxial", throw=False)
    assert onset.status is Status.undecided
    sigma, x = np.array([1.0, 1, 0, 0]), np.array([[0, 0], [0.5, 0], [0.5, 0.01]])
    critical = replace(critical_configuration(network, sigma, x), rest_lengths=np.array([0.5, 0.5, 0.51, 0.51]))
    path = strain_path(critical, [0.01, 0.03], deformation="uniaxial").value
    # Each cable of two springs has stiffness 1/2; V = 1 + γ.
    np.testing.assert_allclose(path.modulus, [0.5 / 1.01, 1.0 / 1.03], rtol=1e-9)
    np.testing.assert_allclose(path.energy, [0.25 * 0.01**2, 0.25 * (0.03**2 + 0.01**2)], rtol=1e-9)


@pytest.mark.parametrize("n_vertices, z, seed", [(60, 3.5, 1), pytest.param(100, 3.4, 2, marks=pytest.mark.sweep)])
def test_the_path_past_an_onset_has_the_least_energy_of_all_cables(n_vertices, z, seed):
    network = fibre_network("mikado", n_vertices, z=z, seed=seed)
    lengths = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    onset = critical_strain(network, lengths, "simple_shear")
    path = strain_path(onset, [0.01, 0.1], deformation="simple_shear").value
    g, k = network.free_incidence, network.stiffness
    for state in path.states:

        def energy(x, b=state.network.boundary_vectors):
            L = g @ x.reshape(-1, 2) + b
            length = np.linalg.norm(L, axis=1)
            extension = np.maximum(length - lengths, 0.0)
            return 0.5 * k @ extension**2, (g.T @ ((k * extension / length)[:, None] * L)).ravel()

        start = state.coordinates[network.free] + 0.01 * np.random.default_rng(0).standard_normal(
            (len(network.free), 2)
        )
        found = minimize(energy, start.ravel(), jac=True, options={"gtol": 1e-10, "maxiter": 10_000})
        assert state.energy == pytest.approx(found.fun, rel=1e-6)
    taut = [np.count_nonzero(state.sigma > 1e-9) for state in path.states]
    assert taut[1] > onset.value.taut.sum()
    assert strain_path(onset, [0.1], deformation="simple_shear", taut_only=True).value.energy[0] < 0.99 * path.energy[1]


def test_floppy_vertices_do_not_end_a_path():
    # Relaxation leaves cables at |L| = ℓ to rounding; 120 of 450 edges are slack at first.
    network = voronoi(300, seed=503)
    critical = critical_from_lengths(network, np.random.default_rng(503).uniform(0.3, 1.7, 450), throw=False)
    path = strain_path(critical, [0.01, 0.1]).value
    assert path.max_force.max() < 1e-13 and path.coordinate_error.max() < 1e-10
    assert not path.inserted.any()


def test_all_edges_are_as_stiff_as_the_taut_ones_until_one_tightens():
    network, lengths, critical = slack_lattice()
    alone = strain_path(backbone(critical).configuration, [1e-4, 1e-3]).value
    cables = strain_path(critical_from_lengths(network, lengths, throw=False), [1e-4, 1e-3])
    np.testing.assert_allclose(cables.value.bulk_modulus, alone.bulk_modulus, rtol=1e-9)
    assert cables.value.states[0].network.n_edges == network.n_edges and cables.note == ""


def test_a_configuration_of_known_rest_lengths_is_of_cables():
    solution = critical_from_lengths(voronoi(20, seed=1), np.ones(30))
    assert strain_path(solution, [0.01]).value.states[0].law == Cable()


def beginning(**changes):
    return replace(replace(taut_rows(2), rest_lengths=np.ones(taut_rows(2).network.n_edges)), **changes)


@pytest.mark.parametrize(
    "start, options, word",
    [
        (beginning(), {"law": Hookean()}, "compressed"),
        (beginning(rest_lengths=np.linspace(1, 2, 8)), {}, "these rest lengths"),
    ],
    ids=["two-sided", "other lengths"],
)
def test_starts_that_are_refused(start, options, word):
    with pytest.raises(InputError, match=word):
        strain_path(start, [0.1], **options)


def test_paths_of_cables_take_general_steps(monkeypatch):
    steps, step = [], Path.lean_step
    monkeypatch.setattr(Path, "lean_step", lambda *arguments: steps.append(step(*arguments)) or steps[-1])
    assert strain_path(critical_of(voronoi(20, seed=2)), [0.01, 0.02], law=Cable()).ok
    assert steps and all(end is None for end in steps)
