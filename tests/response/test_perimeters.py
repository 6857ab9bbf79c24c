"""Cells with perimeter springs: K with entries off its diagonal, the transition, and the moduli on both sides of it."""

from functools import lru_cache

import numpy as np
import pytest
import scipy.sparse as sp
from problems import NETWORKS, dense_free, pinned_grid, random_stress, voronoi_3d, with_random_stiffness

from critflow import (
    CriticalManifold,
    InputError,
    Network,
    SolveError,
    Status,
    cells_of,
    critical_from_perimeters,
    elastic_moduli,
    equilibrium,
    honeycomb_network,
    linear_response,
    perimeter_moduli,
    perimeter_state,
    spring_state,
    voronoi_network,
)
from critflow.response.perimeters import Cells

# A regular hexagon of area 1 has the perimeter √(8√3), the least of all tilings by Hales' theorem.
HEXAGON = np.sqrt(8 * np.sqrt(3))


def random_cells(network, n_cells, seed):
    """Cells of a few random sides each, of random weights; every edge belongs to one at least."""
    rng = np.random.default_rng(seed)
    A = rng.uniform(0.5, 2.0, (n_cells, network.n_edges)) * (rng.random((n_cells, network.n_edges)) < 0.15)
    A[rng.integers(n_cells, size=network.n_edges), np.arange(network.n_edges)] = 1.0
    return cells_of(network, rng.uniform(0.5, 2.0, n_cells), A)


CELLS = {
    "faces": lambda: cells_of(voronoi_network(40, seed=1), np.random.default_rng(1).uniform(0.5, 2.0, 20)),
    "random cells, 3D": lambda: random_cells(voronoi_3d(), 30, 2),
    "random cells, pinned": lambda: random_cells(pinned_grid(), 12, 3),
}


def deformed_state(cells, spread=0.2, seed=3):
    """Cells under random displacements."""
    network = cells.network
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, seed))
    factor = np.random.default_rng(seed).uniform(1 - spread, 1 + spread, cells.sides.shape[0])
    return perimeter_state(cells, factor * (cells.sides @ critical.lengths), critical.coordinates)


@lru_cache
def disordered(seed=1, n_vertices=100, varied=False):
    """Cells of equal perimeters, or of random ones, and their transition."""
    network = voronoi_network(n_vertices, seed=seed)
    rng = np.random.default_rng(seed)
    n_cells = n_vertices // 2
    targets = 1 + 0.03 * rng.standard_normal(n_cells) if varied else np.ones(n_cells)
    cells = cells_of(network, rng.uniform(0.5, 2.0, n_cells) if varied else 1.0)
    solution = critical_from_perimeters(cells, targets)
    assert solution.status is Status.ok
    return targets, solution


def shear(e):
    return np.eye(2) + 0.5 * e * np.array([[0.0, 1.0], [1.0, 0.0]])


def relaxed_energy(state, F):
    solution = equilibrium(state.deformed(F), tolerance=1e-15, throw=False)
    assert solution.value.max_force < 1e-12
    return solution.value.energy


# Energy and its derivatives


@pytest.mark.parametrize("name", CELLS)
def test_forces_and_hessian_are_derivatives_of_the_energy(name):
    cells = CELLS[name]()
    state, network, A = deformed_state(cells), cells.network, cells.sides.toarray()
    g, b = dense_free(network)
    g = g if network.pins else g[:, 1:]
    free = state.coordinates[network.free]
    direction = np.random.default_rng(3).standard_normal(free.shape)

    def energy(t):
        p = A @ np.linalg.norm(g @ (free + t * direction) + b, axis=1)
        return 0.5 * np.sum(cells.stiffness * (p - state.targets) ** 2)

    step = 5e-4
    E = {n: energy(n * step) for n in (-2, -1, 0, 1, 2)}
    first = (8 * (E[1] - E[-1]) - (E[2] - E[-2])) / (12 * step)
    second = (16 * (E[1] + E[-1]) - (E[2] + E[-2]) - 30 * E[0]) / (12 * step**2)
    assert state.energy == pytest.approx(E[0], rel=1e-13)
    # Truncation 1e-13 times high derivatives, rounding 1e-15 of the energy over step².
    assert -np.sum(state.forces * direction) == pytest.approx(first, rel=1e-7, abs=1e-8 * E[0])
    factor = state.factorize(state.pattern())
    assert direction.ravel() @ factor.multiply(direction.ravel()) == pytest.approx(second, rel=1e-6, abs=1e-8 * E[0])
    # The whole matrix, from K: H = R^hᵀ K R^h + P ⊗ 1.
    Rh = np.einsum("ai,am->aim", g, state.bond_vectors).reshape(network.n_edges, -1)
    P = np.kron(g.T @ (state.sigma[:, None] * g), np.eye(network.dimension))
    H = Rh.T @ state.modified_stiffness.toarray() @ Rh + P
    np.testing.assert_allclose(factor.multiply(np.eye(len(H))), H, rtol=0, atol=1e-12 * np.abs(H).max())


