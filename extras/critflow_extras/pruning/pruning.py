"""The part of a network that can carry tension.

That is each block whose boundary opens it (`critflow.checks`), without bridges and dangling ends, which are blocks of
one edge, and without closed pieces that hang on one vertex.  A piece of springs that hangs on one vertex may still have
a self-stress of both signs; it does not change the moduli, and is removed too.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.checks import blocks, components, opened_edges
from critflow.networks import Array, IntArray, Network
from critflow.result import InputError, NetworkError

Mask = NDArray[np.bool_]


class Pruned(NamedTuple):
    """A network that can carry tension on every edge; `network.note` is a sentence about the edges removed.

    edges     (N_b,) index that each edge had before
    vertices  (N_v,) index that each vertex had before
    """

    network: Network
    edges: IntArray
    vertices: IntArray


@running("pruned")
def pruned(network: Network | ArrayLike, kept: ArrayLike | None = None, **arguments: Any) -> Pruned:
    """The largest part of a network that can carry tension on every edge, with the place of its edges in the whole.

    network    a `Network`; or edges (n, 2), with further arguments of `Network` by keyword, which need not all carry
               tension
    kept       mask (n,) of the edges that remain before this; all by default

    Vertices without edges are dropped too.  Raises `NetworkError` if nothing remains.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> import numpy as np
    >>> ce.pruned(cf.lattice("honeycomb", 3, 3), np.arange(27) != 0).network.n_edges
    26
    >>> part = ce.pruned([[0, 1], [1, 2], [1, 3]], pins={0: [0.0, 0.0], 2: [1.0, 0.0]})
    >>> part.network.n_edges, part.network.note
    (2, 'removed 1 of 3 edges, which cannot carry tension: 1 on bridges and dangling ends')
    """
    network = of_kind(np.ndarray, Network, network=network)
    of_kind(np.ndarray, None, kept=kept)
    if isinstance(network, Network):
        if arguments:
            raise NetworkError(f"a network takes no further {next(iter(arguments))!r}: give edges as an array, or less")
        whole = network
    else:
        n_vertices = 0 if arguments.get("positions") is None else len(np.atleast_1d(np.asarray(arguments["positions"])))
        whole = _Loose(network, **{"n_vertices": n_vertices, **arguments})  # type: ignore[arg-type]
    mask = np.ones(whole.n_edges, bool) if kept is None else np.asarray(kept)
    if mask.dtype != bool or mask.shape != (whole.n_edges,):
        raise NetworkError(f"kept must be a mask with one boolean per edge, shape ({whole.n_edges},)")
    number = np.flatnonzero(mask)
    part = carrying_part(whole.edges[number], whole.offsets[number], whole.pins, whole.n_vertices, whole.cell)
    return part_of(whole, number[part.edges], part.sentence)


class _Loose(Network):
    """Edges and a boundary, of which some edges need not carry tension."""

    _supported = False


class CarryingPart(NamedTuple):
    """The largest connected part whose edges can all carry tension, and the reason for each edge removed.

    edges        (n,) indices of its edges
    n_vertices   vertices of these edges
    directions   number of independent directions in which it winds around the cell
    bridges      edges of bridges and dangling ends
    closed       edges of pieces that hang on one vertex
    separate     edges that can carry tension, but in parts apart from the largest one
    """

    edges: IntArray
    n_vertices: int
    directions: int
    bridges: int
    closed: int
    separate: int

    @property
    def coordination(self) -> float:
        """Mean number of edges a vertex, z = 2 N_b/N_v."""
        return 2 * len(self.edges) / max(self.n_vertices, 1)

    @property
    def sentence(self) -> str:
        """The note on the edges removed."""
        counted = {
            "on bridges and dangling ends": self.bridges,
            "in closed pieces that hang on at most one vertex": self.closed,
            "in separate pieces": self.separate,
        }
        removed = [f"{count} {where}" for where, count in counted.items() if count]
        total = self.bridges + self.closed + self.separate
        if not total:
            return "every edge can carry tension"
        return f"removed {total} of {total + len(self.edges)} edges, which cannot carry tension: {', '.join(removed)}"


def carrying_part(
    edges: IntArray, offsets: IntArray, pins: Mapping[int, Array], n_vertices: int, cell: Array | None = None
) -> CarryingPart:
    """The part of edges (n, 2) with offsets (n, d) that can carry tension; all pins count as joined.

    The cell, if given, makes pins that differ by its vectors one place.
    """
    block, cycle_gain = blocks(edges, offsets, cell, pins, n_vertices)
    winds, carries = cycle_gain.any(axis=1), opened_edges(block, cycle_gain)
    size = np.bincount(block, minlength=len(edges))[block]

    vertex = np.arange(n_vertices)
    vertex[list(pins)] = min(pins, default=0)
    joined = vertex[edges]
    here = components(joined[carries], n_vertices)[joined[:, 0]]
    largest = np.bincount(here[carries], minlength=1).argmax()
    kept = carries & (here == largest)
    loops = np.unique(cycle_gain[kept & winds], axis=0)
    used = np.zeros(n_vertices, bool)
    used[edges[kept]] = True
    return CarryingPart(
        np.flatnonzero(kept),
        int(used.sum()),
        int(np.linalg.matrix_rank(loops[:, :-1])) if len(loops) else 0,
        int(np.sum(~carries & (size == 1))),
        int(np.sum(~carries & (size > 1))),
        int(np.sum(carries & ~kept)),
    )


def part_of(network: Network, kept: IntArray, note: str) -> Pruned:
    """The network of the edges with these indices, in rising order, with their places in the whole."""
    if len(kept) == 0:
        raise NetworkError("no edge can carry tension: no closed path winds around the cell or joins two pins")
    mask = np.zeros(network.n_edges, bool)
    mask[kept] = True
    part, vertices = network.part(mask, note)
    return Pruned(part, kept, vertices)


def taut_mask(network: Network, taut: ArrayLike) -> Mask:
    """A mask of edges (N_b,) that is somewhere true, else an `InputError`."""
    mask = np.asarray(taut)
    if mask.dtype != bool or mask.shape != (network.n_edges,) or not mask.any():
        raise InputError(f"taut edges are a mask of shape ({network.n_edges},), somewhere true: such as sigma != 0")
    return mask
