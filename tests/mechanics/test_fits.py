"""Fits of moduli against strain."""

import numpy as np
import pytest

from critflow import InputError
from critflow.mechanics.fits import fit_stiffening


def test_fits_recover_polynomials():
    gamma = np.linspace(0.001, 0.01, 10)
    fit = fit_stiffening(gamma, 0.3 - 2 * gamma)
    assert (fit.value, fit.slope) == pytest.approx((0.3, -2.0), rel=1e-12)
    assert fit.slope_error < 1e-12
    curved = 0.3 - 2 * gamma + 50 * gamma**2
    assert fit_stiffening(gamma, curved, degree=2).slope == pytest.approx(-2.0, rel=1e-10)
    # Only the points of the window enter.
    spoiled = np.where(gamma > 0.0051, 1e3, 0.3 - 2 * gamma)
    assert fit_stiffening(gamma, spoiled, window=0.005).slope == pytest.approx(-2.0, rel=1e-10)


def test_standard_errors_are_those_of_numpy():
    rng = np.random.default_rng(1)
    gamma = np.linspace(0.001, 0.01, 12)
    values = 0.3 - 2 * gamma + 1e-3 * rng.standard_normal(12)
    fit = fit_stiffening(gamma, values)
    coefficients, covariance = np.polyfit(gamma, values, 1, cov=True)
    assert (fit.slope, fit.value) == pytest.approx(tuple(coefficients), rel=1e-9)
    errors = tuple(np.sqrt(np.diag(covariance)))
    assert (fit.slope_error, fit.value_error) == pytest.approx(errors, rel=1e-9)


def test_fits_with_too_few_points_raise():
    with pytest.raises(InputError, match="widen"):
        fit_stiffening([0.001, 0.002], [1.0, 1.1])
    with pytest.raises(InputError, match="length"):
        fit_stiffening([0.001, 0.002, 0.003], [1.0, 1.1])
    assert np.isnan(fit_stiffening([0.001, 0.002, 0.003], [1.0, np.nan, 1.1]).slope)
    with pytest.raises(InputError, match="degree"):
        fit_stiffening([0.001, 0.002, 0.003], [1.0, 1.1, 1.2], degree=0)
    for strains in ([0.001] * 4, [0.0] * 4, [0.001, 0.001 * (1 + 1e-16), 0.001 * (1 - 1e-16)]):
        with pytest.raises(InputError, match="different"):
            fit_stiffening(strains, np.ones(len(strains)))
