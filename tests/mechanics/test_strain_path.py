"""The strain path: equilibria at increasing volume, equal to direct relaxations."""

from dataclasses import replace

import numpy as np
import pytest
from problems import (
    NETWORKS,
    SMALL_NETWORKS,
    bounds_over_errors,
    exact_moduli,
    random_stress,
    slack_lattice,
    taut_rows,
    with_random_stiffness,
)
from scipy.optimize import minimize, minimize_scalar

from critflow import (
    DEFORMATIONS,
    Cable,
    CriticalManifold,
    Deformation,
    Hookean,
    InputError,
    Network,
    PowerLaw,
    SolveError,
    Status,
    WormLike,
    backbone,
    critical_from_lengths,
    deformation_of,
    equilibrium,
    honeycomb_network,
    spring_state,
    stiffening,
    strain_path,
    triangular_network,
)
from critflow import voronoi_network as voronoi
from critflow.critical.manifold import critical_configuration
from critflow.mechanics import continuation
from critflow.mechanics.continuation import Continuation, _Predictor
from critflow.mechanics.free_cell import stretched
from workflows.benchmarks import reference

STRAINS = np.array([1e-6, 1e-5, 1e-4, 0.001, 0.002, 0.003, 0.01, 0.05])


def critical_of(network, seed=1):
    return CriticalManifold(network).configuration(random_stress(network.n_edges, seed))


def relaxed_directly(critical, gamma):
    network = critical.network
    state = spring_state(network, critical.lengths, critical.coordinates)
    F = (1 + gamma) ** (1 / network.dimension) * np.eye(network.dimension)
    solution = equilibrium(state.deformed(F))
    assert solution.status is Status.ok
    return solution.value


@pytest.mark.parametrize("name", ["voronoi", "voronoi, random stiffness", "voronoi 3D", "oblique"])
def test_path_is_relaxed_at_every_strain(name):
    critical = critical_of(NETWORKS[name]())
    solution = strain_path(critical.network, critical, STRAINS)
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
        direct = relaxed_directly(critical, gamma)
        # Both may differ by forces of 1e-14 over the softest stiffness, of order γ/100.
        np.testing.assert_allclose(state.bond_vectors, direct.bond_vectors, rtol=0, atol=1e-11 + 1e-13 / gamma)
        # The energy is second order in that error.
        assert energy == pytest.approx(direct.energy, rel=1e-7)


def test_path_is_independent_of_intermediate_strains():
    critical = critical_of(voronoi(40, seed=1))
    few = strain_path(critical.network, critical, [0.03]).value
    many = strain_path(critical.network, critical, np.linspace(0.001, 0.03, 30)).value
    np.testing.assert_allclose(many.states[-1].bond_vectors, few.states[-1].bond_vectors, rtol=0, atol=1e-11)
    for name in ("bulk_modulus", "shear_modulus", "shear_modulus_stress_corrected", "energy"):
        assert getattr(many, name)[-1] == pytest.approx(getattr(few, name)[-1], rel=1e-9)


def test_states_are_independent_of_moduli():
    critical = critical_of(voronoi(40, seed=1))
    plain = strain_path(critical.network, critical, [0.001, 0.01], moduli=False)
    full = strain_path(critical.network, critical, [0.001, 0.01])
    assert plain.status is full.status is Status.ok
    assert np.isnan(plain.value.bulk_modulus).all()
    np.testing.assert_allclose(plain.value.energy, full.value.energy, rtol=1e-10)


def test_fire_follows_the_same_path():
    critical = critical_of(with_random_stiffness(voronoi(20, seed=2), 1))
    fire = strain_path(critical.network, critical, [0.02, 0.04], "fire", tolerance=1e-13)
    newton = strain_path(critical.network, critical, [0.02, 0.04])
    assert fire.status is newton.status is Status.ok
    np.testing.assert_allclose(fire.value.bulk_modulus, newton.value.bulk_modulus, rtol=1e-8)
    np.testing.assert_allclose(
        fire.value.states[-1].bond_vectors, newton.value.states[-1].bond_vectors, rtol=0, atol=1e-10
    )


