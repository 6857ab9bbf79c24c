"""The strain path: equilibria at increasing volume, equal to direct relaxations."""

from dataclasses import replace

import numpy as np
import pytest
from problems import (
    NETWORKS,
    SMALL_NETWORKS,
    bounds_over_errors,
    critical_of,
    partly_compressed,
    random_stress,
    relaxed_directly,
    reordered,
    slack_lattice,
    stiff_lattice,
    taut_rows,
    with_random_stiffness,
)
from scipy.optimize import minimize

from critflow import (
    Cable,
    CriticalManifold,
    Deformation,
    Hookean,
    InputError,
    Network,
    PowerLaw,
    Status,
    critical_from_lengths,
    critical_strain,
    delaunay_network,
    diluted,
    equilibrium,
    fibre_network,
    foam_network,
    lattice,
    optimize,
    packing_network,
    spring_state,
    stiffening,
    strain_path,
)
from critflow import voronoi_network as voronoi
from critflow.critical.backbone import backbone
from critflow.critical.manifold import critical_configuration
from critflow.extras.rest.free_cell import stretched
from critflow.networks.deformation import DEFORMATIONS
from critflow.paths.strain_path import PathSolver
from critflow.springs.state import SpringState
from workflows.benchmarks import reference

STRAINS = np.array([1e-6, 1e-5, 1e-4, 0.001, 0.002, 0.003, 0.01, 0.05])


@pytest.mark.parametrize("name", ["voronoi", "voronoi, random stiffness", "voronoi 3D", "oblique"])
def test_path_is_relaxed_at_every_strain(name):
    critical = critical_of(NETWORKS[name]())
    solution = strain_path(critical, STRAINS)
    assert solution.status is Status.ok
    path = solution.value
    np.testing.assert_array_equal(path.status, Status.ok)
    assert path.max_force.max() < 1e-13
    np.testing.assert_array_equal(path.strains, STRAINS)
    assert len(path.states) == len(STRAINS)
    for gamma, state, energy in zip(STRAINS, path.states, path.energy, strict=True):
        assert state.network.volume == pytest.approx(critical.network.volume * (1 + gamma), rel=1e-13)
        np.testing.assert_array_equal(state.rest_lengths, critical.lengths)
        assert energy == state.energy
        np.testing.assert_allclose(
            state.network.bond_vectors(state.coordinates), state.bond_vectors, rtol=0, atol=1e-13
        )
        direct = relaxed_directly(critical, gamma)
        # Both may differ by forces of 1e-14 over the softest stiffness, of order γ/100.
        np.testing.assert_allclose(state.bond_vectors, direct.bond_vectors, rtol=0, atol=1e-11 + 1e-13 / gamma)
        # The energy is second order in that error.
        assert energy == pytest.approx(direct.energy, rel=1e-7)


def test_fire_follows_the_same_path():
    critical = critical_of(with_random_stiffness(voronoi(20, seed=2), 1))
    fire = strain_path(critical, [0.02, 0.04], solver=PathSolver("fire", 1e-13))
    newton = strain_path(critical, [0.02, 0.04])
    assert fire.status is newton.status is Status.ok
    np.testing.assert_allclose(fire.value.bulk_modulus, newton.value.bulk_modulus, rtol=1e-8)
    np.testing.assert_allclose(
        fire.value.states[-1].bond_vectors, newton.value.states[-1].bond_vectors, rtol=0, atol=1e-10
    )


@pytest.mark.parametrize("make", [lambda: voronoi(40, seed=1), lambda: foam_network(60, seed=1)], ids=["2D", "3D"])
@pytest.mark.parametrize("deformation", ["dilation", "simple_shear", "uniaxial", "uniaxial_free"])
def test_moduli_do_not_depend_on_tensors(make, deformation):
    critical = critical_of(make())
    few, all_ = (
        strain_path(critical, [0.01, 0.05], deformation=deformation, measure=measure, throw=False)
        for measure in ("moduli", "tensors")
    )
    assert few.status is all_.status and few.value.elasticity == ()
    assert len(all_.value.elasticity) == len(all_.value.states)
    for name in ("bulk_modulus", "shear_modulus", "shear_modulus_stress_corrected", "modulus", "energy"):
        np.testing.assert_allclose(getattr(few.value, name), getattr(all_.value, name), rtol=1e-12, err_msg=name)