@pytest.mark.parametrize("name", CELLS)
def test_edges_are_coupled_exactly_where_they_share_a_cell(name):
    cells = CELLS[name]()
    state, A = deformed_state(cells), cells.sides.toarray()
    K = state.modified_stiffness.toarray()
    np.testing.assert_array_equal((K != 0) | np.eye(len(K), dtype=bool), (A.T @ A != 0))
    length, T = np.linalg.norm(state.bond_vectors, axis=1), cells.stiffness * (A @ state.lengths - state.targets)
    expected = np.einsum("c,ca,cb->ab", cells.stiffness, A, A) / np.outer(length, length)
    expected -= np.diag(A.T @ T / length**3)
    np.testing.assert_allclose(K, expected, rtol=1e-12, atol=1e-12)
    # K is ∂σ/∂h: a change of one length alone changes the stresses of all edges of its cells.
    edge, e = 3, 1e-5
    sigma = {}
    for n in (-1, 1):
        h = length.copy()
        h[edge] = np.sqrt(length[edge] ** 2 + 2 * n * e)
        sigma[n] = A.T @ (cells.stiffness * (A @ h - state.targets)) / h
    np.testing.assert_allclose((sigma[1] - sigma[-1]) / (2 * e), K[:, edge], rtol=0, atol=1e-7)


@pytest.mark.parametrize("name", CELLS)
def test_convex_part_has_no_negative_stiffness(name):
    cells = CELLS[name]()
    network, n = cells.network, cells.network.dimension * len(cells.network.free)
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 2))
    compressed = perimeter_state(cells, (cells.sides @ critical.lengths) / 0.8, critical.coordinates)
    pattern = compressed.pattern()
    assert compressed.factorize(pattern).n_negative > 0
    convex = compressed.factorize_convex(pattern, 1.0).multiply(np.eye(n)) - np.eye(n)
    assert np.linalg.eigvalsh(convex).min() > -1e-12 * np.abs(convex).max()
    # The couplings of edges are at most their stiffness.
    bound = np.diag(compressed.edge_stiffness) - cells.overlap.toarray()
    assert np.linalg.eigvalsh(bound).min() > -1e-12 * np.abs(bound).max()


@pytest.mark.parametrize("name", ["voronoi, random stiffness", "voronoi 3D", "pinned grid"])
def test_cells_of_one_edge_each_are_springs(name):
    network = with_random_stiffness(NETWORKS[name](), 5)
    cells = cells_of(network, network.stiffness, sp.eye_array(network.n_edges))
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 2))
    rest = critical.lengths / 1.02
    ours = equilibrium(perimeter_state(cells, rest, critical.coordinates)).value
    springs = equilibrium(spring_state(network, rest, critical.coordinates)).value
    np.testing.assert_allclose(ours.bond_vectors, springs.bond_vectors, rtol=0, atol=1e-11)
    np.testing.assert_allclose(ours.sigma, springs.sigma, rtol=1e-9)
    np.testing.assert_allclose(ours.modified_stiffness.diagonal(), springs.modified_stiffness, rtol=1e-9)
    assert ours.energy == pytest.approx(springs.energy, rel=1e-11)
    fire = equilibrium(perimeter_state(cells, rest, critical.coordinates), "fire", tolerance=1e-13).value
    np.testing.assert_allclose(fire.bond_vectors, springs.bond_vectors, rtol=0, atol=1e-9)
    if not network.pins:
        found, expected = linear_response(ours).value, linear_response(springs).value
        assert (found.bulk, found.shear) == pytest.approx((expected.bulk, expected.shear), rel=1e-8)
        at_rest = perimeter_state(cells, critical.lengths, critical.coordinates)
        found, expected = perimeter_moduli(at_rest).value, elastic_moduli(network, critical.coordinates).value
        assert (found.bulk, found.shear) == pytest.approx((expected.bulk, expected.shear), rel=1e-7)


