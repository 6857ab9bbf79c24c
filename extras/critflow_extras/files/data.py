"""The record between files and networks: vertices, edges and boundary as they were read, before any check."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from critflow.arguments import floats, integers
from critflow.network_files import stored_configuration
from critflow.result import EnvironmentFailure, InputError, Record
from critflow_extras.pruning.digits import Digits, digits_of

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Values of edges, and the names that files and objects have for them; the first is written.
EDGE_VALUES = {
    "stiffness": ("stiffness", "k"),
    "rest_lengths": ("rest_length", "rest_lengths", "length0", "l0"),
    "force_densities": ("force_density", "sigma", "q"),
}
# Numbers in text.  Python also reads 1_0 and digits of other scripts.
NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|[Nn]a[Nn]|[+-]?[Ii]nf"
# Fields of a record with one row for each edge.
EDGE_FIELDS = ("edges", "offsets", "bond_vectors", *EDGE_VALUES, "sides", "edge_numbers")


@dataclass(frozen=True, eq=False, repr=False)
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
    sides            (N_b, 2) polygons of the source on both sides of each edge; -1: none
    volume           V to which the moduli of a network without a cell refer
    border           vertices at the edges of a label mask
    ids              name of each vertex in the source
    known_digits     digits of the coordinates where a format fixes them; None: to be found
    nearest_images   whether the format defines edges by nearest images
    source           format, for messages
    notes            sentences on how the source was read, its repairs, and what else is unusual
    repaired         whether anything was corrected, which a strict reading refuses
    edge_numbers     (N_b,) edge of the source of each edge
    vertex_numbers   (N_v,) vertex of the source of each vertex

    Raises `NetworkError` for values that are no numbers, and for edges and offsets that are not whole.
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
    sides: IntArray | None = None
    volume: float | None = None
    border: tuple[int, ...] = ()
    ids: tuple[str, ...] = ()
    known_digits: Digits | None = None
    nearest_images: bool = False
    source: str = "arrays"
    notes: tuple[str, ...] = ()
    repaired: bool = False
    edge_numbers: IntArray | None = None
    vertex_numbers: IntArray | None = None

    def __post_init__(self) -> None:
        whole = ("edges", "offsets", "sides", "edge_numbers", "vertex_numbers")
        for name in (*whole, "positions", "cell", "bond_vectors", *EDGE_VALUES):
            values, kind = getattr(self, name), np.int64 if name in whole else np.float64
            if values is not None and getattr(values, "dtype", None) != kind:
                array = integers(values, name) if name in whole else floats(values, name)
                object.__setattr__(self, name, array)

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

    @property
    def is_pin(self) -> NDArray[np.bool_]:
        """Which vertices are fixed, (N_v,)."""
        return np.isin(np.arange(self.n_vertices), self.pins)

    def name(self, vertex: int) -> str:
        """Name of a vertex in the source."""
        return self.ids[vertex] if self.ids else str(vertex)

    def with_edges(self, kept: NDArray[np.bool_] | IntArray) -> NetworkData:
        """The same vertices with some of the edges, by a mask or by indices, which may repeat."""
        values = ((name, getattr(self, name)) for name in EDGE_FIELDS)
        return replace(self, **{name: array[kept] for name, array in values if array is not None})

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
            vertex_numbers=None if self.vertex_numbers is None else self.vertex_numbers[kept],
        )

    def noting(self, *sentences: str) -> NetworkData:
        """The same data with further sentences on how it was read, or on something unusual that is left as it is."""
        return replace(self, notes=(*self.notes, *sentences))

    def repairing(self, sentence: str) -> NetworkData:
        """The same data with a sentence on a correction."""
        return replace(self, notes=(*self.notes, sentence), repaired=True)


def from_dataset(case: Any) -> NetworkData:
    """A case of a dataset, selected by its axis values, such as `dataset.sel(seed=3, population="max_B_0")`."""
    arrays: dict[str, Any] = stored_configuration(case)
    positions, sigma = arrays.pop("position"), arrays.pop("sigma")
    return NetworkData(positions=positions, force_densities=sigma, source="critflow dataset", **arrays)


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


def edge_values(data: NetworkData) -> dict[str, Any]:
    """The values of edges that a record has, by the names under which they are written."""
    known = ((names[0], getattr(data, field)) for field, names in EDGE_VALUES.items())
    return {name: values for name, values in known if values is not None}


def number(text: str) -> float:
    """The number that a text is, else a `ValueError`."""
    if not re.fullmatch(NUMBER, text):
        raise ValueError(f"{text!r:.40} is no number: correct it")
    return float(text)


def polygon_edges(polygons: Sequence[Sequence[int]]) -> tuple[IntArray, IntArray]:
    """Sides of polygons, each once, (N_b, 2), and the first and last polygon that has each; -1: one only."""
    corners = np.array([corner for polygon in polygons for corner in polygon], dtype=np.int64)
    after = np.array([corner for polygon in polygons for corner in (*polygon[1:], polygon[0])], dtype=np.int64)
    owner = np.repeat(np.arange(len(polygons)), [len(polygon) for polygon in polygons])
    pairs = np.sort(np.column_stack([corners, after]), axis=1)
    edges, first, edge = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
    # The last of several assignments stands.
    last = np.zeros(len(edges), np.int64)
    last[edge.ravel()] = np.arange(len(pairs))
    return edges, np.column_stack([owner[first], np.where(last == first, -1, owner[last])])


def vertices_on_edges(x: Array, edges: IntArray, tolerance: ArrayLike) -> IntArray:
    """Edge and vertex (n, 2) where an end of other edges lies on an edge, between its ends; in turn along each edge.

    tolerance  distance from the edge and from its ends, one number or (N_b,)
    """
    ends = np.unique(edges)
    tail, along = x[edges[:, 0]], x[edges[:, 1]] - x[edges[:, 0]]
    length = np.linalg.norm(along, axis=1)
    near = cKDTree(x[ends]).query_ball_point(tail + along / 2, length / 2)
    edge = np.repeat(np.arange(len(edges)), [len(one) for one in near])
    vertex = ends[np.concatenate([*near, []]).astype(np.int64)]
    direction = along[edge] / np.maximum(length[edge], np.finfo(float).tiny)[:, None]
    apart = x[vertex] - tail[edge]
    at = np.einsum("nd,nd->n", apart, direction)
    off = np.linalg.norm(apart - at[:, None] * direction, axis=1)
    most = np.broadcast_to(tolerance, len(edges))[edge]
    on = np.flatnonzero((off <= most) & (at > most) & (length[edge] - at > most))
    return np.column_stack([edge, vertex])[on[np.lexsort([at[on], edge[on]])]]


def optional(module: str) -> Any:
    """Import an optional module; `EnvironmentFailure` with the install command where it is missing."""
    try:
        return import_module(module)
    except ImportError:
        package, install = module.split(".")[0], "pip install 'critflow-extras[formats]'"
        raise EnvironmentFailure(f"this format needs {package}, which is not installed: {install}") from None


def require_regular(path: Path) -> None:
    """Raise `InputError` for a pipe or a device, whose reading may never end."""
    if path.exists() and not path.is_file() and not path.is_dir():
        raise InputError(f"{path} is no regular file: copy its contents into one")


def unread(names: Iterable[str], known: Iterable[str]) -> tuple[str, ...]:
    """A sentence on values of edges that a source has and no network."""
    unknown = sorted(set(names) - set(known))
    return (f"values of edges that were not read: {', '.join(unknown[:8])}",) if unknown else ()


def counted(number: int, noun: str, verb: str = "") -> str:
    """A number with its noun and verb, such as "1 edge was" and "3 edges were"; the verb is given for one."""
    one = number == 1
    plural = {"vertex": "vertices", "self-stress": "self-stresses"}.get(noun, f"{noun}s")
    words = [f"{number:,}", noun if one else plural]
    if verb:
        words.append(verb if one else {"is": "are", "was": "were", "has": "have"}.get(verb, verb.removesuffix("s")))
    return " ".join(words)
