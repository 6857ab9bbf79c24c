"""From a record to a network: each repair with one sentence, or refusal of all repairs.

Repairs, in this order: dimensions without extent, self loops, repeated edges, bare vertices, edges between fixed
vertices, and edges that cannot carry tension.  Chains are contracted on request.  Nothing is dropped silently.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from critflow.arguments import finite_rows
from critflow.checks import check_ends, components
from critflow.faces import Faces, planar_faces
from critflow.manifold import CriticalConfiguration
from critflow.networks import Network
from critflow.result import InputError, NetworkError, Solution, Stats, Status
from critflow_extras.files.boundaries import require_boundary
from critflow_extras.files.data import (
    EDGE_VALUES,
    Array,
    IntArray,
    NetworkData,
    bond_vectors_of,
    counted,
    vertices_on_edges,
)
from critflow_extras.pruning.pruning import carrying_part

# Volumes of unit cell vectors below this are none.
_NO_VOLUME = 1e-9
# Squares of coordinates beyond this overflow.
_FAR = 1e100
# Coordinates that vary by less than this part of the size of a network have no extent.
_FLAT = 1e-9
# Vertices within this part of the length of an edge from it are on it.
_TOUCHING = 1e-9


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ImportedNetwork(Solution[Network]):
    """A network from another program; `print` shows how it was read and repaired.

    data   the record that the network was made of, after the repairs
    """

    data: NetworkData = field(repr=False)

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence on each property of the source and each repair."""
        return self.data.notes

    @property
    def network(self) -> Network:
        """The network, the same as `value`."""
        return self.value

    @property
    def positions(self) -> Array:
        """Positions (N_v, d) as read."""
        return self.data.positions

    @property
    def rest_lengths(self) -> Array | None:
        """Rest lengths ℓ (N_b,) of the source, if it has any."""
        return self.data.rest_lengths

    @property
    def force_densities(self) -> Array | None:
        """Force densities σ (N_b,) of the source, if it has any."""
        return self.data.force_densities

    @property
    def configuration(self) -> CriticalConfiguration:
        """The critical configuration of these positions and force densities, such as that of a case of a dataset.

        Raises `InputError` for a source without force densities, and where a repair changed the network.
        """
        if self.force_densities is None:
            raise InputError("the source has no force densities: nearest_critical(network, positions) estimates them")
        if self.repaired:
            raise InputError("the network was repaired, so these force densities may not balance: see its notes")
        x, rest = self.positions, self.rest_lengths
        vectors = self.network.bond_vectors(x)
        return CriticalConfiguration(self.network, self.force_densities, x, vectors, rest_lengths=rest)

    @property
    def sides(self) -> sp.csr_array:
        """A (N_f, N_b), the edges on the perimeter of each polygon of the source, for `tissue`.

        Sides between two fixed vertices are no edges, and constant.  Raises `InputError` for a source without polygons.
        """
        if self.data.sides is None:
            raise InputError("the source names no polygons: give polygons= or labels=, or use the faces of the network")
        edge, side = np.nonzero(self.data.sides >= 0)
        polygon = np.unique(self.data.sides[edge, side], return_inverse=True)[1]
        return sp.csr_array((np.ones(len(edge)), (polygon, edge)), shape=(int(polygon.max()) + 1, self.value.n_edges))

    @property
    def repaired(self) -> bool:
        """Whether anything was changed."""
        return self.data.repaired

    @property
    def vertex_names(self) -> tuple[str, ...]:
        """Names or numbers of the vertices in the source."""
        return self.data.ids or tuple(map(str, np.asarray(self.data.vertex_numbers).tolist()))

    def __str__(self) -> str:
        return "\n  ".join([f"{self.data.source}: {described(self.value)}", *self.notes])


def described(network: Network) -> str:
    """One line: sizes, boundary and mean coordination."""
    kind = "periodic" if network.cell is not None else f"{len(network.pins)} fixed vertices"
    z = 2 * network.n_edges / network.n_vertices
    return f"{network.n_vertices:,} vertices, {network.n_edges:,} edges, {network.dimension}D, {kind}, z = {z:.3g}"


