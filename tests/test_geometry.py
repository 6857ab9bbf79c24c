"""Chart, metric and curvature against finite differences, and against the closed form of the three-bar linkage."""

import numpy as np
import pytest

from critflow import (
    CriticalManifold,
    InputError,
    StereographicChart,
    surface_geometry,
    three_bar_linkage,
    voronoi_network,
)


def half_squares(manifold, sigma):
    return 0.5 * manifold.configuration(sigma).lengths ** 2


@pytest.fixture(
    params=[
        ("linkage", three_bar_linkage(), [1.0, 1.0, 1.0], [0.2, -0.3]),
        ("voronoi", voronoi_network(8, seed=1), np.ones(12), np.linspace(-0.2, 0.3, 11)),
    ],
    ids=lambda case: case[0],
)
def place(request):
    _, network, pole, s = request.param
    return CriticalManifold(network), StereographicChart.about(pole), np.array(s)


def test_the_chart_covers_the_unit_sphere(place):
    _, chart, s = place
    np.testing.assert_allclose(np.linalg.norm(chart.sigma(s)), 1.0, rtol=1e-14)
    np.testing.assert_allclose(chart.sigma(0 * s), chart.pole, rtol=0, atol=1e-15)
    step = 1e-6
    numeric = [(chart.sigma(s + step * e) - chart.sigma(s - step * e)) / (2 * step) for e in np.eye(len(s))]
    np.testing.assert_allclose(chart.derivative(s), np.transpose(numeric), rtol=0, atol=1e-9)


def test_tangents_and_metric_match_finite_differences(place):
    manifold, chart, s = place
    geometry = surface_geometry(manifold, chart, s)
    step = 1e-5
    numeric = np.transpose(
        [
            (half_squares(manifold, chart.sigma(s + step * e)) - half_squares(manifold, chart.sigma(s - step * e)))
            / (2 * step)
            for e in np.eye(len(s))
        ]
    )
    scale = np.abs(geometry.tangents).max()
    # Central differences of step 1e-5 leave about 1e-10 of curvature and rounding.
    np.testing.assert_allclose(geometry.tangents, numeric, rtol=0, atol=1e-7 * scale)
    np.testing.assert_allclose(geometry.metric, numeric.T @ numeric, rtol=0, atol=1e-6 * scale**2)
    np.testing.assert_allclose(chart.sigma(s) @ geometry.tangents, 0.0, rtol=0, atol=1e-12 * scale)


def test_second_fundamental_form_matches_finite_differences(place):
    manifold, chart, s = place
    geometry, normal, step, n = surface_geometry(manifold, chart, s), chart.sigma(s), 2e-4, len(s)
    numeric = np.empty((n, n))
    for i, a in enumerate(np.eye(n)):
        for j, b in enumerate(np.eye(n)):
            ahead = half_squares(manifold, chart.sigma(s + step * (a + b)))
            aside = half_squares(manifold, chart.sigma(s + step * (a - b)))
            behind = half_squares(manifold, chart.sigma(s - step * (a + b)))
            other = half_squares(manifold, chart.sigma(s - step * (a - b)))
            numeric[i, j] = normal @ (ahead - aside - other + behind) / (4 * step**2)
    form = geometry.second_fundamental_form
    np.testing.assert_allclose(form, form.T, rtol=0, atol=1e-12 * np.abs(form).max())
    np.testing.assert_allclose(form, numeric, rtol=0, atol=1e-4 * np.abs(form).max())


def test_the_linkage_bounds_a_convex_region():
    """On the rigid sheet the lengths √(2h) add up to the span: a level set whose curvatures are known."""
    span = 3.0
    manifold, chart = CriticalManifold(three_bar_linkage(span)), StereographicChart.about(np.ones(3))
    s = np.array([0.15, -0.1])
    h = half_squares(manifold, chart.sigma(s))
    np.testing.assert_allclose(np.sqrt(2 * h).sum(), span, rtol=1e-13)
    # The level set of f = Σ√(2h) curves by Hess f on its tangent plane over |∇f|.
    slope, bend = (2 * h) ** -0.5, -((2 * h) ** -1.5)
    normal = slope / np.linalg.norm(slope)
    plane = np.linalg.svd(normal[None])[2][1:].T
    known = -np.linalg.eigvalsh(plane.T @ np.diag(bend) @ plane) / np.linalg.norm(slope)
    found = surface_geometry(manifold, chart, s).principal_curvatures()
    np.testing.assert_allclose(found, np.sort(known), rtol=1e-9)


def test_bad_charts_are_refused():
    with pytest.raises(InputError, match="must not be zero"):
        StereographicChart.about(np.zeros(3))
    with pytest.raises(InputError, match="one coordinate less than edges"):
        surface_geometry(CriticalManifold(three_bar_linkage()), StereographicChart.about(np.ones(3)), np.zeros(3))
