"""Networks at coordinates: at rest or not, with slack edges, and configurations with several self-stresses."""

import numpy as np
import pytest
from problems import (
    UNPINNED,
    critical_of,
    random_stress,
    slack_lattice,
    stressed_lines,
    taut_rows,
    with_random_stiffness,
)
from refusals import refused

from critflow import (
    Cable,
    CriticalManifold,
    Hookean,
    InputError,
    PowerLaw,
    Status,
    elasticity,
    equilibrium,
    lattice,
    optimize,
    spring_state,
    strain_path,
    voronoi_network,
)
from critflow.manifold import CriticalConfiguration
from critflow.quantities import pure_shear
from critflow.taut_part import backbone
from critflow_extras import self_stresses


class Pulling(Hookean):
    """Springs with a tension at their rest length."""

    def tension(self, extension, rest, stiffness):
        return stiffness * (extension + 0.1)


HEXAGONS = lattice("honeycomb", 2, 2)
NOISE = 0.1 * np.random.default_rng(1).standard_normal((8, 2))


def test_networks_at_coordinates_are_states_of_springs():
    critical = CriticalManifold(voronoi_network(40, seed=2)).configuration(random_stress(60, 2))
    state = strain_path(critical, [0.02], law=PowerLaw(4.5)).value.states[0]
    network, expected = state.network, elasticity(state).value
    again = elasticity(network, state.coordinates, state.rest_lengths, law=state.law).value
    assert again.bulk == pytest.approx(expected.bulk, rel=1e-9)
    assert elasticity(equilibrium(state)).value.bulk == pytest.approx(expected.bulk, rel=1e-12)
    at_rest = elasticity(critical.network, critical.coordinates).value.bulk
    manifold = CriticalManifold(critical.network)
    solved = manifold.solve(critical.sigma)
    for holder in (manifold, solved, solved.value):
        assert elasticity(holder, solved.value.coordinates).value.bulk == pytest.approx(at_rest, rel=1e-9)


@pytest.mark.parametrize("name", ["2D", "2D, random stiffness", "3D"])
def test_the_rigidity_matrix_gives_the_moduli_of_the_transition(name):
    critical = critical_of(UNPINNED[name](), 5)
    at_rest, known = elasticity(critical.network, critical.coordinates), elasticity(critical).value
    assert at_rest.n_self_stresses == 1
    difference = np.abs(at_rest.value.tensor - known.tensor)
    assert (difference <= at_rest.value.errors.tensor + known.errors.tensor).all()
    assert at_rest.value.bulk == pytest.approx(known.bulk, rel=1e-9)
    np.testing.assert_allclose(at_rest.value.affine, known.affine, rtol=0, atol=1e-13)


def test_slack_edges_resist_nothing():
    network, _, critical = slack_lattice()
    known, n_slack = elasticity(critical).value, backbone(critical).n_slack
    solution = elasticity(network, critical.coordinates, taut=critical.sigma != 0)
    assert solution.ok and f"{n_slack} of {network.n_edges} edges are slack" in solution.note
    assert (solution.value.bulk, solution.value.shear) == pytest.approx((known.bulk, known.shear), rel=1e-11)


@pytest.mark.parametrize("slack", [1.001, 1.2, 10.0])
def test_slack_cables_resist_nothing(slack):
    """All of them, three that cannot be in balance, and the slack ones of a network that is rigid by the others."""
    critical = optimize(voronoi_network(20, seed=1), "B_0").value
    rest = slack * critical.lengths
    for state in (
        spring_state(critical.network, rest, critical.coordinates, Cable()),
        spring_state(critical.network, [*critical.lengths[:3], *rest[3:]], critical.coordinates, Cable()),
    ):
        solution = elasticity(state)
        assert solution.status is Status.floppy and solution.n_self_stresses == 0
        assert (solution.value.bulk, solution.value.errors.bulk, solution.value.tensor.any()) == (0.0, 0.0, False)
    network, _, part = slack_lattice()
    rest = np.where(part.sigma != 0, 1.0, slack) * part.lengths
    solution, taut = (
        elasticity(network, part.coordinates, rest, law=Cable()),
        elasticity(network, part.coordinates, taut=part.sigma != 0),
    )
    assert solution.ok and solution.note == taut.note and solution.value.bulk == taut.value.bulk


