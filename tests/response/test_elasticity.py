"""Elasticity: relaxed energies of states and strains, closed forms, singular tensors, errors, bad input."""

import numpy as np
import pytest
from derivatives import second_derivative
from problems import (
    SMALL_NETWORKS,
    STRAINS,
    bounds_over_errors,
    exact_moduli,
    foam_network,
    oblique,
    random_stress,
    strained,
    triangular_lattice,
    voronoi_3d,
    with_random_stiffness,
)
from refusals import refused
from responses import (
    STRAIN_PATHS,
    assert_affine,
    assert_moduli_of_energies,
    assert_relaxations,
    assert_stress,
    relaxed_energy,
)

from critflow import (
    CriticalManifold,
    InputError,
    Network,
    PowerLaw,
    SpringLaw,
    Status,
    WormLike,
    elasticity,
    equilibrium,
    lattice,
    spring_state,
    stiffening,
    strain_path,
    three_bar_linkage,
    voronoi_network,
)
from critflow.deformation import strain_basis
from critflow.elastic import under_stress
from critflow.linear_response import form_rounding, linear_response
from critflow.numerics import EPS
from critflow.paths import _edge_rounding as rounding_along_path


def stretched(network, gamma=0.05, F=None, law=None, seed=2):
    """A state past the transition, deformed further and relaxed."""
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, seed))
    state = strain_path(critical, [gamma], law=law).value.states[0]
    return state if F is None else equilibrium(state.deformed(F), tolerance=1e-15).value


def compressed_lattice():
    """A triangular lattice whose springs are compressed and sheared, rigid by its bonds, with displaced vertices."""
    network, x = triangular_lattice(3, 4)
    rng = np.random.default_rng(3)
    state = spring_state(network, 1 + 0.05 * rng.standard_normal(network.n_edges), x)
    return equilibrium(state.deformed(np.array([[0.96, 0.05], [0.0, 0.97]])), tolerance=1e-15).value


STATES = {
    "tension": lambda: stretched(with_random_stiffness(voronoi_network(24, seed=1), 3)),
    "oblique": lambda: stretched(oblique(voronoi_network(40, seed=3)), 0.02),
    "shear": lambda: stretched(voronoi_network(24, seed=2), 0.3, np.array([[1.05, 0.1], [0.0, 0.95]])),
    "compression": compressed_lattice,
    "3D": lambda: stretched(voronoi_3d(), 0.1, np.array([[1.02, 0.03, 0], [0, 1, 0.02], [0.01, 0, 0.99]])),
    "foam": lambda: stretched(with_random_stiffness(foam_network(60, seed=1), 4)),
    "power law": lambda: stretched(with_random_stiffness(voronoi_network(40, seed=2), 3), 0.02, law=PowerLaw(4.5)),
    "power law, 3D": lambda: stretched(voronoi_3d(), 0.02, law=PowerLaw(3)),
    "worm-like": lambda: stretched(voronoi_network(40, seed=2), 0.02, law=WormLike(0.4)),
}


@pytest.fixture(scope="session", params=STATES)
def case(request):
    """A state and its response."""
    state = STATES[request.param]()
    response = elasticity(state)
    assert response.status is Status.ok
    return state, response


@pytest.mark.parametrize("strain", STRAIN_PATHS)
def test_moduli_are_second_derivatives_of_relaxed_energies(case, strain):
    assert_moduli_of_energies(*case, strain)


def test_the_stress_is_a_derivative(case):
    assert_stress(*case)


def test_relaxations_move_the_bonds_to_the_strained_equilibrium(case):
    assert_relaxations(*case)


def test_affine_tensor_has_the_symmetry_of_central_forces(case):
    expected, index = assert_affine(*case), case[1].value.components.index
    # Cauchy: all indices may be exchanged.
    assert expected[index("xx"), index("yy")] == pytest.approx(expected[index("xy"), index("xy")], rel=1e-12)


class Counted:
    """A factor that counts its solves."""

    def __init__(self, factor):
        self.factor, self.count = factor, 0

    def solve(self, right):
        self.count += 1
        return self.factor.solve(right)


@pytest.mark.parametrize("name", [name for name in STATES if name != "compression"])
def test_one_correction_of_each_relaxation_is_enough(name):
    state = equilibrium(STATES[name](), tolerance=1e-15, throw=False).value
    # Two solves a strain; that the state is in equilibrium costs two more, and no response of another state.
    for exact, more in ((True, 0), (False, 2)):
        factor = Counted(state.factorize())
        linear_response(state, state.network.volume, exact=exact, factor=factor, condition=False)
        assert factor.count == 2 * len(strain_basis(state.network.dimension)[0]) + more


