"""Parts of the elastic Hessian, and the response of bonds to force dipoles.

Any central-force energy E(|L|) with σ = τ/|L| and stiffness k = ∂²E/∂|L|² has, over the free coordinates,
  in h = |L|²/2   H = R^hᵀ K R^h + P ⊗ 1,  K = (k − σ)/|L|²     (`GenericHessian`, `ModifiedStiffness`)
  in |L|          H = R̃ᵀ k R̃ + P̃,  P̃ = P ⊗ 1 − Σ R̃ᵀ σ R̃      (`HookeanRigidityMatrix`, `HookeanPrestressMatrix`)
with R^h = ∂h/∂x and R̃ = ∂|L|/∂x = R^h/|L|.  Both splits have the same zero modes, those of R, and P and P̃ agree on
them.  (The paper prints τ where R̃ᵀ σ R̃ has σ; dimensional analysis and finite differences of forces require σ.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.equilibria import FLOPPY_SHIFT
from critflow.networks import Array
from critflow.result import Record, Solution, SolveError, Stats, Status
from critflow.sparse import spread_columns
from critflow.springs import EdgeMatrix, SpringState


@dataclass(frozen=True, eq=False, repr=False)
class HessianSplit(Record):
    """H = response ᵀ · diag(stiffness) · response + prestress, over the free coordinates in the order (vertex, axis).

    response   R^h or R̃, sparse (N_b, d·n_free)
    stiffness  K or k, (N_b,), or sparse (N_b, N_b) where springs couple edges
    prestress  P ⊗ 1 or P̃, sparse (d·n_free)²
    """

    response: sp.csr_array
    stiffness: EdgeMatrix
    prestress: sp.csr_array

    @property
    def gram(self) -> sp.csr_array:
        """Rᵀ K R, the resistance to stretching, sparse (d·n_free)²."""
        k = self.stiffness if sp.issparse(self.stiffness) else sp.diags_array(self.stiffness)
        return sp.csr_array(self.response.T @ k @ self.response)

    @property
    def hessian(self) -> sp.csr_array:
        """H, sparse (d·n_free)²."""
        return sp.csr_array(self.gram + self.prestress)


@running("geometric_split")
def geometric_split(state: SpringState) -> HessianSplit:
    """H = R^hᵀ K R^h + P ⊗ 1 (`GenericHessian`, `RigidityMatrix2`, `PrestressMatrix2`)."""
    state = of_kind(SpringState, state=state)
    network = state.network
    g = network.free_incidence
    P = g.T @ sp.diags_array(state.sigma) @ g
    prestress = sp.csr_array(sp.kron(P, sp.eye_array(network.dimension)))
    return HessianSplit(spread_columns(network, state.bond_vectors), state.modified_stiffness, prestress)


@running("hookean_split")
def hookean_split(state: SpringState) -> HessianSplit:
    """H = R̃ᵀ k R̃ + P̃ with k = K|L|² + σ, the stiffness of any law (`HookeanPrestressMatrix`)."""
    state = of_kind(SpringState, state=state)
    geometric = geometric_split(state)
    R = sp.csr_array(sp.diags_array(1 / state.lengths) @ geometric.response)
    prestress = sp.csr_array(geometric.prestress - R.T @ sp.diags_array(state.sigma) @ R)
    K, length = state.modified_stiffness, state.lengths
    if isinstance(K, np.ndarray):
        return HessianSplit(R, K * length**2 + state.sigma, prestress)
    scale = sp.diags_array(length)
    return HessianSplit(R, sp.coo_array(scale @ K @ scale + sp.diags_array(state.sigma)), prestress)


@running("bond_operator")
def bond_operator(state: SpringState, max_refinements: int = 10) -> LinearOperator:
    """Ξ = R H⁻¹ Rᵀ as an operator (N_b, N_b): changes of length by unit force dipoles on the bonds (`BondOperator`).

    H⁻¹ excludes floppy motions.  Ξ is symmetric; for unstressed springs √k Ξ √k projects on the tensions caused by
    displacements, so its trace is the rank of R, and it annihilates √k⁻¹ times a self-stress.
    Raises `SolveError` where H has negative eigenvalues: the springs then buckle.
    """
    state = of_kind(SpringState, state=state)
    max_refinements = of_kind(int, max_refinements=max_refinements)
    network = state.network
    R = spread_columns(network, state.bond_vectors / state.lengths[:, None])
    factor, shift = state.factorize(), 0.0
    if factor.indefinite:
        shift = FLOPPY_SHIFT * state.stiffness_scale
        factor = state.factorize(shift)
    if factor.indefinite:
        note = f"the Hessian has {factor.n_negative} negative eigenvalues, so the springs buckle: relax them first"
        raise SolveError(f"no bond operator: {note}", Solution(None, Status.unstable, Stats("bond operator"), note))

    def apply(dipoles: Array) -> Array:
        force = np.asarray(R.T @ np.ravel(dipoles))
        u = factor.solve(force)
        # Refinement removes the effect of the shift; floppy motions feel no force and are excluded.
        for _ in range(max_refinements if shift else 1):
            residual = force - factor.multiply(u) + shift * u
            correction = factor.solve(residual)
            u = u + correction
            if np.abs(R @ correction).max() <= 1e-15 * np.abs(R @ u).max():
                break
        return np.asarray(R @ u)

    n = network.n_edges
    return LinearOperator((n, n), matvec=apply, rmatvec=apply, dtype=float)