def imported(read: NetworkData, strict: bool = False, contract: bool = False) -> ImportedNetwork:
    """The network of a checked record with all offsets and fixed vertices known.

    strict    refuse a record that needs any repair, with `NetworkError`
    contract  replace each chain of edges through vertices of two edges by one edge: springs in series
    """
    steps = (
        *(_without_loops, _without_repeats, require_boundary, _without_bare, _without_fixed_edges),
        *(_carrying, partial(_with_chains, join=contract), _with_short_edges),
    )
    data = replace(read, edge_numbers=np.arange(read.n_edges), vertex_numbers=np.arange(read.n_vertices))
    for step in steps:
        data = step(data)
        if strict and data.repaired:
            raise NetworkError(f"strict=True refuses: {data.notes[-1]}; correct the source, or leave strict out")
    data = replace(data, notes=(*read.notes, *_digits(read), *data.notes[len(read.notes) :]))
    faces, note = _faces(data)
    data = data.noting(*note)
    network = Network(
        data.edges,
        data.offsets,  # type: ignore[arg-type]
        data.cell,
        1.0 if data.stiffness is None else data.stiffness,  # type: ignore[arg-type]
        {i: data.positions[i] for i in data.pins},
        n_vertices=data.n_vertices,
        positions=data.positions,
        faces=faces,
    )
    return ImportedNetwork(
        value=network,
        status=Status.ok,
        stats=Stats(f"read {data.source}", len(data.notes)),
        data=data,
    )


def _faces(data: NetworkData) -> tuple[Faces | None, tuple[str, ...]]:
    """The faces of a planar network without crossings, or a sentence on why it has none.

    Where the source names polygons, those that are whole.
    """
    if data.dimension != 2:
        return None, ()
    try:
        faces = planar_faces(data.edges, bond_vectors_of(data), data.n_vertices)
    except NetworkError as error:
        return None, (f"the network has no faces: {error}",)
    tolerance = _TOUCHING * np.linalg.norm(bond_vectors_of(data), axis=1)
    # Edges that overlap do not cross either.
    if data.cell is None and len(on := vertices_on_edges(data.positions, data.edges, tolerance)):
        n, (edge, one) = len(np.unique(on[:, 1])), on[0].tolist()
        vertex, a, b = (data.name(end) for end in (one, *data.edges[edge].tolist()))
        return None, (
            f"the network has no faces: {counted(n, 'vertex', 'lies')} on an edge without being its end, vertex "
            f"{vertex} on edge {a}-{b} first: split such edges, those of polygons by weld=",
        )
    if data.sides is None:
        return faces, ()
    # A polygon is whole where it borders every edge of a walk; holes between polygons are no faces.
    named = np.repeat(data.sides[faces.edges[faces.starts[:-1]]], faces.sizes, axis=0)
    sides = data.sides[faces.edges]
    borders = ((named[:, :, None] == sides[:, None]) & (named[:, :, None] >= 0)).any(axis=2)
    whole = np.logical_and.reduceat(borders, faces.starts[:-1]).any(axis=1)
    kept, starts = np.repeat(whole, faces.sizes), np.concatenate([[0], np.cumsum(faces.sizes[whole])])
    return Faces(faces.edges[kept], faces.signs[kept], starts), ()


def check(data: NetworkData) -> None:
    """Raise `NetworkError` for values that no repair can correct."""
    n, d = data.n_edges, data.positions.shape[-1]
    if data.edges.ndim != 2 or data.edges.shape[1:] != (2,) or not n:
        raise NetworkError("the source has no edges: give pairs of vertices")
    if data.positions.ndim != 2 or not 1 <= d <= 3:
        raise NetworkError(f"positions must have two or three columns, not the shape {data.positions.shape}")
    finite_rows(data.positions, "positions", data.positions.shape)
    check_ends(data.edges, data.n_vertices)
    if np.abs(data.positions).max(initial=0.0) > _FAR:
        raise NetworkError(f"positions lie beyond {_FAR:.0e}: choose other units")
    for name, shape in (("offsets", (n, d)), ("bond_vectors", (n, d)), *((name, (n,)) for name in EDGE_VALUES)):
        if (values := getattr(data, name)) is not None:
            finite_rows(values, name, shape)
    if data.rest_lengths is not None and (short := np.flatnonzero(data.rest_lengths < 0)).size:
        raise NetworkError(f"rest_lengths[{short[0]}] = {data.rest_lengths[short[0]]} is negative: correct that value")
    if data.cell is not None:
        finite = np.isfinite(data.cell).all() and np.abs(data.cell).max() < _FAR
        sides = np.linalg.norm(data.cell, axis=1) if finite else np.zeros(1)
        if not sides.all() or abs(np.linalg.det(data.cell / sides[:, None])) < _NO_VOLUME:
            raise NetworkError("the cell vectors must be finite and span a volume: correct the cell")


