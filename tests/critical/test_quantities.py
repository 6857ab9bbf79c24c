"""Every quantity on every kind of network: values, gradients, Hessian products, derivatives by k, errors, extremes."""

import numpy as np
import pytest
from derivatives import assert_derivative
from problems import (
    HONEYCOMB_BULK_MODULUS,
    NETWORKS,
    PERIODIC_KINDS,
    at,
    dense_bond_vectors,
    modulus_by_formula,
    random_stress,
)
from refusals import refused

from critflow import (
    CriticalManifold,
    InputError,
    Quantity,
    lattice,
    optimize,
    properties,
    quantity,
    stiffening,
    upper_bound,
    voronoi_network,
)
from critflow.extensions import quantities
from critflow.quantities import (
    PenalisedModulus,
    TransitionModulus,
    evaluate,
    has_exact_hessian,
    pure_shear,
    require_exact_hessian,
    takes_complex_steps,
    transition_modulus,
)
from critflow.quantity_names import ALIASES, names

KINDS = {name: make() for name, make in PERIODIC_KINDS.items()}
MANIFOLDS = {name: CriticalManifold(network) for name, network in KINDS.items()}


def spelled(network):
    """The names of all quantities of the scene, with an edge and a face."""
    stems = {name.partition("[")[0] for name in quantities()}
    listed = [name.replace("EDGE", "3") for name in names(network) if name.partition("[")[0] not in stems]
    listed = [name for name in listed if "uniaxial_free" not in name]
    if network.dimension == 3:  # a few of the 21 components of the tensor
        listed = [name for name in listed if name[:2] != "C_" or name in ("C_B", "C_G", "C_xxyy", "C_xzxy")]
    return [name.replace("FACE", "2") for name in listed if "area" not in name or network.faces is not None]


CASES = [(kind, name) for kind, network in KINDS.items() for name in spelled(network)]
PENALISED = PenalisedModulus(TransitionModulus(pure_shear(2), "G_0"), 0.2)


def of(kind, name):
    return PENALISED if name == "penalised" else quantity(KINDS[kind], name)


def stress(network, sign=1.0):
    sigma = random_stress(network.n_edges, 5)
    sigma[::6] *= sign
    return sigma


@pytest.mark.parametrize("sign", [1.0, -0.3], ids=["positive", "signed"])
@pytest.mark.parametrize("kind, name", [*CASES, ("oblique", "penalised")], ids=str)
def test_gradients_and_hessian_products(kind, name, sign):
    manifold, goal = MANIFOLDS[kind], of(kind, name)
    sigma, rng = stress(manifold.network, sign), np.random.default_rng(6)
    directions = 0.1 * rng.standard_normal((2, len(sigma)))
    here = evaluate(manifold, goal, sigma)
    scale = float(np.abs(here.gradient).max())
    size = 1e-8 * scale + 1e-12 * abs(here.value)
    assert_derivative(lambda s: evaluate(manifold, goal, s).value, here.gradient, sigma, directions, 1e-3, 1e-7, size)
    if goal.analytic:
        assert takes_complex_steps(manifold, goal)
        gradient = lambda s: evaluate(manifold, goal, s).gradient  # noqa: E731
        product = here.hessian_product(directions[0])
        np.testing.assert_allclose(1e-100 * here.hessian_product(1e100 * directions[0]), product, rtol=1e-9, atol=size)
        assert_derivative(gradient, here.hessian_product, sigma, directions, 1e-3, 1e-6, 1e-6 * scale)
    else:
        u, v = directions
        assert not has_exact_hessian(manifold, goal)
        Hu, Hv = here.hessian_difference(u), here.hessian_difference(v)
        assert u @ Hv == pytest.approx(v @ Hu, rel=1e-5, abs=1e-6 * np.linalg.norm(Hu) * np.linalg.norm(v))
    # No quantity depends on the scale of σ: H σ = −∇O.
    assert abs(here.gradient @ sigma) < 1e-11 * scale * len(sigma)
    assert evaluate(manifold, goal, 7 * sigma).value == pytest.approx(here.value, rel=1e-10, abs=1e-13)


