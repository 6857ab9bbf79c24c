"""Chart, metric and curvature against finite differences, dense formulas and the closed form of the linkage."""

import mpmath as mp
import numpy as np
import pytest
import scipy.linalg
from derivatives import assert_derivative
from problems import random_stress
from refusals import refused

from critflow import CriticalManifold, Network, SolveError, Status, three_bar_linkage, voronoi_network
from workflows.three_bar.chart import StereographicChart, dense, principal_curvatures, surface_geometry


def half_squares(manifold, sigma):
    return 0.5 * manifold.configuration(sigma).lengths ** 2


def signed_lengths(sigma, span=3.0):
    """Signed lengths of the linkage on its line: r_α = D (1/σ_α)/Σ(1/σ), negative for reversed edges."""
    return span / sigma / np.sum(1 / sigma)


def linkage_curvature(sigma, span=3.0):
    """K = D/((r₁r₂r₃)³ (Σr⁻²)²) of the level set Σ ±√(2h) = D, from the adjugate of its Hessian."""
    r = signed_lengths(np.asarray(sigma, dtype=float), span)
    return span / (np.prod(r) ** 3 * np.sum(r**-2.0) ** 2)


@pytest.fixture(
    params=[
        ("linkage", three_bar_linkage(), [1.0, 1.0, 1.0], [0.2, -0.3]),
        ("linkage, branch", three_bar_linkage(), [1.0, -2.0, 0.5], [0.1, 0.2]),
        ("voronoi", voronoi_network(8, seed=1), np.ones(12), np.linspace(-0.2, 0.3, 11)),
    ],
    ids=lambda case: case[0],
)
def place(request):
    _, network, pole, s = request.param
    return CriticalManifold(network), StereographicChart.about(pole), np.array(s)


# The chart


def test_the_chart_covers_the_unit_sphere(place):
    _, chart, s = place
    np.testing.assert_allclose(np.linalg.norm(chart.sigma(s)), 1.0, rtol=1e-14)
    np.testing.assert_allclose(chart.sigma(0 * s), chart.pole, rtol=0, atol=1e-15)
    assert_derivative(chart.sigma, lambda u: chart.derivative(s) @ u, s, np.eye(len(s)), 1e-3, 1e-9)


@pytest.mark.parametrize("pole", [[2.0, 1.0, -3.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], np.arange(1.0, 30.0)], ids=str)
def test_the_basis_completes_the_pole(pole):
    chart = StereographicChart.about(pole)
    frame = np.column_stack([chart.pole, dense(chart.basis)])
    np.testing.assert_allclose(frame.T @ frame, np.eye(len(chart.pole)), rtol=0, atol=1e-15)
    np.testing.assert_array_equal(dense(StereographicChart.about(pole).basis), frame[:, 1:])


def test_transposes_are_adjoint(place):
    manifold, chart, s = place
    geometry = surface_geometry(manifold, chart, s)
    for operator in (chart.basis, chart.derivative(s), geometry.tangents):
        np.testing.assert_allclose(
            dense(operator.T), dense(operator).T, rtol=0, atol=1e-13 * np.abs(dense(operator)).max()
        )


def test_coordinates_invert_the_chart(place):
    _, chart, s = place
    np.testing.assert_allclose(chart.coordinates(7.0 * chart.sigma(3 * s)), 3 * s, rtol=0, atol=1e-14)


# Metric and second fundamental form


def test_tangents_and_metric_match_finite_differences(place):
    manifold, chart, s = place
    geometry = surface_geometry(manifold, chart, s)
    tangents, metric = dense(geometry.tangents), dense(geometry.metric)
    scale = np.abs(tangents).max()
    moved = lambda at: half_squares(manifold, chart.sigma(at))  # noqa: E731
    assert_derivative(moved, lambda u: tangents @ u, s, np.eye(len(s)), 1e-4, 1e-7)
    np.testing.assert_allclose(metric, tangents.T @ tangents, rtol=0, atol=1e-12 * scale**2)
    np.testing.assert_allclose(chart.sigma(s) @ tangents, 0.0, rtol=0, atol=1e-12 * scale)


