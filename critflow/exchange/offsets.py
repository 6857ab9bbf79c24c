"""Image offsets of edges: from bond vectors, or by the nearest image where it is unambiguous, and their consistency."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from critflow.exchange.data import Array, IntArray, NetworkData, counted
from critflow.networks.checks import doubtful_offsets
from critflow.result import InputError

# Edges longer than this part of the least height of the cell have a second image at most 1.5 times as long.
_UNAMBIGUOUS = 0.4
# Bond vectors and positions agree with whole offsets to this part of a cell vector.
_WHOLE = 0.05
# An offset is reversed where the opposite one shortens the edge to less than this part.
_NEARER = 0.5
# Where so large a part of the edges across the boundary has opposite offsets, these point from head to tail.
_REVERSED = 0.5


def with_offsets(data: NetworkData, nearest: bool = False) -> NetworkData:
    """The data with an image offset for each edge.

    nearest  accept the nearest image of edges that are long compared with the cell

    Raises `InputError` where bond vectors do not fit the cell, or where the nearest image is ambiguous.
    """
    if data.cell is None:
        return replace(data, offsets=None, bond_vectors=None)
    tail, head = data.edges.T
    difference = data.positions[head] - data.positions[tail]
    if data.bond_vectors is not None:
        return _from_bond_vectors(data, data.bond_vectors - difference)
    images = _nearest(difference, data.cell)
    length = np.linalg.norm(difference + images @ data.cell, axis=1)
    if data.offsets is not None:
        return _consistent(data, np.linalg.norm(difference + data.offsets @ data.cell, axis=1), images, length)
    # Least distance between opposite faces of the cell.
    height = float(1 / np.linalg.norm(np.linalg.inv(data.cell), axis=0).max())
    unclear = np.flatnonzero(length > _UNAMBIGUOUS * height)
    if len(unclear) and not (nearest or data.nearest_images):
        i, j = data.edges[unclear[0]]
        raise InputError(
            f"{counted(len(unclear), 'edge', 'is')} longer than {_UNAMBIGUOUS} of the height of the cell, so the image "
            f"is ambiguous (vertices {data.name(i)} and {data.name(j)}): give offsets or bond_vectors, or nearest=True"
        )
    part = length.max() / height
    note = f"image offsets are those of nearest images; the longest edge is {part:.2f} of the height of the cell"
    return replace(data, offsets=images).noting(note)


def _from_bond_vectors(data: NetworkData, shifts: Array) -> NetworkData:
    """Offsets from the differences (N_b, d) of bond vectors and positions."""
    exact = shifts @ np.linalg.inv(np.asarray(data.cell))
    offsets = np.round(exact).astype(np.int64)
    off = np.flatnonzero(np.abs(exact - offsets).max(axis=1) > _WHOLE)
    if len(off):
        raise InputError(
            f"the bond vectors of {counted(len(off), 'edge')} differ from the positions by no whole number of cell "
            f"vectors, edge {off[0]} first: check cell and units"
        )
    return replace(data, offsets=offsets, bond_vectors=None)


def _consistent(data: NetworkData, length: Array, images: IntArray, shortest: Array) -> NetworkData:
    """Given offsets; where a convention is wrong, with the sign reversed on edges that are thereby nearest images.

    length    (N_b,) with the given offsets, and `shortest` with those of the nearest images

    A few edges that are longer than the cell may be meant: they stay, with a sentence.
    """
    assert data.cell is not None and data.offsets is not None
    doubtful, n_crossing, contradicted = doubtful_offsets(data.edges, data.offsets, data.cell, data.positions)
    reverse = (data.offsets == -images).all(axis=1) & (shortest < _NEARER * length)
    if not contradicted and reverse.sum() <= max(1, _REVERSED * n_crossing):
        if not len(doubtful):
            return data
        edge = doubtful[0]
        i, j = (data.name(int(vertex)) for vertex in data.edges[edge])
        return data.noting(
            f"{counted(len(doubtful), 'edge', 'is')} longer than the cell, between vertices {i} and {j} first: "
            f"{length[edge]:.3g}, the nearest image {shortest[edge]:.3g}; the offsets were kept as given"
        )
    wrong = doubtful[~reverse[doubtful]]
    if len(wrong):
        raise InputError(
            f"the offsets of {counted(len(wrong), 'edge')} contradict the positions: edge {wrong[0]} has the length "
            f"{length[wrong[0]]:.3g}, its nearest image {shortest[wrong[0]]:.3g}: correct them, or leave them out"
        )
    turned = replace(data, offsets=np.where(reverse[:, None], images, data.offsets))
    return turned.repairing(
        f"the offsets of {counted(int(reverse.sum()), 'edge')} pointed from head to tail; their sign was reversed"
    )


def _nearest(difference: Array, cell: Array) -> IntArray:
    """Offsets of the nearest images, among the neighbours of the rounded ones (cells may be oblique)."""
    base = -np.round(difference @ np.linalg.inv(cell)).astype(np.int64)
    best, length = base, np.linalg.norm(difference + base @ cell, axis=1)
    for step in np.ndindex(*(3,) * len(cell)):
        trial = base + np.array(step) - 1
        size = np.linalg.norm(difference + trial @ cell, axis=1)
        shorter = size < length * (1 - 1e-12)
        best, length = np.where(shorter[:, None], trial, best), np.where(shorter, size, length)
    return best
