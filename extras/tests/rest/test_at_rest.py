"""Springs at rest: any contrast of stiffness, any number of self-stresses."""

import re

import numpy as np
import pytest
from problems import NETWORKS, thinned, with_random_stiffness
from references_at_rest import digits_for_contrast, elasticity_at_rest
from scipy.linalg import null_space

from critflow import CriticalManifold, InputError, Network, Status, delaunay_network, elasticity, lattice
from critflow import self_stress as spectrum
from critflow_extras.rest import at_rest
from critflow_extras.rest.at_rest import response_at_rest
from critflow_extras.rest.stiffness_contrast import hierarchical_response
from workflows.benchmarks import reference


def on_integers(network, size):
    """The affine image of a lattice with integer coordinates, which have no rounding errors."""
    places = np.rint(network.positions @ np.linalg.inv(network.cell) * size)
    return Network(network.edges, network.offsets, cell=size * np.eye(2), positions=places)


LATTICES = {
    "triangular": lambda: on_integers(lattice("triangular", 3, 3), 3),
    "kagome": lambda: on_integers(lattice("kagome", 2, 2), 4),
    "Delaunay": lambda: delaunay_network(9, seed=1, hard_core=0.6),
}


def softened(network, contrast, part, seed=0):
    """Random edges softened; for no part, stiffnesses of all magnitudes."""
    rng = np.random.default_rng(seed)
    k = contrast ** -rng.random(network.n_edges) if part == 0 else np.ones(network.n_edges)
    k[rng.choice(network.n_edges, int(part * network.n_edges), replace=False)] = 1 / contrast
    return network.with_stiffness(k)


@pytest.mark.parametrize("part", [0, 0.2, 0.4])
@pytest.mark.parametrize("contrast", [1e4, 1e16, 1e40])
@pytest.mark.parametrize("name", LATTICES)
def test_any_contrast_of_stiffness(name, contrast, part):
    network = softened(LATTICES[name](), contrast, part, seed=len(name))
    solution = elasticity(network, network.positions)
    assert solution.status is Status.ok
    digits = digits_for_contrast(network.stiffness)
    exact = elasticity_at_rest(network, network.positions, digits=digits)
    errors = np.abs((reference.numbers(solution.value.tensor * network.volume) - exact).astype(float))
    assert (errors <= network.volume * solution.value.errors.tensor).all()
    known = solution.value.errors
    assert known.tensor.max() < 1e-10 * np.abs(solution.value.tensor).max()
    # B is the mean of the components xx, xy, yx, yy, and so is its error.
    assert known.bulk == pytest.approx(known.tensor[:2, :2].sum() / 4, rel=1e-12, abs=0)
    assert np.linalg.eigvalsh(solution.value.tensor).min() > -1e-15 * solution.value.tensor.max()


@pytest.mark.parametrize("contrast", [1e12, 1e16, 1e40, 1e200])
def test_negligible_springs_are_as_good_as_removed(contrast):
    network = lattice("triangular", 10, 10)
    soft = np.random.default_rng(0).choice(300, 60, replace=False)
    k = np.ones(300)
    k[soft] = 1 / contrast
    moduli = elasticity(network.with_stiffness(k), network.positions)
    assert moduli.status is Status.ok
    kept = np.ones(300, bool)
    kept[soft] = False
    part, vertices = network.part(kept)
    removed = elasticity(part, network.positions[vertices]).value
    assert (moduli.value.bulk, moduli.value.shear) == pytest.approx((removed.bulk, removed.shear), rel=1e-9)
    assert (removed.bulk, removed.shear) == pytest.approx((0.295271, 0.108126), abs=1e-6)
    assert moduli.value.errors.bulk < 1e-11


