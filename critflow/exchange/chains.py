"""Chains of edges through vertices of two edges, replaced by one edge each: springs in series."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from critflow.exchange.data import Array, IntArray, NetworkData
from critflow.result import InputError


def contracted(data: NetworkData, middle: NDArray[np.bool_]) -> tuple[NetworkData, IntArray]:
    """The data without chain vertices, springs joined in series and lengths added; and one old edge of each chain."""
    inner = middle[data.edges]
    n = data.n_edges
    # Two edges that meet at a chain vertex belong to one chain.
    order = np.argsort(data.edges.ravel(), kind="stable")
    ends = data.edges.ravel()[order]
    pairs = (order // 2)[middle[ends]].reshape(-1, 2)
    _, chain = connected_components(sp.coo_array((np.ones(len(pairs)), tuple(pairs.T)), (n, n)), directed=False)
    by_chain = np.argsort(chain, kind="stable")
    edges, offsets, first = [], [], []
    groups = np.split(by_chain, np.flatnonzero(np.diff(chain[by_chain])) + 1)
    zero = np.zeros((n, data.dimension), np.int64) if data.offsets is None else np.asarray(data.offsets)
    for group in groups:
        walked = _walk(data.edges[group], zero[group], inner[group])
        if walked is None:
            continue
        (tail, head), offset = walked
        edges.append((tail, head))
        offsets.append(offset)
        first.append(int(group[0]))
    if not edges:
        raise InputError("the network is a single closed chain: nothing is left to contract")
    kept = np.array(first)
    number = {int(chain[e]): k for k, e in enumerate(first)}
    owner = np.array([number.get(int(c), -1) for c in chain])
    inside = owner >= 0

    def summed(values: Array | None) -> Array | None:
        return None if values is None else np.bincount(owner[inside], values[inside], minlength=len(kept)).astype(float)

    compliance = summed(np.ones(n) if data.stiffness is None else 1 / data.stiffness)
    index = np.cumsum(~middle) - 1
    merged = replace(
        data,
        edges=index[np.array(edges)],
        positions=data.positions[~middle],
        offsets=None if data.offsets is None else np.array(offsets),
        bond_vectors=None,
        pins=tuple(int(index[i]) for i in data.pins),
        stiffness=1 / np.asarray(compliance),
        rest_lengths=summed(data.rest_lengths),
        force_densities=None,
        ids=tuple(name for name, gone in zip(data.ids, middle, strict=True) if not gone) if data.ids else (),
        polygons=(),
    )
    return merged, kept


def _walk(edges: IntArray, offsets: IntArray, inner: NDArray[np.bool_]) -> tuple[tuple[int, int], IntArray] | None:
    """Ends and total offset of one chain from its edges in any order; None for a closed ring."""
    outer = np.argwhere(~inner)
    if not len(outer):
        return None
    row, side = (int(value) for value in outer[0])
    start, total, left = int(edges[row, side]), np.zeros(offsets.shape[1], np.int64), set(range(len(edges)))
    here, sign = row, 1 if side == 0 else -1
    while True:
        left.discard(here)
        total = total + sign * offsets[here]
        end = int(edges[here, 1 if sign > 0 else 0])
        following = [k for k in left if end in edges[k]]
        at_inner = bool(inner[here, 1 if sign > 0 else 0])
        if not at_inner or not following:
            return (start, end), total
        here = following[0]
        sign = 1 if int(edges[here, 0]) == end else -1
