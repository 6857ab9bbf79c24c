"""Error bounds of the values that a design achieves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.quantity import Objective
from critflow.linalg.tolerances import EPS
from critflow.networks.network import Array
from critflow.quantities.stiffening import PathStiffeningCoefficient, StiffeningCoefficient


def error_bounds(objectives: Sequence[Objective], critical: CriticalConfiguration) -> Array:
    """Error bounds (estimate) of values (n,): derivatives by the bond vectors times their errors, and rounding."""
    sigma, L = critical.sigma, critical.bond_vectors
    found = np.empty(len(objectives))
    for n, objective in enumerate(objectives):
        value, (by_sigma, by_L) = objective.evaluate(sigma, L)
        size = np.linalg.norm(by_L, axis=1)
        rounding = 4 * EPS * float(np.sum(np.abs(by_sigma * sigma)) + size @ critical.lengths + abs(value))
        found[n] = float(size @ critical.bond_errors) + rounding
        if isinstance(objective, StiffeningCoefficient | PathStiffeningCoefficient):
            found[n] += objective.third_error(sigma, L)
    return found