# The transition


@pytest.mark.parametrize("columns, rows, k", [(3, 4, 1.0), (4, 4, 2.5)])
def test_transition_of_regular_hexagons(columns, rows, k):
    network = honeycomb_network(columns, rows)
    n_cells = network.faces.n_faces
    solution = critical_from_perimeters(cells_of(network, k), np.full(n_cells, 2.0))
    assert solution.status is Status.ok
    np.testing.assert_allclose(solution.value.shape_index, HEXAGON, rtol=1e-12)
    np.testing.assert_allclose(solution.value.cell_tensions, 1, rtol=1e-8)
    # All perimeters are alike, so the rate is p/2 and B_0 = (1/V) N_c κ (p/2)² = κ p²/4⟨a⟩; no shear changes them.
    moduli = solution.value.moduli()
    assert moduli.bulk == pytest.approx(k * HEXAGON**2 / 4, rel=1e-10)
    assert abs(moduli.shear) < 1e-12


@pytest.mark.parametrize("varied", [False, True], ids=["equal", "varied"])
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_transition_of_disordered_cells(seed, varied):
    targets, solution = disordered(seed, 200, varied)
    value = solution.value
    critical, p = value.configuration, value.at_rest().perimeters
    np.testing.assert_allclose(p / targets, solution.ratio, rtol=1e-8)
    np.testing.assert_allclose(p / targets, np.mean(p / targets), rtol=1e-11)
    assert (value.cell_tensions > 0).all()
    assert critical.residual < 1e-11
    # Edge tensions are sums over the two cells of each edge.
    tensions = value.cells.sides.T @ value.cell_tensions
    np.testing.assert_allclose(critical.tensions / critical.tensions.mean(), tensions / tensions.mean(), rtol=1e-12)
    assert np.sum(critical.sigma**2) == pytest.approx(300, rel=1e-12)
    # Disordered tilings have a larger perimeter than regular hexagons, by less than the bound.
    assert HEXAGON < value.shape_index.mean() < 3.9


def test_transition_is_the_limit_of_straining():
    # Targets a little below the transition leave one relaxed state; the distance to it falls with the excess.
    value = disordered()[1].value
    x = value.configuration.coordinates + 0.05 * np.random.default_rng(1).standard_normal((100, 2))
    apart = []
    for excess in (1e-3, 1e-4, 1e-5):
        goal = (1 - excess) * value.at_rest().perimeters
        state = equilibrium(perimeter_state(value.cells, goal, x)).value
        assert (state.cell_tensions > 0).all()
        apart.append(np.abs(state.bond_vectors - value.configuration.bond_vectors).max())
        np.testing.assert_allclose(
            state.cell_tensions / state.cell_tensions.mean(),
            value.cell_tensions,
            atol=50 * excess,
        )
    np.testing.assert_allclose(np.array(apart[1:]) / apart[:-1], 0.1, rtol=0.2)


def test_configuration_minimises_perimeters():
    targets, solution = disordered()
    value = solution.value
    rng = np.random.default_rng(2)
    network, x = value.configuration.network, value.configuration.coordinates
    for size in (1e-3, 0.05, 0.3):
        L = network.bond_vectors(x + size * rng.standard_normal(x.shape))
        assert np.max(value.cells.sides @ np.linalg.norm(L, axis=1) / targets) > solution.ratio


# Moduli