@pytest.mark.parametrize("n", [2.0, 3.0, 4.5])
def test_power_laws_of_the_largest_bulk_modulus_are_affine(n):
    # With σ = k all edges stretch alike, by λ = √v; every tension is then kℓ times one function of λ, so the
    # balance persists and B = (v/V_0) d²E/dv² with E = Σkℓ²/(n − 1)·((λⁿ − 1)/n − λ + 1) at any strain.
    network = with_random_stiffness(voronoi(40, seed=1), 3)
    critical = CriticalManifold(network).configuration(network.stiffness)
    gamma = np.array([0.01, 0.1, 0.5])
    path = strain_path(critical, gamma, law=PowerLaw(n)).value
    v, scale = 1 + gamma, network.stiffness @ critical.lengths**2 / (n - 1)
    second = (n / 2 - 1) / 2 * v ** (n / 2 - 2) + 0.25 * v**-1.5
    np.testing.assert_allclose(path.bulk_modulus, v * scale * second / network.volume, rtol=1e-10)
    energy = scale * ((v ** (n / 2) - 1) / n - np.sqrt(v) + 1)
    np.testing.assert_allclose(path.energy, energy, rtol=1e-11)
    for g, state in zip(gamma, path.states, strict=True):
        np.testing.assert_allclose(state.lengths, np.sqrt(1 + g) * critical.lengths, rtol=1e-10)


SWEPT = [*10.0 ** -np.arange(12, 4, -1), 0.001, 0.002, 0.003, 0.05, 0.3]


@pytest.mark.parametrize("strains", [[1e-12, 1e-7, 0.001, 0.3], pytest.param(SWEPT, marks=pytest.mark.sweep)], ids=len)
def test_bounds_of_paths(strains):
    network = SMALL_NETWORKS["stiffness"]()
    critical = CriticalManifold(network).configuration(random_stress(18, 4))
    paths = []
    for other, order in reordered(network):
        start = critical_configuration(other, critical.sigma[order], critical.coordinates)
        paths.append(strain_path(start, strains).value)
    ratios = []
    for n, state in enumerate(paths[0].states):
        exact = reference.equilibrium(state.network, state.rest_lengths, state.coordinates)
        errors = [reference.largest_error(path.states[n].coordinates, exact.coordinates, moved=True) for path in paths]
        bounds = [path.coordinate_error[n] for path in paths]
        assert np.less_equal(errors, bounds).all() and max(bounds) <= 10 * max(errors)
        moduli = reference.linear_response(state.network, exact.bond_vectors, state.rest_lengths)
        values = [
            (path.bulk_modulus[n], path.shear_modulus[n], path.shear_modulus_stress_corrected[n]) for path in paths
        ]
        bounds = [(path.bulk_modulus_error[n], *2 * [path.shear_modulus_error[n]]) for path in paths]
        ratios += bounds_over_errors(values, bounds, moduli)
    assert np.median(ratios) < 60


