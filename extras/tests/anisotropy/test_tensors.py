"""Elasticity by direction: closed forms, singular tensors, stress increments, other units, bad input."""

from functools import partial

import numpy as np
import pytest
from increments import assert_increments
from problems import (
    NETWORKS,
    UNPINNED,
    critical_of,
    oblique,
    strained,
    triangular_lattice,
    voronoi_3d,
    with_random_stiffness,
)
from refusals import refused
from units import same_in_units

from critflow import PowerLaw, elasticity, equilibrium, spring_state, strain_path, voronoi_network
from critflow.deformation import strain_basis
from critflow.linear_response import Elasticity, Errors
from critflow_extras import foam_network
from critflow_extras.anisotropy.tensors import affine_stress_corrected, compliance, stress_corrected, voigt


def known(tensor, d, error=1e-15):
    errors = Errors(np.full(tensor.shape, error), error, error, error)
    return Elasticity(tensor, tensor, np.zeros((d, d)), 1.0, errors, float(tensor[:d, :d].sum() / d**2))


def isotropic(bulk, shear, d, error=1e-15):
    basis = strain_basis(d)[1]
    trace = np.einsum("aii->a", basis)
    tensor = bulk * np.outer(trace, trace)
    tensor += 2 * shear * (np.einsum("aij,bij->ab", basis, basis) - np.outer(trace, trace) / d)
    return known(tensor, d, error)


@pytest.mark.parametrize("d", [2, 3])
def test_isotropic_closed_forms(d):
    K, G = 0.7, 0.3
    tensors = isotropic(K, G, d)
    E, nu = (
        (9 * K * G / (3 * K + G), (3 * K - 2 * G) / (6 * K + 2 * G))
        if d == 3
        else (4 * K * G / (K + G), (K - G) / (K + G))
    )
    n, t = np.eye(d)[:2] @ np.linalg.qr(np.random.default_rng(1).standard_normal((d, d)))[0]
    assert (tensors.young(n), tensors.young(0.3)) == pytest.approx((E, E), rel=1e-13)
    ratios = tensors.poisson(n, t), tensors.poisson(0.3), tensors.poisson(n)
    assert ratios == pytest.approx((nu, nu, nu), rel=1e-12)
    assert (tensors.bulk, tensors.shear) == pytest.approx((K, G), rel=1e-14)
    assert voigt(tensors) == pytest.approx((K, G), rel=1e-13)
    assert compliance(tensors)[-1, -1] == pytest.approx(1 / G, rel=1e-13)
    for name, modulus in {"uniaxial_free": E, "simple_shear": G, "pure_shear": 4 * G}.items():
        assert tensors.modulus(name) == pytest.approx(modulus, rel=1e-13)


def test_directions_are_vectors_or_angles():
    tensors = known(np.diag([2.0, 1.0, 0.3]), 2)
    assert tensors.young(0.0) == tensors.young([1, 0]) == pytest.approx(2.0)
    assert tensors.young(np.pi / 2) == pytest.approx(tensors.young([0, 3]))
    assert tensors.poisson(np.pi / 4) == pytest.approx(tensors.poisson([1, 1], [1, -1]))


def test_singular_tensors():
    # No bulk modulus: one soft direction, in which every uniaxial strain ends, with equal strains along all axes.
    soft = isotropic(0.0, 1.0, 2)
    assert soft.young([1, 0]) == 0.0
    assert soft.poisson([1, 2], [2, -1]) == pytest.approx(-1.0, rel=1e-12)
    assert compliance(soft)[0, 0] == np.inf and compliance(soft)[0, 1] == np.inf
    assert compliance(soft)[2, 2] == pytest.approx(1.0, rel=1e-13)
    # No shear modulus: a fluid in the plane; soft strains differ, but all keep the area.
    fluid = isotropic(1.0, 0.0, 2)
    assert fluid.young([1, 1]) == 0.0
    assert fluid.poisson([1, 0], [0, 1]) == pytest.approx(1.0, rel=1e-12)
    assert compliance(fluid)[0, 1] == -np.inf
    # Rank one along x: stiff there, and nothing relates y to it.
    tensors = known(np.diag([4.0, 0.0, 0.0]), 2)
    assert tensors.young([1, 0]) == pytest.approx(4.0, rel=1e-14)
    assert tensors.young([1, 1e-3]) == 0.0
    assert np.isnan(tensors.poisson([1, 0], [0, 1]))
    # Where the errors exceed the tensor, nothing is known.
    for error in (10.0, np.nan):
        unknown = isotropic(1.0, 1.0, 2, error)
        assert np.isnan([unknown.young([1, 0]), unknown.poisson([1, 0])]).all()
        assert np.isnan(compliance(unknown)).all()


