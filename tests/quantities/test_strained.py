"""Gradients at finite strain against differences in 60 digits and in floating point, refusals, and use as objective."""

import numpy as np
import pytest
from derivatives import first_derivative
from problems import square_octagon

from critflow import (
    CriticalManifold,
    Deformation,
    Hookean,
    InputError,
    PowerLaw,
    SpringLaw,
    WormLike,
    delaunay_network,
    equilibrium,
    optimize,
    spring_state,
    strain_path,
    three_bar_linkage,
    voronoi_network,
)
from critflow.quantities.strained import StrainedQuantity, strained_response
from critflow.springs.laws import Hookean as _Base
from workflows.benchmarks import reference
from workflows.benchmarks.high_precision import MP, numbers

STRAIN = 0.0625
QUANTITIES = (
    *("bulk_modulus", "shear_modulus", "shear_modulus_stress_corrected", "youngs_modulus", "poissons_ratio"),
    *("S_xx", "S_xy", "C_xxxy"),
)


def stress_and_springs():
    """A network whose stresses and stiffnesses are sums of few powers of two, so that their steps are exact."""
    rng = np.random.default_rng(2)
    network = square_octagon()
    network = network.with_stiffness(1 + rng.integers(0, 8, network.n_edges) / 8)
    return network, 1 + rng.integers(0, 8, network.n_edges) / 8


def exact_moduli(network, rest, gradient, start):
    """B, G and G − ½dE/dV in 60 digits."""
    strained = network.deformed(gradient)
    found = reference.equilibrium(strained, rest, start)
    return np.array([MP.mpf(value) for value in reference.linear_response(strained, found.bond_vectors, rest)])


def test_gradients_agree_with_differences_in_sixty_digits():
    network, sigma = stress_and_springs()
    F = np.diag([1 + STRAIN, 1.0])
    names = QUANTITIES[:3]
    critical = CriticalManifold(network).configuration(sigma)
    found = strained_response(network, critical, STRAIN, names, deformation="uniaxial")
    x, rest, step = found.value.coordinates, numbers(critical.lengths), 2.0**-20
    edge = 3
    unit = np.eye(network.n_edges)[edge]

    def of_rest(h, unit=unit):
        return exact_moduli(network, rest + MP.mpf(h) * numbers(unit), F, x)

    def of_stiffness(h, unit=unit):
        return exact_moduli(network.with_stiffness(network.stiffness + h * unit), rest, F, x)

    def of_stress(h, unit=unit):
        L = reference.configuration(network, sigma + h * unit).bond_vectors
        return exact_moduli(network, reference.lengths(L), F, x)

    scaled = np.linalg.norm(critical.sigma) / np.linalg.norm(sigma)
    for rows, function, unit_of in (
        (found.by_rest_length, of_rest, 1.0),
        (found.by_stiffness, of_stiffness, 1.0),
        (found.by_stress, of_stress, scaled),
    ):
        exact = np.array([float(value) for value in (function(step) - function(-step)) / (2 * step)])
        given = np.array([rows[name][edge] for name in names]) * unit_of
        np.testing.assert_allclose(given, exact, rtol=1e-9, atol=1e-11)


SIDES = {
    "fixed": Deformation.simple_shear(2),
    "free": Deformation.uniaxial(2, sides="free"),
    "free, sheared": Deformation.uniaxial(2, sides="free").freeing("yy", "xy"),
}


@pytest.mark.parametrize(
    ("law", "sides"), [(Hookean(), "fixed"), (WormLike(0.8), "free"), (PowerLaw(4), "free, sheared")], ids=str
)
def test_gradients_of_every_quantity_agree_with_differences(law, sides):
    rng = np.random.default_rng(3)
    network = delaunay_network(8, seed=1)
    rest = np.linalg.norm(network.bond_vectors(network.positions), axis=1) * rng.uniform(0.95, 1.05, network.n_edges)
    direction = rng.normal(size=network.n_edges)
    start = equilibrium(spring_state(network, rest, network.positions, law)).value
    names = (*QUANTITIES, "modulus") if sides == "fixed" else QUANTITIES

    def response(h):
        springs = network.with_stiffness(network.stiffness * np.exp(2 * h * direction[::-1]))
        state = equilibrium(spring_state(springs, rest * np.exp(h * direction), start.coordinates, law)).value
        return strained_response(springs, state, 0.01, names, deformation=SIDES[sides])

    found = response(0.0)
    scaled = rest * direction, 2 * network.stiffness * direction[::-1]
    given = [found.by_rest_length[name] @ scaled[0] + found.by_stiffness[name] @ scaled[1] for name in names]
    values = lambda h: np.array(list(response(h).achieved.values()))  # noqa: E731
    np.testing.assert_allclose(given, first_derivative(values), rtol=2e-8, atol=1e-9)


def test_values_are_those_of_the_path_and_rigid_networks_have_the_sign_of_their_response():
    network = voronoi_network(16, seed=1)
    critical = CriticalManifold(network).configuration(np.ones(24))
    found = strained_response(network, critical, 0.02, ("bulk_modulus", "modulus", "poissons_ratio", "S_yy"))
    path = strain_path(critical, [0.02]).value
    tensor = path.elasticity[0]
    assert found.achieved == pytest.approx(
        {
            "bulk_modulus": path.bulk_modulus[0],
            "modulus": path.modulus[0],
            "poissons_ratio": tensor.poisson([1, 0], [0, 1]),
            "S_yy": path.stress[0, 1, 1],
        },
        rel=1e-10,
    )
    # Longer rest lengths lower the stress.
    assert found.by_rest_length["S_yy"].sum() < 0


def test_a_modulus_at_finite_strain_is_an_objective():
    manifold = CriticalManifold(voronoi_network(16, seed=1))
    objective = StrainedQuantity("shear_modulus", 0.05, maximise=True)
    best = optimize(manifold, objective, "lbfgs", max_steps=4, throw=False)
    start = objective.evaluate(manifold.balance(np.ones(24)))[0]
    assert best.objective > 1.005 * start


class Offset(_Base):
    """A law whose additional stiffness refers to a fixed length, so that it is not homogeneous."""

    def tension(self, extension, rest, k):
        return k * extension + k * extension**3

    def energy(self, extension, rest, k):
        return k * (extension**2 / 2 + extension**4 / 4)

    def stiffness(self, extension, rest, k):
        return k + 3 * k * extension**2

    def stiffening(self, extension, rest, k):
        return 6 * k * extension


def test_bad_input_raises_one_sentence():
    network = voronoi_network(16, seed=1)
    critical = CriticalManifold(network).configuration(np.ones(24))
    linkage = three_bar_linkage()
    pinned = CriticalManifold(linkage).configuration(np.ones(3))
    assert issubclass(Offset, SpringLaw)
    for arguments, options, word in (
        ((network, critical, 0.1, ["bulk"]), {}, "bulk"),
        ((network, critical, 0.1, []), {}, "quantities"),
        ((network, critical, 0.0), {}, "stiffening"),
        ((network, critical, 0.1), {"law": Offset()}, "homogeneous"),
        ((network, critical, 0.1, ["modulus"]), {"deformation": SIDES["free"]}, "modulus"),
        ((linkage, pinned, 0.1), {}, "pins"),
    ):
        with pytest.raises(InputError, match=word):
            strained_response(*arguments, **options)
    assert strained_response(network, critical, -0.01, throw=False).achieved == {}
