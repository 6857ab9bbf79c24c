"""The strain path: equilibria at increasing volume, equal to direct relaxations."""

from dataclasses import replace

import numpy as np
import pytest
from problems import (
    NETWORKS,
    SMALL_NETWORKS,
    bounds_over_errors,
    critical_of,
    foam_network,
    random_stress,
    relaxed_directly,
    reordered,
    slack_lattice,
    stiff_lattice,
    with_random_stiffness,
)
from refusals import refused

from critflow import (
    Cable,
    CriticalManifold,
    Deformation,
    Hookean,
    InputError,
    Network,
    PowerLaw,
    Status,
    equilibrium,
    lattice,
    optimize,
    spring_state,
    stiffening,
    strain_path,
)
from critflow import voronoi_network as voronoi
from critflow.deformation import DEFORMATIONS, deformation_of
from critflow.manifold import critical_configuration
from critflow.springs import SpringState
from critflow.taut_part import backbone
from workflows.benchmarks import reference

STRAINS = np.array([1e-6, 1e-5, 1e-4, 0.001, 0.002, 0.003, 0.01, 0.05])


@pytest.mark.parametrize("name", ["voronoi", "voronoi, random stiffness", "voronoi 3D", "oblique"])
def test_path_is_relaxed_at_every_strain(name):
    critical = critical_of(NETWORKS[name]())
    solution = strain_path(critical, STRAINS)
    assert solution.status is Status.ok
    path = solution.value
    np.testing.assert_array_equal(path.status, Status.ok)
    assert solution.stats.residual == path.max_force.max() < 1e-13
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
    fire = strain_path(critical, [0.02, 0.04], method="fire", tolerance=1e-13)
    newton = strain_path(critical, [0.02, 0.04])
    assert fire.status is newton.status is Status.ok
    np.testing.assert_allclose(fire.value.bulk_modulus, newton.value.bulk_modulus, rtol=1e-8)
    np.testing.assert_allclose(
        fire.value.states[-1].bond_vectors, newton.value.states[-1].bond_vectors, rtol=0, atol=1e-10
    )


@pytest.mark.parametrize("make", [lambda: voronoi(40, seed=1), lambda: foam_network(60, seed=1)], ids=["2D", "3D"])
@pytest.mark.parametrize("deformation", ["dilation", "simple_shear", "uniaxial"])
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


FIXED = [name for name in DEFORMATIONS if not deformation_of(name, 2).free]


def curving(strain):
    """F(γ) that curves, rotates and changes the volume."""
    return np.array([[np.exp(strain), strain], [0.3 * strain**2, 1.0]])


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    "deformation",
    [*FIXED, np.array([[0.3, 0.2], [-0.5, 0.1]]), curving],
    ids=[*FIXED, "matrix", "function"],
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
    assert volume[n] * np.sum(path.stress[n] * F.velocity(strains[n])) == pytest.approx(first, rel=1e-9, abs=1e-12)
    for strain, one in zip(strains, path.states, strict=True):
        boundary = state.network.boundary_vectors @ F.gradient(strain).T
        np.testing.assert_allclose(one.network.boundary_vectors, boundary, rtol=0, atol=1e-14)
    assert not path.inserted.any() and path.steps.max() <= 4


def test_a_path_of_energies_has_their_second_derivative():
    network = with_random_stiffness(voronoi(24, seed=2), 1)
    # The last stress is of affine motion, without any relaxation.
    for sigma in (random_stress(network.n_edges, 4), network.stiffness):
        critical = CriticalManifold(network).configuration(sigma)
        exact = strain_path(critical, [0.01, 0.02]).value
        for options in ({}, {"method": "fire", "tolerance": 1e-9}):
            path = strain_path(critical, [0.01, 0.02], measure="energy", **options).value
            bounds = path.modulus_error + exact.modulus_error
            assert (np.abs(path.modulus - exact.modulus) <= bounds).all() and bounds.max() < 1e-6
            assert np.isnan(path.bulk_modulus).all() and path.elasticity == ()
            # The rounding of one modulus is a part of that of all.
            assert "method" in options or (path.modulus_error > 0.25 * exact.modulus_error).all()


