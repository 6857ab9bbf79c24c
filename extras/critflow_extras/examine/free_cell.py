"""Counts of self-stresses and motions where the cell may deform.

The d(d + 1)/2 strains of the cell are further columns of the rigidity matrix.  Those that no motion makes up for are
the range of C, the tensor of the springs at rest with k = 1 (Borcea and Streinu 2010; Guest and Hutchinson 2003):

    N_s − rank C  self-stresses without a macroscopic stress,   N_0 + d(d + 1)/2 − rank C  motions
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from critflow.elastic import Elasticity
from critflow.result import Record
from critflow_extras.certificates.counts import Rigidity


@dataclass(frozen=True, eq=False, repr=False)
class FreeCellCounts(Record):
    """Counts on a free cell.

    n_self_stresses, n_zero_modes   N_s and N_0, translations included, rotations excluded
    rank                            of C: strains that springs resist
    largest_zero, smallest_nonzero  √ of eigenvalues of C over the largest of the affine tensor, on both sides of the
                                    tolerance: the gap behind the rank; NaN where there is none
    """

    n_self_stresses: int
    n_zero_modes: int
    rank: int
    largest_zero: float
    smallest_nonzero: float


def free_cell_counts(counts: Rigidity, moduli: Elasticity, tolerance: float) -> FreeCellCounts:
    """Counts on a free cell from those on a fixed one and moduli at k = 1; ratios below the tolerance count as zero."""
    C, affine = moduli.tensor, moduli.affine
    ratios = np.sqrt(np.maximum(np.linalg.eigvalsh(C), 0.0) / np.linalg.eigvalsh(affine).max())
    resisted = ratios > tolerance
    rank = int(resisted.sum())
    return FreeCellCounts(
        counts.n_self_stresses - rank,
        counts.n_zero_modes + len(C) - rank,
        rank,
        float(ratios[~resisted].max()) if rank < len(C) else np.nan,
        float(ratios[resisted].min()) if rank else np.nan,
    )