def test_second_fundamental_form_matches_finite_differences(place):
    manifold, chart, s = place
    form, normal = dense(surface_geometry(manifold, chart, s).second_fundamental_form), chart.sigma(s)
    np.testing.assert_allclose(form, form.T, rtol=0, atol=1e-12 * np.abs(form).max())
    # Of the tangents, which are differences of positions above, along the normal.
    slopes = lambda at: normal @ dense(surface_geometry(manifold, chart, at).tangents)  # noqa: E731
    assert_derivative(slopes, lambda u: form @ u, s, np.eye(len(s)), 1e-4, 0.0, 1e-6 * np.abs(form).max())


# Principal curvatures


def radii_in_sixty_digits(network, sigma):
    """Eigenvalues of −|σ|B but the smallest one, that of σ, from the largest."""
    with mp.workdps(60):
        g = mp.matrix(network.free_incidence.toarray().astype(int).tolist())
        b = mp.matrix(network.boundary_vectors.tolist())
        S = mp.diag([mp.mpf(float(s)) for s in sigma])
        inverse = (g.T * S * g) ** -1
        L = b - g * (inverse * (g.T * (S * b)))
        response, size = g * inverse * g.T, mp.norm(mp.matrix([mp.mpf(float(s)) for s in sigma]))
        n, d = network.n_edges, network.dimension
        B = mp.matrix(n, n)
        for i in range(n):
            for j in range(n):
                B[i, j] = size * response[i, j] * mp.fsum(L[i, k] * L[j, k] for k in range(d))
        return sorted(mp.eigsy(B, eigvals_only=True), key=abs)[:0:-1]


def test_principal_curvatures_are_those_of_the_two_forms():
    """In any chart, eigenvalues of the second fundamental form against the metric: here a chart about another point."""
    manifold = CriticalManifold(voronoi_network(30, seed=2))
    n = manifold.network.n_edges
    chart = StereographicChart.about(random_stress(n, 3))
    s = 0.02 * np.random.default_rng(4).standard_normal(n - 1)
    geometry = surface_geometry(manifold, chart, s)
    form = dense(geometry.second_fundamental_form)
    known = scipy.linalg.eigh((form + form.T) / 2, dense(geometry.metric), eigvals_only=True)
    found = principal_curvatures(manifold, chart.sigma(s)).value
    # The metric squares the condition of B, about 1e3 here.
    np.testing.assert_allclose(np.sort(found.curvatures), known, rtol=1e-8)


@pytest.mark.parametrize("sigma", [[1, 1, 1], [0.3, 2, 1], [-0.2, 1, 1], [3, -0.4, 2], [-2, 1, 1], [1, 1, -3]], ids=str)
def test_curvature_of_the_linkage_is_that_of_its_level_set(sigma):
    sigma = np.array(sigma, dtype=float)
    r = signed_lengths(sigma)
    manifold = CriticalManifold(three_bar_linkage())
    # The level set of f = Σ ±√(2h) has gradient 1/r and Hessian −1/r³, on the side that σ points to.
    normal = sigma / np.linalg.norm(sigma)
    plane = np.linalg.svd(normal[None])[2][1:].T
    slope = normal @ (1 / r)
    known = np.linalg.eigvalsh(plane.T @ np.diag(r**-3.0) @ plane / slope)
    found = principal_curvatures(manifold, sigma).value
    np.testing.assert_allclose(np.sort(found.curvatures), np.sort(known), rtol=1e-11)
    np.testing.assert_allclose(np.prod(found.curvatures), linkage_curvature(sigma), rtol=1e-11)
    # Rigid where both curvatures have one sign, which is where P is definite.
    rigid = sigma[0] * sigma[1] + sigma[1] * sigma[2] + sigma[2] * sigma[0] > 0
    assert (linkage_curvature(sigma) > 0) == rigid
    assert found.log_gaussian == pytest.approx(np.log(abs(linkage_curvature(sigma))), abs=1e-11)
    assert np.count_nonzero(found.radii < 0) == (0 if rigid else 1)


