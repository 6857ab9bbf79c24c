"""Chart, metric and second fundamental form against finite differences; curvatures in closed form."""

import numpy as np
import pytest
from derivatives import assert_derivative

from critflow import CriticalManifold, Status, three_bar_linkage, voronoi_network
from workflows.three_bar.chart import StereographicChart, surface_geometry

STUDY = "three_bar"


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


def geometry_at(manifold, chart, s):
    return surface_geometry(manifold, manifold.configuration(chart.sigma(s)), chart, s)


def test_the_chart_covers_the_unit_sphere(place):
    _, chart, s = place
    np.testing.assert_allclose(np.linalg.norm(chart.sigma(s)), 1.0, rtol=1e-14)
    np.testing.assert_allclose(chart.sigma(0 * s), chart.pole, rtol=0, atol=1e-15)
    np.testing.assert_allclose(chart.coordinates(7.0 * chart.sigma(3 * s)), 3 * s, rtol=0, atol=1e-14)
    assert_derivative(chart.sigma, lambda u: chart.derivative(s) @ u, s, np.eye(len(s)), 1e-3, 1e-9)


@pytest.mark.parametrize("pole", [[2.0, 1.0, -3.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], np.arange(1.0, 30.0)], ids=str)
def test_the_basis_completes_the_pole(pole):
    chart = StereographicChart.about(pole)
    frame = np.column_stack([chart.pole, chart.basis])
    np.testing.assert_allclose(frame.T @ frame, np.eye(len(chart.pole)), rtol=0, atol=1e-15)


def test_tangents_and_metric_match_finite_differences(place):
    manifold, chart, s = place
    tangents, metric, _ = geometry_at(manifold, chart, s)
    scale = np.abs(tangents).max()
    moved = lambda at: 0.5 * manifold.configuration(chart.sigma(at)).lengths ** 2  # noqa: E731
    assert_derivative(moved, lambda u: tangents @ u, s, np.eye(len(s)), 1e-4, 1e-7)
    np.testing.assert_allclose(metric, tangents.T @ tangents, rtol=0, atol=1e-12 * scale**2)
    np.testing.assert_allclose(chart.sigma(s) @ tangents, 0.0, rtol=0, atol=1e-12 * scale)


def test_second_fundamental_form_matches_finite_differences(place):
    manifold, chart, s = place
    form, normal = geometry_at(manifold, chart, s)[2], chart.sigma(s)
    np.testing.assert_allclose(form, form.T, rtol=0, atol=1e-12 * np.abs(form).max())
    # Of the tangents, which are differences of positions above, along the normal.
    slopes = lambda at: normal @ geometry_at(manifold, chart, at)[0]  # noqa: E731
    assert_derivative(slopes, lambda u: form @ u, s, np.eye(len(s)), 1e-4, 0.0, 1e-6 * np.abs(form).max())


def test_stored_curvatures_are_those_of_the_level_set_of_lengths(dataset):
    """The signed lengths r ∝ 1/σ add up to the span: a level set of Σ ±√(2h), with gradient 1/r and Hessian −1/r³."""
    known = dataset.outcome.values == Status.ok
    for normal, curvatures in zip(dataset.normal.values[known], dataset.principal_curvature.values[known], strict=True):
        r = 2.0 / normal / np.sum(1 / normal)
        plane = np.linalg.svd(normal[None])[2][1:].T
        radii = 1 / np.linalg.eigvalsh(plane.T @ np.diag(r**-3.0) @ plane / (normal @ (1 / r)))
        np.testing.assert_allclose(1 / curvatures, radii, rtol=1e-9, atol=1e-13 * np.abs(radii).max())