def test_soft_springs_are_the_only_resistance():
    # A square grid of stiff springs with one soft diagonal in each cell: the grid resists extensions, diagonals shear.
    square, soft = 4, 1e-30
    vertices = np.arange(16).reshape(4, 4)
    edges, offsets, k = [], [], []
    for i, j in np.ndindex(4, 4):
        for step, stiffness in (((1, 0), 1.0), ((0, 1), 1.0), ((1, 1), soft)):
            to = np.array([i, j]) + step
            edges.append([vertices[i, j], vertices[tuple(to % square)]])
            offsets.append(to // square)
            k.append(stiffness)
    positions = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij"), axis=-1).reshape(16, 2)
    network = Network(edges, offsets, cell=4 * np.eye(2), positions=positions, stiffness=k)
    solution = elasticity(network, positions)
    tensors = solution.value
    # Of a diagonal, k (n·E n)²|L|² = k/2 for a unit shear, per unit area.
    assert tensors.tensor[2, 2] == pytest.approx(soft / 2, rel=1e-12)
    assert tensors.errors.tensor[2, 2] < 1e-12 * soft
    assert tensors.tensor[0, 0] == pytest.approx(1.0, rel=1e-12)
    assert tensors.shear == pytest.approx(soft / 2, rel=1e-12)


def test_large_networks_of_large_contrast_are_answered_or_refused(monkeypatch):
    network = softened(lattice("triangular", 12, 12), 1e20, 0.2)
    assert elasticity(network, network.positions).status is Status.ok
    monkeypatch.setattr("critflow_extras.rest.at_rest.LARGEST_RESPONSE", 1000)
    solution = elasticity(network, network.positions)
    assert solution.status is Status.ill_conditioned
    assert np.isnan(solution.value.tensor).all()


def random_multigraph(seed):
    """One to five vertices and many edges between them and their images, parallel ones and lines among them."""
    rng = np.random.default_rng(seed)
    n_vertices = int(rng.integers(1, 6))
    n_edges = int(rng.integers(n_vertices, 3 * n_vertices + 3))
    edges, offsets = rng.integers(0, n_vertices, (n_edges, 2)), rng.integers(-1, 2, (n_edges, 2))
    for vertex in range(1, n_vertices):
        edges[vertex] = vertex, rng.integers(0, vertex)
    offsets[(edges[:, 0] == edges[:, 1]) & ~offsets.any(axis=1)] = [1, 0]
    k = np.exp(rng.choice([0.0, 2.0]) * rng.standard_normal(n_edges))
    cell = np.eye(2) + 0.3 * rng.standard_normal((2, 2))
    x = rng.random((n_vertices, 2)) @ cell
    if seed % 2:
        cell, x = np.diag([4.0, 3.0]), rng.integers(0, 7, (n_vertices, 2)) / 2
    return Network(edges, offsets, cell, positions=x, stiffness=k)


ROUTES = {
    "motions, dense count": (at_rest, "MODERATE_CONTRAST", 1e6),
    "motions, count by inertia": (spectrum, "DENSE_EDGES", 0),
    "groups of stiffness": (at_rest, "MODERATE_CONTRAST", 0.0),
}


@pytest.mark.parametrize("route", ROUTES)
def test_errors_of_random_multigraphs(route, monkeypatch, n=200):
    monkeypatch.setattr(*ROUTES[route])
    ratios = []
    for seed in range(n):
        try:
            network = random_multigraph(seed)
        except InputError:
            continue
        found = response_at_rest(network, network.positions, network.volume)
        if "no length" in found.note:
            continue
        assert found.status in (Status.ok, Status.floppy)
        exact = elasticity_at_rest(network, network.positions, digits=100)
        errors = np.abs((reference.numbers(found.value.tensor * network.volume) - exact).astype(float))
        bound, size = network.volume * found.value.errors.tensor, float(np.abs(exact).max())
        assert (errors <= bound + 1e-40).all(), seed
        if size > 1e-20:
            # From above: small components have the errors of large ones.
            ratios.append(bound.max() / max(errors.max(), 1e-16 * size))
    assert len(ratios) > n // 8 and np.median(ratios) < 80


def test_components_of_squared_rounding_have_its_error():
    # Vertices on a line of which some edges leave the line: tensions of the order of rounding have an energy as well.
    tail = [0, 0, 3, 0, 4, 1, 4, 3, 0, 1, 2, 3, 4]
    head = [0, 1, 3, 4, 1, 4, 3, 2, 1, 2, 3, 4, 0]
    images = [[1, 0]] * 3 + [[0, 0], [0, 0], [2, 0], [-1, 1], [1, 0], [1, 0], [2, 0], [2, 0], [1, 1], [2, 1]]
    x = np.array([[0.328125, 0.0], [0.15625, 0.0], [0.171875, 0.0], [0.203125, 0.0], [0.09375, 0.0]])
    network = Network(np.stack([tail, head], axis=1), images, np.eye(2), n_vertices=5)
    found = elasticity(network, x).value
    exact = elasticity_at_rest(network, x, digits=150)
    errors = np.abs((reference.numbers(found.tensor) - exact).astype(float))
    assert (errors <= found.errors.tensor + 1e-60).all() and found.errors.tensor[2, 2] < 1e-28


@pytest.mark.parametrize("off", [3e-10, 1e-9, 1e-7])
@pytest.mark.parametrize("columns", [4, 14])
def test_networks_next_to_a_self_stress_are_in_doubt(columns, off):
    network = lattice("honeycomb", columns, columns)
    x = network.positions.copy()
    x[0] += [0.3 * off, off]
    found = response_at_rest(network, x, network.volume)
    assert found.status is Status.singular and np.isnan(found.value.bulk)
    # A displacement of one vertex changes singular values by no more than its length over that of an edge.
    assert float(re.search(r"a singular value of (\S+) ", found.note)[1]) < 4 * off


@pytest.mark.parametrize("contrast", [1.0, 1e12])
def test_edges_without_length_are_named(contrast):
    network = softened(lattice("triangular", 3, 3), contrast, 0.2)
    x = network.positions.copy()
    x[network.edges[0, 1]] += [9e-17, 0] - network.bond_vectors(x)[0]
    found = response_at_rest(network, x, network.volume)
    assert found.status is Status.singular and "edge 0" in found.note and np.isnan(found.value.bulk)


def test_three_vertices_at_one_place_have_no_moduli():
    # With the same neighbours, at equal stresses; the edges between them have no length, and self-stresses are several.
    pins = {0: [3.7, 2.8], 1: [0.3, 2.0], 2: [3.0, 1.0], 3: [3.1, 1.2]}
    edges = [[pin, vertex] for vertex in (4, 5, 6) for pin in pins] + [[4, 5], [5, 6]]
    network = Network(edges, pins=pins).with_volume(6.0)
    found = elasticity(CriticalManifold(network).configuration(np.ones(14)))
    assert found.status is Status.singular and "edge 12" in found.note and np.isnan(found.value.tensor).all()


def pinned_lattice():
    """A triangular lattice with two of its vertices held."""
    network = thinned(lattice("triangular", 16, 16), 233)
    pins = {i: network.positions[i] for i in (3, 90)}
    return Network(network.edges, network.offsets, network.cell, pins=pins, positions=network.positions)


@pytest.mark.parametrize(
    "make", [pinned_lattice, lambda: delaunay_network(points=np.random.default_rng(1).random((70, 3)))]
)
def test_large_networks_with_pins_or_in_space(make, monkeypatch):
    network = with_random_stiffness(make(), 4)
    assert network.n_edges > spectrum.DENSE_EDGES
    sparse = response_at_rest(network, network.positions, 7.0)
    monkeypatch.setattr(*ROUTES["groups of stiffness"])
    dense = response_at_rest(network, network.positions, 7.0)
    assert dense.status is sparse.status is Status.ok and dense.n_self_stresses == sparse.n_self_stresses
    difference = np.abs(dense.value.tensor - sparse.value.tensor)
    assert (difference <= dense.value.errors.tensor + sparse.value.errors.tensor).all()
    assert sparse.value.errors.tensor.max() < 1e-12 * sparse.value.tensor.max()


def test_several_self_stresses_add_up():
    network = lattice("cubic", 2, 2, 2)
    solution = elasticity(CriticalManifold(network).configuration(np.ones(network.n_edges)))
    tensors = solution.value
    assert solution.n_self_stresses > 1 and np.linalg.matrix_rank(tensors.tensor) == 3
    # Lines along the axes resist extensions separately; nothing resists shear.
    np.testing.assert_allclose(tensors.tensor, np.diag([1.0, 1, 1, 0, 0, 0]), rtol=0, atol=1e-14)
    assert tensors.young([0, 0, 1]) == pytest.approx(1.0, rel=1e-13)
    assert tensors.young([1, 1, 0]) == 0.0
    assert tensors.poisson([0, 0, 1], [1, 0, 0]) == pytest.approx(0.0, abs=1e-14)


def test_self_stresses_that_no_strain_loads_give_no_modulus():
    network = thinned(lattice("triangular", 20, 20), 537)
    L = network.bond_vectors(network.positions)
    rigidity_matrix = (network.free_incidence.toarray()[:, :, None] * L[:, None]).reshape(network.n_edges, -1)
    stresses = null_space(rigidity_matrix.T)
    # The macroscopic stress Σ σ L⊗L of each of them vanishes.
    assert stresses.shape[1] == 2 and np.abs(np.einsum("an,ai,aj->nij", stresses, L, L)).max() < 1e-11
    for stiffness in (np.ones(network.n_edges), np.logspace(0, 3, network.n_edges)):
        found = response_at_rest(network.with_stiffness(stiffness), network.positions, network.volume)
        assert found.status is Status.floppy and found.n_self_stresses == 2 and "loads" in found.reason
        np.testing.assert_array_equal(found.value.tensor, 0.0)
        assert found.value.errors.tensor.max() < 1e-16
    moduli = elasticity(network, network.positions).value
    assert moduli.bulk == moduli.shear == 0


@pytest.mark.parametrize("name", ["voronoi", "voronoi 3D", "oblique"])
def test_moduli_off_the_manifold_are_exactly_zero(name):
    network = NETWORKS[name]()
    x = network.positions + 0.01 * np.random.default_rng(2).standard_normal(network.positions.shape)
    solution = elasticity(network, x)
    assert solution.status is Status.floppy and not solution.value.tensor.any()
    assert (solution.value.bulk, solution.value.shear, solution.value.shear_stress_corrected) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("part", "resisted"), [(0.7, False), (1.5, True)])
def test_a_strain_is_resisted_if_the_mean_square_of_elongations_exceeds_their_rounding(part, resisted):
    # Four fixed edges of equal elongation by one strain: their root mean square is that of each.
    errors = np.full(4, 1e-10)
    zero = spectrum.ROUNDING_MARGIN * float(np.linalg.norm(errors))
    found = hierarchical_response(np.zeros((4, 0)), np.full((4, 1), part * zero), np.ones(4), errors)
    expected = 4 * (part * zero) ** 2 if resisted else 0.0
    np.testing.assert_allclose(found.form, [[expected]], rtol=1e-12, atol=0)