def test_a_strain_that_keeps_the_balance_needs_no_solve():
    network = voronoi_network(24, seed=1)
    critical = CriticalManifold(network).configuration(network.stiffness)
    state = strain_path(critical, [0.01]).value.states[0]
    factor = Counted(state.factorize())
    linear_response(state, network.volume, exact=True, factor=factor, condition=False)
    # The deviator and the shear, but not the dilation.
    assert factor.count == 2 * 2


# What is elastic


def test_pinned_networks_have_a_stiffness_per_named_volume():
    single, double = (elasticity(PINNED, volume=V).value for V in (1.0, 2.0))
    np.testing.assert_allclose(single.tensor, 2 * double.tensor, rtol=1e-14)
    # Stretching the pins apart along the bars: three springs in series.
    x = PINNED.bond_vectors
    along = x[0] / np.linalg.norm(x[0])
    assert single.modulus(np.outer(along, along)) == pytest.approx(np.linalg.norm(x, axis=1).sum() ** 2 / 3, rel=1e-12)
    # Under tension, against energies: pins move with the strain.
    state = equilibrium(spring_state(PINNED.network, 0.9 * PINNED.lengths, PINNED.coordinates)).value
    A = np.array([[0.3, 0.5], [-0.2, 0.4]])
    expected = second_derivative(lambda e: relaxed_energy(state, np.eye(2) + e * A))
    assert elasticity(state, volume=1.0).value.modulus(A) == pytest.approx(expected, rel=1e-6)


PINNED = CriticalManifold(three_bar_linkage()).configuration(np.ones(3))
BAD = {
    "no volume": (lambda: elasticity(PINNED), "volume"),
    "negative volume": (lambda: elasticity(PINNED, volume=-1.0), "volume"),
    "nothing elastic": (lambda: elasticity(None), "CriticalConfiguration"),
    "out of balance": (lambda: elasticity(spring_state(HEXAGONS, np.ones(12), HEXAGONS.positions + NOISE)), "equilib"),
}
HEXAGONS = lattice("honeycomb", 2, 2)
NOISE = 0.1 * np.random.default_rng(1).standard_normal((8, 2))


test_bad_input_raises_one_sentence = refused(BAD, InputError)


@pytest.mark.parametrize("compression", [1e-13, 1e-12, 1e-9, 1e-3])
def test_weakly_compressed_chains_are_unstable(compression):
    # A compressed chain buckles sideways however small its stress is; it must not have a negative shear modulus.
    corners = np.array([[0.0, 0], [1, 0], [2, 0], [3, 0]])
    chain = Network([[0, 1], [1, 2], [2, 3], [3, 0]], [[0, 0]] * 3 + [[1, 0]], 4 * np.eye(2), positions=corners)
    found = linear_response(spring_state(chain, np.full(4, 1 + compression), corners), 16.0)
    assert found.status is Status.unstable and np.isnan(found.value.shear)


def test_softening_springs_under_tension_are_unstable():
    class Softening(SpringLaw):
        """E = ½ k e² (1 − e²/2): E'' < 0 from e = 1/√3 on."""

        def energy(self, extension, rest, k):
            return 0.5 * k * extension**2 * (1 - extension**2 / 2)

        def tension(self, extension, rest, k):
            return k * extension * (1 - extension**2)

        def stiffness(self, extension, rest, k):
            return k * (1 - 3 * extension**2)

        def stiffening(self, extension, rest, k):
            return -6 * k * extension

    line = Network([[0, 1], [1, 2]], pins={0: [0.0, 0.0], 2: [3.3, 0.0]}).with_volume(1.0)
    for length, status in ((1.1, Status.ok), (0.99, Status.unstable)):
        # With a factor given, as on a path, whose corrections shrink whatever its inertia.
        state = spring_state(line, [length, length], [[0.0, 0.0], [1.65, 0.0], [3.3, 0.0]], Softening())
        assert (state.sigma > 0).all()
        assert linear_response(state, 1.0, factor=state.factorize()).status is status


# Errors under stress


def moduli(numbers):
    return numbers.bulk, numbers.shear, numbers.shear_stress_corrected


@pytest.mark.parametrize("stride", [5, pytest.param(1, marks=pytest.mark.sweep)])
def test_errors_at_all_distances_from_the_transition(stride):
    ratios = []
    for name, make in SMALL_NETWORKS.items():
        for gamma in STRAINS[:: stride if name == "voronoi" else 4 * stride]:
            state = equilibrium(strained(make(), gamma)).value
            found = linear_response(state, state.network.volume)
            assert found.status is Status.ok and found.stats.condition > 0.1 / gamma
            # No digits are lost near the transition.
            errors = moduli(found.value.errors)
            assert max(errors) < 1e-13
            ratios += bounds_over_errors(moduli(found.value), errors, exact_moduli(state))
    assert np.median(ratios) < 100