def in_its_plane(data: NetworkData) -> NetworkData:
    """A sheet in three dimensions reduced to its plane, out of which nothing would resist a motion."""
    if data.dimension != 3:
        return data
    extent = np.ptp(data.positions, axis=0)
    flat = np.flatnonzero(extent <= _FLAT * max(float(extent.max()), 1e-300))
    if len(flat) != 1:
        return data
    k = int(flat[0])
    kept = [axis for axis in range(3) if axis != k]
    cell, offsets, bonds = data.cell, data.offsets, data.bond_vectors
    if bonds is not None:
        if np.abs(bonds[:, k]).max() > _FLAT * float(extent.max()):
            return data
        bonds = bonds[:, kept]
    if cell is not None:
        crossing = offsets is not None and offsets[:, k].any()
        if crossing or np.abs(cell[k, kept]).max() > 0 or np.abs(cell[kept, k]).max() > 0:
            return data
        cell = cell[np.ix_(kept, kept)]
        offsets = None if offsets is None else offsets[:, kept]
    plane = replace(data, positions=data.positions[:, kept], cell=cell, offsets=offsets, bond_vectors=bonds)
    # Many formats know three dimensions only, so this is no fault of the source.
    return plane.noting(f"all vertices have one {'xyz'[k]}, so the network was read as two-dimensional")


def _without_loops(data: NetworkData) -> NetworkData:
    loops = data.edges[:, 0] == data.edges[:, 1]
    if data.offsets is not None:
        loops &= ~data.offsets.any(axis=1)
    if not loops.any():
        return data
    if loops.all():
        raise NetworkError("every edge joins a vertex to itself: give edges between different vertices")
    return data.with_edges(~loops).repairing(f"{counted(int(loops.sum()), 'edge')} from a vertex to itself, removed")


def _without_repeats(data: NetworkData) -> NetworkData:
    """One edge of each set with the same ends and offset, in either direction."""
    edges = data.edges
    offsets = np.zeros((len(edges), 1), np.int64) if data.offsets is None else data.offsets
    leading = offsets[np.arange(len(edges)), np.argmax(offsets != 0, axis=1)]
    turned = (edges[:, 0] > edges[:, 1]) | ((edges[:, 0] == edges[:, 1]) & (leading < 0))
    key = np.concatenate([np.sort(edges, axis=1), np.where(turned[:, None], -offsets, offsets)], axis=1)
    _, first, inverse, count = np.unique(key, axis=0, return_index=True, return_inverse=True, return_counts=True)
    repeated = len(edges) - len(first)
    if not repeated:
        return data
    both = bool((count == 2).all()) and bool(np.bincount(inverse.ravel(), turned.astype(float)).all())
    return data.with_edges(np.sort(first)).repairing(
        f"every edge was given in both directions (a full neighbour list); one of each, {len(first)}, was kept"
        if both
        else f"{counted(repeated, 'repeated edge', 'was')} removed"
    )


def _without_bare(data: NetworkData) -> NetworkData:
    part = _of_edges(data)
    bare = data.n_vertices - part.n_vertices
    return part.repairing(f"{counted(bare, 'vertex')} without edges, removed") if bare else data


def _of_edges(data: NetworkData) -> NetworkData:
    """The record without vertices that have no edges, which are those of edges removed before."""
    return data.with_vertices(np.bincount(data.edges.ravel(), minlength=data.n_vertices) > 0)


def _without_fixed_edges(data: NetworkData) -> NetworkData:
    between = np.asarray(data.is_pin[data.edges].all(axis=1))
    if between.all():
        raise NetworkError("every edge joins two fixed vertices, so none can carry tension: fix fewer of them")
    if not between.any():
        return data
    sentence = f"{counted(int(between.sum()), 'edge')} between fixed vertices, removed: no motion changes the length"
    return _of_edges(data.with_edges(~between).repairing(sentence))


def _carrying(data: NetworkData) -> NetworkData:
    """The largest part of which every edge can carry tension."""
    offsets = np.zeros((data.n_edges, data.dimension), np.int64) if data.offsets is None else data.offsets
    part = carrying_part(data.edges, offsets, {i: data.positions[i] for i in data.pins}, data.n_vertices, data.cell)
    if len(part.edges) == data.n_edges:
        return data
    if not len(part.edges):
        raise NetworkError("no edge can carry tension: fix more vertices, or give the cell")
    return _of_edges(data.with_edges(part.edges).repairing(part.sentence))


