"""Fits of moduli past the transition: B = B_0 + C_B γ and G = G_0 + C_G γ to first order (`ModulusStrainScaling`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import checked
from critflow.result import InputError, Record


@dataclass(frozen=True)
class Fit(Record):
    """A least-squares polynomial in strain: value and slope at the transition with their standard errors."""

    value: float
    slope: float
    value_error: float
    slope_error: float


@checked
def fit_stiffening(strains: ArrayLike, moduli: ArrayLike, window: float = np.inf, degree: int = 1) -> Fit:
    """Least-squares polynomial of a modulus over 0 ≤ γ ≤ window; its slope at γ = 0 is C with a standard error.

    A straight line over a window w has a bias of order w, a parabola of order w².  Raises `InputError` where fewer
    points than degree + 2 lie in the window, whose standard error would be undefined, or they do not differ.

    >>> import critflow as cf
    >>> fit = cf.fit_stiffening([0.001, 0.002, 0.003, 0.004], [0.301, 0.302, 0.303, 0.304])
    >>> round(fit.slope, 6)
    1.0
    """
    gamma, values = np.asarray(strains, dtype=float), np.asarray(moduli, dtype=float)
    if gamma.ndim != 1 or gamma.shape != values.shape:
        raise InputError(
            f"strains and moduli must be lists of one length, not of shapes {gamma.shape} and {values.shape}"
        )
    if degree < 1:
        raise InputError(f"the degree of a fit is a whole number of at least 1, not {degree}: 0 has no slope")
    inside = (gamma >= 0) & (gamma <= window * (1 + 1e-12))
    gamma, values = gamma[inside], values[inside]
    if len(gamma) < degree + 2:
        raise InputError(
            f"a fit of degree {degree} needs {degree + 2} strains in its window, not {len(gamma)}: widen it"
        )
    scale = float(gamma.max())
    # Scaled strains are well conditioned.
    design = np.vander(gamma / scale, degree + 1, increasing=True) if scale else np.ones((len(gamma), 1))
    coefficients, _, rank, _ = np.linalg.lstsq(design, np.where(np.isfinite(values), values, 0.0), rcond=None)
    if rank <= degree:
        raise InputError(f"a fit of degree {degree} needs {degree + 1} different strains in its window: spread them")
    if not np.isfinite(values).all():
        return Fit(np.nan, np.nan, np.nan, np.nan)
    residual = values - design @ coefficients
    variance = float(residual @ residual) / (len(gamma) - degree - 1)
    error = np.sqrt(variance) * np.linalg.norm(np.linalg.inv(np.linalg.qr(design, mode="r")), axis=1)
    return Fit(float(coefficients[0]), float(coefficients[1]) / scale, float(error[0]), float(error[1]) / scale)
