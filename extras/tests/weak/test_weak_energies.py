"""Weak energies: exact derivatives against differences, closed forms, and bad input."""

from functools import partial

import mpmath
import numpy as np
import pytest
import scipy.sparse as sp
from derivatives import assert_derivative
from problems import oblique, pinned_grid, voronoi_3d
from refusals import refused

from critflow import Network, lattice, voronoi_network
from critflow_extras import AngleSprings, PointForces, SoftSprings
from critflow_extras.weak.weak_energies import _by_cosine, weak_function

PLANE, SPACE, PINNED = oblique(voronoi_network(20, seed=1)), voronoi_3d(), pinned_grid(4)
TRIANGULAR = lattice("triangular", 3, 3)
F = np.array([[1.1, 0.2], [0.05, 0.9]])
SOFT = SoftSprings([[0, 4], [2, 6], [1, 3]], [1.0, 2.0, 0.5], [0.3, 0.0, 0.7], [[1, 0], [0, 0], [0, -1]])


def own(x, F):
    """½ Σ|x|⁴, as a user might write it."""
    square = np.sum(x**2, axis=1)
    blocks = 2 * square[:, None, None] * np.eye(x.shape[1]) + 4 * x[:, :, None] * x[:, None, :]
    return 0.5 * np.sum(square**2), 2 * square[:, None] * x, sp.block_diag([sp.coo_array(block) for block in blocks])


def random_angles(n, seed=0):
    return np.random.default_rng(seed).uniform(0.3, 3.0, n)


# A network, an energy, and the displacement of vertices from the positions.
ENERGIES = {
    "angles": (PLANE, AngleSprings(random_angles(60), stiffness=np.linspace(1, 2, 60)), 0.2),
    "angles of the positions": (PLANE, AngleSprings(), 0.1),
    "angles in space": (SPACE, AngleSprings(random_angles(6 * SPACE.n_vertices)), 0.02),
    "angles at pins": (PINNED, AngleSprings(1.7), 0.1),
    "fibres": (TRIANGULAR, AngleSprings(pairs="fibres"), 0.1),
    "fibres, nearly straight": (TRIANGULAR, AngleSprings(pairs="fibres"), 1e-5),
    "fibres, straight": (TRIANGULAR, AngleSprings(pairs="fibres"), 0.0),
    "soft springs": (PLANE, SOFT, 0.1),
    "sum": (PLANE, [SOFT, AngleSprings(), PointForces(np.eye(20, 2) - np.eye(20, 2)[::-1]), own], 0.1),
}


@pytest.mark.parametrize("name", ENERGIES)
def test_gradient_and_hessian_are_derivatives(name):
    network, energy, spread = ENERGIES[name]
    gradient = np.eye(network.dimension) if network.dimension == 3 else F
    x = network.positions + spread * np.random.default_rng(1).standard_normal(network.positions.shape)
    x, U = x @ gradient.T, weak_function(energy, network)
    directions = np.random.default_rng(2).standard_normal((2, *x.shape))
    _, by_x, H = U(x, gradient)
    step = 2e-3 * float(np.linalg.norm(network.bond_vectors(network.positions), axis=1).min())
    assert_derivative(lambda y: U(y, gradient)[0], by_x, x, directions, step=step, rtol=1e-6, atol=1e-8)
    product = lambda u: (H @ u.ravel()).reshape(u.shape)  # noqa: E731
    assert_derivative(lambda y: U(y, gradient)[1], product, x, directions, step=step, rtol=1e-6, atol=1e-8)
    assert abs(H - H.T).max() < 1e-12 * abs(H).max()


def test_angles_are_those_of_the_cell_and_rest_in_the_positions():
    # An affine deformation of the plane changes angles, a rotation and a dilation none.
    U = weak_function(AngleSprings(), PLANE)
    turn = 1.3 * np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    # Rounding of the coordinates turns each of the 180 angles by this much at most.
    shortest = np.linalg.norm(PLANE.bond_vectors(PLANE.positions), axis=1).min()
    rounding = 16 * np.finfo(float).eps * np.abs(PLANE.positions @ turn.T).max() / shortest
    assert U(PLANE.positions, np.eye(2))[0] < 90 * rounding**2
    assert U(PLANE.positions @ turn.T, turn)[0] < 90 * rounding**2
    assert U(PLANE.positions @ F.T, F)[0] > 1e-3


