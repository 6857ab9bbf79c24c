"""Error bounds of the values that a design achieves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.objectives import Objective
from critflow.linalg.tolerances import EPS
from critflow.mechanics.stiffening_objective import Growth, StiffeningCoefficient
from critflow.networks.network import Array


def error_bounds(manifold: CriticalManifold, objectives: Sequence[Objective], critical: CriticalConfiguration) -> Array:
    """Error bounds (estimate) of values (n,): derivatives by the bond vectors times their errors, and rounding."""
    sigma, L = critical.sigma, critical.bond_vectors
    found, volume = np.empty(len(objectives)), manifold.network.volume
    for n, objective in enumerate(objectives):
        value, (by_sigma, by_L) = objective.evaluate(sigma, L)
        size = np.linalg.norm(by_L, axis=1)
        rounding = 4 * EPS * float(np.sum(np.abs(by_sigma * sigma)) + size @ critical.lengths + abs(value))
        found[n] = float(size @ critical.bond_errors) + rounding
        if isinstance(objective, StiffeningCoefficient):
            found[n] += Growth(manifold, sigma, L).energy.third_error[int(objective.of_shear)] / volume
    return found