@pytest.mark.parametrize("kind, name", CASES, ids=str)
def test_derivatives_by_stiffness(kind, name):
    network, goal = KINDS[kind], of(kind, name)
    sigma = stress(network)
    L = MANIFOLDS[kind].balance(sigma).bond_vectors
    direction = np.random.default_rng(7).standard_normal(network.n_edges)

    def value(k):
        return goal.evaluate(at(network.with_stiffness(k), sigma, L))[0]

    found = goal.by_stiffness(at(network, sigma, L))
    assert_derivative(value, found, network.stiffness, [direction], 1e-3, 1e-7, 1e-9 * np.abs(found).max() + 1e-12)
    if kind != "oblique":
        return
    # Without a formula of its own, by differences.
    general = Quantity.by_stiffness(goal, at(network, sigma, L))
    np.testing.assert_allclose(general, found, rtol=1e-6, atol=1e-8 * np.abs(found).max() + 1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_values_by_their_formulas(kind):
    network = KINDS[kind]
    d, sigma = network.dimension, stress(network)
    L = dense_bond_vectors(network, sigma)
    length = np.sqrt(np.sum(L**2, axis=1))
    cost = np.sum(sigma**2 * length**2 / network.stiffness)
    S = (sigma[:, None] * L).T @ L / np.sqrt(cost)
    tension, volume = sigma * length, abs(np.linalg.det(network.cell))
    A = np.zeros((d, d))
    A[0, 1], A[1, 0] = 0.7, 0.3
    expected = {
        "V_L": np.mean(length**2) / np.mean(length) ** 2 - 1,
        "V_tau": np.mean(tension**2) / np.mean(tension) ** 2 - 1,
        "B_0": modulus_by_formula(network, sigma, L, np.eye(d) / d),
        "G_0": modulus_by_formula(network, sigma, L, A),
        "modulus[uniaxial]": modulus_by_formula(network, sigma, L, np.diag([1.0, *[0.0] * (d - 1)])),
        "S_xy": S[0, 1],
        "C_xxyy": S[0, 0] * S[1, 1] / volume,
        "C_xyxy": S[0, 1] ** 2 / volume,
        "length[3]": length[3],
    }
    found = {name: quantity(network, name).evaluate(at(network, sigma, L))[0] for name in expected}
    assert found == pytest.approx(expected, rel=1e-11)
    exact = stiffening(MANIFOLDS[kind].configuration(sigma)).value
    critical = MANIFOLDS[kind].configuration(sigma)
    assert properties(critical, ["C_B", "C_G"]).values == pytest.approx({"C_B": exact.C_B, "C_G": exact.C_G}, rel=1e-11)
    if network.faces is not None:
        areas = sum(quantity(network, f"area[{f}]").evaluate(critical)[0] for f in range(network.faces.n_faces))
        assert areas == pytest.approx(volume, rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_no_stress_exceeds_the_extreme_values(kind):
    manifold, network = MANIFOLDS[kind], KINDS[kind]
    goals = [quantity(network, name) for name in spelled(network)]
    for positive in (True, False):
        limits = [goal.extreme(manifold, positive) for goal in goals]
        for seed in range(20):
            sigma = random_stress(network.n_edges, seed)
            sigma[:: 2 + seed % 5] *= 1.0 if positive else -0.3
            balance = manifold.balance(sigma)
            for goal, (least, most) in zip(goals, limits, strict=True):
                value = goal.evaluate(balance)[0]
                slack = 1e-9 * (1 + abs(value))
                assert least - slack <= value <= most + slack, goal.name


def test_extreme_values_are_attained():
    network = lattice("honeycomb", 3, 4, edge_length=0.7).with_stiffness(2.5)
    assert upper_bound(network, "B_0") == pytest.approx(2.5 * HONEYCOMB_BULK_MODULUS, rel=1e-13)
    network = KINDS["oblique"]
    best = optimize(network, "B_0").value
    assert upper_bound(network, "B_0") == pytest.approx(properties(best, "B_0").values["B_0"], rel=1e-12)
    assert quantity(network, "C_B").extreme(MANIFOLDS["oblique"])[0] == pytest.approx(
        properties(best, "C_B").values["C_B"], rel=1e-9
    )


@pytest.mark.parametrize("name", ["V_L", "V_tau"])
def test_variances_need_no_cell(name):
    network = NETWORKS["pinned grid"]()
    found = evaluate(CriticalManifold(network), quantity(network, name), np.ones(network.n_edges))
    assert found.value > 0 and np.isfinite(found.gradient).all()


def test_names_and_aliases():
    network = voronoi_network(20, seed=1)
    for long, symbol in ALIASES.items():
        assert quantity(network, long).name == quantity(CriticalManifold(network), symbol).name == symbol
    goal = quantity(network, "G_0")
    assert quantity(network, goal) is goal


UNKNOWN = {
    "bulk_modulu": "did you mean 'bulk_modulus'",
    "B_1": "B_0",
    "b_0": "did you mean 'B_0'",
    "colour": "V_tau",
    "length[30]": "counted from 0",
    "area[10]": "faces",
    "modulus[twist]": "modulus",
    "modulus[uniaxial_free]": "free",
    "stiffening[uniaxial_free]": "free components",
}
test_unknown_names_are_one_sentence = refused(
    {name: (lambda name=name: quantity(voronoi_network(20, seed=1), name), word) for name, word in UNKNOWN.items()}
)


def test_bad_quantities_are_refused():
    network = lattice("honeycomb", 2, 2)
    require_exact_hessian(CriticalManifold(network), quantity(network, "B_0"))
    with pytest.raises(InputError, match="C_B has none"):
        require_exact_hessian(CriticalManifold(network), quantity(network, "C_B"))
    with pytest.raises(InputError, match="dimensions"):
        transition_modulus(network, np.eye(3))


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