@pytest.mark.parametrize("cell", [np.diag([1.0, 1.0]), np.diag([1.0, 10.0]), [[1.0, 0.0], [1.0, 0.1]]])
@pytest.mark.parametrize("compressed", [0, 3])
def test_radii_are_those_of_sixty_digits_within_their_residuals(cell, compressed):
    network = voronoi_network(6, seed=2)
    network = Network(network.edges, network.offsets, np.asarray(cell))
    sigma = random_stress(network.n_edges, 3)
    sigma[:compressed] *= -0.7
    found = principal_curvatures(CriticalManifold(network), sigma).value
    known = radii_in_sixty_digits(network, sigma)
    errors = np.array([float(abs(radius / exact - 1)) for radius, exact in zip(found.radii, known, strict=True)])
    assert (errors <= found.residuals + 1e-14 * abs(found.radii[0] / found.radii)).all()
    log_size = -float(mp.fsum(mp.log(abs(r)) for r in known))
    assert abs(found.log_gaussian - log_size) < errors.sum() + 1e-13 * abs(log_size) < 1e-7


def test_the_flattest_agree_with_all():
    manifold = CriticalManifold(voronoi_network(100, seed=3))
    sigma = random_stress(manifold.network.n_edges, 4)
    every, few = principal_curvatures(manifold, sigma).value, principal_curvatures(manifold, sigma, k=6).value
    np.testing.assert_allclose(few.radii, every.radii[:6], rtol=1e-12)
    overlap = np.abs(np.einsum("ne,ne->n", few.directions, every.directions[:6]))
    np.testing.assert_allclose(overlap, 1.0, rtol=0, atol=1e-9)


# Bad input and singular points


def test_curvature_at_singular_stresses_raises():
    manifold = CriticalManifold(three_bar_linkage())
    # σ₁σ₂ + σ₂σ₃ + σ₃σ₁ = 0 makes P singular; an edge of vanishing stress has the length of all others.
    for sigma, status in (([2, 2, -1], Status.singular), ([1e-10, 1, 1], Status.edge_collapse)):
        found = principal_curvatures(manifold, sigma, throw=False)
        assert found.status is status and np.isnan(found.value.curvatures).all()
        assert found.value.radii.shape == (2,) and found.value.directions.shape == (2, 3)
        with pytest.raises(SolveError, match="move"):
            principal_curvatures(manifold, sigma)


def test_curvatures_are_infinite_with_several_self_stresses():
    """Six edges from one free vertex to pins: four self-stresses, so that B has rank two."""
    angle = np.arange(6) + 0.1 * np.arange(6) ** 2
    pins = {i + 1: [np.cos(a), np.sin(a)] for i, a in enumerate(angle)}
    manifold = CriticalManifold(Network([[0, i + 1] for i in range(6)], pins=pins))
    found = principal_curvatures(manifold, random_stress(6, 1), throw=False)
    assert found.status is Status.stalled and "several self-stresses" in found.note
    flat = principal_curvatures(manifold, random_stress(6, 1), k=2)
    assert flat.ok and flat.value.radii.min() > 0


LINKAGE = CriticalManifold(three_bar_linkage())
CHART = StereographicChart.about(np.ones(3))
BAD = {
    "pole of zero": (lambda: StereographicChart.about(np.zeros(3)), "zero"),
    "many coordinates": (lambda: surface_geometry(LINKAGE, CHART, np.zeros(3)), "coordinate"),
    "coordinate NaN": (lambda: surface_geometry(LINKAGE, CHART, [0.0, np.nan]), "coordinate"),
    "more curvatures than few": (lambda: principal_curvatures(LINKAGE, np.ones(3), k=2), "between"),
    "antipode": (lambda: CHART.coordinates(-2 * CHART.pole), "antipode"),
    "beyond memory": (lambda: dense(StereographicChart.about(np.ones(150_000)).basis), "180 GB"),
}
test_bad_input_raises_one_sentence = refused(BAD)
