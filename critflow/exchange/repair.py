"""From a record to a network: each repair with one sentence, or refusal of all repairs.

Repairs, in this order: dimensions without extent, self loops, repeated edges, bare vertices, edges between fixed
vertices, and edges that cannot carry tension.  Edges that cross get a vertex, and chains are contracted, on request.
Nothing is dropped silently.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from critflow.exchange.boundaries import require_boundary
from critflow.exchange.chains import contracted
from critflow.exchange.crossings import crossings_of, split
from critflow.exchange.data import Array, IntArray, NetworkData, bond_vectors_of, counted
from critflow.networks.network import Network
from critflow.networks.pruning import carrying_part
from critflow.result import NetworkError, Solution, Stats, Status

# Coordinates that vary by less than this part of the size of a network have no extent.
_FLAT = 1e-9


@dataclass(frozen=True, eq=False, kw_only=True)
class ImportedNetwork(Solution[Network]):
    """A network from another program; `print` shows how it was read and repaired.

    notes            one sentence on each property of the source and each repair
    data             the record that the network was made of, after the repairs
    edges_kept       (N_b,) edge of the source of each edge
    vertices_kept    (N_v,) vertex of the source of each vertex; -1 for one at a crossing of edges
    repaired         whether anything was changed
    """

    notes: tuple[str, ...] = ()
    data: NetworkData = field(repr=False)
    edges_kept: IntArray = field(repr=False)
    vertices_kept: IntArray = field(repr=False)
    repaired: bool = False

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
    def vertex_names(self) -> tuple[str, ...]:
        """Names or numbers of the vertices in the source; "crossing" for those at a crossing of edges."""
        if self.data.ids:
            return self.data.ids
        return tuple("crossing" if vertex < 0 else str(vertex) for vertex in self.vertices_kept)

    def __str__(self) -> str:
        lines = [f"{self.data.source}: {described(self.value)}", *self.notes]
        return "\n  ".join(lines)


def described(network: Network) -> str:
    """One line: sizes, boundary and mean coordination."""
    kind = "periodic" if network.cell is not None else f"{len(network.pins)} fixed vertices"
    z = 2 * network.n_edges / network.n_vertices
    return f"{network.n_vertices:,} vertices, {network.n_edges:,} edges, {network.dimension}D, {kind}, z = {z:.3g}"


class _Ledger:
    """The current record, the source's index of its edges and vertices, and the sentences of the repairs."""

    def __init__(self, data: NetworkData, strict: bool):
        self.data, self.strict = data, strict
        self.edges = np.arange(data.n_edges)
        self.vertices = np.arange(data.n_vertices)
        self.sentences: list[str] = []
        self.changed = False

    def note(self, sentence: str) -> None:
        if self.strict:
            raise NetworkError(f"strict=True refuses this repair: {sentence}; correct the source, or leave strict out")
        self.changed = True
        self.sentences.append(sentence)

    def keep_edges(self, kept: NDArray[np.bool_]) -> None:
        self.data, self.edges = self.data.with_edges(kept), self.edges[kept]

    def keep_vertices(self, kept: NDArray[np.bool_]) -> None:
        self.edges = self.edges[kept[self.data.edges].all(axis=1)]
        self.vertices = self.vertices[kept]
        self.data = self.data.with_vertices(kept)


