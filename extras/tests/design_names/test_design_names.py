"""Components, lengths and areas on every kind of network: values, derivatives, extremes, and names that are refused."""

import numpy as np
import pytest
from problems import at, dense_bond_vectors
from quantity_checks import (
    KINDS,
    MANIFOLDS,
    assert_gradients_and_hessian_products,
    assert_no_stress_exceeds_the_extreme_values,
    stress,
)
from refusals import refused
from stiffness_checks import assert_derivatives_by_stiffness

from critflow import Status, lattice, optimize, quantity, upper_bound, voronoi_network
from critflow.quantities import names


def spelled(network):
    """The names of this folder, with an edge and a face."""
    modules = {name: getattr(factory, "module", "") for name, factory in names(network).items()}
    own = [name for name, module in modules.items() if module.startswith("critflow_extras.design_names.")]
    if network.dimension == 3:  # a few of the 21 components of the tensor
        own = [name for name in own if name[:2] != "C_" or name in ("C_xxyy", "C_xzxy")]
    own = [name.replace("EDGE", "3") for name in own if "area" not in name or network.faces is not None]
    return [name.replace("FACE", "2") for name in own]


CASES = [(kind, name) for kind, network in KINDS.items() for name in spelled(network)]


@pytest.mark.parametrize("sign", [1.0, -0.3], ids=["positive", "signed"])
@pytest.mark.parametrize("kind, name", CASES, ids=str)
def test_gradients_and_hessian_products(kind, name, sign):
    assert_gradients_and_hessian_products(MANIFOLDS[kind], quantity(KINDS[kind], name), sign)


@pytest.mark.parametrize("kind, name", CASES, ids=str)
def test_derivatives_by_stiffness(kind, name):
    assert_derivatives_by_stiffness(kind, quantity(KINDS[kind], name))


@pytest.mark.parametrize("kind", KINDS)
def test_values_by_their_formulas(kind):
    network = KINDS[kind]
    sigma = stress(network)
    L = dense_bond_vectors(network, sigma)
    length = np.sqrt(np.sum(L**2, axis=1))
    S = (sigma[:, None] * L).T @ L / np.sqrt(np.sum(sigma**2 * length**2 / network.stiffness))
    volume = abs(np.linalg.det(network.cell))
    expected = {
        "S_xy": S[0, 1],
        "C_xxyy": S[0, 0] * S[1, 1] / volume,
        "C_xyxy": S[0, 1] ** 2 / volume,
        "length[3]": length[3],
    }
    found = {name: quantity(network, name).evaluate(at(network, sigma, L))[0] for name in expected}
    assert found == pytest.approx(expected, rel=1e-11)
    if network.faces is not None:
        critical = MANIFOLDS[kind].configuration(sigma)
        areas = sum(quantity(network, f"area[{f}]").evaluate(critical)[0] for f in range(network.faces.n_faces))
        assert areas == pytest.approx(volume, rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_no_stress_exceeds_the_extreme_values(kind):
    goals = [quantity(KINDS[kind], name) for name in spelled(KINDS[kind])]
    assert_no_stress_exceeds_the_extreme_values(MANIFOLDS[kind], goals)


UNKNOWN = {
    "length[30]": "counted from 0",
    "area[10]": "faces",
    "length[x]": "no quantity is called",
    "S_xz": "S_xx",
}
test_unknown_names_are_one_sentence = refused(
    {name: (lambda name=name: quantity(voronoi_network(20, seed=1), name), word) for name, word in UNKNOWN.items()}
)


def test_extreme_values_of_a_product_of_stresses():
    """C_xxyy = S_xx S_yy/(V D) over the ellipse that the bounds of C_xxxx, C_yyyy and B_0 define."""
    manifold = MANIFOLDS["oblique"]
    xx, yy, bulk = (upper_bound(manifold, name) for name in ("C_xxxx", "C_yyyy", "B_0"))
    half = np.linalg.cholesky([[xx, 2 * bulk - 0.5 * (xx + yy)], [2 * bulk - 0.5 * (xx + yy), yy]])
    angle = np.linspace(0, np.pi, 20001)
    products = np.prod(half @ [np.cos(angle), np.sin(angle)], axis=0)
    low, high = quantity(manifold.network, "C_xxyy").extreme(manifold, False)
    assert (low, high) == pytest.approx((products.min(), products.max()), rel=1e-6)
    assert quantity(manifold.network, "C_xxyy").extreme(manifold, True) == pytest.approx((0.0, high), rel=1e-12)


def test_an_infimum_among_symmetric_stresses_is_left():
    network, random = lattice("honeycomb", 2, 2), np.random.default_rng(0)
    found = optimize(network, "S_xy", throw=False)
    shaken = optimize(network, "S_xy", start=1 + 1e-3 * random.standard_normal(network.n_edges), throw=False)
    assert found.status is shaken.status is Status.edge_collapse
    assert abs(found.objective - shaken.objective) < found.uncertainty + shaken.uncertainty < 2e-3