@pytest.mark.parametrize("varied", [False, True], ids=["equal", "varied"])
def test_transition_modulus_by_three_methods(varied):
    value = disordered(varied=varied)[1].value
    found, start = value.moduli(), value.at_rest()
    network, kappa, T = start.network, value.cells.stiffness, value.cell_tensions
    # By the formula, dilation being p/2.
    p = start.perimeters
    assert found.bulk == pytest.approx((T @ p / 2) ** 2 / (T**2 @ (1 / kappa)) / network.volume, rel=1e-12)
    # Cauchy and Schwarz: no tensions give more than Σκp²/4V.
    assert found.bulk <= np.sum(kappa * p**2) / (4 * network.volume)
    # By the self-stress of the state at rest.
    at_rest = perimeter_moduli(start)
    assert at_rest.status is Status.ok and at_rest.n_self_stresses == 1
    assert (at_rest.value.bulk, at_rest.value.shear) == pytest.approx((found.bulk, found.shear), rel=1e-6, abs=1e-9)
    # By energies and by linear response past it: cubics through four small strains leave their fourth order.
    gamma = np.array([1, 2, 3, 4]) * 2.5e-4
    energies, responses = [], []
    for g in gamma:
        state = equilibrium(start.deformed(np.sqrt(1 + g) * np.eye(2)), tolerance=1e-15, throw=False).value
        energies.append(2 * state.energy / (network.volume * g**2))
        responses.append(linear_response(state).value)
    assert np.polyfit(gamma, energies, 3)[-1] == pytest.approx(found.bulk, rel=1e-6)
    assert np.polyfit(gamma, [r.bulk for r in responses], 3)[-1] == pytest.approx(found.bulk, rel=1e-6)
    assert np.polyfit(gamma, [r.shear for r in responses], 3)[-1] == pytest.approx(found.shear, abs=1e-6 * found.bulk)


def test_linear_response_is_the_second_derivative_of_relaxed_energies():
    start = disordered(varied=True)[1].value.at_rest()
    state = equilibrium(start.deformed(np.sqrt(1.03) * np.eye(2))).value
    found = perimeter_moduli(state)
    assert found.status is Status.ok
    h, V = 5e-4, state.network.volume
    for value, F in ((found.value.bulk, lambda e: np.sqrt(1 + e) * np.eye(2)), (found.value.shear, shear)):
        E = {n: relaxed_energy(state, F(n * h)) for n in (-2, -1, 0, 1, 2)}
        second = (16 * (E[1] + E[-1]) - (E[2] + E[-2]) - 30 * E[0]) / (12 * h**2)
        assert value == pytest.approx(second / V, rel=1e-6)


def test_cells_before_the_transition_are_floppy():
    # Targets above the transition are all met, at zero energy.
    value = disordered()[1].value
    start = value.at_rest()
    x = start.coordinates + 0.05 * np.random.default_rng(1).standard_normal(start.coordinates.shape)
    state = equilibrium(perimeter_state(value.cells, 1.03 * start.perimeters, x), tolerance=1e-15).value
    assert np.abs(state.cell_tensions).max() < 1e-12
    found = perimeter_moduli(state)
    assert found.status is Status.floppy
    assert (found.value.bulk, found.value.shear, found.value.shear_stress_corrected) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("name", ["faces", "random cells, pinned"])
def test_newton_and_fire_reach_the_same_equilibrium(name):
    cells = CELLS[name]()
    critical = CriticalManifold(cells.network).configuration(random_stress(cells.network.n_edges, 3))
    start = perimeter_state(cells, 0.8 * (cells.sides @ critical.lengths), critical.coordinates)
    newton, fire = equilibrium(start), equilibrium(start, "fire", tolerance=1e-12)
    assert newton.status is fire.status is Status.ok
    assert newton.value.energy == pytest.approx(fire.value.energy, rel=1e-9)
    np.testing.assert_allclose(newton.value.cell_tensions, fire.value.cell_tensions, rtol=0, atol=1e-8)


# Failures


def test_collapsing_edges_are_named():
    # No perimeter fixes a single edge: two vertices may coincide at the minimum.
    cells = cells_of(voronoi_network(200, seed=1))
    solution = critical_from_perimeters(cells, np.ones(100), throw=False)
    assert solution.status is Status.edge_collapse
    collapsed, value = solution.collapsed_edges, solution.value
    assert len(collapsed) == 1
    assert value.configuration.lengths[collapsed[0]] < 1e-6
    # The ratio, the tensions and the moduli are still defined.
    np.testing.assert_allclose(value.at_rest().perimeters, solution.ratio, rtol=1e-6)
    assert (value.cell_tensions > 0).all()
    T = value.cell_tensions
    bulk = value.shape_index.mean() ** 2 / 4 / np.mean(T**2)
    assert value.moduli().bulk == pytest.approx(bulk, rel=1e-6)
    with pytest.raises(SolveError, match=f"edges {collapsed[0]}"):
        critical_from_perimeters(cells, np.ones(100))


