"""Recomputing physics from stored arrays: the loop of all studies, and the formulas of the smaller ones."""

from __future__ import annotations

from itertools import product

import numpy as np

from critflow import Status


def told(ds, axes, checks):
    """A line for each case whose `checks`, pairs of a name and whether it holds, say that its numbers contradict it."""
    problems = []
    for values in product(*(ds[axis].values for axis in axes)):
        one = ds.sel(dict(zip(axes, values, strict=True)))
        if int(one.status) not in (Status.failed, Status.missing):
            wrong = [name for name, holds in checks(one) if not holds]
            if wrong:
                case = ", ".join(f"{axis} {value}" for axis, value in zip(axes, values, strict=True))
                problems.append(f"{case}: {', '.join(wrong)} does not follow from the arrays")
    return problems


def verify_boundary(ds):
    """Bond vectors from coordinates and boundary, their balance, and the sheared boundary: a line where one fails."""
    return told(ds, ("seed",), _boundary)


def _boundary(one):
    tail, head = one.edges.values.T
    b, x, sigma = one.boundary_vectors.values, one.coordinates.values, one.sigma.values
    L, force = x[head] - x[tail] + b, np.zeros_like(x)
    np.add.at(force, head, sigma[:, None] * L)
    np.add.at(force, tail, -sigma[:, None] * L)
    incidence = np.zeros(one.incidence.shape)
    np.add.at(incidence, (np.arange(len(head)), head), 1)
    np.add.at(incidence, (np.arange(len(tail)), tail), -1)
    yield "incidence", (incidence == one.incidence.values).all()
    yield "sigma", np.isclose(np.sum(sigma**2), len(sigma), rtol=1e-10)
    yield "boundary_vectors", np.allclose(b, one.offsets.values @ one.cell.values, rtol=0, atol=1e-12)
    yield "bond_vectors", np.allclose(L, one.bond_vectors, rtol=0, atol=1e-12)
    yield "force balance", np.abs(force).max() <= 1e-11 * np.abs(sigma[:, None] * L).mean()
    for shear in one.shear.values:
        F = np.array([[1.0, shear], [0.0, 1.0]])
        sheared = one.sheared_bond_vectors.sel(shear=shear)
        yield f"sheared_cell at {shear:g}", np.allclose(one.cell.values @ F.T, one.sheared_cell.sel(shear=shear))
        yield f"sheared_bond_vectors at {shear:g}", np.allclose(L @ F.T, sheared, rtol=0, atol=1e-10)


def verify_three_bar(ds):
    """Equal tensions along the row, the normal, and the metric of the tangents: a line where one fails."""
    return told(ds, ("grid",), _three_bar)


def _three_bar(one):
    good = one.outcome.values == 0
    tension = np.abs(one.sigma.values * one.length.values)[good]
    largest = np.abs(one.sigma.values[good]).max(axis=1) * one.length.values[good].max(axis=1)
    normal, tangents = one.normal.values[good], one.tangents.values[good]
    size = np.abs(tangents).max(axis=(1, 2))
    metric = np.einsum("nec,ned->ncd", tangents, tangents)
    yield "tension", (np.ptp(tension, axis=1) <= 1e-11 * largest).all()
    yield "normal", (np.abs(np.einsum("ne,nec->nc", normal, tangents)).max(axis=1) <= 1e-11 * size).all()
    yield "metric", (np.abs(metric - one.metric.values[good]).max(axis=(1, 2)) <= 1e-11 * size**2).all()


def verify_ascent(ds):
    """Moduli, longest edges and compressed edges from the stored stresses and coordinates, in single precision."""
    return told(ds, ("seed",), _ascent)


def _ascent(one):
    tail, head = one.edges.values.T
    sigma, x = one.sigma.values.astype(float), one.coordinates.values.astype(float)
    L = x[:, head] - x[:, tail] + one.offsets.values @ one.cell.values
    square, area = np.sum(L**2, axis=2), abs(np.linalg.det(one.cell.values))
    modulus = np.sum(sigma * L[..., 0] * L[..., 1], axis=1) ** 2 / np.sum(sigma**2 * square, axis=1) / area
    longest = np.sqrt(square.max(axis=1) / area)
    # Single precision leaves 1e-7 of lengths, which grow to many box sides near a singular prestress matrix.
    stored = np.isfinite(one.shear_modulus.values) & (longest < 10)
    yield "shear_modulus", np.allclose(modulus[stored], one.shear_modulus.values[stored], rtol=2e-3)
    yield "longest_edge", np.allclose(longest[stored], one.longest_edge.values[stored], rtol=1e-4)
    yield "compressed_edges", (np.sum(sigma < 0, axis=1)[stored] == one.compressed_edges.values[stored]).all()
    yield "bound", not (one.shear_modulus.values > float(one.bound) * (1 + 1e-9)).any()
