"""Onset of rigidity: cables by hand, cone programs of single strains, differences, lattices with parallel chains."""

import numpy as np
import pytest
from derivatives import assert_derivative
from onsets import check
from problems import thinned, voronoi_3d

from critflow import (
    CriticalManifold,
    Deformation,
    InputError,
    Network,
    SolveError,
    Status,
    critical_from_lengths,
    equilibrium,
    lattice,
    optimize,
    spring_state,
    voronoi_network,
)
from critflow.cones import fit_lengths
from critflow.deformation import deformation_of
from critflow_extras import critical_strain

NETWORK = voronoi_network(60, seed=3)
# Between 5 % and 10 % longer than at the isotropic transition, without any symmetry.
LENGTHS = critical_from_lengths(NETWORK, np.ones(90)).ratio * np.random.default_rng(1).uniform(1.05, 1.1, 90)
PATHS = {
    "dilation": "dilation",
    "simple_shear": "simple_shear",
    "pure_shear": "pure_shear",
    "uniaxial": "uniaxial",
    "matrix": [[0.3, 0.5], [-0.2, 0.1]],
    "function": lambda strain: np.array([[1 + strain, strain], [0.0, 1 + strain**2]]),
    "free shear": Deformation.uniaxial(2).freeing("xy"),
}


def ratio(network, lengths, F):
    """t(F) = min max |L|/ℓ by a cone program of that boundary alone."""
    deformed = network.deformed(F)
    return fit_lengths(deformed.free_incidence, deformed.boundary_vectors, lengths, 1e-12).ratio


@pytest.mark.parametrize("name", PATHS)
def test_the_onset_on_a_path(name):
    onset = critical_strain(NETWORK, LENGTHS, PATHS[name])
    check(onset, LENGTHS)
    assert ratio(NETWORK, LENGTHS, onset.value.deformation_gradient) == pytest.approx(1, abs=1e-9)
    if name == "free shear":
        # ∂/∂q of b → (1 + q E) F b is E (1 + q E)⁻¹ per current bond vector.
        E = np.array([[0, 0.5], [0.5, 0]])
        assert abs(np.sum(onset.value.stress * (E @ np.linalg.inv(np.eye(2) + onset.value.free * E)))) < 1e-12
        assert onset.value.strain > critical_strain(NETWORK, LENGTHS, "uniaxial").value.strain


def test_a_free_shear_delays_a_shear_as_long_as_it_can():
    onset = critical_strain(NETWORK, LENGTHS, Deformation.simple_shear(2).freeing("xy"))
    check(onset, LENGTHS)
    for part, floppy in ((0.97, True), (1.03, False)):
        shears = np.linspace(onset.value.free[0] - 0.5, onset.value.free[0] + 0.5, 11)
        cells = [[[1, q / 2], [q / 2, 1]] @ np.array([[1, part * onset.value.strain], [0, 1]]) for q in shears]
        assert (min(ratio(NETWORK, LENGTHS, F) for F in cells) < 1) == floppy


