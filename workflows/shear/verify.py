"""Recomputation of the recorded ascents from the stored stresses and coordinates, in single precision."""

from __future__ import annotations

import numpy as np

from ..shared.verification import contradictions
from .figures import recorded


def verify(ds):
    """A line for each network whose moduli, longest edges or compressed edges contradict its arrays."""
    return contradictions(recorded(ds), ("seed",), _checks)


def _checks(one):
    tail, head = one.edges.values.T
    sigma, x = one.sigma.values.astype(float), one.coordinates.values.astype(float)
    L = x[:, head] - x[:, tail] + one.offsets.values @ one.cell.values
    square, area = np.sum(L**2, axis=2), abs(np.linalg.det(one.cell.values))
    modulus = np.sum(sigma * L[..., 0] * L[..., 1], axis=1) ** 2 / np.sum(sigma**2 * square, axis=1) / area
    longest = np.sqrt(square.max(axis=1) / area)
    # The relative error 1e-7 of single precision grows with the lengths near a singular prestress matrix.
    stored = np.isfinite(one.shear_modulus.values) & (longest < 10)
    yield "shear_modulus", np.allclose(modulus[stored], one.shear_modulus.values[stored], rtol=2e-3)
    yield "longest_edge", np.allclose(longest[stored], one.longest_edge.values[stored], rtol=1e-4)
    yield "compressed_edges", (np.sum(sigma < 0, axis=1)[stored] == one.compressed_edges.values[stored]).all()
    yield "bound", not (one.shear_modulus.values > float(one.bound) * (1 + 1e-9)).any()