def curving(strain):
    """F(γ) that curves, rotates and changes the volume."""
    return np.array([[np.exp(strain), strain], [0.3 * strain**2, 1.0]])


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    "deformation",
    [*DEFORMATIONS, np.array([[0.3, 0.2], [-0.5, 0.1]]), curving],
    ids=[*DEFORMATIONS, "matrix", "function"],
)
def test_modulus_and_stress_are_derivatives_of_the_relaxed_energy(deformation, sign):
    state = stiff_lattice()
    h = 1e-3
    strains = sign * h * np.arange(7)
    path = strain_path(state, strains, deformation=deformation).value
    F = path.deformation
    E, volume = path.energy, np.array([one.network.volume for one in path.states])
    n = 3
    # Sixth order.
    first = sign * (E[n + 3] - 9 * E[n + 2] + 45 * E[n + 1] - 45 * E[n - 1] + 9 * E[n - 2] - E[n - 3]) / (60 * h)
    second = np.array([2, -27, 270, -490, 270, -27, 2]) @ E / (180 * h**2)
    assert path.modulus[n] == pytest.approx(second / volume[n], rel=1e-7)
    # The work of the stress: free components do none.
    S = stretched(path.free_components[n], F.free_strains)
    rate = S @ F.velocity(strains[n]) @ np.linalg.inv(S)
    assert volume[n] * np.sum(path.stress[n] * rate) == pytest.approx(first, rel=1e-9, abs=1e-12)
    for strain, q, one in zip(strains, path.free_components, path.states, strict=True):
        boundary = state.network.boundary_vectors @ (stretched(q, F.free_strains) @ F.gradient(strain)).T
        np.testing.assert_allclose(one.network.boundary_vectors, boundary, rtol=0, atol=1e-14)
    assert not path.inserted.any() and path.steps.max() <= 4


def test_free_cell_in_space_has_no_stress():
    network = with_random_stiffness(delaunay_network(points=np.random.default_rng(1).random((12, 3))), 1)
    at_rest = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    state = equilibrium(spring_state(network, 0.98 * at_rest, network.positions)).value
    deformation = Deformation.uniaxial(3, sides="free").freeing("yy", "zz", "xy")
    path = strain_path(state, [0.0, 0.02, 0.05], deformation=deformation).value
    assert path.free_components.shape == (3, 3)
    assert (path.stress[1:, 0, 0] > 0.01).all() and (path.coordinate_error < 1e-12).all()
    for stress, q in zip(path.stress, path.free_components, strict=True):
        # Of the boundary (1 + Σ q E) F b the stress does the work V Σ_ij S_ij A_ij with A = E (1 + Σ q E)⁻¹.
        rates = deformation.free_strains @ np.linalg.inv(stretched(q, deformation.free_strains))
        np.testing.assert_allclose(np.einsum("ij,mij->m", stress, rates), 0, atol=1e-14)


def test_a_strain_that_loosens_is_floppy():
    critical = critical_of(voronoi(12, seed=1))
    solution = strain_path(critical, [-0.01, -0.02], throw=False)
    assert solution.status is Status.floppy
    assert solution.value.status.tolist() == [Status.floppy, Status.missing]
    assert np.isnan(solution.value.energy).all() and solution.stats.steps == 0


@pytest.mark.parametrize("deformation", ["uniaxial_free", Deformation.simple_shear(2).freeing("yy")], ids=str)
@pytest.mark.parametrize("strain", [1e-3, 0.05, 0.2])
def test_free_sides_leave_a_critical_network_floppy(deformation, strain):
    critical = critical_of(voronoi(60, seed=2))
    ends = [strain_path(critical, [sign * strain], deformation=deformation, throw=False) for sign in (1, -1)]
    assert [end.status for end in ends] == [Status.floppy] * 2
    # On one side the strain loosens the network anyway; on the other one springs find a cell that keeps their lengths.
    assert sum("keep all lengths" in end.note for end in ends) == 1


@pytest.mark.parametrize(
    "network", [voronoi(24, seed=1), packing_network(24, z=3.6, seed=2), fibre_network("mikado", 40, z=3.4, seed=1)]
)
def test_cables_do_not_hold_free_sides_apart(network):
    # Cables only pull, Σ σ L_y² = 0 leaves those along x taut, whatever the height of the cell.
    lengths = 1.05 * np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    onset = critical_strain(network, lengths, "uniaxial_free")
    strains = onset.value.strain + np.array([-1e-3, 1e-6, 1e-3, 0.3, 2.0])
    path = strain_path(
        spring_state(network, lengths, network.positions, Cable()), strains, "uniaxial_free", throw=False
    )
    assert path.value.status.tolist() == [Status.ok, Status.floppy, *[Status.missing] * 3]
    assert "free components" in path.note and len(path.value.states) == 1 and path.stats.steps < 100
    # Each strain by itself: at large ones all chains are taut and pull the cell flat.
    for strain in strains[1:]:
        end = strain_path(onset, [strain - onset.value.strain], "uniaxial_free", throw=False)
        assert end.status is Status.floppy and np.isnan(end.value.bulk_modulus).all()


