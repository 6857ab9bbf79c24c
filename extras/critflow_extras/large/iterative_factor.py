"""A factor without pivots: solves by multigrid where all stresses are positive, and by elimination elsewhere.

Requested by its name, multigrid refuses what it cannot serve; chosen by "auto" it leaves that to elimination.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import scipy.sparse as sp

from critflow.result import InputError
from critflow.sparse import REDUCED, Array, Factor, FixedPattern, by_columns
from critflow_extras.large import multigrid


class MultigridFactor(Factor):
    """A Laplacian of one pattern, solved by conjugate gradients with algebraic multigrid."""

    def __init__(self, pattern: FixedPattern, matrix: sp.csc_matrix):
        super().__init__(pattern, matrix)
        self._multigrid: multigrid.Multigrid | None = None

    def prepare(self) -> None:
        if multigrid.serves(self._matrix):
            self._multigrid, self.iterates = multigrid.Multigrid(self._matrix), True
            return
        self._refuse("mixed signs or other matrices")
        super().prepare()

    def _refuse(self, call: str) -> None:
        """Raise `InputError` where multigrid was requested by its name and cannot serve a call."""
        if not self._pattern.may_eliminate:
            raise InputError(
                f"the backend {self._pattern.backend!r} serves solves with positive stresses alone, not {call}: choose "
                f"backend={self._pattern.elimination!r}, or 'auto'"
            )

    def solve(self, right_side: Array) -> Array:
        return self.solve_roughly(right_side, REDUCED)

    def solve_roughly(self, right_side: Array, reduction: float) -> Array:
        if self._multigrid is None:
            return super().solve(right_side)
        x = by_columns(partial(self._multigrid.solve, reduction=reduction), right_side)
        return super().solve(right_side) if not np.isfinite(x).all() and self.eliminate() else x

    def eliminate(self) -> bool:
        changes = self.iterates and self._pattern.may_eliminate
        if changes:
            self._multigrid, self.iterates = None, False
        return changes

    @property
    def pivots(self) -> Array:
        if self.iterates:
            self._refuse("pivots and determinants")
        return super().pivots

    @property
    def n_negative(self) -> int:
        return 0 if self.iterates else super().n_negative

    @property
    def sound(self) -> bool:
        return self.iterates or super().sound

    @property
    def singular(self) -> bool:
        return self._singular if self.iterates else super().singular
