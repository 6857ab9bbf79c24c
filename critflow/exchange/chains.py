"""Chains of edges through vertices of two edges, replaced by one edge each: springs in series."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from critflow.exchange.data import Array, NetworkData
from critflow.networks.chains import chains
from critflow.result import InputError


def contracted(data: NetworkData, middle: NDArray[np.bool_]) -> NetworkData:
    """The record without the vertices inside chains: springs joined in series, lengths added, closed chains left out.

    Each chain has the number and the direction of its first edge.
    """
    chain, direction = chains(data.edges, middle)
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
