"""Springs on perimeters: K with entries off its diagonal, the transition, and the moduli on both sides of it."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from derivatives import assert_derivative, first_derivative, second_derivative
from problems import (
    NETWORKS,
    grounded,
    pinned_grid,
    random_stress,
    voronoi_3d,
    with_random_stiffness,
)
from refusals import refused
from scipy.optimize import minimize
from tissues import disordered_tissue

from critflow import (
    Cable,
    CriticalManifold,
    InputError,
    Network,
    PowerLaw,
    SolveError,
    Status,
    elasticity,
    equilibrium,
    lattice,
    spring_state,
    stiffening,
    strain_path,
    voronoi_network,
)
from critflow.deformation import deformation_of
from critflow_extras import critical_from_perimeters, draw, tissue

# A regular hexagon of area 1 has the perimeter √(8√3), the least of all tilings by Hales' theorem.
HEXAGON = np.sqrt(8 * np.sqrt(3))


def faces_of(network):
    """Sides of the faces of a planar network, and stiffnesses."""
    faces = network.faces
    owner = np.repeat(np.arange(faces.n_faces), faces.sizes)
    A = sp.csr_array((np.ones(len(owner)), (owner, faces.edges)), shape=(faces.n_faces, network.n_edges))
    return network, A.toarray(), np.random.default_rng(1).uniform(0.5, 2.0, faces.n_faces)


def random_faces(network, n_faces, seed):
    """Faces of a few random sides each, of random weights; every edge belongs to one at least."""
    rng = np.random.default_rng(seed)
    A = rng.uniform(0.5, 2.0, (n_faces, network.n_edges)) * (rng.random((n_faces, network.n_edges)) < 0.15)
    A[rng.integers(n_faces, size=network.n_edges), np.arange(network.n_edges)] = 1.0
    return network, A, rng.uniform(0.5, 2.0, n_faces)


FACES = {
    "faces": lambda: faces_of(voronoi_network(40, seed=1)),
    "random faces, 3D": lambda: random_faces(voronoi_3d(), 30, 2),
    "random faces, pinned": lambda: random_faces(pinned_grid(), 12, 3),
}


def deformed_tissue(name, low=0.8, high=1.2, seed=3):
    """Faces in a random configuration, with perimeters at rest between two parts of their own."""
    network, A, stiffness = FACES[name]()
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, seed))
    factor = np.random.default_rng(seed).uniform(low, high, len(A))
    return tissue(network, factor * (A @ critical.lengths), critical.coordinates, stiffness=stiffness, sides=A)


# Energy and its derivatives


@pytest.mark.parametrize("name", FACES)
def test_forces_and_hessian_are_derivatives_of_the_energy(name):
    state = deformed_tissue(name)
    A, free = state.faces.sides.toarray(), state.coordinates[state.network.free]
    g, b = grounded(state.network)

    def energy(u):
        p = A @ np.linalg.norm(g @ (free + u) + b, axis=1)
        return 0.5 * np.sum(state.faces.stiffness * (p - state.rest_lengths) ** 2)

    zero, u = np.zeros_like(free), np.random.default_rng(3).standard_normal(free.shape)
    assert state.energy == pytest.approx(energy(zero), rel=1e-13)
    assert_derivative(energy, -state.forces, zero, [u], rtol=1e-7, atol=1e-8 * state.energy)
    factor = state.factorize()
    assert_derivative(
        lambda v: -state.moved(v).forces, lambda v: factor.multiply(v.ravel()).reshape(v.shape), zero, [u], rtol=1e-7
    )


@pytest.mark.parametrize("name", FACES)
def test_convex_part_has_no_negative_stiffness(name):
    compressed = deformed_tissue(name, 1.25, 1.25)
    n = compressed.forces.size
    assert compressed.factorize().n_negative > 0
    convex = compressed.factorize_convex(1.0).multiply(np.eye(n)) - np.eye(n)
    assert np.linalg.eigvalsh(convex).min() > -1e-12 * np.abs(convex).max()
    # The couplings of edges are at most their stiffness.
    bound = np.diag(compressed.edge_stiffness) - compressed.faces.overlap.toarray()
    assert np.linalg.eigvalsh(bound).min() > -1e-12 * np.abs(bound).max()


@pytest.mark.parametrize("name", ["voronoi, random stiffness", "voronoi 3D", "pinned grid"])
def test_faces_of_one_edge_each_are_springs(name):
    network = with_random_stiffness(NETWORKS[name](), 5)
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 2))

    def alike(rest):
        # Weights that are no whole numbers: sums must be exact for them too.
        options = {"stiffness": network.stiffness / 0.09, "sides": 0.3 * sp.eye_array(network.n_edges)}
        return tissue(network, 0.3 * rest, critical.coordinates, **options)

    rest = critical.lengths / 1.02
    ours = equilibrium(alike(rest)).value
    springs = equilibrium(spring_state(network, rest, critical.coordinates)).value
    np.testing.assert_allclose(ours.bond_vectors, springs.bond_vectors, rtol=0, atol=1e-11)
    np.testing.assert_allclose(ours.sigma, springs.sigma, rtol=1e-9)
    np.testing.assert_allclose(ours.modified_stiffness.diagonal(), springs.modified_stiffness, rtol=1e-9)
    assert ours.energy == pytest.approx(springs.energy, rel=1e-11)
    found, expected = (elasticity(state, volume=None if network.cell is not None else 1.0) for state in (ours, springs))
    np.testing.assert_allclose(found.value.tensor, expected.value.tensor, rtol=0, atol=1e-8)
    if not network.pins:
        found, expected = elasticity(alike(critical.lengths)), elasticity(network, critical.coordinates)
        np.testing.assert_allclose(found.value.tensor, expected.value.tensor, rtol=0, atol=1e-8)
        assert found.n_self_stresses == expected.n_self_stresses == 1


# The transition


@pytest.mark.parametrize("columns, rows, k", [(3, 4, 1.0), (4, 4, 2.5)])
def test_transition_of_regular_hexagons(columns, rows, k):
    network = lattice("honeycomb", columns, rows)
    solution = critical_from_perimeters(network, np.full(network.faces.n_faces, 2.0), stiffness=k)
    assert solution.status is Status.ok
    np.testing.assert_allclose(solution.value.shape_index, HEXAGON, rtol=1e-12)
    np.testing.assert_allclose(solution.value.face_tensions, 1, rtol=1e-8)
    # All perimeters are alike, so the rate is p/2 and B_0 = (1/V) N_f κ (p/2)² = κ p²/4⟨a⟩; no shear changes them.
    moduli = elasticity(solution).value
    assert moduli.bulk == pytest.approx(k * HEXAGON**2 / 4, rel=1e-10)
    assert abs(moduli.shear) < 1e-12


@pytest.mark.parametrize("varied", [False, True], ids=["equal", "varied"])
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_transition_of_disordered_faces(seed, varied):
    perimeters, solution = disordered_tissue(seed, 200, varied)
    value = solution.value
    critical, p = value.configuration, value.perimeters
    np.testing.assert_allclose(p / perimeters, solution.ratio, rtol=1e-8)
    np.testing.assert_allclose(p / perimeters, np.mean(p / perimeters), rtol=1e-11)
    assert (value.face_tensions > 0).all()
    assert critical.residual < 1e-11
    # Edge tensions are sums over the two faces of each edge.
    tensions = value.faces.sides.T @ value.face_tensions
    np.testing.assert_allclose(critical.tensions / critical.tensions.mean(), tensions / tensions.mean(), rtol=1e-12)
    assert np.sum(critical.sigma**2) == pytest.approx(300, rel=1e-12)
    # Disordered tilings have a larger perimeter than regular hexagons, by less than the bound.
    assert HEXAGON < value.shape_index.mean() < 3.9


def test_transition_is_the_limit_of_straining():
    # Perimeters a little below the transition leave one relaxed state; the distance to it falls with the excess.
    value = disordered_tissue()[1].value
    x = value.configuration.coordinates + 0.05 * np.random.default_rng(1).standard_normal((100, 2))
    apart = []
    for excess in (1e-3, 1e-4, 1e-5):
        goal = (1 - excess) * value.perimeters
        state = equilibrium(tissue(value.network, goal, x)).value
        assert (state.tension > 0).all()
        apart.append(np.abs(state.bond_vectors - value.configuration.bond_vectors).max())
        found = state.tension / state.tension.mean()
        np.testing.assert_allclose(found, value.face_tensions, atol=50 * excess)
    np.testing.assert_allclose(np.array(apart[1:]) / apart[:-1], 0.1, rtol=0.2)


# Moduli


@pytest.mark.parametrize("varied", [False, True], ids=["equal", "varied"])
def test_transition_modulus_by_two_methods(varied):
    value = disordered_tissue(varied=varied)[1].value
    found, start = elasticity(value).value, value.at_rest()
    network, kappa, T, p = value.network, value.faces.stiffness, value.face_tensions, start.spring_lengths
    # By the formula, dilation being p/2.
    assert found.bulk == pytest.approx((T @ p / 2) ** 2 / (T**2 @ (1 / kappa)) / network.volume, rel=1e-12)
    # Cauchy and Schwarz: no tensions give more than Σκp²/4V.
    assert found.bulk <= np.sum(kappa * p**2) / (4 * network.volume)
    # By the self-stress of the state at rest, with known errors.
    at_rest = elasticity(start)
    assert at_rest.status is Status.ok and at_rest.n_self_stresses == 1
    np.testing.assert_allclose(at_rest.value.tensor, found.tensor, rtol=0, atol=1e-9)
    assert at_rest.value.errors.tensor.max() < 1e-10 and np.isnan(found.errors.bulk)


def test_tissues_with_several_self_stresses_are_measured_at_rest():
    # Hexagons and triangles of the kagome lattice: two self-stresses; dilation changes p by p/2.
    solution = critical_from_perimeters(network := lattice("kagome", 6, 6), network.faces.sizes.astype(float))
    found, p = elasticity(solution), solution.value.perimeters
    assert found.status is Status.ok and found.n_self_stresses == 2
    assert found.value.bulk == pytest.approx(np.sum(p**2) / (4 * network.volume), rel=1e-12)


def test_tissues_before_the_transition_are_floppy():
    # Perimeters above the transition are all met, at zero energy.
    start = disordered_tissue()[1].value.at_rest()
    x = start.coordinates + 0.05 * np.random.default_rng(1).standard_normal(start.coordinates.shape)
    state = equilibrium(tissue(start.network, 1.03 * start.spring_lengths, x), tolerance=1e-15).value
    assert np.abs(state.tension).max() < 1e-12
    found = elasticity(state)
    assert found.status is Status.floppy
    assert not found.value.tensor.any() and found.value.bulk == found.value.shear_stress_corrected == 0.0


# Paths


def relaxed_energy(start, network, gradient):
    """The least energy at perimeters p0 (N_f,) after a deformation, from energies and forces alone."""
    A, kappa, p0 = start.faces.sides.toarray(), start.faces.stiffness, start.rest_lengths
    deformed = network.deformed(gradient)
    g, b = grounded(deformed)

    def value(u):
        L = g @ u.reshape(-1, 2) + b
        l = np.linalg.norm(L, axis=1)
        T = kappa * (A @ l - p0)
        return 0.5 * T @ (T / kappa), (g.T @ (((A.T @ T) / l)[:, None] * L)).ravel()

    x = (start.coordinates @ gradient.T)[network.free]
    found = minimize(value, x.ravel(), jac=True, method="L-BFGS-B", options={"ftol": 1e-16, "gtol": 1e-12})
    return found.fun


@pytest.mark.parametrize("deformation", ["dilation", "simple_shear"])
def test_paths_of_tissues_are_those_of_relaxed_energies(deformation):
    solution = disordered_tissue(varied=True)[1]
    start, network, strain = solution.value.at_rest(), solution.value.network, 0.05
    solved = strain_path(solution, [0.01, strain], deformation)
    assert solved.status is Status.ok
    path, course = solved.value, deformation_of(deformation, 2)
    energies = [relaxed_energy(start, network, course.gradient(g)) for g in strain + 1e-3 * np.arange(-2, 3)]
    assert path.energy[-1] == pytest.approx(energies[2], rel=1e-9)
    first, second = (of(lambda g: energies[round(g / 1e-3) + 2]) for of in (first_derivative, second_derivative))
    V, A = network.deformed(course.gradient(strain)).volume, course.velocity(strain)
    assert np.vdot(path.stress[-1], A) * V == pytest.approx(first, rel=1e-6)
    assert path.modulus[-1] * V == pytest.approx(second, rel=1e-4)


def test_free_sides_of_faces_and_edges_have_no_stress():
    # Perimeters alone only pull; edges with springs of their own hold the sides apart.
    network, A, stiffness = faces_of(lattice("triangular", 4, 4))
    sides = np.vstack([A, np.eye(network.n_edges)])
    lengths = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    rest = (sides @ lengths) * np.random.default_rng(1).uniform(0.95, 1.05, len(sides))
    springs = tissue(network, rest, stiffness=np.r_[stiffness, np.ones(network.n_edges)], sides=sides)
    path = strain_path(equilibrium(springs), 0.01 + 1e-3 * np.arange(-2, 3), "uniaxial_free").value
    assert np.abs(path.stress[:, 1, 1]).max() < 1e-12 and (path.free_components < -1e-3).all()
    V = path.states[2].network.volume
    first, second = (of(lambda g: path.energy[round(g / 1e-3) + 2]) for of in (first_derivative, second_derivative))
    assert path.stress[2, 0, 0] * V == pytest.approx(1.01 * first, rel=1e-7)
    assert path.modulus[2] * V == pytest.approx(second, rel=1e-5)


def test_stiffening_of_hexagons_in_closed_form():
    # B = B_0/√(1 + γ), and no shear changes a perimeter to first order.
    solution = critical_from_perimeters(lattice("honeycomb", 4, 4), np.ones(16), stiffness=2.5)
    found = stiffening(solution)
    assert found.status is Status.ok
    B, error = 2.5 * HEXAGON**2 / 4, found.stats.error_bound
    assert abs(found.value.bulk_0 - B) <= error.bulk_0 and abs(found.value.C_B + B / 2) <= error.C_B
    assert abs(found.value.C_G) <= error.C_G < 1e-13
    assert stiffening(solution, deformation="simple_shear", throw=False).status is Status.floppy


def test_starts_of_paths_and_drawings():
    solution, axes = disordered_tissue()[1], draw(disordered_tissue()[1])
    assert len(axes.collections) >= 1
    axes.figure.clear()
    loosened = strain_path(solution, [-0.001], throw=False)
    assert loosened.status is Status.floppy
    slack = replace(solution.value, face_tensions=np.r_[0.0, solution.value.face_tensions[1:]])
    for start, options, message in [(slack, {}, "face 0 has no tension"), (solution, {"law": Cable()}, "law")]:
        with pytest.raises(InputError, match=message):
            strain_path(start, [0.001], **options)
    several = critical_from_perimeters(lattice("triangular", 4, 4), np.ones(32))
    for start, options, message in [
        (slack, {}, "without tension"),
        (several, {}, "several"),
        (solution, {"law": PowerLaw(4)}, "Hookean"),
    ]:
        with pytest.raises(InputError, match=message):
            stiffening(start, **options)


# Failures


def test_collapsing_edges_are_named():
    # No perimeter fixes a single edge: two vertices may coincide at the minimum.
    network = voronoi_network(200, seed=1)
    solution = critical_from_perimeters(network, np.ones(100), throw=False)
    assert solution.status is Status.edge_collapse
    (edge,), value = solution.collapsed_edges, solution.value
    assert value.configuration.lengths[edge] < 1e-6
    # The ratio, the tensions and the moduli are still defined.
    np.testing.assert_allclose(value.perimeters, solution.ratio, rtol=1e-6)
    assert (value.face_tensions > 0).all()
    bulk = value.shape_index.mean() ** 2 / 4 / np.mean(value.face_tensions**2)
    assert elasticity(value).value.bulk == pytest.approx(bulk, rel=1e-6)
    with pytest.raises(SolveError, match=f"edges {edge}"):
        critical_from_perimeters(network, np.ones(100))
    # So ends a relaxation to smaller perimeters.
    start = tissue(network, np.full(100, 0.95 * solution.ratio))
    assert equilibrium(start, throw=False).status is Status.edge_collapse
    with pytest.raises(SolveError, match=f"edge {edge}"):
        equilibrium(start)


def test_slack_faces_are_named():
    # A face with a larger perimeter than its neighbours allow.
    perimeters, network = np.ones(50), voronoi_network(100, seed=1)
    perimeters[7] = 5.0
    solution = critical_from_perimeters(network, perimeters, throw=False)
    assert solution.status is Status.slack_edges
    np.testing.assert_array_equal(solution.slack_faces, [7])
    ratio = solution.value.perimeters / perimeters / solution.ratio
    assert ratio[7] < 0.99
    np.testing.assert_allclose(np.delete(ratio, 7), 1, rtol=1e-8)
    with pytest.raises(SolveError, match="faces 7"):
        critical_from_perimeters(network, perimeters)


NETWORK = voronoi_network(12, seed=1)
PLAIN = Network(NETWORK.edges, NETWORK.offsets, NETWORK.cell)
BAD = {
    "faces unknown": (lambda: tissue(PLAIN, np.ones(6), NETWORK.positions), "faces.*planar_faces"),
    "positions unknown": (lambda: tissue(PLAIN, np.ones(6), sides=np.ones((6, 18))), "positions"),
    "stiffness negative": (lambda: made(stiffness=[1, 1, -1, 1, 1, 1]), r"positive.*stiffness\[2\] = -1"),
    "stiffness zero": (lambda: made(stiffness=0.0), r"positive.*stiffness\[0\]"),
    "stiffness too short": (lambda: made(stiffness=[1, 2]), r"one value per face, shape \(6,\)"),
    "sides too narrow": (lambda: made(sides=np.ones((3, 5))), r"shape \(N_f, 18\), not \(3, 5\)"),
    "sides a list": (lambda: made(sides=np.ones(18)), r"shape \(N_f, 18\)"),
    "sides negative": (lambda: made(sides=-np.eye(18)), "must not be negative"),
    "sides NaN": (lambda: made(sides=np.nan * np.eye(18)), "must not be negative"),
    "edge without a face": (lambda: made(sides=np.eye(18)[:-1]), "edge 17 belongs to no face"),
    "perimeters negative": (lambda: critical_from_perimeters(NETWORK, -np.ones(6)), r"positive.*perimeters\[0\]"),
    "perimeters NaN": (lambda: critical_from_perimeters(NETWORK, np.full(6, np.nan)), r"perimeters\[0\]"),
    "perimeters too many": (lambda: tissue(NETWORK, np.ones(7)), "one value per face"),
    "coordinates": (lambda: tissue(NETWORK, np.ones(6), np.ones((3, 2))), r"shape \(12, 2\)"),
    "out of balance": (lambda: elasticity(tissue(NETWORK, np.ones(6))), "call equilibrium"),
}


def made(**options):
    return critical_from_perimeters(NETWORK, np.ones(6), **options)


test_bad_input_raises_one_sentence = refused(BAD)
