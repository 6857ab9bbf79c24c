"""The record between files and networks: vertices, edges and boundary as they were read, before any check."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import shown
from critflow.networks.digits import Digits, digits_of
from critflow.networks.network import Network
from critflow.result import InputError, Record

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class NetworkData(Record):
    """A network as a file or an object holds it.

    edges            (N_b, 2) tail and head of each edge, indices of rows of `positions`
    positions        (N_v, d)
    cell             (d, d) rows are the cell vectors; None: not periodic
    offsets          (N_b, d) image offset of each head; None: to be found
    bond_vectors     (N_b, d) true bond vectors, from which offsets follow
    pins             indices of fixed vertices
    stiffness        (N_b,) k
    rest_lengths     (N_b,) ℓ
    force_densities  (N_b,) σ
    ids              name of each vertex in the source
    polygons         vertices of each cell of a polygon mesh, in order
    known_digits     digits of the coordinates where a format fixes them; None: to be found
    nearest_images   whether the format defines edges by nearest images
    source           format, for messages
    notes            sentences on how the source was read
    repairs          sentences on corrections made on reading, which a strict reading refuses
    """

    edges: IntArray
    positions: Array
    cell: Array | None = None
    offsets: IntArray | None = None
    bond_vectors: Array | None = None
    pins: tuple[int, ...] = ()
    stiffness: Array | None = None
    rest_lengths: Array | None = None
    force_densities: Array | None = None
    ids: tuple[str, ...] = ()
    polygons: tuple[tuple[int, ...], ...] = ()
    known_digits: Digits | None = None
    nearest_images: bool = False
    source: str = "arrays"
    notes: tuple[str, ...] = ()
    repairs: tuple[str, ...] = ()

    @property
    def n_vertices(self) -> int:
        return len(self.positions)

    @property
    def n_edges(self) -> int:
        return len(self.edges)

    @property
    def dimension(self) -> int:
        return int(self.positions.shape[1])

    @property
    def digits(self) -> Digits:
        """Digits of the coordinates in the units of the source."""
        return digits_of(self.positions) if self.known_digits is None else self.known_digits

    def name(self, vertex: int) -> str:
        """Name of a vertex in the source."""
        return self.ids[vertex] if self.ids else str(vertex)

    def with_edges(self, kept: NDArray[np.bool_] | IntArray) -> NetworkData:
        """The same vertices with some of the edges."""

        def part(values: Any) -> Any:
            return None if values is None else values[kept]

        return replace(
            self,
            edges=part(self.edges),
            offsets=part(self.offsets),
            bond_vectors=part(self.bond_vectors),
            stiffness=part(self.stiffness),
            rest_lengths=part(self.rest_lengths),
            force_densities=part(self.force_densities),
        )

    def with_vertices(self, kept: NDArray[np.bool_]) -> NetworkData:
        """Some of the vertices and the edges between them."""
        index = np.cumsum(kept) - 1
        part = self.with_edges(np.asarray(kept[self.edges].all(axis=1)))
        return replace(
            part,
            edges=index[part.edges],
            positions=self.positions[kept],
            pins=tuple(int(index[i]) for i in self.pins if kept[i]),
            ids=tuple(name for name, keep in zip(self.ids, kept, strict=True) if keep) if self.ids else (),
            polygons=tuple(tuple(int(index[i]) for i in p) for p in self.polygons if kept[list(p)].all()),
        )

    def noting(self, *sentences: str) -> NetworkData:
        """The same data with further sentences on how it was read."""
        return replace(self, notes=(*self.notes, *sentences))

    def repairing(self, *sentences: str) -> NetworkData:
        """The same data with further sentences on corrections."""
        return replace(self, repairs=(*self.repairs, *sentences))


def data_of(
    network: Network,
    coordinates: ArrayLike | None = None,
    rest_lengths: ArrayLike | None = None,
    force_densities: ArrayLike | None = None,
) -> NetworkData:
    """The record of a network, at coordinates (N_v, d) or its positions; raises `InputError` where it has neither."""
    x = network.positions if coordinates is None else np.asarray(coordinates, dtype=float)
    if x is None:
        raise InputError("the network has no positions to write: give coordinates, such as those of a configuration")
    if x.shape != (network.n_vertices, network.dimension):
        raise InputError(f"coordinates must have shape {(network.n_vertices, network.dimension)}, not {x.shape}")
    x = x.copy()
    for vertex, position in network.pins.items():
        x[vertex] = position
    return NetworkData(
        edges=network.edges,
        positions=x,
        cell=network.cell,
        offsets=network.offsets,
        pins=tuple(sorted(network.pins)),
        stiffness=network.stiffness,
        rest_lengths=None if rest_lengths is None else np.asarray(rest_lengths, dtype=float),
        force_densities=None if force_densities is None else np.asarray(force_densities, dtype=float),
        source="critflow",
    )


def from_zero(data: NetworkData) -> NetworkData:
    """The record with vertices counted from 0; those counted from 1 keep these numbers as their names."""
    n = data.n_vertices
    if not data.n_edges or data.edges.min() != 1 or data.edges.max() != n:
        return data
    counted_from_1 = replace(data, edges=data.edges - 1, ids=tuple(str(k + 1) for k in range(n)))
    return counted_from_1.repairing("vertices were counted from 1, and keep these numbers as names")


def bond_vectors_of(data: NetworkData) -> Array:
    """L = x_head − x_tail + offset · cell, (N_b, d)."""
    tail, head = data.edges.T
    L = data.positions[head] - data.positions[tail]
    return L if data.cell is None or data.offsets is None else L + data.offsets @ data.cell


def polygon_edges(polygons: Sequence[Sequence[int]]) -> IntArray:
    """Sides of polygons, each once, (N_b, 2)."""
    sides = [(int(a), int(b)) for polygon in polygons for a, b in zip(polygon, [*polygon[1:], polygon[0]], strict=True)]
    if not sides:
        raise InputError("the mesh has no polygons: give one with cells of at least three vertices")
    return np.unique(np.sort(np.array(sides), axis=1), axis=0)


def numbers(values: Any, name: str, whole: bool = False) -> Any:
    """An array of real numbers, or `InputError`; whole ones as integers."""
    try:
        array = np.asarray(values)
        real = array if array.dtype.kind in "biuf" else array.astype(object).astype(float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} must be numbers, one row each, not {shown(values)}") from None
    if not whole:
        return real.astype(float)
    if not (np.isfinite(real).all() and (np.abs(real) < 2.0**53).all() and (real == np.round(real)).all()):
        raise InputError(f"{name} must be whole numbers: correct them")
    return real.astype(np.int64)


def unread(names: Iterable[str], known: Iterable[str]) -> tuple[str, ...]:
    """A sentence on values of edges that a source has and no network."""
    others = sorted(set(names) - set(known))
    return (f"values of edges that were not read: {', '.join(others[:8])}",) if others else ()


def counted(number: int, noun: str, verb: str = "") -> str:
    """A number with its noun and verb, such as "1 edge was" and "3 edges were"; the verb is given for one."""
    one = number == 1
    plural = {"vertex": "vertices", "self-stress": "self-stresses"}.get(noun, f"{noun}s")
    words = [f"{number:,}", noun if one else plural]
    if verb:
        words.append(verb if one else {"is": "are", "was": "were", "has": "have"}.get(verb, verb.removesuffix("s")))
    return " ".join(words)
