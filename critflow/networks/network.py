"""Networks: edges, boundary, stiffnesses and pins, as one frozen and validated value.

The bond vector of edge α is L_α = Σ_i g_{αi} x_i + b_α with the signed incidence g (+1 at the head, −1 at the tail).
The constant b_α carries the boundary: the image offset of the edge times the cell, plus the pinned positions.  No
minimum-image rule is ever applied, so any shear and edges longer than half the cell are exact (`BondVectors`).
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import connected_components

from critflow.networks.faces import Faces
from critflow.result import InputError, NetworkError

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Network:
    """A spring network in a periodic cell, or hung on pins, or both.

    edges      (N_b, 2) tail and head of each edge
    offsets    (N_b, d) integer image offset of the head; None: no edge crosses the boundary
    cell       (d, d) rows are the cell vectors; None: not periodic
    stiffness  (N_b,) k_α, or one number for all
    pins       vertex -> fixed position (d,); the pins leave the unknowns
    positions  (N_v, d) any embedding, to draw or to start from; not part of the physics
    faces      the polygons of a planar network, if known
    note       a sentence about its making, such as the edges that were removed

    Raises `NetworkError` when no positive stress could give every edge a length.
    """

    # The types are those after construction, which accepts anything that converts to them.
    edges: IntArray
    offsets: IntArray = None  # type: ignore[assignment]
    cell: Array | None = None
    stiffness: Array = 1.0  # type: ignore[assignment]
    pins: Mapping[int, Array] = field(default_factory=dict)
    n_vertices: int = 0
    positions: Array | None = None
    faces: Faces | None = field(default=None, repr=False)
    note: str = field(default="", repr=False)

    def __post_init__(self) -> None:
        edges = _integers(self.edges, "edges")
        if edges.ndim != 2 or edges.shape[1] != 2 or len(edges) == 0:
            raise NetworkError(f"edges must have shape (N_b, 2) with N_b >= 1, not {edges.shape}: give tail and head")
        n_vertices = self.n_vertices or int(edges.max()) + 1
        pins = _pins(self.pins)
        cell = None if self.cell is None else np.array(self.cell, dtype=float)
        dimension = _dimension(cell, pins)
        offsets = np.zeros((len(edges), dimension), int) if self.offsets is None else _integers(self.offsets, "offsets")
        stiffness = np.array(self.stiffness, dtype=float)
        if stiffness.ndim == 0:
            stiffness = np.full(len(edges), float(stiffness))
        positions = None if self.positions is None else np.array(self.positions, dtype=float)

        if offsets.shape != (len(edges), dimension):
            raise NetworkError(f"offsets must have shape {(len(edges), dimension)}, not {offsets.shape}: one per edge")
        if cell is None and offsets.any():
            raise NetworkError("edges with image offsets need a cell: give its vectors as rows")
        if positions is not None and positions.shape != (n_vertices, dimension):
            raise NetworkError(f"positions must have shape {(n_vertices, dimension)}, not {positions.shape}")
        _check_values(stiffness, len(edges), cell, pins, n_vertices)
        _check_edges(edges, offsets, n_vertices)
        self._check_support(edges, pins, n_vertices)

        arrays = (
            ("edges", edges),
            ("offsets", offsets),
            ("cell", cell),
            ("stiffness", stiffness),
            ("positions", positions),
        )
        for name, array in arrays:
            if array is not None:
                array.flags.writeable = False
            object.__setattr__(self, name, array)
        object.__setattr__(self, "pins", pins)
        object.__setattr__(self, "n_vertices", n_vertices)

    @staticmethod
    def _check_support(edges: IntArray, pins: Mapping[int, Array], n_vertices: int) -> None:
        _check_degrees(edges, pins, n_vertices)
        _check_connection(edges, pins, n_vertices)

    # Sizes

    @property
    def n_edges(self) -> int:
        return len(self.edges)

    @property
    def dimension(self) -> int:
        return int(self.offsets.shape[1])

    @property
    def volume(self) -> float:
        """Volume V of the cell (area in two dimensions)."""
        if self.cell is None:
            raise NetworkError("a network without a cell has no volume and so no modulus: give it a cell")
        return float(abs(np.linalg.det(self.cell)))

    # Geometry

    @cached_property
    def incidence(self) -> sp.csr_array:
        """Signed incidence g, (N_b, N_v): +1 at the head, −1 at the tail, nothing at both (`incidenceMatrix`)."""
        rows = np.repeat(np.arange(self.n_edges), 2)
        signs = np.tile([-1.0, 1.0], self.n_edges)
        g = sp.csr_array((signs, (rows, self.edges.ravel())), shape=(self.n_edges, self.n_vertices))
        g.eliminate_zeros()
        return g

    @cached_property
    def free(self) -> IntArray:
        """The unknown vertices: all but the pins, or all but vertex 0, the ground of a periodic network."""
        free = np.ones(self.n_vertices, bool)
        free[list(self.pins) if self.pins else 0] = False
        return np.flatnonzero(free)

    @cached_property
    def fixed_positions(self) -> Array:
        """Positions (N_v, d) with zeros at the free vertices: where the pins, or the grounded vertex, are."""
        x = np.zeros((self.n_vertices, self.dimension))
        for vertex, position in self.pins.items():
            x[vertex] = position
        return x

    @cached_property
    def boundary_vectors(self) -> Array:
        """b, (N_b, d): image offset times cell, plus what the pins contribute (`BondVectors2`, `BoundaryTerm`)."""
        b = np.asarray(self.incidence @ self.fixed_positions)
        return b if self.cell is None else b + self.offsets @ self.cell

    @cached_property
    def free_incidence(self) -> sp.csr_array:
        """Columns of g at the free vertices, (N_b, n_free)."""
        return sp.csr_array(self.incidence[:, self.free])

    @cached_property
    def divergence(self) -> sp.csr_array:
        """Transpose of `free_incidence`: sums edge vectors into forces on the free vertices, (n_free, N_b)."""
        return sp.csr_array(self.free_incidence.T)

    def bond_vectors(self, coordinates: Array) -> Array:
        """L = g x + b, (N_b, d), for coordinates (N_v, d); where vertices are pinned, the pins are used."""
        x = np.asarray(coordinates, dtype=float)
        # A periodic network is grounded at vertex 0, which need not lie at the origin here.
        x = x if self.pins else x - x[0]
        return np.asarray(self.free_incidence @ x[self.free]) + self.boundary_vectors

    def all_coordinates(self, free_coordinates: Array) -> Array:
        """Coordinates (N_v, d) from those of the free vertices (n_free, d)."""
        x = self.fixed_positions.copy()
        x[self.free] = free_coordinates
        return x

    # Copies

    def with_stiffness(self, stiffness: ArrayLike) -> Network:
        """The same network with other stiffnesses k, (N_b,) or one number."""
        return replace(self, stiffness=np.asarray(stiffness, dtype=float))

    def deformed(self, gradient: ArrayLike) -> Network:
        """The network after the affine deformation F of its boundary: b → F b, including pins and positions."""
        F = np.asarray(gradient, dtype=float)
        if F.shape != (self.dimension,) * 2 or not np.isfinite(F).all() or not abs(np.linalg.det(F)) > 0:
            raise NetworkError(f"a deformation must be an invertible {self.dimension} × {self.dimension} matrix")
        # The graph is the same: its checks and its matrices stay valid.
        copied = copy(self)
        copied.__dict__.pop("boundary_vectors", None)
        copied.__dict__.pop("fixed_positions", None)
        copied.__dict__["cell"] = None if self.cell is None else self.cell @ F.T
        copied.__dict__["pins"] = {i: F @ p for i, p in self.pins.items()}
        copied.__dict__["positions"] = None if self.positions is None else self.positions @ F.T
        return copied

    def part(self, kept_edges: NDArray[np.bool_]) -> tuple[Network, IntArray]:
        """The network of some of the edges, and the old index of each of its vertices."""
        edges = self.edges[kept_edges]
        vertices = np.unique(edges)
        index = np.full(self.n_vertices, -1)
        index[vertices] = np.arange(len(vertices))
        part = Network(
            index[edges],
            self.offsets[kept_edges],
            self.cell,
            self.stiffness[kept_edges],
            {int(index[i]): p for i, p in self.pins.items() if index[i] >= 0},
            positions=None if self.positions is None else self.positions[vertices],
        )
        return part, vertices


def edge_values(values: ArrayLike, n_edges: int, name: str, positive: bool = True) -> Array:
    """Values per edge as floats (N_b,), finite and positive, else a `NetworkError` that names the first bad edge."""
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise NetworkError(f"{name} must be numbers, one per edge, not {values!r:.60}") from None
    if array.shape != (n_edges,):
        raise NetworkError(f"{name} must have one value per edge, shape ({n_edges},), not {array.shape}")
    bad = ~np.isfinite(array) | (positive & ~(array > 0))
    if bad.any():
        edge = int(np.flatnonzero(bad)[0])
        rule = "positive and finite" if positive else "finite"
        raise NetworkError(
            f"{name} must be {rule} on every edge, but {name}[{edge}] = {array[edge]}: correct that value"
        )
    return array


def validated_coordinates(network: Network, coordinates: ArrayLike) -> Array:
    """A copy of vertex coordinates as finite floats (N_v, d), else an `InputError`."""
    x = np.array(coordinates, dtype=float)
    shape = (network.n_vertices, network.dimension)
    if x.shape != shape or not np.isfinite(x).all():
        raise InputError(f"coordinates must be finite and of shape {shape}, not {x.shape}: give one row per vertex")
    return x


def _integers(values: ArrayLike, name: str) -> IntArray:
    array = np.array(values)
    if array.dtype.kind not in "iu":
        if array.dtype.kind != "f" or not np.array_equal(array, np.round(array)):
            raise NetworkError(f"{name} must be whole numbers, not {array.dtype}: they count vertices and cell images")
    return array.astype(np.int64)


def _pins(pins: Mapping[int, ArrayLike] | None) -> dict[int, Array]:
    if pins is not None and not isinstance(pins, Mapping):
        raise NetworkError(
            f"pins must be a mapping from vertices to positions, such as {{0: [0.0, 0.0]}}, not a {type(pins).__name__}"
        )
    return {int(i): np.array(p, dtype=float) for i, p in (pins or {}).items()}


def _dimension(cell: Array | None, pins: Mapping[int, Array]) -> int:
    if cell is None and not pins:
        raise NetworkError("a network needs a periodic cell or pins: without either it collapses to a point")
    sizes = {p.shape for p in pins.values()} | ({cell.shape[:1]} if cell is not None else set())
    if len(sizes) != 1 or any(len(size) != 1 for size in sizes):
        raise NetworkError("the cell vectors and the pinned positions must all have the same dimension")
    dimension = int(sizes.pop()[0])
    if cell is not None and cell.shape != (dimension, dimension):
        raise NetworkError(f"cell must be a square matrix with the cell vectors as rows, not {cell.shape}")
    return dimension


def _check_values(
    stiffness: Array, n_edges: int, cell: Array | None, pins: Mapping[int, Array], n_vertices: int
) -> None:
    edge_values(stiffness, n_edges, "stiffness")
    if cell is not None and not (np.isfinite(cell).all() and abs(np.linalg.det(cell)) > 0):
        raise NetworkError("the cell vectors must be finite and span a volume: two of them are parallel or one is zero")
    for vertex, position in pins.items():
        if not 0 <= vertex < n_vertices:
            raise NetworkError(f"pin {vertex} is not a vertex: vertices run from 0 to {n_vertices - 1}")
        if not np.isfinite(position).all():
            raise NetworkError(f"the position of pin {vertex} is not finite: give {len(position)} numbers")


def _check_edges(edges: IntArray, offsets: IntArray, n_vertices: int) -> None:
    missing = (edges < 0) | (edges >= n_vertices)
    if missing.any():
        edge = int(np.flatnonzero(missing.any(axis=1))[0])
        raise NetworkError(
            f"edge {edge} joins vertices {edges[edge].tolist()}, but vertices run from 0 to {n_vertices - 1}: "
            "remove it or add the vertex"
        )
    loops = (edges[:, 0] == edges[:, 1]) & ~offsets.any(axis=1)
    if loops.any():
        edge = int(np.flatnonzero(loops)[0])
        raise NetworkError(f"edge {edge} joins vertex {edges[edge, 0]} to itself, which has no length: remove it")


def _check_degrees(edges: IntArray, pins: Mapping[int, Array], n_vertices: int) -> None:
    if len(pins) == n_vertices or n_vertices == 1:
        raise NetworkError("no vertex is free to move, so there is nothing to find: add vertices or remove pins")
    degree = np.bincount(edges.ravel(), minlength=n_vertices)
    loose = [int(i) for i in np.flatnonzero(degree <= 1) if i not in pins]
    if loose:
        support = "no edge" if degree[loose[0]] == 0 else "a single edge, which cannot carry tension"
        raise NetworkError(f"vertex {loose[0]} hangs on {support}: remove it, or use pruned_network")


def _check_connection(edges: IntArray, pins: Mapping[int, Array], n_vertices: int) -> None:
    tail, head = edges.T
    # All pins belong to one support, so they count as joined.
    anchors = np.fromiter(pins, int, len(pins))
    tail, head = np.concatenate([tail, anchors[:-1]]), np.concatenate([head, anchors[1:]])
    graph = sp.coo_array((np.ones(len(tail)), (tail, head)), shape=(n_vertices, n_vertices))
    n_parts, part = connected_components(graph, directed=False)
    if n_parts > 1:
        stray = int(np.flatnonzero(part != part[0])[0])
        raise NetworkError(
            f"the network falls into {n_parts} parts that no edge joins (vertices 0 and {stray} are in two of them): "
            "keep one part (pruned_network keeps the largest), or make a network of each"
        )
