"""Networks under loads: known answers, reactions, errors, and the pull-back."""

import mpmath as mp
import numpy as np
import pytest
import scipy.fft
from derivatives import assert_derivative
from loaded_nets import catenary, net, rope
from refusals import refused

from critflow import CriticalManifold, Status, elasticity, stiffening, strain_path, voronoi_network
from critflow_extras import draw, loaded, weak_forces
from critflow_extras.loads.loaded import LoadedManifold
from critflow_extras.sensitivities.gradients import pull_backs

PLANE = voronoi_network(20, seed=1)
DOWN = (0.0, 0.0, -0.3)


def parabola():
    """y = −w i(n − i)/2σ under w on each vertex, at equal σ."""
    i = np.arange(13.0)
    return loaded(rope(12, 12), np.full(12, 0.7), (0.0, -0.2)), np.column_stack([i, -0.2 * i * (12 - i) / 1.4])


def hung_mass():
    """T = W/(2 sin a) in two equal edges at the slope a."""
    a, weight = 0.3, 5.0
    sigma = weight / (2 * np.sin(a)) * np.cos(a) * np.ones(2)  # tension over length, at a half span of 1
    return loaded(rope(2, 2), sigma, [[0, 0], [0, -weight], [0, 0]]), np.array([[0, 0], [1, -np.tan(a)], [2, 0]])


def hypar():
    """z = xy/n between straight borders, and sines for the load: eigenvectors of the Laplacian of the net."""
    n, sigma, w = 8, 1.7, 0.4
    network, x = net(n, lambda x, y: x * y / n)
    j, k = np.meshgrid(*2 * [np.pi * np.arange(1, n) / n], indexing="ij")
    waves = scipy.fft.dstn(np.full((n - 1, n - 1), -w), type=1)
    sag = scipy.fft.idstn(waves / (sigma * (4 - 2 * np.cos(j) - 2 * np.cos(k))), type=1)
    x = x.copy()
    x[network.free, 2] += sag.ravel()
    return loaded(network, np.full(network.n_edges, sigma), (0, 0, -w)), x


def own_weight():
    """2σy = w√(a² + y²) of two edges of half span a that weigh w for each unit of their length."""
    sigma, w = 1.3, 2.0
    return loaded(rope(2, 2), [sigma] * 2, weight=(0, -w)), [[0, 0], [1, -w / np.sqrt(4 * sigma**2 - w**2)], [2, 0]]


@pytest.mark.parametrize("case", [parabola, hung_mass, hypar, own_weight])
def test_known_answers(case):
    found, x = case()
    assert found.status is Status.ok
    np.testing.assert_allclose(found.value.coordinates, x, rtol=0, atol=1e-13)
    assert found.value.residual < 1e-14 and found.negative_pivots == 0


def test_tension_of_a_hung_mass():
    assert hung_mass()[0].value.tensions == pytest.approx(5 / (2 * np.sin(0.3)), rel=1e-14)


@pytest.mark.parametrize("k", [3.0, 100.0, 1e5])
def test_extensible_catenary(k):
    sigma, x = catenary(20, 14, k, 0.1)
    found = loaded(rope(20, 14, k), sigma, weight=(0, -0.1), lengths=np.ones(20))
    assert found.status is Status.ok
    np.testing.assert_allclose(found.value.coordinates, x, rtol=0, atol=1e-12)
    assert found.value.lengths * (1 - sigma / k) == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("options", [{}, {"weight": DOWN}, {"weight": DOWN, "lengths": np.ones(112)}], ids=len)
def test_reactions_sum_to_the_loads(options):
    network, rng = net(8, lambda x, y: x * y / 8)[0], np.random.default_rng(1)
    forces = rng.standard_normal((network.n_vertices, 3))  # also on pins
    found = loaded(network, 1 + rng.random(network.n_edges), forces, **options)
    value = found.value
    assert found.status is Status.ok and not value.reactions[network.free].any()
    np.testing.assert_allclose(value.reactions.sum(axis=0), -value.loads.sum(axis=0), rtol=0, atol=1e-12)
    weights = 0.0 if not options else DOWN[2] * options.get("lengths", value.lengths).sum()
    assert value.loads.sum(axis=0)[2] == pytest.approx(forces.sum(axis=0)[2] + weights, rel=1e-13)


def test_the_scale_of_the_stress_counts():
    network, forces = net(4)[0], (0, 0, -1.0)
    sigma = 1 + np.random.default_rng(0).random(network.n_edges)
    sag = [loaded(network, scale * sigma, forces).value.coordinates[:, 2].min() for scale in (1.0, 2.0)]
    assert sag[0] == pytest.approx(2 * sag[1], rel=1e-13)
    # Twice the scale in both, and the hanging net turned over: compression.
    hanging, twice, standing = (loaded(network, c * sigma, (0, 0, f)) for c, f in ((1, -1), (2, -2), (-1, -1)))
    np.testing.assert_allclose(twice.value.coordinates, hanging.value.coordinates, rtol=0, atol=1e-14)
    np.testing.assert_allclose(standing.value.coordinates[:, 2], -hanging.value.coordinates[:, 2], rtol=0, atol=1e-14)
    assert standing.negative_pivots == len(network.free)