BAD = {
    "no direction": (lambda: isotropic(1.0, 1.0, 2).young([0, 0]), "direction"),
    "direction in space": (lambda: isotropic(1.0, 1.0, 2).young([1, 0, 0]), "direction"),
    "direction NaN": (lambda: isotropic(1.0, 1.0, 2).young([np.nan, 1]), "direction"),
    "direction in words": (lambda: isotropic(1.0, 1.0, 2).young("xy"), "direction"),
    "not transverse": (lambda: isotropic(1.0, 1.0, 2).poisson([1, 0], [1, 1]), "orthogonal"),
}
test_bad_input_raises_one_sentence = refused(BAD)


def past_transition(network, gamma=0.05, F=None, law=None):
    """A state past the transition, deformed further and relaxed."""
    state = strain_path(critical_of(network, 2), [gamma], law=law).value.states[0]
    return state if F is None else equilibrium(state.deformed(F), tolerance=1e-15).value


def compressed_lattice():
    """A triangular lattice whose springs are compressed and sheared, with displaced vertices."""
    network, x = triangular_lattice(3, 4)
    state = spring_state(network, 1 + 0.05 * np.random.default_rng(3).standard_normal(network.n_edges), x)
    return equilibrium(state.deformed(np.array([[0.96, 0.05], [0.0, 0.97]])), tolerance=1e-15).value


STATES = {
    "tension": lambda: past_transition(with_random_stiffness(voronoi_network(24, seed=1), 3)),
    "oblique": lambda: past_transition(oblique(voronoi_network(40, seed=3)), 0.02),
    "shear": lambda: past_transition(voronoi_network(24, seed=2), 0.3, np.array([[1.05, 0.1], [0.0, 0.95]])),
    "compression": compressed_lattice,
    "3D": lambda: past_transition(voronoi_3d(), 0.1, np.array([[1.02, 0.03, 0], [0, 1, 0.02], [0.01, 0, 0.99]])),
    "foam": lambda: past_transition(with_random_stiffness(foam_network(60, seed=1), 4)),
    "power law": lambda: past_transition(
        with_random_stiffness(voronoi_network(40, seed=2), 3), 0.02, law=PowerLaw(4.5)
    ),
}


@pytest.mark.parametrize("name", STATES)
def test_increments_of_the_stress_are_those_of_relaxed_states(name):
    state = STATES[name]()
    response = elasticity(state)
    assert response.ok
    assert_increments(state, response)
    found, d = response.value, state.network.dimension
    if d == 2:
        # The worked factor: tr(E² S) = ¼ tr S = ½ dE/dV.
        assert stress_corrected(found)[-1, -1] == pytest.approx(found.shear_stress_corrected, rel=1e-12)
    # Cauchy: affine motion by the Green–Lagrange strain has the symmetry of central forces.
    index, tensor = found.components.index, affine_stress_corrected(found)
    assert tensor[index("xx"), index("yy")] == pytest.approx(tensor[index("xy"), index("xy")], rel=1e-12)


@pytest.mark.parametrize("name", ["2D", "2D, random stiffness", "3D"])
def test_all_tensors_agree_at_the_transition(name):
    found = elasticity(critical_of(UNPINNED[name](), 5)).value
    assert voigt(found)[0] == pytest.approx(found.bulk, rel=1e-12)
    np.testing.assert_array_equal(stress_corrected(found), found.tensor)
    # Every uniaxial stress excites a soft direction, and a stress of both signs would be needed for auxetic response.
    assert found.young(np.eye(found.dimension)[0]) == 0.0


def averages(network, units, gamma=None):
    """Of a network at its transition, or past it."""
    springs = critical_of(network) if gamma is None else equilibrium(strained(network, gamma), "newton", 1e-14).value
    value, d = elasticity(springs).value, network.dimension
    return {
        "stiffness" if d == 2 else "pressure": (*voigt(value), value.young(np.eye(d)[0])),
        "softness" if d == 2 else "compliance": (compliance(value),),
    }


NETWORK, SPACE = NETWORKS["voronoi, random stiffness"], lambda: with_random_stiffness(voronoi_3d(), 1)
test_averages_in_other_units = same_in_units(
    {
        "transition": (averages, NETWORK),
        "transition in space": (averages, SPACE),
        **{f"strain {gamma}": (partial(averages, gamma=gamma), NETWORK) for gamma in (0.1, 1e-4, 1e-9)},
        "under stress in space": (partial(averages, gamma=0.1), SPACE),
    }
)
