"""The physics of an ensemble recomputed from its stored arrays, by formulas of its own."""

from __future__ import annotations

import json

import numpy as np

from critflow import Status

from ..shared.measurements import fitted
from ..shared.verification import told

# Relative force balance that edges as short as a thousandth of the mean allow in stored coordinates.
BALANCED = 1e-11


def verify(ds):
    """A line for each stored configuration that its own numbers contradict."""
    parameters = json.loads(ds.attrs["parameters"])
    return told(ds, ("population", "seed"), lambda one: _checks(one, parameters))


def _checks(one, parameters):
    if not np.isfinite(one.residual):  # no configuration was found
        return
    tail, head = one.edges.values.T
    x, sigma, cell = one.coordinates.values, one.sigma.values, one.cell.values
    L = x[head] - x[tail] + one.offsets.values @ cell
    length, volume = np.linalg.norm(L, axis=1), abs(np.linalg.det(cell))
    tension, force = sigma * length, np.zeros_like(x)
    np.add.at(force, head, sigma[:, None] * L)
    np.add.at(force, tail, -sigma[:, None] * L)
    cost = np.sum(tension**2)
    yield "force balance", np.abs(force).max() <= BALANCED * np.abs(tension).mean()
    yield "residual", np.isclose(np.abs(force).max() / tension.mean(), one.residual, rtol=1e-3, atol=BALANCED)
    yield "tension everywhere", int(one.status) != Status.ok or sigma.min() > 0
    yield "length", np.allclose(length, one.length, rtol=1e-10, atol=1e-13)
    yield "sigma", np.isclose(np.sum(sigma**2), len(sigma), rtol=1e-10)
    yield (
        "bulk_modulus_0",
        np.isclose(np.sum(sigma * length**2) ** 2 / (len(cell) ** 2 * volume * cost), one.bulk_modulus_0, rtol=1e-9),
    )
    shear = np.sum(sigma * L[:, 0] * L[:, 1]) ** 2 / (volume * cost)
    yield "shear_modulus_0", np.isclose(shear, one.shear_modulus_0, rtol=1e-6, atol=1e-14)
    for name, values in (("length_variance", length), ("tension_variance", tension)):
        yield name, np.isclose(np.var(values) / np.mean(values) ** 2, one[name], rtol=1e-8, atol=1e-20)
    yield (
        "stressed_fraction",
        np.isclose(np.mean(sigma > 1e-9 * np.abs(sigma).mean()), one.stressed_fraction, rtol=1e-12),
    )
    yield "energy along the path", not (np.diff(one.energy.values) < 0).any()
    for modulus, slope in (("bulk_modulus", "C_B"), ("shear_modulus", "C_G")):
        line = fitted(one.strain.values, one[modulus].values, parameters["fit_window"])
        if np.isfinite(one[slope]):
            yield slope, np.allclose(line, (one[slope], one[f"{slope}_error"]), rtol=1e-9)