def test_a_path_begins_at_springs_exactly_at_rest():
    network = lattice("square", 4, 4)
    state = spring_state(network, np.ones(32), network.positions)
    assert not state.sigma.any()
    solution = strain_path(state, [0.0, 1e-3], "uniaxial")
    np.testing.assert_allclose(solution.value.energy, [0, 16 * 0.5 * 1e-6], rtol=1e-9)


@pytest.mark.parametrize("kind, deformation", [("kagome", "uniaxial"), ("kagome", "dilation"), ("phantom", "dilation")])
def test_straight_fibres_with_free_sides_keep_their_lengths(kind, deformation):
    # Lengths grow as the square of deflections, which forces do not feel: their balance leaves stresses of 1e-12.
    network = diluted(lattice("kagome", 6, 6), 3.5, 0) if kind == "kagome" else fibre_network("phantom", 8, 8, z=3.2)
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, seed=0))
    path = getattr(Deformation, deformation)(2).freeing("yy")
    solution = strain_path(critical, [1e-3], path, throw=False)
    assert solution.status is Status.floppy and "keep all lengths" in solution.note
    # Gauss-Newton steps for |L| = ℓ in (x, q_yy).
    g, b = network.free_incidence.toarray(), network.boundary_vectors @ path.gradient(1e-3).T
    x, q = critical.coordinates[network.free], 0.0
    for _ in range(20):
        L = g @ x + b + q * b * [0, 1]
        length = np.linalg.norm(L, axis=1)
        n = L / length[:, None]
        rates = np.hstack([n[:, :1] * g, n[:, 1:] * g, (n[:, 1] * b[:, 1])[:, None]])
        step = np.linalg.lstsq(rates, critical.lengths - length, rcond=1e-10)[0]
        x, q = x + step[:-1].reshape(2, -1).T, q + step[-1]
    np.testing.assert_allclose(length, critical.lengths, rtol=1e-13)


def test_cables_in_tension_pull_a_free_cell_flat():
    network = lattice("triangular", 4, 4)
    state = spring_state(network, np.full(network.n_edges, 0.9), network.positions, Cable())
    end = strain_path(state, [0.0, 0.01], "uniaxial_free", throw=False)
    assert end.status is Status.floppy and "flat" in end.note
    assert strain_path(state, [0.0, 0.01], "uniaxial").ok


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


def test_a_sheared_cell_that_is_free_resists_beyond_its_onset():
    critical, path = critical_of(voronoi(60, seed=0)), Deformation.uniaxial(2).freeing("xy")
    onset = critical_strain(critical.network, critical.lengths, path)
    assert onset.value.valid_for_springs and 1e-4 < onset.value.strain
    below, above = (strain_path(critical, [factor * onset.value.strain], path, throw=False) for factor in (0.8, 1.5))
    assert below.status is Status.floppy and above.ok
    E = path.free_strains[0]
    rate = E @ np.linalg.inv(np.eye(2) + above.value.free_components[0] * E)
    assert above.value.energy[0] > 1e-8 and abs(np.sum(above.value.stress[0] * rate)) < 1e-14


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


def test_pins_follow_the_deformation():
    # Two springs in series on a line of pins: each takes half of the elongation.
    network = Network([[0, 1], [1, 2], [1, 3], [1, 4]], pins={0: [-1, 0], 2: [1, 0], 3: [0, 1], 4: [0, -1]})
    state = spring_state(network, np.full(4, 0.5), np.array([[-1, 0], [0, 0], [1, 0], [0, 1], [0, -1.0]]))
    path = strain_path(state, [0.0, 0.1, 0.2], deformation="uniaxial").value
    np.testing.assert_allclose(path.energy, (0.5 + path.strains) ** 2 + 0.25, rtol=1e-14)
    np.testing.assert_allclose(path.modulus, 2.0, rtol=1e-13)
    assert np.isnan(path.bulk_modulus).all()


