"""Several copies of a periodic cell as one larger cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from critflow.exchange.data import NetworkData
from critflow.result import InputError

Copies = int | Sequence[int]

# Edges of copies that fit into the memory of a usual computer with their file.
_MOST_EDGES = 10_000_000


def tiled(data: NetworkData, copies: Copies) -> NetworkData:
    """The record of copies of the cell along each cell vector, one number or d numbers, joined as one periodic network.

    Raises `InputError` for numbers that are not positive and whole, and where there is no cell to repeat.
    """
    counts, d = np.asarray(copies), data.dimension
    if counts.dtype.kind not in "iu" or counts.shape not in ((), (1,), (d,)) or (counts < 1).any():
        raise InputError(
            f"copies must be a whole number from 1, or one for each of the {d} cell vectors, not {copies!r:.40}"
        )
    counts = np.broadcast_to(counts, (d,)).astype(np.int64)
    if (counts == 1).all():
        return data
    if data.cell is None or data.offsets is None:
        raise InputError("copies repeat a periodic cell, and this network has none: leave copies out")
    edges = data.n_edges * float(np.prod(counts, dtype=float))
    if edges > _MOST_EDGES:
        raise InputError(f"these copies have {edges:.1e} edges, more than {_MOST_EDGES:.0e}: give fewer copies")
    images = np.array(list(product(*map(range, counts))))
    m, n = len(images), data.n_vertices
    # The image of each head, counted in old cells, and the copy and the larger cell in which it lies.
    target = images[:, None] + data.offsets[None]
    copy = np.ravel_multi_index(tuple(np.moveaxis(target % counts, -1, 0)), tuple(counts))
    tails = data.edges[None, :, 0] + n * np.arange(m)[:, None]
    heads = data.edges[None, :, 1] + n * copy

    whole = data.with_edges(np.tile(np.arange(data.n_edges), m))
    return replace(
        whole,
        edges=np.stack([tails.ravel(), heads.ravel()], axis=1),
        positions=(data.positions[None] + (images @ data.cell)[:, None]).reshape(m * n, -1),
        cell=counts[:, None] * data.cell,
        offsets=(target // counts).reshape(-1, data.dimension),
        pins=tuple(pin + n * k for k in range(m) for pin in data.pins),
        ids=(),
    )