def imported(
    data: NetworkData, strict: bool = False, contract: bool = False, join_crossings: bool = False
) -> ImportedNetwork:
    """The network of a checked record with all offsets and fixed vertices known.

    strict    refuse a record that needs any repair, with `NetworkError`
    contract  replace each chain of edges through vertices of two edges by one edge: springs in series
    join_crossings  put a vertex where two edges of a planar network cross
    """
    ledger = _Ledger(data, strict)
    for sentence in data.repairs:
        ledger.note(sentence)
    _without_loops(ledger)
    _without_repeats(ledger)
    require_boundary(ledger.data)
    _crossings(ledger, join_crossings)
    bare = int((np.bincount(ledger.data.edges.ravel(), minlength=ledger.data.n_vertices) == 0).sum())
    if bare:
        ledger.note(f"{counted(bare, 'vertex')} without edges, removed")
    _without_fixed_edges(ledger)
    _carrying(ledger)
    _without_bare(ledger)
    _chains(ledger, contract)
    found = ledger.data
    ledger.sentences.extend(_without_length(found))
    network = Network(
        found.edges,
        found.offsets,  # type: ignore[arg-type]
        found.cell,
        1.0 if found.stiffness is None else found.stiffness,  # type: ignore[arg-type]
        {i: found.positions[i] for i in found.pins},
        n_vertices=found.n_vertices,
        positions=found.positions,
    )
    notes = (*data.notes, *_digits(data), *ledger.sentences)
    stats = Stats(f"read {data.source}", len(ledger.sentences))
    return ImportedNetwork(
        value=network,
        status=Status.ok,
        stats=stats,
        note="; ".join(ledger.sentences),
        notes=notes,
        data=found,
        edges_kept=ledger.edges,
        vertices_kept=ledger.vertices,
        repaired=ledger.changed,
    )


def in_its_plane(data: NetworkData) -> NetworkData:
    """A sheet in three dimensions reduced to its plane, out of which nothing would resist a motion."""
    if data.dimension != 3:
        return data
    extent = np.ptp(data.positions, axis=0)
    flat = np.flatnonzero(extent <= _FLAT * max(float(extent.max()), 1e-300))
    if len(flat) != 1:
        return data
    k = int(flat[0])
    others = [axis for axis in range(3) if axis != k]
    cell, offsets, bonds = data.cell, data.offsets, data.bond_vectors
    if bonds is not None:
        if np.abs(bonds[:, k]).max() > _FLAT * float(extent.max()):
            return data
        bonds = bonds[:, others]
    if cell is not None:
        crossing = offsets is not None and offsets[:, k].any()
        if crossing or np.abs(cell[k, others]).max() > 0 or np.abs(cell[others, k]).max() > 0:
            return data
        cell = cell[np.ix_(others, others)]
        offsets = None if offsets is None else offsets[:, others]
    plane = replace(data, positions=data.positions[:, others], cell=cell, offsets=offsets, bond_vectors=bonds)
    # Many formats know three dimensions only, so this is no fault of the source.
    return plane.noting(f"all vertices have one {'xyz'[k]}, so the network was read as two-dimensional")


def _without_loops(ledger: _Ledger) -> None:
    data = ledger.data
    loops = data.edges[:, 0] == data.edges[:, 1]
    if data.offsets is not None:
        loops &= ~data.offsets.any(axis=1)
    if loops.any():
        ledger.keep_edges(~loops)
        ledger.note(f"{counted(int(loops.sum()), 'edge')} from a vertex to itself, removed")


def _without_repeats(ledger: _Ledger) -> None:
    """One edge of each set with the same ends and offset, in either direction."""
    data = ledger.data
    if not data.n_edges:
        raise NetworkError("every edge joins a vertex to itself: give edges between different vertices")
    edges = data.edges
    offsets = np.zeros((len(edges), 0), np.int64) if data.offsets is None else np.asarray(data.offsets)
    first = np.argmax(offsets != 0, axis=1) if offsets.shape[1] else np.zeros(len(edges), int)
    leading = offsets[np.arange(len(edges)), first] if offsets.shape[1] else np.zeros(len(edges), int)
    turned = (edges[:, 0] > edges[:, 1]) | ((edges[:, 0] == edges[:, 1]) & (leading < 0))
    key = np.concatenate([np.sort(edges, axis=1), np.where(turned[:, None], -offsets, offsets)], axis=1)
    _, where, inverse, count = np.unique(key, axis=0, return_index=True, return_inverse=True, return_counts=True)
    repeated = len(edges) - len(where)
    if not repeated:
        return
    both = bool((count == 2).all()) and bool(np.bincount(inverse.ravel(), turned.astype(float)).all())
    kept = np.zeros(len(edges), bool)
    kept[where] = True
    ledger.keep_edges(kept)
    ledger.note(
        f"every edge was given in both directions (a full neighbour list); one of each, {len(where)}, was kept"
        if both
        else f"{counted(repeated, 'repeated edge', 'was')} removed"
    )