def test_energy_is_the_work_done():
    # dE/dV = pressure-like Σσ|L|²/(dV): the trapezium over the path has an error of the square of the step.
    critical = critical_of(voronoi(40, seed=3))
    gamma = np.linspace(0.0005, 0.02, 40)
    path = strain_path(critical.network, critical, gamma).value
    volume = np.array([s.network.volume for s in path.states])
    slope = np.array([np.sum(s.sigma * s.lengths**2) / (2 * s.network.volume) for s in path.states])
    work = np.sum(0.5 * (slope[1:] + slope[:-1]) * np.diff(volume))
    assert work == pytest.approx(path.energy[-1] - path.energy[0], rel=1e-4)


def test_failed_path_names_the_strain():
    critical = critical_of(voronoi(40, seed=1))
    # No solve reaches a force of 1e-30.
    solution = strain_path(critical.network, critical, [0.001, 0.002], tolerance=1e-30, throw=False)
    assert solution.status is not Status.ok
    assert solution.value.status[1] == Status.missing
    assert np.isnan(solution.value.energy).all()
    with pytest.raises(SolveError, match=r"0\.001"):
        strain_path(critical.network, critical, [0.001, 0.002], tolerance=1e-30)


@pytest.mark.parametrize(
    "strains", [[], [0.002, 0.001], [-0.001, 0.001], [-0.001, -0.001], [0.0, 0.001], [np.nan], [0.001, 0.001], [np.inf]]
)
def test_bad_strains(strains):
    with pytest.raises(InputError, match=r"0\.001"):
        strain_path(voronoi(12, seed=1), critical_of(voronoi(12, seed=1)), strains)


def test_steps_start_near_their_solution():
    # Extrapolation of third order along an even path leaves a step or two to Newton's method.
    critical = critical_of(voronoi(40, seed=1))
    path = strain_path(critical.network, critical, np.linspace(0.001, 0.02, 20)).value
    assert path.steps[3:].max() <= 3


@pytest.mark.parametrize("n", [2.0, 3.0, 4.5])
def test_power_laws_of_the_largest_bulk_modulus_are_affine(n):
    # With σ = k all edges stretch alike, by λ = √v; every tension is then kℓ times one function of λ, so the
    # balance persists and B = (v/V_0) d²E/dv² with E = Σkℓ²/(n − 1)·((λⁿ − 1)/n − λ + 1) at any strain.
    network = with_random_stiffness(voronoi(40, seed=1), 3)
    critical = CriticalManifold(network).configuration(network.stiffness)
    gamma = np.array([0.01, 0.1, 0.5])
    path = strain_path(network, critical, gamma, law=PowerLaw(n)).value
    v, scale = 1 + gamma, network.stiffness @ critical.lengths**2 / (n - 1)
    second = (n / 2 - 1) / 2 * v ** (n / 2 - 2) + 0.25 * v**-1.5
    np.testing.assert_allclose(path.bulk_modulus, v * scale * second / network.volume, rtol=1e-10)
    energy = scale * ((v ** (n / 2) - 1) / n - np.sqrt(v) + 1)
    np.testing.assert_allclose(path.energy, energy, rtol=1e-11)
    for g, state in zip(gamma, path.states, strict=True):
        np.testing.assert_allclose(state.lengths, np.sqrt(1 + g) * critical.lengths, rtol=1e-10)


def test_path_ends_with_the_range_of_its_law():
    # With σ = k the edges of equal law reach their contour length together, at the volume (1 + m)².
    network = voronoi(40, seed=1)
    critical = CriticalManifold(network).configuration(np.ones(60))
    law, strains = WormLike(0.02), 0.002 * np.arange(1, 26)
    solution = strain_path(network, critical, strains, law=law, throw=False)
    assert solution.status is Status.stalled
    path = solution.value
    assert len(path.states) == 20
    assert path.strains[19] < 1.02**2 - 1 < path.strains[20]
    assert (np.diff(path.bulk_modulus[:20]) > 0).all()
    assert np.isnan(path.bulk_modulus[20:]).all()
    with pytest.raises(SolveError, match=r"0\.042"):
        strain_path(network, critical, strains, law=law)


@pytest.mark.parametrize("moduli", [True, False])
@pytest.mark.parametrize("end", [0.1, 0.5])
def test_one_step_equals_many_steps(end, moduli):
    critical = critical_of(voronoi(40, seed=1))
    one = strain_path(critical.network, critical, [end], moduli=moduli).value
    many = strain_path(critical.network, critical, np.linspace(0, end, 51)[1:]).value
    np.testing.assert_allclose(one.states[-1].bond_vectors, many.states[-1].bond_vectors, rtol=0, atol=1e-13)
    # Without compression the equilibrium is unique and no step is inserted.
    assert (one.states[-1].extension > 0).all()
    assert not one.inserted.any() and not many.inserted.any()


