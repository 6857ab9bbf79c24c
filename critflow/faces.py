"""The faces of a planar network, from its embedding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import Array, IntArray, finite_rows, floats, integers, of_kind
from critflow.checks import check_ends, components
from critflow.result import NetworkError, Record

# Numbers of full turns are whole up to the rounding of a sum of angles.
_ROUNDING = 1e-6
_NO_POLYGONS = (
    "the edges do not bound polygons: some of them cross, or a face winds around the cell; give an embedding without "
    "crossings"
)


@dataclass(frozen=True, eq=False, repr=False)
class Faces(Record):
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

    def mirrored(self) -> Faces:
        """The same faces in a mirror: walked the other way, since it turns left into right."""
        back = np.repeat(self.starts[:-1] + self.starts[1:] - 1, self.sizes) - np.arange(len(self.edges))
        return Faces(self.edges[back], -self.signs[back], self.starts)


class PlanarFaces(Faces):
    """The faces of a planar network from its embedding, computed at their first use by `planar_faces`."""

    def __init__(self, edges: IntArray, bond_vectors: Array, n_vertices: int):
        self.__dict__["_embedding"] = edges, bond_vectors, n_vertices

    def __getattr__(self, name: str) -> IntArray:
        """A field that is not known yet."""
        if name not in ("edges", "signs", "starts"):
            raise AttributeError(name)
        self.__dict__ |= vars(planar_faces(*self.__dict__["_embedding"]))
        value: IntArray = self.__dict__[name]
        return value


def planar_faces(edges: ArrayLike, bond_vectors: ArrayLike, n_vertices: int) -> Faces:
    """The faces of a planar network from its embedding: bond vectors (N_b, 2) that do not cross.

    Walking an edge and taking the sharpest left turn at each vertex goes once around a face counterclockwise, and
    clockwise around the outside of a network that is not periodic, which is no face.  Raises `NetworkError` where the
    walks are no polygons because edges cross or have no length, or because a face winds around the cell.

    >>> import critflow as cf
    >>> from critflow.faces import planar_faces
    >>> network = cf.lattice("honeycomb", 2, 2)
    >>> planar_faces(network.edges, network.bond_vectors(network.positions), 8).sizes
    array([6, 6, 6, 6])
    """
    of_kind(np.ndarray, edges=edges, bond_vectors=bond_vectors)
    n_vertices = of_kind(int, n_vertices=n_vertices)
    edges, n_edges = integers(edges, "edges"), len(np.atleast_1d(edges))
    bond_vectors = finite_rows(floats(bond_vectors, "bond_vectors"), "bond_vectors", (n_edges, 2))
    if edges.shape != (n_edges, 2) or n_edges == 0:
        raise NetworkError(f"edges must have shape (N_b, 2), not {edges.shape}: give tail and head of each")
    check_ends(edges, n_vertices)
    if (no_length := np.flatnonzero(~bond_vectors.any(axis=1))).size:
        raise NetworkError(f"edge {no_length[0]} has no length, and so no direction: move its ends apart")
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

    cycle = components(np.column_stack([np.arange(2 * n_edges), following]), 2 * n_edges)
    turns = _turns(direction, following, cycle)
    _check_polygons(edges, turns, n_vertices)
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
    inner = turns > 0
    kept = np.repeat(inner, size)
    walk, starts = walk[kept], np.concatenate([[0], np.cumsum(size[inner])])
    _check_simple(direction[walk], starts)
    return Faces(walk // 2, 1 - 2 * (walk % 2), starts)


def _turns(direction: Array, following: IntArray, cycle: IntArray) -> Array:
    """Number of full counterclockwise turns of each walk: 1 around a polygon, −1 around the outside."""
    after = direction[following]
    cross = direction[:, 0] * after[:, 1] - direction[:, 1] * after[:, 0]
    angle = np.arctan2(cross, np.einsum("ad,ad->a", direction, after))
    # At the end of a dangling edge the walk turns back clockwise.
    angle[following == np.arange(len(following)) ^ 1] = -np.pi
    return np.asarray(np.bincount(cycle, angle) / (2 * np.pi))


def _check_polygons(edges: IntArray, turns: Array, n_vertices: int) -> None:
    """Raise `NetworkError` unless the walks are polygons that tile a torus, or the plane with one outside a part."""
    used = np.bincount(edges.ravel(), minlength=n_vertices) > 0
    n_parts = len(np.unique(components(edges, n_vertices)[used]))
    n_outer = int(np.sum(np.abs(turns + 1) < _ROUNDING))
    # Euler's formula: N_v − N_b + N_f is 0 on a torus and 2 on a sphere, whose outside is one of the faces.
    characteristic = int(used.sum()) - len(edges) + len(turns)
    polygons = bool((np.abs(np.abs(turns) - 1) < _ROUNDING).all())
    if not polygons or (n_outer, characteristic) not in ((0, 0), (n_parts, 2 * n_parts)):
        raise NetworkError(_NO_POLYGONS)


def _check_simple(sides: Array, starts: IntArray) -> None:
    """Raise `NetworkError` if two sides of one polygon cross; without such crossings polygons that turn once tile."""
    size = np.repeat(np.diff(starts), np.diff(starts))
    start = np.repeat(starts[:-1], np.diff(starts))
    place = np.arange(len(sides)) - start
    end = np.cumsum(sides, axis=0)
    end -= (end - sides)[start]
    begin = end - sides
    for apart in range(2, int(size.max(initial=0)) // 2 + 1):
        i = np.flatnonzero(size >= 2 * apart)
        j = start[i] + (place[i] + apart) % size[i]
        a, b, c, d = begin[i], end[i], begin[j], end[j]
        if ((_side_of(a, b, c) * _side_of(a, b, d) < 0) & (_side_of(c, d, a) * _side_of(c, d, b) < 0)).any():
            raise NetworkError(_NO_POLYGONS)


def _side_of(a: Array, b: Array, p: Array) -> Array:
    """1 for points p (n, 2) to the left of the lines from a to b, −1 to their right, 0 on them up to rounding."""
    u, v = b - a, p - a
    area, scale = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], np.sum(u**2 + v**2, axis=1)
    return np.asarray(np.sign(area) * (np.abs(area) > _ROUNDING**2 * scale))
