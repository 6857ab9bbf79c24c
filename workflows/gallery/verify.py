"""Recomputation of the gallery from its stored arrays."""

from __future__ import annotations

import numpy as np

from ..shared.verification import bond_vectors, configuration, contradictions
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
    length, area = one.length.values, abs(np.linalg.det(one.cell.values))
    tension = one.sigma.values * length
    yield from configuration(one)
    yield "tension", np.allclose(tension * 2 * area / np.sum(tension * length), one.tension, rtol=1e-9, atol=1e-12)
    yield "bulk_modulus_affine", np.isclose(np.sum(length**2) / (4 * area), one.bulk_modulus_affine, rtol=1e-10)


def _parallel(one, origin):
    unit = [bond_vectors(each) / each.length.values[:, None] for each in (one, origin)]
    tension = [each.tension.values / each.tension.values.mean() for each in (one, origin)]
    return np.allclose(*unit, rtol=0, atol=1e-9) and np.allclose(*tension, rtol=1e-9)
