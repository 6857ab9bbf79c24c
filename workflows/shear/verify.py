"""Recomputation of the recorded ascents from the stored stresses and coordinates, in single precision."""

from __future__ import annotations

import numpy as np

from ..shared.verification import contradictions
from .figures import recorded


def verify(ds):
    """A line for each network whose moduli, lengths, tensions or compressed edges contradict its arrays."""
    return contradictions(recorded(ds), ("seed",), _checks)


def _checks(one):
    tail, head = one.edges.values.T
    sigma, x = one.sigma.values.astype(float), one.coordinates.values.astype(float)
    L = x[:, head] - x[:, tail] + one.offsets.values @ one.cell.values
    square, area = np.sum(L**2, axis=2), abs(np.linalg.det(one.cell.values))
    length, compressed = np.sqrt(square), sigma < 0
    tension, squeezed = sigma * length, np.sum(length * compressed, axis=1)
    modulus = np.sum(sigma * L[..., 0] * L[..., 1], axis=1) ** 2 / np.sum(sigma**2 * square, axis=1) / area
    longest, least = length.max(axis=1) / np.sqrt(area), tension.min(axis=1) / np.abs(tension).max(axis=1)
    # The relative error 1e-7 of single precision grows with the lengths near a singular prestress matrix.
    stored = np.isfinite(one.shear_modulus.values) & (longest < 10)
    yield "shear_modulus", np.allclose(modulus[stored], one.shear_modulus.values[stored], rtol=2e-3)
    yield "longest_edge", np.allclose(longest[stored], one.longest_edge.values[stored], rtol=1e-4)
    yield "least_tension", np.allclose(least[stored], one.least_tension.values[stored], rtol=1e-3, atol=1e-6)
    yield "compressed_edges", (np.sum(compressed, axis=1)[stored] == one.compressed_edges.values[stored]).all()
    yield "compressed_length", np.allclose(squeezed[stored], one.compressed_length.values[stored], rtol=1e-3)
    yield "bound", not (one.shear_modulus.values > float(one.bound) * (1 + 1e-9)).any()