def test_closed_forms():
    # A right angle between two unit edges, at rest at 60 degrees, and a stretched soft spring
    network = Network([[0, 1], [0, 2]], pins={1: [1.0, 0.0], 2: [0.0, 1.0]})
    x = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    U = weak_function(AngleSprings(np.pi / 3, stiffness=2.0), network)
    assert U(x, np.eye(2))[0] == pytest.approx((np.pi / 6) ** 2, rel=1e-14)
    soft = weak_function(SoftSprings([[1, 2]], 3.0, 1.0), network)
    assert soft(x, np.eye(2))[0] == pytest.approx(1.5 * (np.sqrt(2) - 1) ** 2, rel=1e-14)
    load = weak_function(PointForces([[0.0, 2.0], [1.0, 0.0], [0.0, 0.0]]), network)
    assert load(x + 0.5, np.eye(2))[0] == pytest.approx(-2.5, rel=1e-14)


def test_functions_of_the_cosine_are_continuous_where_edges_are_nearly_straight():
    # A series up to 0.01, the functions themselves beyond: φ/sin φ and (sin φ − φ cos φ)/sin³ φ, to 50 digits
    bends = [1e-9, 1e-4, 9.99e-3, 1.001e-2, 0.1, 1.0]
    first, second = _by_cosine(np.pi - np.array(bends), np.full(6, np.pi))
    with mpmath.workdps(50):
        exact = [mpmath.mpf(b) / mpmath.sin(b) for b in bends]
        curves = [(mpmath.sin(b) - b * mpmath.cos(b)) / mpmath.sin(b) ** 3 for b in map(mpmath.mpf, bends)]
    np.testing.assert_allclose(first, np.array(exact, float), rtol=1e-11)
    np.testing.assert_allclose(second, np.array(curves, float), rtol=1e-8)


def test_pairs():
    assert len(AngleSprings().pairs_of(PLANE)[0]) == 3 * 20
    assert len(AngleSprings().pairs_of(SPACE)[0]) == 6 * SPACE.n_vertices
    # Three fibres pass through every vertex of the lattice.
    edges, signs = AngleSprings(pairs="fibres").pairs_of(TRIANGULAR)
    assert len(edges) == 3 * TRIANGULAR.n_vertices
    L = TRIANGULAR.bond_vectors(TRIANGULAR.positions)
    away = signs[:, :, None] * L[edges]
    np.testing.assert_allclose(away[:, 0], -away[:, 1], rtol=0, atol=1e-12)


STRAIGHT = Network([[0, 1], [0, 2]], pins={1: [1.0, 0.0], 2: [-1.0, 0.0]})
BAD = {
    "angles of a wrong shape": (AngleSprings(np.ones(7)), PLANE, "pair"),
    "angles beyond π": (AngleSprings(4.0), PLANE, "between 0 and π"),
    "no positions": (AngleSprings(), STRAIGHT, "positions"),
    "unknown pairs": (AngleSprings(pairs="some"), PLANE, "fibres"),
    "no fibres": (AngleSprings(pairs="fibres"), PLANE, "fibre"),
    "no direction": (AngleSprings(1.0), STRAIGHT, "parallel"),
    "a soft spring without length": (SoftSprings([[0, 0]], 1.0, 0.5), PLANE, "no length"),
    "a soft spring to nowhere": (SoftSprings([[0, 99]]), PLANE, "no vertex 99"),
    "offsets without a cell": (SoftSprings([[0, 1]], offsets=[[1, 0]]), STRAIGHT, "offsets"),
    "a negative stiffness": (SoftSprings([[0, 1]], -1.0), PLANE, "positive"),
    "a negative length": (SoftSprings([[0, 1]], 1.0, -1.0), PLANE, "not negative"),
    "edges of a wrong shape": (SoftSprings([0, 1]), PLANE, "shape"),
    "forces of a wrong shape": (PointForces(np.ones((3, 2))), PLANE, "shape"),
    "forces that move everything": (PointForces(np.ones((20, 2))), PLANE, "sum to zero"),
    "a function of other results": (lambda x, F: 1.0, PLANE, "three things"),
    "a function of other shapes": (lambda x, F: (1.0, x[:2], sp.eye_array(40)), PLANE, "gradient of shape"),
    "a word": ("bending", PLANE, "AngleSprings"),
    "an empty list": ([], PLANE, "AngleSprings"),
}


def evaluated(energy, network):
    x = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0]]) if network is STRAIGHT else network.positions
    return weak_function(energy, network)(x, np.eye(2))


test_bad_input_raises_one_sentence = refused(
    {name: (partial(evaluated, energy, network), word) for name, (energy, network, word) in BAD.items()}
)
