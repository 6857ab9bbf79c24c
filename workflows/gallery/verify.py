"""Recomputation of the gallery from its stored arrays."""

from __future__ import annotations

import numpy as np

from ..shared.verification import bond_vectors, contradictions, forces, variances
from .report import ISOGONAL


def verify(ds):
    """A line for each stored configuration that the numbers next to it, or those of its isogonal origin, contradict."""

    def checks(one):
        if np.isfinite(one.residual):
            yield from _checks(one)
            origin = ISOGONAL.get(str(one.panel.values))
            if origin in ds.panel.values:
                yield "directions and tensions", _parallel(one, ds.sel(panel=origin, seed=one.seed))

    return contradictions(ds, ("panel", "seed"), checks)


def _checks(one):
    L, sigma = bond_vectors(one), one.sigma.values
    length, area = np.linalg.norm(L, axis=1), abs(np.linalg.det(one.cell.values))
    tension, work = sigma * length, sigma @ length**2
    yield "force balance", np.abs(forces(one, L)).max() <= 1e-11 * np.abs(tension).mean()
    yield "length", np.allclose(length, one.length, rtol=1e-10, atol=1e-13)
    yield "tension", np.allclose(tension * 2 * area / work, one.tension, rtol=1e-9, atol=1e-12)
    yield "bulk_modulus_0", np.isclose(work**2 / (4 * area * np.sum(tension**2)), one.bulk_modulus_0, rtol=1e-9)
    yield "bulk_modulus_affine", np.isclose(np.sum(length**2) / (4 * area), one.bulk_modulus_affine, rtol=1e-10)
    shear = np.sum(sigma * L[:, 0] * L[:, 1]) ** 2 / (area * np.sum(tension**2))
    yield "shear_modulus_0", np.isclose(shear, one.shear_modulus_0, rtol=1e-6, atol=1e-14)
    yield from variances(one, length, tension)


def _parallel(one, origin):
    unit = [bond_vectors(each) / each.length.values[:, None] for each in (one, origin)]
    tension = [each.tension.values / each.tension.values.mean() for each in (one, origin)]
    return np.allclose(*unit, rtol=0, atol=1e-9) and np.allclose(*tension, rtol=1e-9)