@pytest.mark.parametrize("name", ["uniaxial", "pure_shear", "dilation"])
def test_a_free_shear_beside_a_free_side_changes_nothing(name):
    # The taut chain runs along x, so that a shear of the cell would only lengthen it: γ_c is where F_xx = ℓ/W.
    path = deformation_of(name, 2)
    side = critical_strain(NETWORK, LENGTHS, path.freeing("yy"))
    onset = critical_strain(NETWORK, LENGTHS, path.freeing("yy", "xy"))
    assert (
        onset.ok
        and all(onset.value.proven)
        and onset.value.lower < onset.value.strain < onset.value.upper < onset.value.lower + 1e-9
    )
    assert onset.value.strain == pytest.approx(side.value.strain, rel=1e-10) and abs(onset.value.free[1]) < 1e-12
    chain = LENGTHS[onset.value.taut].sum() / NETWORK.cell[0, 0]
    assert path.gradient(onset.value.strain)[0, 0] == pytest.approx(chain, rel=1e-10)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_free_shear_undoes_a_shear_beside_a_free_side(direction):
    # Neither is zero then, and the stress conjugate to both vanishes, S : E (1 + Σ q E)⁻¹ = 0.
    network, path = voronoi_network(24, seed=0), Deformation.simple_shear(2).freeing("yy", "xy")
    lengths = critical_from_lengths(network, np.ones(36)).ratio * np.random.default_rng(0).uniform(1.05, 1.1, 36)
    onset = critical_strain(network, lengths, path, direction=direction)
    check(onset, lengths)
    strains = path.free_strains
    stretch = np.linalg.inv(np.eye(2) + np.tensordot(onset.value.free, strains, 1))
    np.testing.assert_allclose(np.einsum("ij,mik,kj->m", onset.value.stress, strains, stretch), 0, atol=1e-12)
    # At one strain the least ratio over all free components is one cone program.
    for part, floppy in ((1 - 1e-6, True), (1 + 1e-6, False)):
        deformed = network.deformed(path.gradient(part * onset.value.strain))
        b = deformed.boundary_vectors
        rates = np.einsum("mij,aj->mai", strains, b)
        assert (fit_lengths(deformed.free_incidence, b, lengths, 1e-11, rates).ratio < 1) == floppy


@pytest.mark.parametrize("name", ["simple_shear", "pure_shear", "matrix"])
def test_negative_strains_are_those_of_the_reversed_path(name):
    path = deformation_of(PATHS[name], 2)
    onset = critical_strain(NETWORK, LENGTHS, path, direction=-1)
    check(onset, LENGTHS)
    assert onset.value.strain < 0
    reversed_path = critical_strain(NETWORK, LENGTHS, lambda strain: path.gradient(-strain))
    assert reversed_path.value.strain == pytest.approx(-onset.value.strain, abs=1e-12)
    np.testing.assert_allclose(reversed_path.value.gradient, -onset.value.gradient, rtol=1e-8, atol=1e-10)


def test_dilation_leads_to_the_critical_configuration_of_the_lengths():
    onset, critical = critical_strain(NETWORK, LENGTHS), critical_from_lengths(NETWORK, LENGTHS, throw=False)
    assert onset.value.strain == pytest.approx(critical.ratio**-2 - 1, rel=1e-12)
    np.testing.assert_allclose(onset.value.configuration.sigma, critical.value.sigma, rtol=1e-7, atol=1e-10)


def energy_below(onset, lengths, network, strain):
    """Energy of springs that resist compression, relaxed at a strain below the onset."""
    F = deformation_of("dilation", 2).gradient(strain)
    x = onset.value.configuration.coordinates @ np.linalg.inv(onset.value.deformation_gradient).T @ F.T
    x += 1e-3 * np.random.default_rng(0).standard_normal(x.shape)
    return equilibrium(spring_state(network.deformed(F), lengths, x), throw=False).value.energy


SPRINGS = {
    "a flex and one self-stress": (voronoi_network(20, seed=1), True),
    "no flex": (lattice("honeycomb", 1, 1), False),
    "several self-stresses": (lattice("triangular", 4, 4), False),
}


@pytest.mark.parametrize("name", SPRINGS)
def test_springs_share_an_onset_below_which_they_keep_their_lengths(name):
    network, valid = SPRINGS[name]
    lengths = 1.1 * critical_from_lengths(network, np.ones(network.n_edges)).value.lengths
    onset = critical_strain(network, lengths)
    assert onset.value.strain == pytest.approx(0.21) and onset.value.taut.all()
    assert onset.value.valid_for_springs is valid
    assert (energy_below(onset, lengths, network, 0.2) < 1e-20) is valid


@pytest.mark.parametrize("name", ["simple_shear", "pure_shear", "free shear"])
def test_gradient_and_stress_against_differences(name):
    onset, edges = critical_strain(NETWORK, LENGTHS, PATHS[name]), np.eye(90)[[0, 17, 60]]
    strain = lambda lengths: critical_strain(NETWORK, lengths, PATHS[name]).value.strain  # noqa: E731
    assert_derivative(strain, onset.value.gradient, LENGTHS, edges, 4e-4, 0.0, 1e-9)