@pytest.mark.parametrize("gamma, tolerance", [(0.1, 1e-6), (0.1, 1e-10), (1e-3, 1e-8), (1e-3, 1e-12)])
def test_errors_of_an_unfinished_relaxation(gamma, tolerance):
    state = equilibrium(strained(SMALL_NETWORKS["voronoi"](), gamma), "fire", tolerance).value
    found = linear_response(state, state.network.volume)
    assert found.status is Status.ok
    assert max(bounds_over_errors(moduli(found.value), moduli(found.value.errors), exact_moduli(state))) < 100


def test_errors_count_the_velocities_of_both_vertices():
    # Vertices that move together leave rates as differences of large numbers; k differs from edge to edge.
    state = stretched(with_random_stiffness(voronoi_network(24, seed=1), 3))
    network, u = state.network, np.full((1, 2, len(state.network.free)), 1e6)
    inner, moved = np.isin(network.edges, network.free).all(axis=1), 2 * np.sqrt(2) * 1e6
    _, parts = form_rounding(state, np.zeros((1, network.n_edges)), u, np.ones((1, network.n_edges)))
    expected = 2 * state.lengths * EPS * (moved + state.lengths)
    np.testing.assert_allclose(parts[inner], expected[inner], rtol=1e-12)
    speed = 1e-3 * state.bond_vectors
    pull = np.abs(state.resistance(1e-3 * state.lengths**2)) * state.lengths + 1e-3 * state.sigma * state.lengths
    parts = rounding_along_path(state, speed, u[0].T)
    np.testing.assert_allclose(parts[inner], (2 * pull * EPS * moved)[inner], rtol=1e-4)


@pytest.mark.parametrize("size", [(2, 2), (3, 2)])
@pytest.mark.parametrize("gamma", [1e-3, 1e-8])
def test_errors_with_equal_rounding_on_all_edges(size, gamma):
    # Lattices repeat one rounding on every edge, so that errors accumulate instead of averaging out.
    network = lattice("honeycomb", *size)
    critical = CriticalManifold(network).configuration(np.ones(network.n_edges))
    state = strain_path(critical, [gamma]).value.states[0]
    value = elasticity(state).value
    bounds_over_errors(moduli(value), moduli(value.errors), exact_moduli(state))


@pytest.mark.parametrize("gamma", [1e-8, 1e-10, 1e-12, 1e-14])
def test_moduli_count_the_smallest_stress(gamma):
    """B − B_0 = C_B γ also where the stress is far below the stiffness, as balanced forces show it."""
    critical = CriticalManifold(voronoi_network(60, 1)).configuration(random_stress(90, 1))
    value, growth = elasticity(strain_path(critical, [gamma]).value.states[0]).value, stiffening(critical).value
    error = value.errors.bulk + EPS * value.bulk
    assert error < 10 * gamma + 1e-14
    assert abs(value.bulk - growth.bulk_0 - growth.C_B * gamma) < 1e-4 * abs(growth.C_B) * gamma + error


@pytest.mark.parametrize("gamma, off", [(1e-3, 1e-4), (1e-4, 1e-4), (1e-5, 1e-6)])
def test_moduli_far_from_equilibrium_are_ill_conditioned(gamma, off):
    # Extensions are about γ/2, so such displacements change every stress.
    state = strained(SMALL_NETWORKS["voronoi"](), gamma)
    state = state.moved(off * np.random.default_rng(1).standard_normal((len(state.network.free), 2)))
    found = linear_response(state, state.network.volume)
    assert found.status is Status.ill_conditioned and np.isnan(moduli(found.value)).all()


@pytest.mark.parametrize("first, second, expected", [(3.5, 3.0, True), (0.8, 0.3, False), (1e6, 1e6, True)])
@pytest.mark.parametrize("k", [1.0, 2.0**-18, 2.0**40])
def test_stresses_out_of_balance_count_above_a_tolerance_of_the_stiffness(first, second, expected, k):
    # A vertex between two pins at a distance of one, pulled by tensions in units of the tolerance times k.
    chain = Network([[0, 1], [1, 2]], pins={0: [0, 0], 2: [2, 0]}, stiffness=np.full(2, k))
    tolerance = 1e-9
    state = spring_state(chain, 1 - tolerance * np.array([first, second]), [[0, 0], [1, 0], [2, 0]])
    assert under_stress(state, tolerance) is expected
