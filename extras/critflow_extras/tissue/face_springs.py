"""Springs on the perimeters of faces, in which K couples edges of one face.

The perimeters are p = A|L|, with A (N_f, N_b) being 1 where an edge is a side of a face.  Tensions T of the faces add
up on their sides, τ = Aᵀ T, σ = τ/|L|, and
    K_{αβ} = Σ_f κ_f A_fα A_fβ/(|L_α||L_β|) − δ_{αβ} σ_α/|L_α|²      (`ModifiedStiffness`)
has entries off its diagonal exactly where two edges share a face.  With A = 1 these are Hookean springs on the edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.linalg import eigsh

from critflow.arguments import edge_values
from critflow.networks import Array, Network
from critflow.numerics import norms, quasi_random
from critflow.result import InputError, Record
from critflow.sparse import spread_columns

# Squared singular values of ∂p/∂x that are zero, relative to the largest; others are above 5e-3 at 1,000 cells.
UNLOADED = 1e-11
SMALL_GRAM = 50  # number of faces up to which all singular values are computed


@dataclass(frozen=True, eq=False, repr=False)
class FaceSprings(Record):
    """Springs on the perimeters of faces: sides A (N_f, N_b) sparse, A ≥ 0, and stiffness κ (N_f,).

    Raises `InputError` where a side is negative, or an edge belongs to no face.
    """

    sides: sp.csr_array
    stiffness: Array

    @classmethod
    def of(cls, network: Network, stiffness: ArrayLike, sides: sp.sparray | ArrayLike | None) -> FaceSprings:
        """Those of the faces of a network, or of given sides, with a stiffness (N_f,) or one for all."""
        if sides is None:
            faces = network.faces
            if faces is None:
                raise InputError("faces are not known: give sides, or those of `planar_faces`")
            owner = np.repeat(np.arange(faces.n_faces), faces.sizes)
            sides = sp.csr_array((np.ones(len(owner)), (owner, faces.edges)), shape=(faces.n_faces, network.n_edges))
        if np.ndim(sides) != 2 and not sp.issparse(sides):
            raise InputError(f"sides must have shape (N_f, {network.n_edges}), not {np.shape(sides)}: one row a face")
        A = sp.csr_array(sides, dtype=float)
        if A.ndim != 2 or A.shape[1] != network.n_edges:
            raise InputError(f"sides must have shape (N_f, {network.n_edges}), not {A.shape}: one row a face")
        A.sum_duplicates()
        A.eliminate_zeros()
        if not (np.isfinite(A.data) & (A.data > 0)).all():
            raise InputError("sides must not be negative: an entry is the multiplicity of an edge in a perimeter")
        bare = np.flatnonzero(np.asarray(A.sum(axis=0)) == 0)
        if len(bare):
            raise InputError(f"edge {bare[0]} belongs to no face, so nothing resists its extension: make it a side")
        values = np.array(stiffness) if np.ndim(stiffness) else np.full(A.shape[0], stiffness)
        return cls(A, edge_values(values, A.shape[0], "stiffness", place="face"))

    def perimeters(self, values: ArrayLike) -> Array:
        """Perimeters at rest (N_f,), else an `InputError`."""
        return edge_values(np.array(values), len(self.stiffness), "perimeters", place="face")

    def rates(self, network: Network, bond_vectors: Array) -> sp.csr_array:
        """∂p/∂x over the free coordinates, (N_f, d·n_free) sparse, at bond vectors (N_b, d)."""
        return sp.csr_array(self.sides @ spread_columns(network, bond_vectors / norms(bond_vectors)[:, None]))

    def several_self_stresses(self, network: Network, bond_vectors: Array) -> bool:
        """Whether more than one independent set of tensions of the faces is in balance."""
        rates = self.rates(network, bond_vectors)
        gram, n = sp.csc_array(rates @ rates.T), rates.shape[0]
        scale = float(gram.diagonal().max())
        if n <= SMALL_GRAM:
            least = np.linalg.eigvalsh(gram.toarray())[:2]
        else:
            least = eigsh(gram, 2, sigma=-1e-6 * scale, v0=quasi_random(n) - 0.5, return_eigenvectors=False)
        return bool(np.sum(least < UNLOADED * scale) > 1)

    def of_edges(self, edges: Any) -> Any:
        """Springs on perimeters from springs on edges, `Springs` at rest, whose extensions and motions add up."""
        A = self.sides
        directions, extension = sp.csr_array(A @ edges.directions), A @ edges.extension
        return edges._replace(
            directions=directions, extension=extension, stiffness=self.stiffness, errors=A @ edges.errors
        )

    @cached_property
    def overlap(self) -> sp.coo_array:
        """Aᵀ diag(κ) A, (N_b, N_b): which edges share a face, and how stiffly."""
        return sp.coo_array(self.sides.T @ sp.diags_array(self.stiffness) @ self.sides)
