"""Isogonal modes keep directions and tensions, and so the tension variance and the largest bulk modulus."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from problems import critical_of, dense_free, oblique, pinned_grid, sheared, square_octagon, voronoi_3d
from refusals import refused
from scipy.optimize import nnls

from critflow import (
    CriticalManifold,
    InputError,
    Network,
    elasticity,
    isogonal_modes,
    lattice,
    optimize,
    stiffening,
    strain_path,
    upper_bound,
    voronoi_network,
)
from critflow.isogonal import affine_bulk_modulus, face_modes


@cache
def with_stiffness(n_vertices):
    """A network of random stiffnesses at its largest bulk modulus."""
    network = voronoi_network(n_vertices, seed=3)
    network = network.with_stiffness(np.random.default_rng(1).uniform(0.5, 2.0, network.n_edges))
    return CriticalManifold(network).configuration(network.stiffness)


@cache
def least_tension_variance(n_vertices):
    return optimize(voronoi_network(n_vertices, seed=0), "tension_variance").value


PERIODIC = {
    "voronoi": lambda: voronoi_network(60, seed=1),
    "oblique": lambda: oblique(voronoi_network(60, seed=2)),
    "sheared": lambda: sheared(voronoi_network(60, seed=3), 1.7),
    "few faces, edges longer than half the cell": lambda: voronoi_network(8, seed=3),
    "honeycomb": lambda: lattice("honeycomb", 3, 4),
}
CRITICAL = {
    **{name: lambda make=make: critical_of(make(), 5) for name, make in PERIODIC.items()},
    "random stiffness": lambda: with_stiffness(60),
    "least tension variance": lambda: least_tension_variance(100),
    "largest shear modulus": lambda: optimize(voronoi_network(60, seed=4), "shear_modulus").value,
}


def dense(matrix):
    return np.asarray(matrix.todense()) if hasattr(matrix, "todense") else matrix


def grounded(modes):
    """Displacements (n_modes, 2·N_v) less that of vertex 0, so that translations are gone."""
    u = dense(modes.displacements).reshape(len(dense(modes.displacements)), -1, 2)
    return (u - u[:, :1]).reshape(len(u), -1)


@pytest.mark.parametrize("name", CRITICAL)
def test_the_modes_of_the_faces_are_all_modes_with_one_relation(name):
    critical = CRITICAL[name]()
    every, local = isogonal_modes(critical), face_modes(critical)
    n_faces = critical.network.n_vertices // 2
    assert every.n_independent == local.n_independent == n_faces - 1 == len(every.elongations)
    low, high = every.gap
    assert low < 1e-12 and high > 1e-5
    # The same space: independent, and nothing is left of one outside the other.
    local_u, basis = grounded(local), np.linalg.qr(grounded(every).T)[0]
    size = np.abs(local_u).max()
    assert np.linalg.matrix_rank(local_u, tol=1e-9 * size) == n_faces - 1
    assert np.abs(local_u - local_u @ basis @ basis.T).max() < 1e-10 * size
    # The relation: all faces inflated alike leave every vertex where it is.
    assert np.abs(local.displacements.sum(axis=0)).max() < 1e-13 * size
    assert np.linalg.matrix_rank(local_u[1:], tol=1e-9 * size) == n_faces - 1


@pytest.mark.parametrize("name", CRITICAL)
def test_each_mode_moves_the_sides_of_its_face_outwards(name):
    critical = CRITICAL[name]()
    network, modes = critical.network, face_modes(critical)
    faces = network.faces
    g, _ = dense_free(network)
    unit = critical.bond_vectors / critical.lengths[:, None]
    reach = critical.tensions.mean() / critical.tensions
    for face in range(faces.n_faces):
        here = slice(faces.starts[face], faces.starts[face + 1])
        sides, signs = faces.edges[here], faces.signs[here]
        u = dense(modes.displacements)[face].reshape(-1, 2)
        change = g @ u
        size = np.abs(u).max()
        # Directions stay, and the stored numbers are the elongations.
        across = unit[:, 0] * change[:, 1] - unit[:, 1] * change[:, 0]
        np.testing.assert_allclose(across, 0.0, rtol=0, atol=1e-13 * size)
        along = np.einsum("ad,ad->a", unit, change)
        np.testing.assert_allclose(along, dense(modes.elongations)[face], rtol=0, atol=1e-13 * size)
        # Only corners move, and with them every side, to the right of its walk; a face may be a neighbour of itself.
        corners = np.unique(network.edges[sides])
        assert not np.delete(u, corners, axis=0).any()
        outside = np.stack([unit[:, 1], -unit[:, 0]], axis=1)
        pushed = np.zeros(network.n_edges)
        np.add.at(pushed, sides, signs * reach[sides])
        for end in network.edges.T:
            moved = np.einsum("ad,ad->a", outside, u[end])
            np.testing.assert_allclose(moved[sides], pushed[sides], rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize("find", [face_modes, isogonal_modes])
def test_the_walk_keeps_directions_tensions_and_bulk_modulus(find):
    before = with_stiffness(60)
    modes, bound = find(before), upper_bound(before.network, "B_0")
    rng = np.random.default_rng(2)
    for _ in range(5):
        after = modes.towards(rng.standard_normal(len(dense(modes.elongations))), 0.8)
        assert np.abs(after.lengths / before.lengths - 1).max() > 0.5
        assert after.residual < 1e-12
        unit = after.bond_vectors / after.lengths[:, None]
        np.testing.assert_allclose(unit, before.bond_vectors / before.lengths[:, None], rtol=0, atol=1e-12)
        ratio = after.tensions / before.tensions
        np.testing.assert_allclose(ratio, ratio[0], rtol=1e-12)
        np.testing.assert_allclose(elasticity(after).value.bulk, bound, rtol=1e-12)
        # The stress alone leads back to the same coordinates.
        again = CriticalManifold(before.network).configuration(after.sigma)
        np.testing.assert_allclose(again.coordinates, after.coordinates, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", PERIODIC)
def test_moduli_at_the_transition_belong_to_the_force_network_alone(name):
    # At any stress, not only where it is best: T in balance does the same work on all L that close on the cell.
    critical = critical_of(PERIODIC[name](), 5)
    network, modes, before = critical.network, face_modes(critical), elasticity(critical).value
    rng = np.random.default_rng(3)
    other = CriticalManifold(network).configuration(rng.uniform(0.3, 2.0, network.n_edges))
    for fraction in (0.4, 0.9):
        after = modes.towards(rng.standard_normal(network.n_vertices // 2), fraction)
        moduli = elasticity(after).value
        assert moduli.bulk == pytest.approx(before.bulk, rel=1e-12)
        assert moduli.shear == pytest.approx(before.shear, rel=1e-10, abs=1e-14)
        # Any other configuration in the same cell may stand for L.
        T = after.sigma[:, None] * after.bond_vectors
        by_other = np.sum(T * other.bond_vectors) ** 2 / (
            4 * network.volume * np.sum(T**2 / network.stiffness[:, None])
        )
        assert moduli.bulk == pytest.approx(by_other, rel=1e-11)


def test_the_stiffest_family_answers_to_any_expansion_alike():
    # L + s L* is in balance with forces k s L*: E = ½ s² Σ k|L*|² with (1 + s)² = 1 + γ.
    stiffest, strains = with_stiffness(60), np.array([0.001, 0.03, 0.5])
    bound, network = upper_bound(stiffest.network, "B_0"), stiffest.network
    s = np.sqrt(1 + strains) - 1
    for fraction in (0.0, 0.5, 0.9):
        member = face_modes(stiffest).towards(np.random.default_rng(6).standard_normal(30), fraction)
        path = strain_path(member, strains).value
        np.testing.assert_allclose(path.bulk_modulus, bound / np.sqrt(1 + strains), rtol=1e-12)
        np.testing.assert_allclose(path.energy, 2 * network.volume * bound * s**2, rtol=1e-11)
        expected = member.bond_vectors + s[-1] * stiffest.bond_vectors
        np.testing.assert_allclose(path.states[-1].bond_vectors, expected, rtol=0, atol=1e-12)
        assert stiffening(member).value.C_B == pytest.approx(-bound / 2, rel=1e-9)


def test_the_affine_part_of_the_bulk_modulus():
    affine = with_stiffness(100)
    np.testing.assert_allclose(affine_bulk_modulus(affine), elasticity(affine).value.bulk, rtol=1e-13)
    # The derivative that it stands for: energy of springs at rest, all lengths scaled with the box.
    network, strain = affine.network, 1e-4
    scale = np.sqrt(1 + strain * np.array([-1, 0, 1]))[:, None] - 1
    energy = 0.5 * np.sum(network.stiffness * (scale * affine.lengths) ** 2, axis=1)
    numeric = (energy[0] - 2 * energy[1] + energy[2]) / (strain**2 * network.volume)
    np.testing.assert_allclose(affine_bulk_modulus(affine), numeric, rtol=1e-6)
    modes, rng = face_modes(affine), np.random.default_rng(4)
    for fraction in (0.01, 0.3, 0.9):
        other = modes.towards(rng.standard_normal(50), fraction)
        assert affine_bulk_modulus(other) > elasticity(other).value.bulk * (1 + 1e-6 * fraction**2)
    assert affine_bulk_modulus(critical_of(voronoi_3d(), 5)) > 0


@pytest.mark.parametrize("find", [face_modes, isogonal_modes])
def test_a_walk_to_zero_length_is_refused_with_the_largest_scale(find):
    modes = find(with_stiffness(60))
    step = np.arange(1.0, 1.0 + len(dense(modes.elongations)))
    with pytest.raises(InputError, match="would lose its length") as refusal:
        modes.walk(1e3 * step)
    largest = float(str(refusal.value).rsplit(" ", 1)[1]) * 1e3
    assert 0 < largest == pytest.approx(modes.limit(step), rel=1e-3)
    modes.walk(0.999 * largest * step)
    with pytest.raises(InputError):
        modes.walk(1.001 * largest * step)


def slackened():
    """A configuration with an edge without stress, and a vertex of it."""
    critical = with_stiffness(60)
    return replace(critical, sigma=np.where(np.arange(90) == 11, 0.0, critical.sigma))


SMALL = face_modes(with_stiffness(60))
BAD = {
    "few amplitudes": (lambda: SMALL.walk(np.ones(3)), "30 finite amplitudes"),
    "amplitudes NaN": (lambda: SMALL.limit(np.full(30, np.nan)), "30 finite amplitudes"),
    **{
        f"fraction {part}": (lambda part=part: SMALL.towards(np.arange(30.0), part), "fraction")
        for part in (1.0, -0.1, np.nan, "half")
    },
    "amplitudes in words": (lambda: SMALL.walk("abc"), "amplitudes must be real numbers"),
    "direction in words": (lambda: SMALL.towards("abc"), "amplitudes must be real numbers"),
    "nothing shrinks": (lambda: SMALL.towards(np.zeros(30)), "no edge shrinks"),
    "lengths of no member": (lambda: SMALL.largest(np.ones(90), 1.5), "smaller length"),
    **{
        f"length {shortest}": (lambda shortest=shortest: SMALL.largest(np.ones(90), shortest), "shortest")
        for shortest in (0.0, np.inf, np.nan, "short")
    },
    "few weights": (lambda: SMALL.largest(np.ones(89), 0.1), "one value per edge"),
    "four edges a vertex": (lambda: face_modes(critical_of(square_octagon(), 5)), "use isogonal_modes instead"),
    "pins": (lambda: face_modes(critical_of(pinned_grid(), 5)), "use isogonal_modes instead"),
    "faces in space": (lambda: face_modes(critical_of(voronoi_3d(), 5)), "use isogonal_modes instead"),
    "modes in space": (lambda: isogonal_modes(critical_of(voronoi_3d(), 5)), "two dimensions"),
    "a slack edge": (
        lambda: face_modes(slackened()),
        f"vertex {with_stiffness(60).network.edges[11].min()} lie along one line or vanish",
    ),
}
test_bad_input_raises_one_sentence = refused(BAD)


def test_modes_that_do_not_fit_in_memory_are_refused_at_once():
    critical = optimize(voronoi_network(4000, seed=1), "bulk_modulus").value
    with pytest.raises(InputError, match=r"7998 × 7998 is too large .* face_modes\(\) finds"):
        isogonal_modes(critical)
    assert face_modes(critical).n_independent == 1999


def test_a_pinned_network_keeps_its_pins():
    # Four edges a vertex are more directions than displacements: nothing is isogonal.
    rigid = isogonal_modes(critical_of(pinned_grid(6), 5))
    assert rigid.n_independent == 0 and rigid.elongations.shape == (0, rigid.critical.network.n_edges)
    # A cube seen from above, its outer corners pinned: the inner square swells along the diagonals, its one mode.
    outer = np.array([[0.0, 0.0], [3.0, 0.2], [3.1, 3.0], [-0.2, 2.8]])
    ring = [[k, (k + 1) % 4] for k in range(4)]
    network = Network([*ring, *[[k, 4 + k] for k in range(4)]], pins={4 + k: outer[k] for k in range(4)})
    critical = critical_of(network, 5)
    modes = isogonal_modes(critical)
    assert modes.n_independent == 1
    after = modes.towards([1.0], 0.5)
    np.testing.assert_array_equal(after.coordinates[4:], outer)
    assert after.residual < 1e-13
    ratio = after.tensions / critical.tensions
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-12)


def test_the_largest_of_a_family_meets_the_conditions_of_an_optimum():
    before = with_stiffness(60)
    faces, modes = before.network.faces, face_modes(before)
    weights = np.zeros(90)
    np.add.at(weights, faces.edges[faces.starts[5] : faces.starts[6]], 1.0)
    solution = modes.largest(weights, 0.1)
    assert solution.ok
    after = solution.value
    np.testing.assert_array_equal(modes.walk(solution.amplitudes).lengths, after.lengths)
    # HiGHS meets its constraints to 1e-7.
    assert after.lengths.min() > 0.1 - 1e-7
    assert np.sum(weights * after.lengths) > 1.5 * np.sum(weights * before.lengths)
    assert elasticity(after).value.bulk == pytest.approx(upper_bound(before.network, "B_0"), rel=1e-12)
    # Duality: weights, with prices that are not negative on the tight edges, pull along no mode.
    tight = np.flatnonzero(after.lengths < 0.1 + 1e-6)
    assert len(tight) > 0
    prices = nnls(np.asarray((-modes.elongations[:, tight]).todense()), modes.elongations @ weights)
    assert prices[1] < 1e-8
    # Another method, and modes of another basis, find the same.
    again = isogonal_modes(before).largest(weights, 0.1).value
    assert np.sum(weights * again.lengths) == pytest.approx(np.sum(weights * after.lengths), rel=1e-7)
