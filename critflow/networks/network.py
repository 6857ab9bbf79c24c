"""Networks: edges, boundary, stiffnesses and pins, as one frozen and validated value.

The bond vector of edge α is L_α = Σ_i g_{αi} x_i + b_α with the signed incidence g (+1 at the head, −1 at the tail).
The constant b_α carries the boundary: the image offset of the edge times the cell, plus the pinned positions.  No
minimum-image rule is ever applied, so any shear and edges longer than half the cell are exact (`BondVectors`).
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from critflow.networks.faces import Faces
from critflow.networks.images import doubtful_offsets
from critflow.networks.support import check_support
from critflow.result import NetworkError

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False, repr=False)
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
    reference_volume  V of a network without a cell, to which its moduli refer (`with_volume`)

    Raises `NetworkError` when no positive stress can give every edge a length (but without a cell accepts pieces of
    several edges on one vertex, which stresses of both signs may open), and when the positions contradict the offsets:
    edges span the cell although their ends are close to each other in another image.
    """

    # The types are those after construction, which accepts anything that converts to them.
    edges: IntArray
    offsets: IntArray = None  # type: ignore[assignment]
    cell: Array | None = None
    stiffness: Array = 1.0  # type: ignore[assignment]
    pins: Mapping[int, Array] = field(default_factory=dict)
    n_vertices: int = 0
    positions: Array | None = None
    faces: Faces | None = None
    note: str = ""
    reference_volume: float | None = None

    def __post_init__(self) -> None:
        edges = _integers(self.edges, "edges")
        if edges.ndim != 2 or edges.shape[1] != 2 or len(edges) == 0:
            raise NetworkError(f"edges must have shape (N_b, 2) with N_b >= 1, not {edges.shape}: give tail and head")
        n_vertices = _n_vertices(self.n_vertices) or max(int(edges.max()) + 1, 0)
        pins = _pins(self.pins)
        cell = None if self.cell is None else _floats(self.cell, "cell")
        dimension = _dimension(cell, pins)
        offsets = np.zeros((len(edges), dimension), int) if self.offsets is None else _integers(self.offsets, "offsets")
        stiffness = _floats(self.stiffness, "stiffness")
        if stiffness.ndim == 0:
            stiffness = np.full(len(edges), float(stiffness))
        positions = None if self.positions is None else _floats(self.positions, "positions")

        if offsets.shape != (len(edges), dimension):
            raise NetworkError(f"offsets must have shape {(len(edges), dimension)}, not {offsets.shape}: one per edge")
        if cell is None and offsets.any():
            raise NetworkError("edges with image offsets need a cell: give its vectors as rows")
        _check_values(stiffness, len(edges), cell, pins, n_vertices)
        _check_edges(edges, offsets, n_vertices)
        self._check_support(edges, offsets, cell, pins, n_vertices)
        if positions is not None:
            _check_positions(positions, edges, offsets, cell, (n_vertices, dimension))

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
    def _check_support(
        edges: IntArray, offsets: IntArray, cell: Array | None, pins: Mapping[int, Array], n_vertices: int
    ) -> None:
        check_support(edges, offsets, cell, pins, n_vertices)

    def __repr__(self) -> str:
        parts = [f"{self.n_vertices:,} vertices", f"{self.n_edges:,} edges", f"{self.dimension} dimensions"]
        if self.cell is not None:
            parts.append("periodic")
        if self.pins:
            parts.append(f"{len(self.pins):,} pins")
        return f"Network({', '.join(parts)}, z = {2 * self.n_edges / self.n_vertices:.4g})"

    # Sizes

    @property
    def n_edges(self) -> int:
        return len(self.edges)

    @property
    def dimension(self) -> int:
        return int(self.offsets.shape[1])

    @property
    def volume(self) -> float:
        """Volume V of the cell (area in two dimensions), or the one named for a network without a cell."""
        if self.cell is None:
            if self.reference_volume is None:
                raise NetworkError(
                    "a network without a cell has no volume and so no modulus: give it a cell, or name the volume to "
                    "which moduli refer, by network.with_volume(V), or --volume in a command"
                )
            return self.reference_volume
        # NumPy's determinant is the exponential of a logarithm, which rounds more the farther V is from one.
        return float(abs(scipy.linalg.det(self.cell)))

    @property
    def has_volume(self) -> bool:
        """Whether moduli are defined: a cell, or a named volume."""
        return self.cell is not None or self.reference_volume is not None

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
    def free_rows(self) -> slice | IntArray:
        """The free vertices as an index of rows: a slice where they are consecutive, which NumPy reads much faster."""
        free = self.free
        consecutive = len(free) > 0 and free[-1] - free[0] == len(free) - 1
        return slice(int(free[0]), int(free[-1]) + 1) if consecutive else free

    @cached_property
    def fixed_positions(self) -> Array:
        """Positions (N_v, d) with zeros at the free vertices: where the pins, or the grounded vertex, are."""
        x = np.zeros((self.n_vertices, self.dimension))
        for vertex, position in self.pins.items():
            x[vertex] = position
        return x

    @cached_property
    def boundary_vectors(self) -> Array:
        """b, (N_b, d): image offset times cell, plus the contribution of the pins (`BondVectors2`, `BoundaryTerm`)."""
        if self.cell is not None and not self.pins:
            return np.asarray(self.offsets @ self.cell)
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
        values = _floats(stiffness, "stiffness")
        values = np.full(self.n_edges, float(values)) if values.ndim == 0 else values
        edge_values(values, self.n_edges, "stiffness")
        values.flags.writeable = False
        return self._copied(stiffness=values)

    def with_volume(self, volume: float) -> Network:
        """The same network without a cell, with the volume V (area in two dimensions) to which its moduli refer."""
        if self.cell is not None:
            raise NetworkError("the volume of a periodic network is that of its cell: name one only without a cell")
        value = _floats(volume, "a volume")
        if value.ndim or not 0 < value < np.inf:
            raise NetworkError(f"a volume must be positive and finite, not {_shown(volume)}: give one number")
        return self._copied(reference_volume=float(value))

    def deformed(self, gradient: ArrayLike) -> Network:
        """The network after the affine deformation F of its boundary: b → F b, including pins and positions."""
        F = _floats(gradient, "a deformation")
        if F.shape != (self.dimension,) * 2 or not np.isfinite(F).all() or not abs(np.linalg.det(F)) > 0:
            raise NetworkError(f"a deformation must be an invertible {self.dimension} × {self.dimension} matrix")
        copied = self._copied(
            cell=None if self.cell is None else self.cell @ F.T,
            pins={i: F @ p for i, p in self.pins.items()},
            positions=None if self.positions is None else self.positions @ F.T,
            reference_volume=None if self.reference_volume is None else self.reference_volume * abs(np.linalg.det(F)),
        )
        copied.__dict__.pop("boundary_vectors", None)
        copied.__dict__.pop("fixed_positions", None)
        return copied

    def _copied(self, **changed: Any) -> Network:
        """A copy with other values of the same graph, whose checks and matrices stay valid."""
        copied = copy(self)
        copied.__dict__.update(changed)
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
        )
        # The positions were checked in the whole, of which fewer edges may be no sample.
        positions = None if self.positions is None else self.positions[vertices]
        return part._copied(positions=positions, reference_volume=self.reference_volume), vertices


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
    return _rows(_floats(coordinates, "coordinates"), "coordinates", (network.n_vertices, network.dimension))


