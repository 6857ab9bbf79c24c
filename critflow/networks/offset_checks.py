"""Image offsets that contradict positions: edges that are longer than the cell though their ends have images nearby."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Part of the edges across the boundary that may be longer than the cell: wrong signs make it about a half.
CONTRADICTING = 0.1
# An edge longer than every diagonal of the cell is doubtful if its nearest image is less than this part of it.
_NEARER = 0.5


class DoubtfulOffsets(NamedTuple):
    """Edges that are longer than every diagonal of the cell and twice as long as with the nearest image of their head.

    edges         their indices
    lengths       with the given offsets, and `nearest` with those of the nearest images
    n_crossing    edges across the boundary of the cell
    contradicted  whether these edges are more than one and more than a tenth of those, so that a convention is wrong;
                  a few long edges may be meant
    """

    edges: NDArray[np.intp]
    lengths: Array
    nearest: Array
    n_crossing: int
    contradicted: bool


def doubtful_offsets(edges: IntArray, offsets: IntArray, cell: Array, positions: Array) -> DoubtfulOffsets:
    """The edges whose offsets the positions contradict, and whether they are too many to be meant.

    The nearest image is the one that a rounding of the coordinates in units of the cell vectors finds.
    """
    # An edge from a vertex to an image of itself has no nearer one.
    crossing = np.flatnonzero(offsets.any(axis=1) & (edges[:, 0] != edges[:, 1]))
    tail, head = edges[crossing].T
    apart = (positions[head] - positions[tail]) @ np.linalg.inv(cell) + offsets[crossing]
    given, nearest = (np.linalg.norm(v @ cell, axis=1) for v in (apart, apart - np.round(apart)))
    corners = np.array(list(product((-1.0, 1.0), repeat=len(cell)))) @ cell
    doubtful = (given > np.linalg.norm(corners, axis=1).max()) & (nearest < _NEARER * given)
    count = int(doubtful.sum())
    return DoubtfulOffsets(
        edges=crossing[doubtful],
        lengths=given[doubtful],
        nearest=nearest[doubtful],
        n_crossing=len(crossing),
        contradicted=count > max(1, CONTRADICTING * len(crossing)),
    )
