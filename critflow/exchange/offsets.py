"""Image offsets of edges: from bond vectors, or by the nearest image where it is unambiguous, and their consistency."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from critflow.exchange.data import Array, IntArray, NetworkData, counted
from critflow.networks.offset_checks import doubtful_offsets
from critflow.result import InputError

# Edges longer than this part of the least height of the cell have a second image at most 1.5 times as long.
_UNAMBIGUOUS = 0.4
# Bond vectors and positions agree with whole offsets to this part of a cell vector.
_WHOLE = 0.05
# An offset is reversed where the opposite one shortens the edge to less than this part.
_NEARER = 0.5
# Where so large a part of the edges across the boundary has opposite offsets, these point from head to tail.
_REVERSED = 0.5


def least_height(cell: Array) -> float:
    """Least distance between opposite faces of a cell (d, d)."""
    return float(1 / np.linalg.norm(np.linalg.inv(cell), axis=0).max())


def with_offsets(data: NetworkData, nearest: bool = False) -> NetworkData:
    """The data with an image offset for each edge.

    nearest  accept the nearest image of edges that are long compared with the cell

    Raises `InputError` where bond vectors do not fit the cell, or where the nearest image is ambiguous.
    """
    if data.cell is None:
        return replace(data, offsets=None, bond_vectors=None)
    tail, head = data.edges.T
    difference = data.positions[head] - data.positions[tail]
    inverse = np.asarray(np.linalg.inv(data.cell), dtype=float)
    if data.bond_vectors is not None:
        return _from_bond_vectors(data, difference, inverse)
    if data.offsets is not None:
        return _consistent(data, difference, inverse)
    offsets = _nearest(difference, data.cell, inverse)
    length = np.linalg.norm(difference + offsets @ data.cell, axis=1)
    limit = _UNAMBIGUOUS * least_height(data.cell)
    unclear = np.flatnonzero(length > limit)
    if len(unclear) and not (nearest or data.nearest_images):
        i, j = data.edges[unclear[0]]
        raise InputError(
            f"{counted(len(unclear), 'edge', 'is')} longer than {_UNAMBIGUOUS} of the height of the cell, so the image "
            f"is ambiguous (vertices {data.name(i)} and {data.name(j)}): give offsets or bond_vectors, or nearest=True"
        )
    part = length.max() / least_height(data.cell)
    note = f"image offsets are those of nearest images; the longest edge is {part:.2f} of the height of the cell"
    return replace(data, offsets=offsets).noting(note)


def _from_bond_vectors(data: NetworkData, difference: Array, inverse: Array) -> NetworkData:
    assert data.bond_vectors is not None
    exact = (data.bond_vectors - difference) @ inverse
    offsets = np.round(exact).astype(np.int64)
    off = np.flatnonzero(np.abs(exact - offsets).max(axis=1) > _WHOLE)
    if len(off):
        raise InputError(
            f"the bond vectors of {counted(len(off), 'edge')} differ from the positions by no whole number of cell "
            f"vectors, edge {off[0]} first: check cell and units"
        )
    return replace(data, offsets=offsets, bond_vectors=None)


def _consistent(data: NetworkData, difference: Array, inverse: Array) -> NetworkData:
    """Given offsets; where a convention is wrong, with the sign reversed on edges that are thereby nearest images.

    A few edges that are longer than the cell may be meant: they stay, with a sentence.
    """
    assert data.cell is not None and data.offsets is not None
    given = np.asarray(data.offsets)
    doubtful = doubtful_offsets(data.edges, given, data.cell, data.positions)
    nearest = _nearest(difference, data.cell, inverse)
    opposite = (given == -nearest).all(axis=1)
    shorter = opposite & (
        np.linalg.norm(difference + nearest @ data.cell, axis=1)
        < _NEARER * np.linalg.norm(difference + given @ data.cell, axis=1)
    )
    if not doubtful.contradicted and shorter.sum() <= max(1, _REVERSED * doubtful.n_crossing):
        if not len(doubtful.edges):
            return data
        i, j = (data.name(int(vertex)) for vertex in data.edges[doubtful.edges[0]])
        return data.noting(
            f"{counted(len(doubtful.edges), 'edge', 'is')} longer than the cell, between vertices {i} and {j} first: "
            f"{doubtful.lengths[0]:.3g}, the nearest image {doubtful.nearest[0]:.3g}; the offsets were kept as given"
        )
    wrong = np.flatnonzero(~shorter[doubtful.edges])
    if len(wrong):
        k = int(wrong[0])
        raise InputError(
            f"the offsets of {counted(len(wrong), 'edge')} contradict the positions: edge {doubtful.edges[k]} is "
            f"{doubtful.lengths[k]:.3g} long and its nearest image {doubtful.nearest[k]:.3g}: correct them, or leave "
            "them out"
        )
    offsets = np.where(shorter[:, None], nearest, given)
    note = f"the offsets of {counted(int(shorter.sum()), 'edge')} pointed from head to tail; their sign was reversed"
    return replace(data, offsets=offsets).repairing(note)


def _nearest(difference: Array, cell: Array, inverse: Array) -> IntArray:
    """Offsets of the nearest images, among the neighbours of the rounded ones (cells may be oblique)."""
    base = -np.round(difference @ inverse).astype(np.int64)
    best, length = base, np.linalg.norm(difference + base @ cell, axis=1)
    for step in np.ndindex(*(3,) * len(cell)):
        trial = base + np.array(step) - 1
        size = np.linalg.norm(difference + trial @ cell, axis=1)
        shorter = size < length * (1 - 1e-12)
        best, length = np.where(shorter[:, None], trial, best), np.where(shorter, size, length)
    return best


def wrapped(data: NetworkData) -> NetworkData:
    """Positions inside the cell, with the offsets that this changes."""
    if data.cell is None or data.offsets is None:
        return data
    fraction = data.positions @ np.linalg.inv(data.cell)
    image = np.floor(fraction).astype(np.int64)
    tail, head = data.edges.T
    positions = data.positions - image @ data.cell
    return replace(data, positions=positions, offsets=data.offsets + image[head] - image[tail])
