"""The pattern of Hessians of energies that couple edges."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from critflow.networks import Network
from critflow.sparse import Entries, FixedPattern, free_ends


def pair_laplacian(
    network: Network, pairs: tuple[NDArray[np.integer], NDArray[np.integer]], backend: str = "auto"
) -> FixedPattern:
    """Σ_{αβ} g_α g_βᵀ ⊗ C_{αβ} over the free coordinates, (d·n_free)², for energies that couple edges.

    pairs  edges α and β, (n_pairs,) each, containing (β, α) for every (α, β); the values are C (n_pairs, d, d)
    """
    d = network.dimension
    ends, signs = free_ends(network), (-1.0, 1.0)
    first, second = ends[pairs[0]], ends[pairs[1]]

    def entries() -> Iterator[Entries]:
        for row, col in np.ndindex(d, d):
            source = np.arange(len(first)) * d * d + d * row + col
            for end, other in np.ndindex(2, 2):
                i, j = first[:, end], second[:, other]
                inside = (i >= 0) & (j >= 0)
                yield d * i[inside] + row, d * j[inside] + col, source[inside], signs[end] * signs[other]

    return FixedPattern(d * len(network.free), len(first) * d * d, entries(), backend, d > 2)