def _with_chains(data: NetworkData, join: bool) -> NetworkData:
    """Vertices of two edges and no other reason to be there, reported or removed with their springs in series."""
    degree = np.bincount(data.edges.ravel(), minlength=data.n_vertices)
    degree[data.edges[data.edges[:, 0] == data.edges[:, 1], 0]] = 0
    middle = (degree == 2) & ~data.is_pin
    if not (count := int(middle.sum())):
        return data
    if not join:
        return data.noting(
            f"{counted(count, 'vertex', 'has')} two edges, which are in line under tension; contract=True joins them"
        )
    sentence = f"{counted(count, 'vertex')} of two edges, removed; the springs were joined in series"
    return _of_edges(_without_loops(_contracted(data, middle).repairing(sentence)))


def _contracted(data: NetworkData, middle: NDArray[np.bool_]) -> NetworkData:
    """The record without the vertices inside chains: springs joined in series, lengths added, closed chains left out.

    Each chain has the number and the direction of its first edge.
    """
    chain, direction = _chains(data.edges, middle)
    first = np.unique(chain, return_index=True)[1]
    walked = np.where(direction[:, None] > 0, data.edges, data.edges[:, ::-1])
    ends = np.full((len(first), 2), -1)
    for side in (0, 1):
        outer = ~middle[walked[:, side]]
        ends[chain[outer], side] = walked[outer, side]
    is_open = (ends >= 0).all(axis=1)
    if not is_open.any():
        raise InputError("the network is a single closed chain: nothing is left to contract")

    def total(values: Array) -> Array:
        """Sums over each open chain."""
        return np.bincount(chain, values)[is_open].astype(float)

    offsets = None
    if data.offsets is not None:
        offsets = np.stack([total(direction * axis) for axis in data.offsets.T], axis=1).astype(np.int64)
    joined = replace(
        data.with_edges(first[is_open]),
        edges=ends[is_open],
        offsets=offsets,
        bond_vectors=None,
        stiffness=1 / total(np.ones(data.n_edges) if data.stiffness is None else 1 / data.stiffness),
        rest_lengths=None if data.rest_lengths is None else total(data.rest_lengths),
        force_densities=None,
    )
    return joined.with_vertices(~middle)


def _chains(edges: IntArray, middle: NDArray[np.bool_]) -> tuple[IntArray, IntArray]:
    """The chain (N_b,) of each edge, counted in the order of their first edges, and its direction ±1 along that edge.

    middle  (N_v,) which vertices are inside chains: each has two edges, or twice the same one
    """
    m, ends = len(edges), edges.ravel()
    order = np.argsort(ends, kind="stable")
    first, second = order[middle[ends[order]]].reshape(-1, 2).T
    # Of two edges that meet, one turns round unless the head of one is the tail of the other.
    turned = m * (first % 2 == second % 2)
    first, second = first // 2, second // 2
    # Both directions of each edge are nodes of a graph whose components are the directed chains.
    rows, columns = np.concatenate([first, first + m]), np.concatenate([second + turned, second + (m - turned)])
    forward, backward = components(np.column_stack([rows, columns]), 2 * m).reshape(2, m)
    _, start, chain = np.unique(np.minimum(forward, backward), return_index=True, return_inverse=True)
    return chain, np.where(forward == forward[start][chain], 1, -1)


def _with_short_edges(data: NetworkData) -> NetworkData:
    """Edges whose ends have one position."""
    short = np.flatnonzero(np.linalg.norm(bond_vectors_of(data), axis=1) == 0)
    if not len(short):
        return data
    i, j = (data.name(int(vertex)) for vertex in data.edges[short[0]])
    return data.noting(
        f"{counted(len(short), 'edge', 'has')} no length, between vertices {i} and {j} first: its direction is "
        "unknown, so move them apart or join them"
    )


def _digits(data: NetworkData) -> tuple[str, ...]:
    """A sentence on coordinates that were rounded, and its effect on counts."""
    digits = data.digits
    if not digits.error:
        return ()
    known = f"coordinates have {digits.words}"
    effect = digits.effect(np.linalg.norm(bond_vectors_of(data), axis=1))
    if not effect:
        return (f"{known} and count as exact; if they are rounded, counts next to the transition mean nothing",)
    return (
        f"{known}, so lengths are known to {digits.error:.0e}: singular values below {effect:.0e} may be those "
        "of motions and self-stresses; nearest_critical restores a critical configuration that was rounded",
    )