def partly_compressed(n_vertices, seed):
    """A critical configuration of which an edge in twenty is compressed."""
    network, rng = voronoi(n_vertices, seed=seed), np.random.default_rng(seed)
    sigma = np.abs(rng.standard_normal(network.n_edges)) + 0.05
    sigma[rng.choice(network.n_edges, max(1, network.n_edges // 20), replace=False)] *= -0.15
    return CriticalManifold(network).configuration(sigma)


@pytest.mark.parametrize("end", [0.1, 0.5])
def test_one_step_follows_the_branch_of_many_steps(end):
    critical = partly_compressed(20, 12)
    one = strain_path(critical.network, critical, [end]).value
    many = strain_path(critical.network, critical, np.linspace(0, end, 101)[1:]).value
    np.testing.assert_allclose(one.states[-1].bond_vectors, many.states[-1].bond_vectors, rtol=0, atol=1e-12)
    assert one.bulk_modulus[-1] == pytest.approx(many.bulk_modulus[-1], rel=1e-11)
    assert one.inserted[0] > 0 and (one.states[-1].extension < 0).any()
    # Relaxed at once, Newton's method ends in another equilibrium.
    direct = relaxed_directly(critical, end)
    assert np.abs(direct.bond_vectors - one.states[-1].bond_vectors).max() > 0.1


@pytest.mark.parametrize("n_vertices, seed", [(12, 5), pytest.param(40, 11, marks=pytest.mark.sweep)])
def test_end_of_a_branch_is_reported(n_vertices, seed):
    critical = partly_compressed(n_vertices, seed)
    # There are equilibria beyond, but no continuous path to them.
    assert relaxed_directly(critical, 0.5).max_force < 1e-12
    for strains in ([0.5], np.linspace(0, 0.5, 51)[1:]):
        solution = strain_path(critical.network, critical, strains, throw=False)
        assert solution.status in (Status.unstable, Status.step_limit, Status.stalled, Status.ill_conditioned)
        assert np.isnan(solution.value.energy[-1]) and np.isnan(solution.value.coordinate_error[-1])


def test_inserted_strains_are_removed_and_steps_grow():
    critical = partly_compressed(20, 12)
    strains = [0.3, 0.301, 0.4]
    path = strain_path(critical.network, critical, strains).value
    assert len(path.states) == 3
    assert path.inserted[0] > 0 and path.inserted[1] == 0
    for gamma, state in zip(strains, path.states, strict=True):
        assert state.network.volume == pytest.approx(critical.network.volume * (1 + gamma), rel=1e-13)


@pytest.mark.parametrize("name", ["voronoi", "voronoi 3D", "oblique"])
def test_coordinates_and_bond_vectors_stay_consistent(name):
    critical = CriticalManifold(NETWORKS[name]()).configuration(random_stress(NETWORKS[name]().n_edges, 4))
    path = strain_path(critical.network, critical, [0.01, 0.02, 0.05]).value
    for state in path.states:
        np.testing.assert_allclose(
            state.network.bond_vectors(state.coordinates), state.bond_vectors, rtol=0, atol=1e-13
        )


SWEPT = [*10.0 ** -np.arange(12, 4, -1), 0.001, 0.002, 0.003, 0.05, 0.3]


@pytest.mark.parametrize("strains", [[1e-12, 1e-7, 0.001, 0.3], pytest.param(SWEPT, marks=pytest.mark.sweep)], ids=len)
def test_bounds_of_paths(strains):
    network = SMALL_NETWORKS["stiffness"]()
    critical = CriticalManifold(network).configuration(random_stress(18, 4))
    path = strain_path(network, critical, strains).value
    found = []
    for n, state in enumerate(path.states):
        exact = reference.equilibrium(state.network, state.rest_lengths, state.coordinates)
        error = reference.largest_error(state.coordinates, exact.coordinates, moved=True)
        assert error <= path.coordinate_error[n] <= 10 * error
        values = (path.bulk_modulus[n], path.shear_modulus[n], path.shear_modulus_stress_corrected[n])
        shear = path.shear_modulus_error[n]
        found += bounds_over_errors(values, (path.bulk_modulus_error[n], shear, shear), exact_moduli(state))
    assert np.median(found) < 100


def stiff_lattice(seed=1):
    """A triangular lattice under random stress of both signs, in equilibrium."""
    network, rng = with_random_stiffness(triangular_network(4, 4), seed), np.random.default_rng(seed)
    at_rest = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    rest = at_rest * (1 + 0.02 * rng.standard_normal(network.n_edges))
    return equilibrium(spring_state(network, rest, network.positions)).value


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
    path = strain_path(state.network, state, strains, deformation=deformation).value
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


def test_free_sides_minimise_the_energy():
    # Against golden-section search over the lateral strain, each point relaxed at fixed sides.
    state = stiff_lattice(2)
    path = strain_path(state.network, state, [0.05], deformation="uniaxial_free").value

    def energy(q):
        F = np.diag([1.05, 1 + q])
        return equilibrium(state.deformed(F)).value.energy

    found = minimize_scalar(energy, bracket=(-0.05, 0.0, 0.05), tol=1e-10)
    # The energy is quadratic in the error of q.
    assert path.free_components[0, 0] == pytest.approx(found.x, abs=1e-7)
    assert path.energy[0] == pytest.approx(found.fun, rel=1e-13)
    assert abs(path.stress[0, 1, 1]) < 1e-14 and path.stress[0, 0, 0] > 0.03
    assert 0 < path.coordinate_error[0] < 1e-13


def test_free_cell_in_space_has_no_stress():
    offsets = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1]]
    sites = np.array(list(np.ndindex(2, 2, 2)))
    heads = sites[:, None] + offsets
    edges = [
        [4 * a + 2 * b + c, 4 * (i % 2) + 2 * (j % 2) + k % 2]
        for (a, b, c), row in zip(sites, heads, strict=True)
        for i, j, k in row
    ]
    network = Network(edges, heads.reshape(-1, 3) // 2, 2 * np.eye(3), positions=sites)
    network = with_random_stiffness(network, 1)
    at_rest = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    state = equilibrium(spring_state(network, 0.98 * at_rest, network.positions)).value
    deformation = Deformation.uniaxial(3, sides="free").freeing("yy", "zz", "xy")
    path = strain_path(network, state, [0.0, 0.02, 0.05], deformation=deformation).value
    assert path.free_components.shape == (3, 3)
    assert (path.stress[1:, 0, 0] > 0.01).all()
    for stress, q in zip(path.stress, path.free_components, strict=True):
        # Of the boundary (1 + Σ q E) F b the stress does the work V Σ_ij S_ij A_ij with A = E (1 + Σ q E)⁻¹.
        rates = deformation.free_strains @ np.linalg.inv(stretched(q, deformation.free_strains))
        np.testing.assert_allclose(np.einsum("ij,mij->m", stress, rates), 0, atol=1e-14)


@pytest.mark.parametrize("deformation", ["simple_shear", "pure_shear", "uniaxial", "uniaxial_free"])
def test_the_path_back_returns_to_its_start(deformation):
    state = stiff_lattice(3)
    F = deformation_of(deformation, 2)
    there = strain_path(state.network, state, [0.02, 0.04], deformation=F).value
    total = stretched(there.free_components[-1], F.free_strains) @ F.gradient(0.04)

    last = there.states[-1]
    back = strain_path(last.network, last, [0.5, 1.0], deformation=np.linalg.inv(total) - np.eye(2)).value
    np.testing.assert_allclose(back.states[-1].bond_vectors, state.bond_vectors, rtol=0, atol=1e-13)
    assert back.energy[-1] == pytest.approx(state.energy, rel=1e-11)


@pytest.mark.parametrize("gamma", [0.01, 0.1, 0.3])
def test_honeycomb_from_its_transition(gamma):
    # Uniform: two vertices a cell; the energy of three edges, minimal over the one relative position.
    network = honeycomb_network(2, 2)
    critical = CriticalManifold(network).configuration(np.ones(network.n_edges))
    for deformation in ("dilation", "simple_shear", "pure_shear", "uniaxial"):
        path = strain_path(network, critical, [gamma], deformation=deformation).value
        F = path.deformation.gradient(gamma)
        directions = np.unique(np.round(critical.bond_vectors, 12), axis=0)
        assert len(directions) == 3, "all edges point from one sublattice to the other"
        length = critical.lengths[0]

        def energy(u, edges=directions @ F.T, length=length):
            return 0.5 * np.sum((np.linalg.norm(edges + u, axis=1) - length) ** 2)

        found = minimize(energy, np.zeros(2), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-16})
        assert path.energy[0] == pytest.approx(network.n_edges / 3 * found.fun, rel=1e-8)


def test_a_strain_that_loosens_is_floppy():
    critical = critical_of(voronoi(12, seed=1))
    solution = strain_path(critical.network, critical, [-0.01, -0.02], throw=False)
    assert solution.status is Status.floppy
    assert solution.value.status.tolist() == [Status.floppy, Status.missing]
    assert np.isnan(solution.value.energy).all() and solution.stats.steps == 0


def test_pins_follow_the_deformation():
    # Two springs in series on a line of pins: each takes half of the elongation.
    network = Network([[0, 1], [1, 2], [1, 3], [1, 4]], pins={0: [-1, 0], 2: [1, 0], 3: [0, 1], 4: [0, -1]})
    state = spring_state(network, np.full(4, 0.5), np.array([[-1, 0], [0, 0], [1, 0], [0, 1], [0, -1.0]]))
    path = strain_path(network, state, [0.0, 0.1, 0.2], deformation="uniaxial").value
    np.testing.assert_allclose(path.energy, (0.5 + path.strains) ** 2 + 0.25, rtol=1e-14)
    np.testing.assert_allclose(path.modulus, 2.0, rtol=1e-13)
    assert np.isnan(path.bulk_modulus).all()


@pytest.mark.parametrize("strain", [5e-324, 1e-320, 1e-310, 1e-17])
def test_strains_below_the_rounding_of_the_cell_end_at_once(strain):
    critical = critical_of(voronoi(16, seed=5100))
    solution = strain_path(critical.network, critical, [strain], throw=False)
    assert solution.status is Status.ill_conditioned
    assert solution.value.inserted[0] == 0


@pytest.mark.parametrize("moduli", [True, False])
def test_the_velocity_at_a_transition_is_found_where_it_is_needed(moduli):
    # The affinely deformed network is unstable at any strain, however small.
    critical = partly_compressed(20, 2)
    strains = [6.4e-8, 1.2e-7, 7.2e-6, 9e-5, 3e-4]
    solution = strain_path(critical.network, critical, strains, moduli=moduli, deformation="pure_shear")
    assert solution.ok and not solution.value.inserted.any()


def test_no_strain_exceeds_its_budget(monkeypatch):
    # Steps beyond a fixed length fail, so that strides never grow.
    critical, steps = critical_of(voronoi(8, seed=1)), []
    monkeypatch.setattr(continuation, "_MOST_STEPS", 50)
    follow = Continuation._step

    def short_ones(self, strain):
        steps.append(abs(strain - self.strain))
        step = follow(self, strain)
        return step if steps[-1] < 2e-6 else replace(step, status=Status.unstable, note="too far")

    monkeypatch.setattr(Continuation, "_step", short_ones)
    solution = strain_path(critical.network, critical, [0.01, 0.02], throw=False)
    assert solution.status is Status.step_limit and "closer" in solution.note
    assert len(steps) <= 50


def test_slack_parts_do_not_shorten_the_steps():
    # Slack edges are springs at rest in floppy parts, of which a few are compressed by 1e-9.
    network = voronoi(200, seed=5)
    lengths = np.random.default_rng(5).uniform(0.3, 1.7, network.n_edges)
    critical = critical_from_lengths(network, lengths, throw=False)
    assert len(critical.slack_edges) > 100
    strains = np.linspace(0.001, 0.01, 10)
    path = strain_path(network, critical.value, strains).value
    assert path.inserted.sum() < 20 and path.steps.sum() < 200
    other = strain_path(network, critical.value, [0.0013, 0.01]).value
    np.testing.assert_allclose(other.bulk_modulus[-1], path.bulk_modulus[-1], rtol=1e-9)


def test_the_path_of_a_slack_configuration_is_that_of_its_taut_part():
    network, lengths, critical = slack_lattice()
    strains = [1e-4, 1e-3]
    solution = strain_path(network, critical, strains)
    part = backbone(critical)
    assert solution.ok
    assert f"{part.n_slack} of {network.n_edges} edges are slack" in solution.note
    alone = strain_path(part.network, part.configuration, strains)
    assert np.array_equal(solution.value.bulk_modulus, alone.value.bulk_modulus)
    growth = stiffening(network, critical).value
    assert solution.value.bulk_modulus[0] == pytest.approx(growth.bulk_0 + 1e-4 * growth.C_B, rel=1e-4)
    # A solution with slack edges is a start as well; as cables all edges give the same as long as none becomes taut.
    cables = strain_path(
        network, critical_from_lengths(network, lengths, throw=False), strains, law=Cable(), rest_lengths=lengths
    )
    np.testing.assert_allclose(cables.value.bulk_modulus, alone.value.bulk_modulus, rtol=1e-9)
    assert cables.value.states[0].network.n_edges == network.n_edges


def test_a_slack_cable_becomes_taut_on_the_path():
    # Two cables between a vertex and its image: one taut, one slack until the strain reaches 0.02; k = 1, V = 1.
    network = Network([[0, 1], [1, 0], [0, 2], [2, 0]], [[0, 0], [1, 0], [0, 0], [1, 0]], np.eye(2))
    sigma, x = np.array([1.0, 1, 0, 0]), np.array([[0, 0], [0.5, 0], [0.5, 0.01]])
    critical = critical_configuration(network, sigma, x)
    path = strain_path(
        *(network, critical, [0.01, 0.03]),
        deformation="uniaxial",
        law=Cable(),
        rest_lengths=np.array([0.5, 0.5, 0.51, 0.51]),
    ).value
    # Each cable of two springs has stiffness 1/2; V = 1 + γ.
    np.testing.assert_allclose(path.modulus, [0.5 / 1.01, 1.0 / 1.03], rtol=1e-9)
    np.testing.assert_allclose(path.energy, [0.25 * 0.01**2, 0.25 * (0.03**2 + 0.01**2)], rtol=1e-9)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({}, "compressed"),
        ({"law": Hookean()}, "compressed"),
        ({"law": Cable(), "rest_lengths": np.linspace(1, 2, 4)}, "these rest lengths"),
    ],
    ids=["no law", "two-sided", "other lengths"],
)
def test_rest_lengths_of_slack_edges_need_cables(options, word):
    critical = taut_rows(2)
    n = critical.network.n_edges
    lengths = np.linspace(1, 2, n) if "rest_lengths" in options else np.ones(n)
    with pytest.raises(InputError, match=word):
        strain_path(critical.network, critical, [0.1], **{**options, "rest_lengths": lengths})


