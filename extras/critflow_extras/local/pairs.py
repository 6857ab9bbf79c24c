"""Pairs of vertices that no edge joins, each with the image of its head, and the vector between them; single vertices.

The vector of a pair is that of a path of edges, r = Σ ±(L_α − m_α C) + n C with the images m of the edges and n of the
pair and the cell C (rows), so that its derivative by the bond vectors is ±1 on the path.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import combinations, product
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order

from critflow.arguments import floats, is_number, shown
from critflow.manifold import CriticalManifold
from critflow.networks import Array, IntArray, Network
from critflow.points import short_cell
from critflow.result import InputError

_WRITTEN = re.compile(r"(\d+)-(\d+)((?::[+-]?\d+)*)")
_AXIS = re.compile(r"(\d+)([xyz])")
_SPELLING = "write a pair as 3-20, or 3-20:1:0 for vertex 20 in the next cell along the first vector"


@dataclass(frozen=True)
class Pair:
    """Two vertices, tail and head, and the cell of the head (d,) relative to that of the tail."""

    tail: int
    head: int
    image: tuple[int, ...]

    def __str__(self) -> str:
        return f"{self.tail}-{self.head}" + "".join(f":{n}" for n in self.image if any(self.image))

    @property
    def reversed(self) -> Pair:
        """The same pair from its head."""
        return Pair(self.head, self.tail, tuple(-n for n in self.image))

    def pull(self, network: Network, direction: Array) -> Array:
        """Unit forces (N_v, d) at both ends along a direction (d,), outwards."""
        force = np.zeros((network.n_vertices, network.dimension))
        force[self.head] += direction
        force[self.tail] -= direction
        return force

    def apart(self, displacement: Array) -> Array:
        """Relative motion (d,) of the ends."""
        return np.asarray(displacement[self.head] - displacement[self.tail])

    def vector(self, network: Network, L: Array) -> Array:
        """r (d,) for bond vectors L (N_b, d)."""
        edges, signs, constant = self.path(network)
        return constant + signs @ L[edges]

    def path(self, network: Network) -> tuple[IntArray, Array, Array]:
        """Edges of the path, their signs, and what is not a bond vector (d,): r = constant + Σ sign L."""
        tree = _tree(network)
        if self not in tree.paths:
            tree.paths[self] = self._path(network, tree)
        return tree.paths[self]

    def _path(self, network: Network, tree: _Tree) -> tuple[IntArray, Array, Array]:
        cell = np.zeros(network.dimension)
        if network.cell is not None:
            cell = np.asarray(self.image) @ network.cell
        (edges, signs, start), (own, own_signs, origin) = tree.walk(self.head), tree.walk(self.tail)
        # The part that both ends have in common cancels.
        used, place = np.unique(np.array([*edges, *own], dtype=int), return_inverse=True)
        total = np.bincount(place, np.concatenate([signs, -own_signs]), len(used))
        images = np.zeros(network.dimension)
        if network.cell is not None:
            images = total @ network.offsets[used] @ network.cell
        return used[total != 0], total[total != 0], start - origin + cell - images


@dataclass(frozen=True)
class Vertex:
    """The motion of one vertex along a unit vector (d,).

    floating  relative to the mean motion of all vertices, where nothing is pinned
    """

    number: int
    direction: tuple[float, ...]
    floating: bool

    def __str__(self) -> str:
        return f"{self.number} along ({', '.join(f'{n:.4g}' for n in self.direction)})"

    def pull(self, network: Network, direction: Array) -> Array:
        """A unit force (N_v, d) on the vertex, balanced by equal ones on all vertices where nothing is pinned."""
        force = np.zeros((network.n_vertices, network.dimension))
        force[self.number] = direction
        return force - force.mean(axis=0) if self.floating else force

    def apart(self, displacement: Array) -> Array:
        """Motion (d,) of the vertex, to be multiplied by its direction."""
        return np.asarray(displacement[self.number] - (displacement.mean(axis=0) if self.floating else 0.0))

    def path(self, network: Network) -> tuple[IntArray, Array, Array]:
        """No edges: the direction depends on no bond vector, and its length is 1."""
        return np.zeros(0, np.int64), np.zeros(0), np.array(self.direction)


Target = Pair | Vertex


@dataclass(frozen=True, eq=False)
class _Tree:
    """Of each vertex the edge (N_v,) by which it is reached from a fixed one, and the vertex before it; −1: fixed.

    paths  of pairs, each found once
    """

    network: Network
    edge: IntArray
    before: IntArray
    paths: dict[Pair, tuple[IntArray, Array, Array]] = field(default_factory=dict, repr=False)

    def walk(self, vertex: int) -> tuple[list[int], Array, Array]:
        """Edges from a fixed vertex, their signs, and the position of that vertex (d,)."""
        edges, signs = [], []
        while self.before[vertex] >= 0:
            edge = int(self.edge[vertex])
            edges.append(edge)
            signs.append(1.0 if self.network.edges[edge, 1] == vertex else -1.0)
            vertex = int(self.before[vertex])
        return edges, np.array(signs), self.network.fixed_positions[vertex]


@lru_cache(maxsize=8)
def _tree(network: Network) -> _Tree:
    """Shortest paths from the fixed vertices: the pins, or the ground of a periodic network."""
    n, (tail, head) = network.n_vertices, network.edges.T
    fixed = np.setdiff1d(np.arange(n), network.free)
    rows = np.concatenate([tail, head, np.full(len(fixed), n)])
    columns = np.concatenate([head, tail, fixed])
    # Edge numbers from one; where several edges join two vertices, the last.
    numbers = np.concatenate([np.tile(np.arange(1, network.n_edges + 1), 2), np.full(len(fixed), network.n_edges + 1)])
    joined = sp.csr_array(sp.coo_array((np.ones(len(rows)), (rows, columns)), shape=(n + 1, n + 1)))
    _, before = breadth_first_order(joined, n, directed=True)
    by_ends = dict(zip(zip(rows.tolist(), columns.tolist(), strict=True), numbers.tolist(), strict=True))
    before = np.where(before == n, -1, before)[:n]
    edge = np.array([by_ends[int(b), v] - 1 if b >= 0 else -1 for v, b in enumerate(before)])
    return _Tree(network, edge, before)


# From arguments and names


def pair_of(network: Network, given: Any, name: str) -> Pair:
    """A checked pair from (i, j), with the nearest image of j, or (i, j, image); `InputError` otherwise.

    name  of the argument, for messages
    """
    if not isinstance(given, Sequence | np.ndarray) or isinstance(given, str) or len(given) not in (2, 3):
        raise InputError(f"{name} must be two vertices (i, j), or (i, j, image), not {shown(given)}")
    return checked_pair(network, [_whole(one, name) for one in given[:2]], given[2] if len(given) == 3 else None, name)


def target_of(network: Network, given: Any, name: str) -> Target:
    """A checked pair, or the motion of one vertex along a direction (vertex, (n_x, n_y)); `InputError` otherwise."""
    listed = isinstance(given, Sequence | np.ndarray) and not isinstance(given, str) and len(given) == 2
    if not listed or is_number(given[1]):
        return pair_of(network, given, name)
    return _vertex(network, _whole(given[0], name), floats(given[1], f"the direction of {name}"), name)


def _vertex(network: Network, number: int, direction: Array, name: str) -> Vertex:
    if not 0 <= number < network.n_vertices or number in network.pins:
        raise InputError(f"{name} names vertex {number}, which is fixed or not there: name one that can move")
    size = float(np.linalg.norm(direction))
    if direction.shape != (network.dimension,) or not 0 < size < np.inf:
        raise InputError(f"the direction of {name} must be {network.dimension} numbers, not all zero")
    return Vertex(number, tuple((direction / size).tolist()), not network.pins)


def next_neighbours(network: Network) -> list[Pair]:
    """All pairs that two edges in a row join, and no edge: angles at a vertex, whose changes are all local strains."""
    walks: list[list[tuple[int, Array]]] = [[] for _ in range(network.n_vertices)]
    for (tail, head), offset in zip(network.edges.tolist(), network.offsets, strict=True):
        walks[tail].append((head, offset))
        walks[head].append((tail, -offset))
    joined = {(a, b, *image.tolist()) for a, walk in enumerate(walks) for b, image in walk}
    found = dict[tuple[int, ...], Pair]()
    for walk in walks:
        for (i, here), (j, there) in combinations(walk, 2):
            a, b, image = (i, j, there - here) if i <= j else (j, i, here - there)
            key = (a, b, *image.tolist())
            pinned = a in network.pins and b in network.pins
            if a != b and key not in joined and not pinned:
                found[key] = Pair(a, b, tuple(image.tolist()))
    return list(found.values())


def _whole(vertex: Any, name: str) -> int:
    if isinstance(vertex, bool) or not isinstance(vertex, int | np.integer):
        raise InputError(f"{name} must name vertices by whole numbers, not {shown(vertex)}")
    return int(vertex)


def spelled_pair(given: Any, name: str) -> str:
    """The name of a pair (i, j, image) in names of quantities, i-j:n:m, without a network; `InputError` otherwise."""
    if not isinstance(given, Sequence | np.ndarray) or isinstance(given, str) or len(given) != 3:
        raise InputError(f"{name} must be two vertices and an image (i, j, image), not {shown(given)}")
    tail, head = (_whole(one, name) for one in given[:2])
    image = [_whole(n, f"the image of {name}") for n in np.asarray(given[2], dtype=object).ravel().tolist()]
    return f"{tail}-{head}" + "".join(f":{n}" for n in image)


def read_pair(network: Network, text: str) -> Pair:
    """A checked pair as names of quantities spell it, such as 3-20 or 3-20:1:0."""
    match = _WRITTEN.fullmatch(text.strip())
    if match is None:
        raise InputError(f"no pair of vertices is called {text!r:.40}: {_SPELLING}")
    tail, head, image = match.groups()
    return checked_pair(network, [int(tail), int(head)], [int(n) for n in image.split(":")[1:]] or None, "the pair")


def read_target(network: Network, text: str) -> Target:
    """A pair, or a vertex and an axis, such as 20x."""
    if (match := _AXIS.fullmatch(text.strip())) is None:
        return read_pair(network, text)
    axis = "xyz".index(match[2])
    if axis >= network.dimension:
        raise InputError(
            f"the target {text.strip()!r:.40} has an axis that the network lacks: take {'xyz'[: network.dimension]}"
        )
    return _vertex(network, int(match[1]), np.eye(network.dimension)[axis], "the target")


def checked_pair(network: Network, ends: list[int], image: Any, name: str) -> Pair:
    """A pair of two vertices that no edge joins, with its image, else an `InputError`."""
    tail, head = ends
    for vertex in ends:
        if not 0 <= vertex < network.n_vertices:
            raise InputError(
                f"{name} names vertex {vertex}, which is not there: vertices run from 0 to {network.n_vertices - 1}"
            )
    if tail == head:
        raise InputError(f"{name} names vertex {tail} twice, whose distance no force changes: name two vertices")
    pair = Pair(tail, head, nearest_image(network, tail, head) if image is None else _image(network, image, name))
    edges, offsets = network.edges, network.offsets
    forward = (edges == ends).all(axis=1) & (offsets == pair.image).all(axis=1)
    backward = (edges == ends[::-1]).all(axis=1) & (-offsets == pair.image).all(axis=1)
    if (joined := np.flatnonzero(forward | backward)).size:
        raise InputError(f"{name} {pair} is edge {joined[0]}, which keeps its length: name vertices that no edge joins")
    return pair


def _image(network: Network, image: Any, name: str) -> tuple[int, ...]:
    """The image as whole numbers, one for each vector of the cell."""
    numbers = np.asarray(image, dtype=object).ravel().tolist()
    if len(numbers) != network.dimension:
        raise InputError(f"the image of {name} must be {network.dimension} whole numbers, not {shown(image)}")
    whole = tuple(_whole(n, f"the image of {name}") for n in numbers)
    if network.cell is None and any(whole):
        raise InputError(f"the network has no cell, so the image of {name} must be zero, not {shown(image)}")
    return whole


def nearest_image(network: Network, tail: int, head: int) -> tuple[int, ...]:
    """The image of the head that is nearest to the tail where all stresses are equal: it depends on the graph alone.

    In other configurations of the network another image may be nearer: a response is that of one image throughout.
    """
    if network.cell is None:
        return (0,) * network.dimension
    short, rows = short_cell(network.cell)
    x = _equal_stresses(network)
    apart = x[head] - x[tail]
    whole = -np.round(apart @ np.linalg.inv(short)).astype(int)
    near = [whole + np.array(step) for step in product((-1, 0, 1), repeat=len(short))]
    nearest = min(near, key=lambda n: float(np.linalg.norm(apart + n @ short)))
    return tuple(int(n) for n in nearest @ rows)


@lru_cache(maxsize=8)
def _equal_stresses(network: Network) -> Array:
    """Coordinates (N_v, d) at equal stresses."""
    return network.all_coordinates(CriticalManifold(network).balance(np.ones(network.n_edges)).coordinates)


def check_distinct(source: Pair, target: Target) -> None:
    """`InputError` where source and target are the same pair."""
    if target in (source, source.reversed):
        raise InputError(f"the source and a target are the same pair {source}, whose response is 1: name another")
