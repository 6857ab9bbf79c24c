"""The pattern of springs and a weak energy together: the blocks of the edges, and the entries of the weak Hessian."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from critflow.networks import Array, IntArray, Network
from critflow.result import InputError
from critflow.sparse import FixedPattern, block_entries, n_block_values


class WeakPattern(FixedPattern):
    """Of a network and a Hessian, sparse (d·n_free)², and of all others without further entries.

    Sparse matrices may drop entries that vanish, such as those of right angles: what is missing counts as zero.
    """

    def __init__(self, network: Network, hessian: sp.csr_array):
        n_springs, self._keys = n_block_values(network), _keys(hessian)
        rows, cols = np.divmod(self._keys, hessian.shape[0])
        weak = (rows, cols, n_springs + np.arange(len(rows)), 1.0)
        entries, in_space = [*block_entries(network), weak], network.dimension > 2
        super().__init__(hessian.shape[0], n_springs + len(rows), entries, in_space=in_space)

    def covers(self, hessian: sp.csr_array) -> bool:
        """Whether a Hessian has no further entries."""
        return bool(np.isin(_keys(hessian), self._keys, assume_unique=True).all())

    def values(self, springs: Array, hessian: sp.csr_array) -> Array:
        """Values to factorise, from those of `edge_blocks` and a Hessian; `InputError` where it has further entries."""
        if not self.covers(hessian):
            raise InputError("the Hessian of a weak energy keeps its pattern: store its zeros too")
        weak = np.zeros(len(self._keys))
        weak[np.searchsorted(self._keys, _keys(hessian))] = hessian.data
        return np.concatenate([springs, weak])


def _keys(hessian: sp.csr_array) -> IntArray:
    """row·n + column of the stored entries, ascending: the matrix has sorted indices and no duplicates."""
    rows = np.repeat(np.arange(hessian.shape[0]), np.diff(hessian.indptr))
    return rows * hessian.shape[1] + hessian.indices