@pytest.mark.parametrize("length", [1e-9, 1e9])
@pytest.mark.parametrize("stiffness", [1e-6, 1e6])
def test_other_units_give_the_same_path(length, stiffness):
    critical, strains = partly_compressed(16, 2), [0.001, 0.01, 0.1]
    network = critical.network
    scaled = Network(network.edges, network.offsets, network.cell * length, stiffness)
    path = strain_path(network, critical, strains, throw=False).value
    other = strain_path(scaled, CriticalManifold(scaled).configuration(critical.sigma), strains, throw=False).value
    np.testing.assert_array_equal(other.status, path.status)
    np.testing.assert_array_equal(other.steps, path.steps)
    np.testing.assert_allclose(other.energy, path.energy * stiffness * length**2, rtol=1e-11)
    np.testing.assert_allclose(other.modulus, path.modulus * stiffness, rtol=1e-12)


@pytest.mark.parametrize("strains, degree", [([0.0, 1.0], 3), ([0.0, 0.3, 1.0], 5)])
def test_a_path_is_extrapolated_to_the_order_of_its_points(strains, degree):
    """Hermite polynomials of two and three points with velocities are exact up to the third and the fifth power."""

    def path(t):
        return np.array([t**degree, 1 - 2 * t**degree])

    def velocity(t):
        return degree * np.array([t ** (degree - 1), -2 * t ** (degree - 1)])

    predictor = _Predictor(path(0.0), velocity(0.0))
    for t in strains[1:]:
        predictor.add(t, path(t), velocity(t))
    np.testing.assert_allclose(predictor.displacement(1.7), path(1.7) - path(1.0), rtol=1e-11)
    # Far beyond the last step a straight line errs least.
    np.testing.assert_allclose(predictor.displacement(9.0), 8.0 * velocity(1.0))


def test_a_path_with_a_kink_is_extrapolated_from_two_points():
    predictor = _Predictor(np.zeros(1), np.ones(1))
    for t in (1.0, 2.0, 3.0, 4.0):
        predictor.displacement(t)
        predictor.add(t, np.array([abs(t - 1.5)]), np.sign([t - 1.5]))
    # Two points after the kink lie on a line; three points across it do not.
    np.testing.assert_allclose(predictor.displacement(5.0), [1.0])
