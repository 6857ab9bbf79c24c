"""Chains of edges through vertices of two edges, which tension pulls straight: springs in series."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from critflow.networks.blocks import components

IntArray = NDArray[np.int64]


def chains(edges: IntArray, middle: NDArray[np.bool_]) -> tuple[IntArray, IntArray]:
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