def test_the_path_of_the_taut_part_alone():
    network, lengths, critical = slack_lattice()
    strains, part = [1e-4, 1e-3], backbone(critical)
    solution = strain_path(critical, strains, taut_only=True)
    assert solution.ok
    assert f"{part.n_slack} of {network.n_edges} edges are slack" in solution.note
    alone = strain_path(part.configuration, strains).value
    assert np.array_equal(solution.value.bulk_modulus, alone.bulk_modulus)
    growth = stiffening(critical).value
    assert alone.bulk_modulus[0] == pytest.approx(growth.bulk_0 + 1e-4 * growth.C_B, rel=1e-4)
    # All edges give the same as long as none becomes taut; without rest lengths there is nothing else to follow.
    cables = strain_path(critical_from_lengths(network, lengths, throw=False), strains)
    np.testing.assert_allclose(cables.value.bulk_modulus, alone.bulk_modulus, rtol=1e-9)
    assert cables.value.states[0].network.n_edges == network.n_edges and cables.note == ""
    assert "taut part" in strain_path(replace(critical, rest_lengths=None), strains).note


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


def test_an_optimum_of_stresses_is_of_springs():
    network = voronoi(20, seed=1)
    best = optimize(network, "length_variance", "conic")
    assert strain_path(best, [0.01]).value.states[0].law == Hookean()
    assert strain_path(critical_from_lengths(network, np.ones(30)), [0.01]).value.states[0].law == Cable()


def beginning(**changes):
    return replace(replace(taut_rows(2), rest_lengths=np.ones(taut_rows(2).network.n_edges)), **changes)


# The vertices 1 and 2 have the same neighbours, and at σ = 1 the same place.
TWINS = CriticalManifold(
    Network(
        [[0, 1], [1, 0], [0, 2], [2, 0], [1, 2], [0, 1], [0, 2]],
        [[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 1]],
        np.eye(2),
    )
).configuration(np.ones(7))

WRONG_STARTS = {
    "an edge without length": (TWINS, {}, "edge 4 has no length.*stress"),
    "a spring without length": (
        SpringState(TWINS.network, np.ones(7), TWINS.coordinates, TWINS.bond_vectors),
        {},
        "edge 4 has no length.*apart",
    ),
    "two-sided": (beginning(), {"law": Hookean()}, "compressed"),
    "other lengths": (beginning(rest_lengths=np.linspace(1, 2, 8)), {}, "these rest lengths"),
    "a state": (stiff_lattice(), {"taut_only": True}, "no slack part"),
    "another law": (stiff_lattice(), {"law": Cable()}, "leave out law"),
}


@pytest.mark.parametrize("name", WRONG_STARTS)
def test_starts_that_are_refused(name):
    start, options, word = WRONG_STARTS[name]
    with pytest.raises(InputError, match=word):
        strain_path(start, [0.1], **options)


@pytest.mark.parametrize("length", [1e-9, 1e9])
@pytest.mark.parametrize("stiffness", [1e-6, 1e6])
def test_other_units_give_the_same_path(length, stiffness):
    critical, strains = partly_compressed(16, 2), [0.001, 0.01, 0.1]
    network = critical.network
    scaled = Network(network.edges, network.offsets, network.cell * length, stiffness)
    path = strain_path(critical, strains, throw=False).value
    other = strain_path(CriticalManifold(scaled).configuration(critical.sigma), strains, throw=False).value
    np.testing.assert_array_equal(other.status, path.status)
    np.testing.assert_array_equal(other.steps, path.steps)
    np.testing.assert_allclose(other.energy, path.energy * stiffness * length**2, rtol=1e-11)
    np.testing.assert_allclose(other.modulus, path.modulus * stiffness, rtol=1e-12)
