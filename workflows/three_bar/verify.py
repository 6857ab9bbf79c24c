"""Recomputation of the geometry of the three-bar linkage from its stored arrays."""

from __future__ import annotations

import numpy as np

from critflow import Status

from ..shared.verification import contradictions


def verify(ds):
    """A line for each grid whose tensions differ in a row, or whose normal or metric contradicts the tangents."""
    return contradictions(ds, ("grid",), _checks)


def _checks(one):
    good = one.outcome.values == Status.ok
    tension = np.abs(one.sigma.values * one.length.values)[good]
    largest = np.abs(one.sigma.values[good]).max(axis=1) * one.length.values[good].max(axis=1)
    normal, tangents = one.normal.values[good], one.tangents.values[good]
    size = np.abs(tangents).max(axis=(1, 2))
    metric = np.einsum("nec,ned->ncd", tangents, tangents)
    yield "tension", (np.ptp(tension, axis=1) <= 1e-11 * largest).all()
    yield "normal", (np.abs(np.einsum("ne,nec->nc", normal, tangents)).max(axis=1) <= 1e-11 * size).all()
    yield "metric", (np.abs(metric - one.metric.values[good]).max(axis=(1, 2)) <= 1e-11 * size**2).all()