def test_without_loads_it_is_the_critical_configuration():
    sigma = np.exp(0.3 * np.random.default_rng(1).standard_normal(30))
    plain = CriticalManifold(PLANE).configuration(sigma)
    assert np.array_equal(loaded(PLANE, sigma, (0, 0)).value.coordinates, plain.coordinates)


def exact_coordinates(network, sigma, forces, weight):
    """The configuration in 40 digits, by iteration of the weights."""
    g = mp.matrix(network.free_incidence.toarray().astype(int).tolist())
    matrix = lambda rows: mp.matrix([[mp.mpf(float(v)) for v in row] for row in rows])  # noqa: E731
    S, b, w = mp.diag([mp.mpf(float(s)) for s in sigma]), matrix(network.boundary_vectors), matrix(weight)
    ends = abs(network.incidence).toarray()[:, network.free].T
    half, f = matrix(ends / 2), matrix(forces[network.free])
    right = f - g.T * S * b
    inverse = (g.T * S * g) ** -1
    x = inverse * right
    for _ in range(150):
        L = g * x + b
        length = [mp.sqrt(sum(L[e, a] ** 2 for a in range(L.cols))) for e in range(L.rows)]
        x = inverse * (right + half * mp.diag(length) * w)
    return x


@pytest.mark.parametrize(("own", "size"), [(0.0, 1.0), (0.3, 1.0), (1e-4, 1e6)])
@pytest.mark.parametrize("seed", range(2))
def test_error_estimate_holds_against_forty_digits(seed, own, size):
    network, rng = net(3, lambda x, y: 0.1 * x * y)[0], np.random.default_rng(seed)
    sigma, m = np.exp(0.5 * rng.standard_normal(network.n_edges)), network.n_edges
    forces, weight = size * rng.standard_normal((network.n_vertices, 3)), own * rng.standard_normal((m, 3))
    value = loaded(network, sigma, forces, weight if own else None).value
    with mp.workdps(40):
        exact = np.array(exact_coordinates(network, sigma, forces, weight).tolist())
        error = float(np.abs(exact - value.coordinates[network.free]).max())
    assert 0 < error <= value.error_bound < 1e-12 * size


@pytest.mark.parametrize("own", [0.0, 0.3])
def test_pull_back_is_the_gradient_by_force_density(own):
    network, rng = net(3, lambda x, y: 0.1 * x * y)[0], np.random.default_rng(3)
    m, forces = network.n_edges, rng.standard_normal((network.n_vertices, 3))
    manifold = LoadedManifold(CriticalManifold(network), forces, own * rng.standard_normal((m, 3)) if own else None)
    sigma, weights = 1 + rng.random(m), rng.standard_normal((2, m, 3))
    rows = pull_backs(manifold.balance(sigma), [(0 * sigma, one) for one in weights])
    values = lambda sigma: np.einsum("nad,ad->n", weights, manifold.balance(sigma).bond_vectors)  # noqa: E731
    assert_derivative(values, lambda u: rows @ u, sigma, [rng.standard_normal(m)], 1e-3, 1e-8)


def test_weights_without_balance_have_a_status():
    found = loaded(rope(2, 2), [0.9, 0.9], weight=(0, -2.0), throw=False)  # needs 2σ > w
    assert found.status is Status.not_reached and "raise sigma" in found.note
    assert np.isnan(found.value.coordinates).all() and np.isnan(found.value.error_bound)


@pytest.mark.parametrize("weight", [None, (0, -0.1)])
def test_no_stress_on_a_part_has_no_configuration(weight):
    found = loaded(rope(4, 4), [1, 0, 0, 1], (0, -1.0), weight, throw=False)
    assert found.status is Status.singular and np.isnan(found.value.coordinates).all()


def test_a_loaded_network_is_drawn():
    axes = draw(parabola()[0])
    assert len(axes.collections) > 0


VALUE = loaded(PLANE, np.ones(30), np.zeros((20, 2))).value
BAD = {
    "elasticity": (lambda: elasticity(VALUE), "carries loads"),
    "stiffening": (lambda: stiffening(VALUE), "carries loads"),
    "path": (lambda: strain_path(VALUE, [0.01]), "carries loads"),
    "weak forces": (lambda: weak_forces(VALUE, None), "carries loads"),
    "no load": (lambda: loaded(PLANE, np.ones(30)), "no load"),
    "sum": (lambda: loaded(PLANE, np.ones(30), (0, 1.0)), "sum to zero"),
    "weight without pins": (lambda: loaded(PLANE, np.ones(30), weight=(0, 1.0)), "sum to zero"),
    "lengths": (lambda: loaded(rope(2, 2), [1, 1], (0, 1.0), lengths=[1, 1]), "give weight"),
    "shape": (lambda: loaded(rope(2, 2), [1, 1], (0, 0, 1.0)), "forces must have shape"),
    "not finite": (lambda: loaded(rope(2, 2), [1, 1], weight=(0, np.nan)), "weight must be finite"),
    "no stress": (lambda: loaded(rope(2, 2), [0, 0], (0, 1.0)), "zero on every edge"),
    "no balance": (lambda: loaded(rope(2, 2), [0.9, 0.9], weight=(0, 2.0)), "no balance"),
}
test_bad_input_raises_one_sentence = refused(BAD)
