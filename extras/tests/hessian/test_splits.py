"""Both splits of the Hessian, differences of forces, and the bond operator by its definition."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from derivatives import assert_derivative
from problems import NETWORKS, critical_of, random_stress, triangular_lattice, with_random_stiffness
from units import same_in_units

from critflow import (
    CriticalManifold,
    PowerLaw,
    SolveError,
    Status,
    spring_state,
    three_bar_linkage,
    voronoi_network,
)
from critflow.self_stress import Spectrum
from critflow_extras.hessian.splits import bond_operator, geometric_split, hookean_split

NAMES = ["voronoi, random stiffness", "voronoi 3D", "own images", "oblique", "pinned star", "pinned grid"]


def stressed(network, strength=0.3):
    """Springs in equilibrium under a random stress: σ = k(|L| − ℓ)/|L| requires ℓ = |L|(1 − σ/k)."""
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 1))
    sigma = strength * network.stiffness.min() * critical.sigma / critical.sigma.max()
    return spring_state(network, critical.lengths * (1 - sigma / network.stiffness), critical.coordinates)


def moved(state, seed=2, size=0.05):
    """The same springs out of equilibrium."""
    return state.moved(size * np.random.default_rng(seed).standard_normal(state.forces.shape))


@pytest.mark.parametrize("name", NAMES)
def test_both_splits_are_the_hessian(name):
    # Also out of equilibrium, with tension and compression, and of another law.
    plain = stressed(NETWORKS[name]())
    for state in (plain, moved(plain), replace(moved(plain), law=PowerLaw(4))):
        geometric, hookean = geometric_split(state), hookean_split(state)
        H = geometric.hessian.toarray()
        scale = np.abs(H).max()
        np.testing.assert_allclose(hookean.hessian.toarray(), H, rtol=0, atol=1e-13 * scale)
        np.testing.assert_allclose(H, H.T, rtol=0, atol=1e-14 * scale)
        factor = state.factorize()
        np.testing.assert_allclose(factor.multiply(np.eye(len(H))), H, rtol=0, atol=1e-13 * scale)
        # The two stiffnesses are K and k.
        np.testing.assert_allclose(hookean.stiffness, state.edge_stiffness, rtol=1e-12)
        np.testing.assert_allclose(geometric.stiffness, state.modified_stiffness)


@pytest.mark.parametrize("name", NAMES)
def test_responses_are_derivatives_of_squares_and_lengths(name):
    state = moved(stressed(NETWORKS[name]()))
    zero, u = np.zeros_like(state.forces), np.random.default_rng(3).standard_normal(state.forces.shape)
    for split, lengths in (
        (geometric_split(state), lambda v: 0.5 * state.moved(v).lengths ** 2),
        (hookean_split(state), lambda v: state.moved(v).lengths),
    ):
        assert_derivative(lengths, lambda v, split=split: split.response @ v.ravel(), zero, [u])


@pytest.mark.parametrize(
    "make", [NETWORKS["voronoi, random stiffness"], NETWORKS["voronoi 3D"], NETWORKS["oblique"], three_bar_linkage]
)
def test_both_splits_agree_on_zero_modes(make):
    state = stressed(make())
    network = state.network
    # Of the free vertices, with the ground vertex fixed.
    spectrum = Spectrum(network, state.coordinates)
    Z, _ = spectrum.null_space(spectrum.n_motions, of_stresses=False)
    geometric, hookean = geometric_split(state), hookean_split(state)
    for split in (geometric, hookean):
        assert np.abs(split.response @ Z.T).max(initial=0.0) < 1e-12
        assert np.linalg.matrix_rank(split.response.toarray(), tol=1e-9) == Z.shape[1] - len(Z)
    P, P_hookean = Z @ (geometric.prestress @ Z.T), Z @ (hookean.prestress @ Z.T)
    np.testing.assert_allclose(P, P_hookean, rtol=0, atol=1e-13)
    np.testing.assert_allclose(P, Z @ (geometric.hessian @ Z.T), rtol=0, atol=1e-13)
    # Elsewhere they differ, by the part R̃ᵀσR̃.
    assert np.abs((geometric.prestress - hookean.prestress).toarray()).max() > 0.01


@pytest.mark.parametrize("name", NAMES)
def test_bond_operator_by_dense_matrices(name):
    state = stressed(NETWORKS[name]())
    operator = bond_operator(state)
    X = operator @ np.eye(state.network.n_edges)
    split = hookean_split(state)
    R, H = split.response.toarray(), split.hessian.toarray()
    expected = R @ np.linalg.solve(H, R.T)
    np.testing.assert_allclose(X, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    np.testing.assert_allclose(X, X.T, rtol=0, atol=1e-12 * np.abs(X).max())
    np.testing.assert_allclose(operator.rmatvec(np.ones(len(X))), X.sum(axis=0), rtol=0, atol=1e-11 * np.abs(X).max())


def test_unstressed_bond_operator_is_a_projection():
    # Rigid to first order with 18 self-stresses, and a critical network with 20 floppy motions.
    lattice, x = triangular_lattice(4, 4)
    voronoi = voronoi_network(40, seed=2)
    there = CriticalManifold(voronoi).configuration(random_stress(60, 1)).coordinates
    for plain, y in ((lattice, x), (voronoi, there)):
        network = with_random_stiffness(plain, 3)
        lengths = np.linalg.norm(network.bond_vectors(y), axis=1)
        root = np.sqrt(network.stiffness)
        X = bond_operator(spring_state(network, lengths, y)) @ np.diag(root)
        projector = root[:, None] * X
        spectrum = Spectrum(network, y)
        np.testing.assert_allclose(projector @ projector, projector, rtol=0, atol=1e-11)
        assert np.trace(projector) == pytest.approx(network.n_edges - spectrum.n_self_stresses, abs=1e-10)
        # No displacement results from the tensions of self-stresses.
        tensions, _ = spectrum.null_space(spectrum.n_self_stresses, of_stresses=True)
        assert np.abs(projector @ (tensions / root).T).max() < 1e-10


def test_buckled_springs_have_no_bond_operator():
    network = three_bar_linkage()
    critical = CriticalManifold(network).configuration([1.0, 1.0, 1.0])
    pushed = spring_state(network, 1.2 * critical.lengths, critical.coordinates)
    with pytest.raises(SolveError, match="2 negative") as refusal:
        bond_operator(pushed)
    assert refusal.value.solution.status is Status.unstable


def splits(network, units, size):
    """Both splits, and the bond operator where the springs do not buckle."""
    critical = critical_of(network, 1)
    state = spring_state(network, size * critical.lengths, critical.coordinates)
    one, other = geometric_split(state), hookean_split(state)
    matrices = (*(each.hessian.toarray() for each in (one, other)), one.prestress.data, other.prestress.data)
    return {"number": (other.response.data,), "length": (one.response.data,), "stiffness": matrices}


def operator(network, units, size):
    critical = critical_of(network, 1)
    X = bond_operator(spring_state(network, size * critical.lengths, critical.coordinates)) @ np.eye(network.n_edges)
    return {"number": (X * units.stiffness,)}


NETWORK = NETWORKS["voronoi, random stiffness"]
test_splits_in_other_units = same_in_units(
    {f"splits {size}": (partial(splits, size=size), NETWORK) for size in (0.95, 1.0, 1.05)}
    | {f"operator {size}": (partial(operator, size=size), NETWORK) for size in (0.98, 1.0)}
)
