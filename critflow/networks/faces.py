"""The faces of a planar network, from its embedding."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Faces:
    """The polygons of a planar network, each a closed walk along its edges with the face on the left.

    Face f walks `edges[starts[f]:starts[f + 1]]` in turn; `signs` is +1 where an edge is walked from tail to head.
    """

    edges: IntArray
    signs: IntArray
    starts: IntArray

    @property
    def n_faces(self) -> int:
        return len(self.starts) - 1

    @property
    def sizes(self) -> IntArray:
        """Number of sides of each face, (n_faces,)."""
        return np.diff(self.starts)


class PlanarFaces(Faces):
    """The faces of a planar network from its embedding, computed at their first use by `planar_faces`."""

    def __init__(self, edges: IntArray, bond_vectors: Array, n_vertices: int):
        self.__dict__["_embedding"] = edges, bond_vectors, n_vertices

    def __getattr__(self, name: str) -> Any:
        if name in ("edges", "signs", "starts"):
            self.__dict__.update(vars(planar_faces(*self._embedding)))
            return self.__dict__[name]
        raise AttributeError(name)


def planar_faces(edges: IntArray, bond_vectors: Array, n_vertices: int) -> Faces:
    """The faces of a planar network from its embedding: bond vectors (N_b, 2) that do not cross.

    Walking an edge and taking the sharpest left turn at each vertex goes once around a face counterclockwise.
    """
    n_edges = len(edges)
    # Half-edge 2α leaves the tail of edge α, half-edge 2α + 1 leaves its head.
    origin = edges.ravel()
    direction = np.repeat(bond_vectors, 2, axis=0) * np.tile([1.0, -1.0], n_edges)[:, None]
    order = np.lexsort((np.arctan2(direction[:, 1], direction[:, 0]), origin))
    degree = np.bincount(origin, minlength=n_vertices)
    first = np.cumsum(degree) - degree
    place = np.empty(2 * n_edges, int)
    place[order] = np.arange(2 * n_edges)
    twin = np.arange(2 * n_edges) ^ 1
    # Arriving along a half-edge, the next one of the face is clockwise before its twin.
    vertex = origin[twin]
    following = order[first[vertex] + (place[twin] - first[vertex] - 1) % degree[vertex]]

    cycle = connected_components(
        sp.coo_array((np.ones(2 * n_edges), (np.arange(2 * n_edges), following))), directed=False
    )[1]
    size = np.bincount(cycle)
    # The least half-edge of each face, since the last of several assignments stands.
    walker = np.empty(len(size), int)
    walker[cycle[::-1]] = np.arange(2 * n_edges)[::-1]
    starts = np.concatenate([[0], np.cumsum(size)])
    walk = np.empty(2 * n_edges, int)
    for k in range(int(size.max())):
        inside = size > k
        walk[starts[:-1][inside] + k] = walker[inside]
        walker = following[walker]
    return Faces(walk // 2, 1 - 2 * (walk % 2), starts)