def _crossings(ledger: _Ledger, join: bool) -> None:
    """Edges of a planar network that cross: reported, or joined by a vertex."""
    data = ledger.data
    if data.dimension != 2:
        return
    found = crossings_of(data)
    if not len(found.pairs):
        return
    i, j = found.pairs[0]
    if not join:
        ledger.sentences.append(
            f"{counted(len(found.pairs), 'crossing')} of two edges without a vertex, edges {ledger.edges[i]} and "
            f"{ledger.edges[j]} first; join_crossings=True puts one there"
        )
        return
    ledger.data, owner = split(data, found)
    ledger.edges = ledger.edges[owner]
    ledger.vertices = np.concatenate([ledger.vertices, np.full(ledger.data.n_vertices - data.n_vertices, -1)])
    ledger.note(f"{counted(len(found.pairs), 'crossing')} of two edges, joined by a vertex there")


def _without_fixed_edges(ledger: _Ledger) -> None:
    data = ledger.data
    fixed = np.zeros(data.n_vertices, bool)
    fixed[list(data.pins)] = True
    between = np.asarray(fixed[data.edges].all(axis=1))
    if between.all():
        raise NetworkError("every edge joins two fixed vertices, so none can carry tension: fix fewer of them")
    if between.any():
        ledger.keep_edges(~between)
        ledger.note(
            f"{counted(int(between.sum()), 'edge')} between fixed vertices, removed: no motion changes the length"
        )


def _carrying(ledger: _Ledger) -> None:
    """The largest part of which every edge can carry tension."""
    data = ledger.data
    offsets = np.zeros((data.n_edges, data.dimension), np.int64) if data.offsets is None else np.asarray(data.offsets)
    part = carrying_part(data.edges, offsets, {i: data.positions[i] for i in data.pins}, data.n_vertices, data.cell)
    if len(part.edges) == data.n_edges:
        return
    if not len(part.edges):
        raise NetworkError(
            "no edge can carry tension: no closed path winds around the cell or joins two fixed vertices: fix more "
            "vertices, or give the cell"
        )
    kept = np.zeros(data.n_edges, bool)
    kept[part.edges] = True
    ledger.keep_edges(kept)
    ledger.note(part.sentence)


def _without_bare(ledger: _Ledger) -> None:
    """Remove vertices without edges, which edges removed before may have left."""
    used = np.zeros(ledger.data.n_vertices, bool)
    used[ledger.data.edges] = True
    if not used.all():
        ledger.keep_vertices(used)


def _chains(ledger: _Ledger, contract: bool) -> None:
    """Vertices of two edges: reported, or replaced by springs in series."""
    data = ledger.data
    degree = np.bincount(data.edges.ravel(), minlength=data.n_vertices)
    loops = data.edges[data.edges[:, 0] == data.edges[:, 1], 0]
    middle = degree == 2
    middle[list(data.pins)] = False
    middle[loops] = False
    if not middle.any():
        return
    if not contract:
        ledger.sentences.append(
            f"{counted(int(middle.sum()), 'vertex', 'has')} two edges, which are in line under tension; "
            "contract=True joins them"
        )
        return
    merged, edge = contracted(data, middle)
    ledger.data, ledger.edges = merged, ledger.edges[edge]
    ledger.vertices = ledger.vertices[~middle]
    ledger.note(f"{counted(int(middle.sum()), 'vertex')} of two edges, removed; the springs were joined in series")
    _without_loops(ledger)


def _without_length(data: NetworkData) -> tuple[str, ...]:
    """A sentence on edges whose ends have one position."""
    short = np.flatnonzero(np.linalg.norm(bond_vectors_of(data), axis=1) == 0)
    if not len(short):
        return ()
    i, j = (data.name(int(vertex)) for vertex in data.edges[short[0]])
    return (
        f"{counted(len(short), 'edge', 'has')} no length, between vertices {i} and {j} first: its direction is "
        "unknown, so move them apart or join them",
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
