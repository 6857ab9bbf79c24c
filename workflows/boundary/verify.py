"""Recomputation of the boundary term and of the sheared configurations from the stored arrays."""

from __future__ import annotations

import numpy as np

from ..shared.verification import contradictions, forces


def verify(ds):
    """A line for each network whose bond vectors, force balance or sheared boundary contradict its arrays."""
    return contradictions(ds, ("seed",), _checks)


def _checks(one):
    tail, head = one.edges.values.T
    b, x, sigma = one.boundary_vectors.values, one.coordinates.values, one.sigma.values
    L = x[head] - x[tail] + b
    incidence = np.zeros(one.incidence.shape)
    np.add.at(incidence, (np.arange(len(head)), head), 1)
    np.add.at(incidence, (np.arange(len(tail)), tail), -1)
    yield "incidence", (incidence == one.incidence.values).all()
    yield "sigma", np.isclose(np.sum(sigma**2), len(sigma), rtol=1e-10)
    yield "boundary_vectors", np.allclose(b, one.offsets.values @ one.cell.values, rtol=0, atol=1e-12)
    yield "bond_vectors", np.allclose(L, one.bond_vectors, rtol=0, atol=1e-12)
    yield "force balance", np.abs(forces(one, L)).max() <= 1e-11 * np.abs(sigma[:, None] * L).mean()
    for shear in one.shear.values:
        F = np.array([[1.0, shear], [0.0, 1.0]])
        sheared = one.sheared_bond_vectors.sel(shear=shear)
        yield f"sheared_cell at {shear:g}", np.allclose(one.cell.values @ F.T, one.sheared_cell.sel(shear=shear))
        yield f"sheared_bond_vectors at {shear:g}", np.allclose(L @ F.T, sheared, rtol=0, atol=1e-10)