# Networks of which several sets of edges become taut together, a path, its direction, and two edges.
KINKS = {
    "parallel chains": (lattice("honeycomb", 2, 2), "simple_shear", 1, (0, 5)),
    "backwards": (lattice("honeycomb", 2, 2), "simple_shear", -1, (0, 4)),
    "one connected part": (lattice("triangular", 3, 3), "dilation", 1, (0, 13)),
    "free shear": (lattice("honeycomb", 2, 2), Deformation.simple_shear(2).freeing("xy"), 1, (1, 5)),
}


@pytest.mark.parametrize("name", KINKS)
def test_where_sets_of_edges_become_taut_together_both_derivatives_are_given(name):
    network, path, direction, edges = KINKS[name]
    ratio = critical_from_lengths(network, np.ones(network.n_edges), throw=False).ratio
    lengths = np.full(network.n_edges, 1.2 * ratio)
    strain = lambda lengths: critical_strain(network, lengths, path, direction=direction).value.strain  # noqa: E731
    onset = critical_strain(network, lengths, path, direction=direction)
    assert onset.status is Status.ok and "one_sided" in onset.note
    for edge in edges:
        for side, sign in enumerate((-1e-4, 1e-4)):
            near, far = (strain(lengths * (1 + n * sign * (np.arange(len(lengths)) == edge))) for n in (1, 2))
            change = (4 * near - far - 3 * onset.value.strain) / (2 * sign * lengths[edge])
            assert onset.value.one_sided[side, edge] == pytest.approx(change, abs=1e-6)
    shorter, longer = np.sort(onset.value.one_sided, axis=0)
    assert (shorter - 1e-9 <= onset.value.gradient).all() and (onset.value.gradient <= longer + 1e-9).all()
    assert np.ptp(onset.value.one_sided, axis=0).max() > 0.1 and np.isnan(onset.value.tolerance(1e-3))


def test_one_self_stress_has_one_gradient():
    onset = critical_strain(NETWORK, LENGTHS, "simple_shear")
    assert onset.note == ""
    np.testing.assert_array_equal(onset.value.one_sided, [onset.value.gradient] * 2)
    assert onset.value.tolerance(2.0) == 2 * np.linalg.norm(onset.value.gradient)


def test_the_stress_is_the_normal_of_the_rigidity_surface():
    onset, entries = critical_strain(NETWORK, LENGTHS, "simple_shear"), np.eye(4).reshape(4, 2, 2)
    F = onset.value.deformation_gradient
    assert_derivative(lambda F: ratio(NETWORK, LENGTHS, F), onset.value.normal, F, entries, 1e-4, 0.0, 1e-6)


# Two cables in a row, of the lengths 0.5 and 0.7, between pins at distance 1: taut at a distance of 1.2.
CHAIN = {
    "uniaxial": ([1.0, 0.0], 0.2, [1.0, 1.0]),
    # √(1 + γ²) = 1.2, and dγ/dℓ = 1.2/γ.
    "simple_shear": ([0.0, 1.0], np.sqrt(0.44), [1.2 / np.sqrt(0.44)] * 2),
    # 1 + γ = 1.2².
    "dilation": ([1.0, 0.0], 0.44, [2.4, 2.4]),
}


@pytest.mark.parametrize("name", CHAIN)
def test_two_cables_between_pins_by_hand(name):
    end, strain, gradient = CHAIN[name]
    onset = critical_strain(Network([[0, 1], [1, 2]], pins={0: [0, 0], 2: end}), [0.5, 0.7], name)
    check(onset, np.array([0.5, 0.7]))
    assert onset.value.strain == pytest.approx(strain, rel=1e-13)
    np.testing.assert_allclose(onset.value.gradient, gradient, rtol=1e-12)


