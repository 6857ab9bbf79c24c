"""Strains of a network as given, along a path that starts from its onset of rigidity: F(γ_total) = F(γ) F(γ_c)."""

from __future__ import annotations

import numpy as np

from critflow.deformation import Deformation
from critflow.networks import Array
from critflow_extras.cables.onset_end import CriticalStrain

# Distance of two gradients, relative to their size, below which they are the same, and the most steps to its strain.
_SAME_GRADIENT, _MOST_STEPS = 1e-10, 50


def total_strains(onset: CriticalStrain, path: Deformation, gamma: Array) -> Array:
    """Total strains (n,) of strains γ (n,) that count from the onset; NaN where the deformation has none."""
    F = onset.deformation_gradient
    return np.array([strain_of(path, path.gradient(one) @ F, onset.strain + one) for one in gamma.tolist()])


def strain_of(path: Deformation, gradient: Array, near: float) -> float:
    """The strain γ at which the path has a gradient G (d, d), but for free components; NaN if it has it nowhere.

    near  a strain from which Newton's method starts

    G F(γ)⁻¹ − 1 is zero, or a sum Σ q E of free components.
    """
    strain, E = near, path.free_strains.reshape(len(path.free), path.dimension**2)
    across = np.eye(path.dimension**2) - np.linalg.pinv(E) @ E
    for _ in range(_MOST_STEPS):
        F = path.matrix(strain, 0)
        if not np.linalg.det(F) > 0:
            return np.nan
        quotient = gradient @ np.linalg.inv(F)
        left = across @ (quotient - np.eye(path.dimension)).ravel()
        along = across @ (quotient @ path.rate(strain) @ np.linalg.inv(F)).ravel()
        step = float(left @ along) / (float(along @ along) or 1.0)
        if abs(step) <= 1e-15 * (1 + abs(strain)):
            break
        strain += step
    return strain if np.abs(left).max() <= _SAME_GRADIENT else np.nan