def test_disconnected_taut_parts_add_up():
    critical = taut_rows(4)
    solution = elasticity(critical.network, critical.coordinates, taut=critical.sigma != 0)
    assert solution.ok and solution.n_self_stresses == 4
    assert solution.value.bulk == pytest.approx(0.25, rel=1e-13)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_all_self_stresses_of_a_configuration_resist(n):
    solution = elasticity(stressed_lines(n))
    assert solution.n_self_stresses == 2 * n and solution.value.bulk == pytest.approx(0.25, rel=1e-12)


@pytest.mark.parametrize("name, sizes", [("triangular", (4, 3)), ("triangular", (1, 2)), ("cubic", (2, 3, 2))])
def test_the_modulus_is_the_largest_of_all_self_stresses(name, sizes):
    """μ = max over the self-stresses σ of (σ·ḣ)²/(V σᵀK⁻¹σ)."""
    network = with_random_stiffness(lattice(name, *sizes), 4)
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 5))
    basis, L, A = self_stresses(critical).value.basis, critical.bond_vectors, pure_shear(network.dimension)
    hdot, flexibility = np.einsum("ad,ad->a", L, L @ A), np.sum(L**2, axis=1) / network.stiffness
    works = basis @ hdot
    most = works @ np.linalg.solve((basis * flexibility) @ basis.T, works) / network.volume
    assert elasticity(network, critical.coordinates).value.shear == pytest.approx(most, rel=1e-9)


def test_moduli_of_a_stress_of_rounding_are_those_of_the_transition():
    critical = CriticalManifold(voronoi_network(60, 1)).configuration(random_stress(90, 1))
    solution, known = elasticity(strain_path(critical, [1e-15]).value.states[0]), elasticity(critical).value
    assert solution.stats.method == "self-stress" and solution.n_self_stresses == 1
    assert abs(solution.value.bulk - known.bulk) < solution.value.errors.bulk + 1e-14


def test_springs_under_tension_at_their_rest_length_are_refused():
    with pytest.raises(InputError, match="rest"):
        elasticity(HEXAGONS, HEXAGONS.positions, law=Pulling())


def test_an_uncertain_number_of_self_stresses_has_a_status():
    critical = stressed_lines(2)
    moved = critical.coordinates + 1e-9 * np.random.default_rng(0).standard_normal(critical.coordinates.shape)
    blurred = CriticalConfiguration(critical.network, critical.sigma, moved, critical.network.bond_vectors(moved))
    assert elasticity(blurred).status is Status.singular


def test_stress_out_of_balance_below_the_tolerance_is_part_of_the_errors():
    network = lattice("triangular", 3, 3)
    rest = 1 + 1e-12 * np.random.default_rng(0).standard_normal(network.n_edges)
    state, at_rest = spring_state(network, rest, network.positions), elasticity(network, network.positions).value
    value = elasticity(state, tolerance=1e-9).value
    np.testing.assert_array_equal(value.tensor, at_rest.tensor)
    added = value.errors.tensor - at_rest.errors.tensor
    np.testing.assert_allclose(added, 5 * np.abs(state.sigma).max() * np.abs(at_rest.affine).max(), rtol=1e-6)


BAD = {
    "no coordinates": (lambda: elasticity(voronoi_network(12, seed=1)), "coordinates"),
    "out of balance": (lambda: elasticity(HEXAGONS, HEXAGONS.positions + NOISE, np.ones(12)), "equilibrium"),
    "taut and stressed": (
        lambda: elasticity(HEXAGONS, HEXAGONS.positions, np.ones(12), taut=np.arange(12) > 3),
        "Cable",
    ),
}
test_bad_input_raises_one_sentence = refused(BAD)


def test_errors_by_a_stress_that_is_rounding_have_the_unit_of_moduli():
    network = lattice("triangular", 4, 4)
    lengths = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    rest, stiff = lengths * (1 + 1e-13 * np.random.default_rng(0).standard_normal(network.n_edges)), 2.0**20
    one, other = (
        elasticity(spring_state(network.with_stiffness(k), rest, network.positions)).value for k in (1.0, stiff)
    )
    assert 1e-14 < one.errors.tensor.max() < 1e-11
    np.testing.assert_array_equal(other.errors.tensor, stiff * one.errors.tensor)