@pytest.mark.parametrize("decades, strain", [(0, 1e-12), (8, 1e-3), (8, 1e-6)])
def test_a_path_of_energies_has_a_modulus_where_that_of_tensors_has_one(decades, strain):
    # Forces of an affine motion are rounding alone; corrections by a factor next to stiff springs do not shrink.
    k = 10 ** np.random.default_rng(4).uniform(-decades / 2, decades / 2, 30)
    network = voronoi(20, seed=4).with_stiffness(k)
    critical = CriticalManifold(network).configuration(random_stress(30, 4) if decades else k)
    path, exact = (strain_path(critical, [strain], measure=measure).value for measure in ("energy", "tensors"))
    assert np.abs(path.modulus - exact.modulus) <= path.modulus_error + exact.modulus_error < 1e-6 * exact.modulus
    assert np.isnan(path.bulk_modulus).all() and path.elasticity == ()


def test_the_statistics_of_a_path_have_its_largest_error_and_residual():
    solution = strain_path(optimize(voronoi(20, seed=1), "G_0"), [1e-5, 1e-3, 0.1])
    path, stats = solution.value, solution.stats
    assert 0 < path.coordinate_error.min() < path.coordinate_error.max() == stats.error_bound
    assert path.max_force.min() < path.max_force.max() == stats.residual and stats.steps == path.steps.sum()


@pytest.mark.parametrize("seed", [0, 1])
def test_errors_contain_what_soft_modes_leave(seed):
    """The energy of the last corrections is that of the stiff modes; paths of energies correct to the end."""
    network = voronoi(20, seed=seed)
    network = network.with_stiffness(10 ** np.random.default_rng(seed).uniform(-3, 3, network.n_edges))
    critical = CriticalManifold(network).configuration(network.stiffness)
    whole, exact = (strain_path(critical, [1e-12], "uniaxial", measure=m).value for m in ("tensors", "energy"))
    assert exact.modulus_error < 1e-2 * abs(whole.modulus - exact.modulus)
    assert abs(whole.modulus - exact.modulus) <= whole.modulus_error < 1e-6 * exact.modulus


def test_a_path_of_energies_needs_a_modulus_at_its_strains_alone():
    # Springs exactly at rest leave vertices of the kagome lattice floppy, here also after a small shear.
    network = lattice("kagome", 4, 4)
    state = spring_state(network, np.full(network.n_edges, 1.0), network.positions)
    state = replace(state, rest_lengths=state.lengths)
    assert strain_path(state, [1e-6], "uniaxial", measure="energy").value.modulus == pytest.approx(0.6495, rel=1e-4)
    for strains, deformation in (([0.0, 1e-6], "uniaxial"), ([1e-6], "pure_shear")):
        solution = strain_path(state, strains, deformation, measure="energy", throw=False)
        assert solution.status is Status.ill_conditioned and np.isnan(solution.value.modulus).all()


@pytest.mark.parametrize(
    "stiffness, parameter, strain",
    [(1e10, 1, 1.0), (1, 1e-6, 0.01), (1, 1, 1e6), (1, 1, 1e13)],
    ids=["one stiff spring", "slow", "large", "huge"],
)
def test_springs_that_resist_are_not_floppy(stiffness, parameter, strain):
    """F(t) of a dilation γ = t, or of one that a slow parameter runs through."""
    k = np.where(np.arange(60) == 7, stiffness, 1.0)
    critical = CriticalManifold(voronoi(40, seed=1).with_stiffness(k)).configuration(np.ones(60))
    slow = Deformation.exponential(0.5 * parameter * np.eye(2)) if parameter < 1 else "dilation"
    path = strain_path(critical, [strain / parameter], slow).value
    x = np.sqrt(np.exp(strain) if parameter < 1 else 1 + strain)
    direct = spring_state(critical.network, critical.lengths, critical.coordinates).deformed(x * np.eye(2))
    # At the largest strains rounding hides the last digits of the balance.
    assert path.energy[0] == pytest.approx(equilibrium(direct, throw=False).value.energy, rel=1e-9)


def test_springs_that_only_turn_keep_their_lengths():
    turn = Deformation.exponential([[0.0, 1.0], [-1.0, 0.0]])
    solution = strain_path(critical_of(voronoi(12, seed=1)), [1e-3], turn, throw=False)
    assert solution.status is Status.floppy
    assert solution.note.endswith("springs keep all lengths, so nothing resists: deform the cell in another way")
    assert solution.note.count("strain") == 1 and "free" not in solution.note