def test_relaxation_to_a_collapse_raises():
    network = voronoi_network(200, seed=1)
    cells = cells_of(network)
    critical = critical_from_perimeters(cells, np.ones(100), throw=False)
    edge, goal = critical.collapsed_edges[0], 0.95 * critical.ratio
    start = perimeter_state(cells, np.full(100, goal), network.positions)
    assert equilibrium(start, throw=False).status is Status.edge_collapse
    with pytest.raises(SolveError, match=f"edge {edge}"):
        equilibrium(start)


def test_slack_cells_are_named():
    # A cell with a target larger than its neighbours allow.
    targets = np.ones(50)
    targets[7] = 5.0
    cells = cells_of(voronoi_network(100, seed=1))
    solution = critical_from_perimeters(cells, targets, throw=False)
    assert solution.status is Status.slack_edges
    np.testing.assert_array_equal(solution.slack_cells, [7])
    ratio = solution.value.at_rest().perimeters / targets / solution.ratio
    assert ratio[7] < 0.99
    np.testing.assert_allclose(np.delete(ratio, 7), 1, rtol=1e-8)
    with pytest.raises(SolveError, match="cells 7"):
        critical_from_perimeters(cells, targets)


NETWORK = voronoi_network(12, seed=1)
FACES = cells_of(NETWORK)
BAD = {
    "faces unknown": (lambda: cells_of(Network(NETWORK.edges, NETWORK.offsets, NETWORK.cell)), "faces.*planar_faces"),
    "stiffness negative": (lambda: cells_of(NETWORK, [1, 1, -1, 1, 1, 1]), r"positive.*stiffness\[2\] = -1"),
    "stiffness zero": (lambda: cells_of(NETWORK, 0.0), r"positive.*stiffness\[0\]"),
    "stiffness too short": (lambda: cells_of(NETWORK, [1, 2]), r"one value per cell, shape \(6,\)"),
    "sides too narrow": (lambda: cells_of(NETWORK, sides=np.ones((3, 5))), r"shape \(N_c, 18\), not \(3, 5\)"),
    "sides a list": (lambda: cells_of(NETWORK, sides=np.ones(18)), r"shape \(N_c, 18\)"),
    "sides negative": (lambda: cells_of(NETWORK, sides=-np.eye(18)), "must not be negative"),
    "sides NaN": (lambda: cells_of(NETWORK, sides=np.nan * np.eye(18)), "must not be negative"),
    "edge without a cell": (lambda: cells_of(NETWORK, sides=np.eye(18)[:-1]), "edge 17 belongs to no cell"),
    "targets negative": (lambda: critical_from_perimeters(FACES, -np.ones(6)), r"positive.*targets\[0\]"),
    "targets NaN": (lambda: critical_from_perimeters(FACES, np.full(6, np.nan)), r"targets\[0\]"),
    "targets too many": (lambda: perimeter_state(FACES, np.ones(7), NETWORK.positions), "one value per cell"),
    "coordinates": (lambda: perimeter_state(FACES, np.ones(6), np.ones((3, 2))), r"shape \(12, 2\)"),
    "out of balance": (
        lambda: perimeter_moduli(perimeter_state(FACES, np.ones(6), NETWORK.positions)),
        "call equilibrium",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_raises_one_sentence(name):
    call, pattern = BAD[name]
    with pytest.raises(InputError, match=pattern) as caught:
        call()
    assert "\n" not in str(caught.value)
    assert 10 < len(str(caught.value)) < 250


def test_cells_are_immutable():
    before = FACES.sides.toarray()
    critical_from_perimeters(FACES, np.ones(6), throw=False)
    np.testing.assert_array_equal(FACES.sides.toarray(), before)
    assert isinstance(FACES, Cells)
