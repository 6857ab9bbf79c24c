"""Checks of the values that make a network: each raises a `NetworkError` that names the first bad one."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import shown
from critflow.result import NetworkError

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Most vertices of a network that is made from a number alone, which may be a typing error: 1 kB a vertex is 20 GB.
MOST_VERTICES = 20_000_000
# Distance of the pins from the origin in units of their extent, at most: four digits of every length.
FARTHEST = 1e4
# Part of the edges across the boundary that may be longer than the cell: wrong signs make it about a half.
_CONTRADICTING = 0.1
# An edge longer than every diagonal of the cell is doubtful if its nearest image is less than this part of it.
_NEARER = 0.5


def edge_values(values: ArrayLike, n_edges: int, name: str, positive: bool = True, place: str = "edge") -> Array:
    """Values per edge, or face, as floats (N_b,), finite and positive, else a `NetworkError` on the first bad one."""
    array = floats(values, name)
    if array.shape != (n_edges,):
        raise NetworkError(f"{name} must have one value per {place}, shape ({n_edges},), not {array.shape}")
    bad = ~np.isfinite(array) | (positive & ~(array > 0))
    if bad.any():
        edge = int(np.flatnonzero(bad)[0])
        rule = "positive and finite" if positive else "finite"
        raise NetworkError(f"{name} must be {rule} on every {place}, but {name}[{edge}] = {array[edge]}: correct it")
    return array


def stiffnesses(values: ArrayLike, n_edges: int) -> Array:
    """Stiffnesses (N_b,) from one number or one for each edge, else a `NetworkError`."""
    array = floats(values, "stiffness")
    return edge_values(np.full(n_edges, float(array)) if array.ndim == 0 else array, n_edges, "stiffness")


def finite_rows(array: Array, name: str, shape: tuple[int, ...]) -> Array:
    """The array if it has this shape and is finite, else a `NetworkError` that names the first bad row."""
    if array.shape != shape:
        raise NetworkError(f"{name} must have shape {shape}, not {array.shape}: give one row for each")
    bad = np.flatnonzero(~np.isfinite(array).reshape(len(array), -1).all(axis=1))
    if len(bad):
        raise NetworkError(f"{name} must be finite, but {name}[{bad[0]}] = {array[bad[0]].tolist()}: correct that row")
    return array


def floats(values: ArrayLike, name: str) -> Array:
    """A copy of the values as floats, else a `NetworkError`."""
    try:
        array = np.array(values)
        if array.dtype.kind == "c":
            raise TypeError
        return array.astype(float)
    except (TypeError, ValueError, OverflowError):
        raise NetworkError(f"{name} must be real numbers in rows of equal length, not {shown(values)}") from None


def integers(values: ArrayLike, name: str) -> IntArray:
    """A copy of the values as integers, else a `NetworkError`."""
    try:
        array = np.array(values)
    except ValueError:
        raise NetworkError(f"{name} must be rows of equal length, not {shown(values)}") from None
    kind, bad = array.dtype.kind, np.zeros(array.shape, bool)
    if kind == "f":
        bad = ~((array == np.round(array)) & (np.abs(array) < 2.0**63))
    elif kind == "u":
        bad = array >= 2**63
    if kind not in "iuf" or bad.any():
        value = array[bad][0] if bad.any() else array.dtype
        raise NetworkError(f"{name} must be whole numbers, not {value}: they count vertices and cell images")
    return array.astype(np.int64)


def checked_count(value: object) -> int:
    if not isinstance(value, int | np.integer) or value < 0:
        raise NetworkError(f"n_vertices must be a whole number above zero, not {shown(value)}, or left out")
    return int(value)


def checked_pins(pins: object, n_vertices: int) -> dict[int, Array]:
    if pins is None:
        return {}
    if not isinstance(pins, Mapping):
        raise NetworkError(f"pins must be a mapping, such as {{0: [0.0, 0.0]}}, not a {type(pins).__name__}")
    places = {}
    for vertex, position in pins.items():
        if not isinstance(vertex, int | np.integer) or not 0 <= vertex < n_vertices:
            raise NetworkError(f"pin {shown(vertex)} is not a vertex: vertices run from 0 to {n_vertices - 1}")
        places[int(vertex)] = place = floats(position, f"the position of pin {vertex}")
        if not np.isfinite(place).all():
            raise NetworkError(f"the position of pin {vertex} is not finite: give one number for each dimension")
    if len({place.shape for place in places.values()}) == 1:
        positions = np.array(list(places.values()))
        distance, extent = np.abs(positions).max(), np.ptp(positions, axis=0).max(initial=0.0)
        if distance > FARTHEST * extent > 0:
            raise NetworkError(
                f"the pins lie {distance / extent:.0e} times their extent from the origin, which costs as many digits "
                "of every length: subtract their mean"
            )
    return places


def checked_cell(cell: ArrayLike, dimension: int | None = None) -> Array:
    """A copy of cell vectors as rows (d, d), else a `NetworkError`."""
    array = floats(cell, "cell")
    if array.ndim != 2 or array.shape != (dimension or len(array),) * 2:
        raise NetworkError(
            f"cell must be a square matrix with {dimension or 'd'} cell vectors as rows, not {array.shape}"
        )
    with np.errstate(all="ignore"):
        volume = abs(np.linalg.det(array))
    # A volume beyond the range of doubles has no digits.
    if not (np.isfinite(array).all() and 0 < volume < np.inf):
        raise NetworkError(
            "the cell vectors must span a finite volume: two of them are parallel, or one is zero or huge"
        )
    return array


def dimension_of(cell: Array | None, pins: Mapping[int, Array]) -> int:
    if cell is None and not pins:
        raise NetworkError("a network needs a periodic cell or pins: without either it collapses to a point")
    sizes = {p.shape for p in pins.values()} | ({cell.shape[:1]} if cell is not None else set())
    if len(sizes) != 1 or any(len(size) != 1 for size in sizes):
        raise NetworkError("the cell vectors and the pinned positions must all have the same dimension")
    return int(sizes.pop()[0])


def check_size(n_vertices: float) -> None:
    """Raise `NetworkError` before a network of this size is made if it is out of reach."""
    if not n_vertices <= MOST_VERTICES:
        raise NetworkError(
            f"a network of {n_vertices:,} vertices needs about {n_vertices / 1e6:,.0f} GB to make: choose at most "
            f"{MOST_VERTICES:,} vertices"
        )


def check_ends(edges: IntArray, n_vertices: int) -> None:
    missing = (edges < 0) | (edges >= n_vertices)
    if missing.any():
        edge = int(np.flatnonzero(missing.any(axis=1))[0])
        raise NetworkError(
            f"edge {edge} joins vertices {edges[edge].tolist()}, but vertices run from 0 to {n_vertices - 1}: "
            "remove it or add the vertex, or check whether counting begins at 0 or 1"
        )


def check_loops(edges: IntArray, offsets: IntArray) -> None:
    loops = (edges[:, 0] == edges[:, 1]) & ~offsets.any(axis=1)
    if loops.any():
        edge = int(np.flatnonzero(loops)[0])
        raise NetworkError(f"edge {edge} joins vertex {edges[edge, 0]} to itself, which has no length: remove it")


def check_positions(
    positions: Array, edges: IntArray, offsets: IntArray, cell: Array | None, shape: tuple[int, int]
) -> None:
    """Raise `NetworkError` for positions that are not finite, or contradict the offsets of many edges."""
    finite_rows(positions, "positions", shape)
    if cell is None:
        return
    doubtful, n_crossing, contradicted = doubtful_offsets(edges, offsets, cell, positions)
    if contradicted:
        raise NetworkError(
            f"the positions contradict the offsets of {len(doubtful)} of {n_crossing} edges across the "
            f"boundary: edge {doubtful[0]} is longer than the cell, though its ends have images nearby; an "
            "offset is that of the head (negate it?), or leave positions out"
        )


def doubtful_offsets(
    edges: IntArray, offsets: IntArray, cell: Array, positions: Array
) -> tuple[NDArray[np.intp], int, bool]:
    """Edges longer than every diagonal of the cell and more than twice their image nearest by rounded coordinates.

    With the number of edges across the boundary, and whether so many are doubtful that a convention is wrong; a few
    long edges may be meant.
    """
    # An edge from a vertex to an image of itself has no nearer one.
    crossing = np.flatnonzero(offsets.any(axis=1) & (edges[:, 0] != edges[:, 1]))
    tail, head = edges[crossing].T
    apart = (positions[head] - positions[tail]) @ np.linalg.inv(cell) + offsets[crossing]
    given, nearest = (np.linalg.norm(v @ cell, axis=1) for v in (apart, apart - np.round(apart)))
    corners = np.array(list(product((-1.0, 1.0), repeat=len(cell)))) @ cell
    doubtful = crossing[(given > np.linalg.norm(corners, axis=1).max()) & (nearest < _NEARER * given)]
    return doubtful, len(crossing), len(doubtful) > max(1, _CONTRADICTING * len(crossing))