def test_a_strain_that_loosens_is_floppy():
    solution = strain_path(critical_of(voronoi(12, seed=1)), [-0.01, -0.02], throw=False)
    assert solution.status is Status.floppy
    assert solution.value.status.tolist() == [Status.floppy, Status.missing]
    assert np.isnan(solution.value.energy).all() and solution.stats.steps == 0


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("deformation", ["simple_shear", "pure_shear"])
def test_a_strain_without_work_loosens_in_neither_direction(deformation, sign):
    # The stress of the honeycomb is isotropic: a shear does no work to first order, and its energy is of fourth order.
    network = lattice("honeycomb", 3, 3)
    critical = CriticalManifold(network).configuration(np.ones(network.n_edges))
    strains = sign * np.array([1e-3, 2e-3])
    solution = strain_path(critical, strains, deformation, throw=False)
    assert solution.status is Status.ok
    assert solution.value.energy[1] / solution.value.energy[0] == pytest.approx(16, rel=0.01)


def test_a_path_begins_at_springs_exactly_at_rest():
    network = lattice("square", 4, 4)
    state = spring_state(network, np.ones(32), network.positions)
    assert not state.sigma.any()
    solution = strain_path(state, [0.0, 1e-3], "uniaxial")
    np.testing.assert_allclose(solution.value.energy, [0, 16 * 0.5 * 1e-6], rtol=1e-9)


def pinned_cross(apart=0.0):
    """Four springs from a vertex to pins, stretched to twice their lengths; the vertex is moved along x."""
    network = Network([[0, 1], [1, 2], [1, 3], [1, 4]], pins={0: [-1, 0], 2: [1, 0], 3: [0, 1], 4: [0, -1]})
    return spring_state(network, np.full(4, 0.5), np.array([[-1, 0], [apart, 0], [1, 0], [0, 1], [0, -1.0]]))


def test_a_path_begins_where_forces_are_below_a_millionth():
    near = pinned_cross(1.2e-7)
    assert near.max_force < 5e-7 < pinned_cross(2.5e-7).max_force
    direct = strain_path(pinned_cross(), [0.1], "uniaxial").value
    np.testing.assert_allclose(strain_path(near, [0.1], "uniaxial").value.energy, direct.energy, rtol=1e-12)


def test_pins_follow_the_deformation():
    # Two springs in series on a line of pins: each takes half of the elongation.
    path = strain_path(pinned_cross(), [0.0, 0.1, 0.2], deformation="uniaxial").value
    np.testing.assert_allclose(path.energy, (0.5 + path.strains) ** 2 + 0.25, rtol=1e-14)
    np.testing.assert_allclose(path.modulus, 2.0, rtol=1e-13)
    assert np.isnan(path.bulk_modulus).all()


def test_the_path_of_the_taut_part_alone():
    network, _, critical = slack_lattice()
    strains, part = [1e-4, 1e-3], backbone(critical)
    solution = strain_path(critical, strains, taut_only=True)
    assert solution.ok
    assert f"{part.n_slack} of {network.n_edges} edges are slack" in solution.note
    alone = strain_path(part.configuration, strains).value
    assert np.array_equal(solution.value.bulk_modulus, alone.bulk_modulus)
    growth = stiffening(critical).value
    assert alone.bulk_modulus[0] == pytest.approx(growth.bulk_0 + 1e-4 * growth.C_B, rel=1e-4)
    # Without rest lengths there is nothing else to follow.
    assert "taut part" in strain_path(replace(critical, rest_lengths=None), strains).note


def test_an_optimum_of_stresses_is_of_springs():
    best = optimize(voronoi(20, seed=1), "length_variance", "conic")
    assert strain_path(best, [0.01]).value.states[0].law == Hookean()


# The vertices 1 and 2 have the same neighbours, and at σ = 1 the same place.
TWINS = CriticalManifold(
    Network(
        [[0, 1], [1, 0], [0, 2], [2, 0], [1, 2], [0, 1], [0, 2]],
        [[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 1]],
        np.eye(2),
    )
).configuration(np.ones(7))

UNSTRESSED = SpringState(TWINS.network, np.ones(7), TWINS.coordinates, TWINS.bond_vectors)
test_starts_that_are_refused = refused(
    {
        "an edge without length": (lambda: strain_path(TWINS, [0.1]), "edge 4 has no length.*stress"),
        "a spring without length": (lambda: strain_path(UNSTRESSED, [0.1]), "edge 4 has no length.*apart"),
        "a state": (lambda: strain_path(stiff_lattice(), [0.1], taut_only=True), "no slack part"),
        "another law": (lambda: strain_path(stiff_lattice(), [0.1], law=Cable()), "leave out law"),
        # The force is 3 k for each unit of the distance, and the limit 1e-6 k ℓ with ℓ = 1/2.
        "out of balance": (
            lambda: strain_path(pinned_cross(2.5e-7), [0.1], "uniaxial"),
            r"not in equilibrium, a force of 7\.5e-07 is left",
        ),
    },
    InputError,
)