def test_a_chain_around_a_free_side_is_straight_in_a_flat_cell_only():
    network = voronoi_network(60, 1)
    lengths = 1.05 * optimize(network, "bulk_modulus").value.lengths
    onset = critical_strain(network, lengths, "uniaxial_free", throw=False)
    assert onset.status is Status.floppy and "sides" in onset.reason
    # The chain is nearly straight in a cell of a hundredth of the height.
    flat = critical_strain(network.deformed(np.diag([1.0, 0.01])), lengths, "uniaxial").value.strain
    assert flat == pytest.approx(0.3415, abs=1e-3)


def test_free_sides_leave_the_shortest_chain_taut():
    # Cables without lateral tension are taut along the axis only: the chain of fewest edges around the cell.
    onset = critical_strain(NETWORK, np.full(90, LENGTHS.mean()), "uniaxial_free")
    around = onset.value.network.bond_vectors(onset.value.configuration.coordinates)[onset.value.taut_edges]
    assert np.abs(around[:, 1]).max() < 1e-6
    width = NETWORK.cell[0, 0]
    # Parallel chains share the vertices where they part, so the shortest one has at most as many edges as are taut.
    n_edges = (1 + onset.value.strain) * width / LENGTHS.mean()
    assert n_edges == pytest.approx(round(n_edges), abs=1e-8)
    assert onset.value.taut_edges.size >= round(n_edges)
    assert not onset.value.valid_for_springs


def test_a_lattice_with_slack_edges_and_parallel_chains():
    network = thinned(lattice("triangular", 12, 12), 181, seed=3)
    lengths = np.full(network.n_edges, 1.01)
    for direction in (1, -1):
        onset = critical_strain(network, lengths, "simple_shear", direction=direction)
        check(onset, lengths)
        assert 0 < onset.value.taut.sum() < network.n_edges
        np.testing.assert_array_equal(onset.value.backbone.taut, onset.value.taut)
        assert (np.diff(onset.value.configuration.tensions[onset.value.taut_edges]) <= 0).all()


def test_three_dimensions():
    network = voronoi_3d()
    lengths = np.full(
        network.n_edges, 1.05 * critical_from_lengths(network, np.ones(network.n_edges), throw=False).ratio
    )
    for name in ("simple_shear", "dilation", Deformation.uniaxial(3, "z").freeing("xy")):
        check(critical_strain(network, lengths, name), lengths)


def test_units_and_the_choice_of_the_cell_do_not_matter():
    onset = critical_strain(NETWORK, LENGTHS, "uniaxial")
    small = Network(NETWORK.edges, NETWORK.offsets, 1e-9 * NETWORK.cell)
    assert critical_strain(small, 1e-9 * LENGTHS, "uniaxial").value.strain == pytest.approx(
        onset.value.strain, abs=1e-12
    )
    offsets = NETWORK.offsets @ np.array([[1, -2], [0, 1]])
    other = Network(NETWORK.edges, offsets, np.array([[1, 2], [0, 1]]) @ NETWORK.cell)
    assert critical_strain(other, LENGTHS, "uniaxial").value.strain == pytest.approx(onset.value.strain, abs=1e-12)


ENDS = {
    "compression": (NETWORK, LENGTHS, "dilation", -1, Status.floppy, "flat"),
    "uniaxial compression": (NETWORK, LENGTHS, "uniaxial", -1, Status.floppy, "flat"),
    "rigid": (NETWORK, 0.5 * LENGTHS, "simple_shear", 1, Status.rigid, "rigid"),
    "no strain": (NETWORK, LENGTHS, np.zeros((2, 2)), 1, Status.floppy, "taut"),
    "rotation": (NETWORK, LENGTHS, Deformation.exponential([[0, 1], [-1, 0]]), 1, Status.floppy, "onset"),
}


