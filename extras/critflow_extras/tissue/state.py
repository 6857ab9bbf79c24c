"""Springs on the perimeters of faces in a configuration: what differs from springs on edges.

Hookean springs E = ½ Σ_f κ_f (p_f − p0_f)² on perimeters p = A|L| have tensions T = κ(p − p0), which add up on the
edges, τ = Aᵀ T, and couple the edges of each face (`face_springs`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from critflow.double_double import Extended, lengths
from critflow.networks import Array
from critflow.numerics import EPS
from critflow.result import Status
from critflow.sparse import FixedPattern
from critflow.springs import TAUT, SpringState
from critflow_extras.tissue.exact_sums import exact_sums
from critflow_extras.tissue.face_springs import FaceSprings
from critflow_extras.tissue.pair_laplacian import pair_laplacian

COLLAPSING_LENGTH = 1e-3  # in a failed relaxation an edge below this part of the mean length is reported as collapsing


@dataclass(frozen=True, eq=False, repr=False)
class TissueState(SpringState):
    """Springs on the perimeters of `faces`, of rest lengths p0 (N_f,): a `SpringState` with (N_f,) for its springs."""

    faces: FaceSprings = field(kw_only=True)

    @property
    def stiffness(self) -> Array:
        """κ, (N_f,)."""
        return self.faces.stiffness

    @property
    def spring_lengths(self) -> Array:
        """p = A|L|, (N_f,)."""
        return self.faces.sides @ self.lengths

    @property
    def face_tensions(self) -> Array:
        """T, (N_f,)."""
        return self.tension

    def edge_tension(self, tension: Array) -> Array:
        """τ = Aᵀ T (N_b,) of tensions T (N_f,)."""
        return self.faces.sides.T @ tension

    @property
    def edge_stiffness(self) -> Array:
        """Row sums (N_b,) of Aᵀ κ A: a matrix without negative entries is at most the diagonal of these."""
        return np.asarray(self.faces.overlap.sum(axis=1))

    @cached_property
    def modified_stiffness(self) -> sp.coo_array:
        """K = Aᵀ κ A/(|L||L|) − σ/|L|², (N_b, N_b)."""
        return self.couplings(self.sigma)

    def resistance(self, hdot: Array) -> Array:
        """K ḣ for changes ḣ of h, both (m, N_b)."""
        return np.asarray((self.modified_stiffness @ hdot.T).T)

    def convex_parts(self) -> tuple[sp.coo_array, Array]:
        """K and σ without the geometric softening of compressed edges."""
        tension = np.maximum(self.sigma, 0.0)
        return self.couplings(tension), tension

    def couplings(self, sigma: Array) -> sp.coo_array:
        """K of stresses σ (N_b,)."""
        pairs, length = self.faces.overlap, self.lengths
        values = pairs.data / (length[pairs.row] * length[pairs.col])
        same = pairs.row == pairs.col
        values[same] -= (sigma / length**2)[pairs.row[same]]
        return sp.coo_array((values, (pairs.row, pairs.col)), shape=pairs.shape)

    @property
    def pattern(self) -> FixedPattern:
        """The pattern of the Hessian, with a block for each two edges of one face."""
        matrices = self.network.matrices
        faces, pattern = matrices.get("faces", (None, None))
        if faces is not self.faces:
            pattern = pair_laplacian(self.network, (self.faces.overlap.row, self.faces.overlap.col), self.backend)
            matrices["faces"] = self.faces, pattern
        return pattern

    def blocks(self, K: sp.coo_array, sigma: Array) -> Array:
        """Values for the pattern of K L Lᵀ + σ 1."""
        L = self.bond_vectors
        blocks = K.data[:, None, None] * L[K.row, :, None] * L[K.col, None, :]
        same = np.flatnonzero(K.row == K.col)
        blocks[same] += sigma[K.row[same], None, None] * np.eye(L.shape[1])
        return np.asarray(blocks.ravel())

    @property
    def stress_rounding(self) -> Array:
        """Rounding error of σ, (N_b,)."""
        return EPS * self.edge_tension(self.stiffness * self.spring_lengths) / self.lengths

    def exact_stress(self, bond_vectors: Extended) -> Array:
        """σ (N_b,) of other bond vectors (N_b, d), accurate to the rounding of σ itself."""
        exact, rest = lengths(bond_vectors), self.rest_lengths
        extension = exact_sums(self.faces.sides, exact, rest)
        return self.edge_tension(self.law.tension(extension, rest, self.stiffness)) / exact.high

    def taut(self, least: float = TAUT) -> bool:
        """False: perimeters leave open the length of a single edge."""
        return False

    def explained(self, failed: Any) -> Any:
        """With `Status.edge_collapse` where an edge shrinks to zero length: no perimeter resists that."""
        edge = int(self.lengths.argmin())
        if not self.lengths[edge] < COLLAPSING_LENGTH * self.lengths.mean():
            return failed
        note = f"edge {edge} shrinks to zero length, where its tension has no direction"
        return replace(failed, status=Status.edge_collapse, note=note)