def _rows(array: Array, name: str, shape: tuple[int, int]) -> Array:
    """The array if it has this shape and is finite, else a `NetworkError` that names the first bad row."""
    if array.shape != shape:
        raise NetworkError(f"{name} must have shape {shape}, not {array.shape}: give one row per vertex")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(bad):
        raise NetworkError(f"{name} must be finite, but {name}[{bad[0]}] = {array[bad[0]].tolist()}: correct that row")
    return array


def _floats(values: ArrayLike, name: str) -> Array:
    """A copy of the values as floats, else a `NetworkError`."""
    try:
        array = np.array(values)
        if array.dtype.kind == "c":
            raise TypeError
        return array.astype(float)
    except (TypeError, ValueError, OverflowError):
        raise NetworkError(f"{name} must be real numbers in rows of equal length, not {_shown(values)}") from None


def _integers(values: ArrayLike, name: str) -> IntArray:
    """A copy of the values as integers, else a `NetworkError`."""
    try:
        array = np.array(values)
    except ValueError:
        raise NetworkError(f"{name} must be rows of equal length, not {_shown(values)}") from None
    if array.dtype.kind == "f" and np.array_equal(array, np.round(array)) and (np.abs(array) < 2.0**63).all():
        return array.astype(np.int64)
    if array.dtype.kind not in "iu" or (array.size and array.max() >= 2**63):
        raise NetworkError(f"{name} must be whole numbers, not {array.dtype}: they count vertices and cell images")
    return array.astype(np.int64)


def _shown(value: object) -> str:
    """The value in one short line."""
    return " ".join(f"{value!r:.60}".split())


def _n_vertices(value: object) -> int:
    if not isinstance(value, int | np.integer) or value < 0:
        raise NetworkError(f"n_vertices must be a whole number above zero, not {_shown(value)}, or left out")
    return int(value)


def _pins(pins: object) -> dict[int, Array]:
    if pins is None:
        return {}
    if not isinstance(pins, Mapping):
        raise NetworkError(
            f"pins must be a mapping from vertices to positions, such as {{0: [0.0, 0.0]}}, not a {type(pins).__name__}"
        )
    for vertex in pins:
        if not isinstance(vertex, int | np.integer):
            raise NetworkError(f"pin {_shown(vertex)} is not a vertex: the keys of pins are numbers of vertices")
    return {int(i): _floats(p, f"the position of pin {i}") for i, p in pins.items()}


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


def _check_positions(
    positions: Array, edges: IntArray, offsets: IntArray, cell: Array | None, shape: tuple[int, int]
) -> None:
    """Raise `NetworkError` for positions that are not finite, or contradict the offsets of many edges."""
    _rows(positions, "positions", shape)
    if cell is None:
        return
    doubtful = doubtful_offsets(edges, offsets, cell, positions)
    if doubtful.contradicted:
        raise NetworkError(
            f"the positions contradict the offsets of {len(doubtful.edges)} of {doubtful.n_crossing} edges across the "
            f"boundary: edge {doubtful.edges[0]} is longer than the cell, though its ends have images nearby; an "
            "offset is that of the head (negate it?), or leave positions out"
        )