@pytest.mark.parametrize("name", ENDS)
def test_paths_without_an_onset(name):
    network, lengths, path, direction, status, word = ENDS[name]
    onset = critical_strain(network, lengths, path, direction=direction, throw=False)
    assert onset.status is status
    assert word in onset.reason
    assert np.isnan(onset.value.strain)
    assert np.isnan(onset.value.gradient).all() and np.isnan(onset.value.tolerance(1.0))
    with pytest.raises(SolveError, match=word):
        critical_strain(network, lengths, path, direction=direction)


def test_bad_arguments():
    with pytest.raises(InputError, match="direction"):
        critical_strain(NETWORK, LENGTHS, direction=2)
    with pytest.raises(InputError, match=r"rest_lengths\[3\]"):
        critical_strain(NETWORK, np.where(np.arange(90) == 3, 0.0, LENGTHS))
    with pytest.raises(InputError, match="called"):
        critical_strain(NETWORK, LENGTHS, "twist")


def near(n_vertices, seed):
    """A network and its lengths at the isotropic transition."""
    network = voronoi_network(n_vertices, seed)
    return network, optimize(network, "bulk_modulus").value.lengths


@pytest.mark.parametrize("deformation", ["dilation", "simple_shear"])
@pytest.mark.parametrize("excess", [1e-8, 1e-10, 1e-12, 0.0, -1e-12, -1e-8, -0.5])
def test_a_verdict_at_strain_zero_is_a_proof(excess, deformation):
    network, critical = near(60, 0)
    onset = critical_strain(network, (1 + excess) * critical, deformation, throw=False)
    status = Status.ok if excess > 0 else Status.rigid if excess else Status.undecided
    assert onset.status is status
    assert ("transition" in onset.note) == (excess == 0)
    if excess > 0 and deformation == "dilation":
        assert onset.value.lower < (2 + excess) * excess < onset.value.upper < onset.value.lower + 1e-12


def test_a_network_at_its_transition_names_the_change_that_decides():
    # Straight chains in a lattice: nine self-stresses, whose rounding hides the verdict as built.
    network = thinned(lattice("kagome", 8, 8), 19)
    built = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    onset = critical_strain(network, built, throw=False)
    assert onset.status is Status.undecided and "transition" in onset.note
    change = 2 * float(onset.note.split("longer by ")[1].split()[0])
    assert change < 1e-6
    assert critical_strain(network, (1 - change) * built, throw=False).status is Status.rigid
    longer = critical_strain(network, (1 + change) * built, throw=False)
    assert longer.status in (Status.ok, Status.stalled) and longer.value.upper > 0


def test_one_short_edge_does_not_widen_the_bounds():
    # Its length is known to fewer digits than those of the others, and enters the strain with a small weight.
    network, sigma = voronoi_network(40, seed=2), np.ones(60)
    sigma[7] = 1e6
    lengths = 1.05 * CriticalManifold(network).configuration(sigma).lengths
    assert lengths.min() < 1e-5
    onset = critical_strain(network, lengths, "simple_shear")
    assert all(onset.value.proven) and onset.value.upper - onset.value.lower < 3e-11


def test_a_ring_with_an_edge_of_no_length_has_no_warning():
    edges, offsets = [[i, (i + 1) % 5] for i in range(5)], [[0, 0]] * 3 + [[1, 1], [0, 0]]
    network = Network(edges, offsets, 1e4 * np.eye(2))
    rest = 1e4 * np.array([*[2**0.5 / 4] * 4, 1e-13])
    assert not critical_strain(network, rest, "uniaxial", throw=False).ok


def test_no_program_is_solved_where_displacements_cancel_the_strain(monkeypatch):
    """Two rings that wind around the cell along x, and bars between them: a shear moves whole rings."""
    edges, offsets = [[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [1, 3]], np.zeros((6, 2), int)
    offsets[[1, 3], 0] = 1
    monkeypatch.setattr("critflow_extras.cables.search.farthest", lambda *_: pytest.fail("a cone program"))
    for direction in (1, -1):
        found = critical_strain(
            Network(edges, offsets, np.eye(2)), np.ones(6), "simple_shear", direction=direction, throw=False
        )
        assert found.status is Status.floppy and np.isnan(found.value.strain)
