"""Elasticity by direction, and the tensors of other conventions that follow from that of the energy.

    energy            C_ab = (1/V) ∂²E/∂ε_a∂ε_b
    stress-corrected  c_ab = (1/V) ∂²E/∂η_a∂η_b = C_ab − tr(E_a E_b S), with η = ½(FᵀF − 1), the Green–Lagrange strain
    stress–strain     B_ab = dS_a/dε_b without rotation, the increment of the stress that an experiment measures

For symmetric ε, η = ε + ½ε², and ∂E/∂η = V S, hence the correction: in the plane a shear has E_a² = ¼ 1, which
subtracts ¼ tr S = ½ dE/dV.  A stretched volume adds to the stress-strain coefficients (Barron and Klein 1965)
    B_ijkl = c_ijkl + ½(δ_ik S_jl + δ_jk S_il + δ_il S_jk + δ_jl S_ik) − S_ij δ_kl.
Without stress all three are equal.

Singular tensors, as at the transition, where the rank is one per self-stress, have soft directions: Young's modulus is
0 where a uniaxial stress excites one, and compliances are infinite.  Singular values below the errors count as zero,
and all is NaN where the errors exceed a tenth of the tensor.  Poisson's ratio is NaN where the tensor does not
determine it.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import floats
from critflow.deformation import strain_basis, strain_components
from critflow.linear_response import TRUSTED_ERROR, Elasticity
from critflow.networks import Array
from critflow.numerics import EPS
from critflow.result import InputError

UNIT_ROUNDING = 1e-7  # components of unit tensors below this are zero: they carry the errors of singular vectors


def stress_corrected(elastic: Elasticity) -> Array:
    """Relaxed c_ab, the derivatives by the Green–Lagrange strain, (m, m)."""
    return elastic.tensor - _stress_terms(elastic)


def affine_stress_corrected(elastic: Elasticity) -> Array:
    """Affine c_ab, (m, m)."""
    return elastic.affine - _stress_terms(elastic)


def stress_strain(elastic: Elasticity) -> Array:
    """Relaxed B_ab, the stress S_a by the strain ε_b, (m, m); not symmetric under anisotropic stress."""
    basis, S = strain_basis(elastic.dimension)[1], elastic.stress
    # ½(δ_ik S_jl + …) contracted with E_b is S E_b + E_b S.
    turned = np.einsum("ij,bjk->bik", S, basis) + np.einsum("bij,jk->bik", basis, S)
    grown = turned - np.einsum("ij,bkk->bij", S, basis)
    # Components of a stress are its entries: the contraction with E_a, whose shear entries are halves.
    return stress_corrected(elastic) + np.einsum("aij,bij->ab", basis, grown)


def compliance(elastic: Elasticity) -> Array:
    """Inverse of the stress–strain tensor, (m, m), its limit with vanishing resistance added where it is singular.

    Infinite in soft directions.
    """
    inverse, soft, _ = _inverse(elastic)
    with np.errstate(divide="ignore", invalid="ignore"):
        limit = np.where(np.abs(soft) > UNIT_ROUNDING, np.copysign(np.inf, soft), inverse)
    return limit * np.outer(_mandel(elastic.dimension), _mandel(elastic.dimension))


def young(elastic: Elasticity, direction: ArrayLike) -> float:
    """Young's modulus: `Elasticity.young`."""
    n = _components(_unit(elastic, direction))
    inverse, soft, _ = _inverse(elastic)
    return 0.0 if abs(n @ soft @ n) > UNIT_ROUNDING else float(1 / (n @ inverse @ n))


def poisson(elastic: Elasticity, direction: ArrayLike, transverse: ArrayLike | None = None) -> float:
    """Poisson's ratio: `Elasticity.poisson`."""
    along = _unit(elastic, direction)
    if transverse is None:
        _require_plane(elastic)
        transverse = np.concatenate([[-along[1], along[0]], np.zeros(elastic.dimension - 2)])
    across = _unit(elastic, transverse)
    if abs(along @ across) > 1e-9:
        raise InputError("Poisson's ratio needs a transverse direction orthogonal to the direction of the stress")
    n, t = _components(along), _components(across)
    inverse, _, null = _inverse(elastic)
    if not np.isfinite(inverse).all():
        return np.nan
    n_soft, t_soft = null.T @ n, null.T @ t
    if np.linalg.norm(n_soft) <= UNIT_ROUNDING:
        return float(-(t @ inverse @ n) / (n @ inverse @ n)) if np.linalg.norm(t_soft) <= UNIT_ROUNDING else np.nan
    # Soft strains per strain along n; determined where all give the same strain along t.
    ratio = float(t_soft @ n_soft / (n_soft @ n_soft))
    return -ratio if np.linalg.norm(t_soft - ratio * n_soft) <= UNIT_ROUNDING else np.nan


def voigt(elastic: Elasticity) -> tuple[float, float]:
    """Bulk and shear modulus of a random polycrystal by Voigt, at equal strain: not less than any."""
    d, n_deviators = elastic.dimension, len(elastic.tensor) - 1
    one, stiff = _components(np.eye(d)), _mandel_tensor(elastic)
    bulk = float(one @ stiff @ one) / d**2
    return bulk, float(np.trace(stiff) - d * bulk) / (2 * n_deviators) if n_deviators else np.nan


@cache
def _mandel(dimension: int) -> Array:
    """Factors √2 of shear components, (m,), that make an orthonormal basis of symmetric tensors."""
    return np.sqrt(np.repeat([1.0, 2.0], [dimension, dimension * (dimension - 1) // 2]))


def _stress_terms(elastic: Elasticity) -> Array:
    """tr(E_a E_b S), (m, m)."""
    basis = strain_basis(elastic.dimension)[1]
    terms = np.einsum("aij,bjk,ki->ab", basis, basis, elastic.stress)
    return 0.5 * (terms + terms.T)


def _mandel_tensor(elastic: Elasticity) -> Array:
    """The stress–strain tensor in an orthonormal basis of symmetric tensors, (m, m)."""
    return stress_strain(elastic) * np.outer(_mandel(elastic.dimension), _mandel(elastic.dimension))


def _inverse(elastic: Elasticity) -> tuple[Array, Array, Array]:
    """Pseudo-inverse in the orthonormal basis, and orthonormal strains without resistance, (m, n).

    Between them the matrix whose product with 1/δ the inverse gains with a resistance δ.  NaN where the tensor or
    its errors are not known.
    """
    stiff, weights = _mandel_tensor(elastic), _mandel(elastic.dimension)
    errors, unknown = elastic.errors.tensor * np.outer(weights, weights), np.full_like(stiff, np.nan)
    if not (np.isfinite(stiff).all() and np.isfinite(errors).all()):
        return unknown, unknown, unknown
    left, values, right = np.linalg.svd(stiff)
    error = float(np.linalg.norm(errors)) + 8 * len(values) * EPS * values[0]
    if not error <= TRUSTED_ERROR * values[0]:
        return unknown, unknown, unknown
    rank = int(np.count_nonzero(values > error))
    null, conjugate = right[rank:].T, left[:, rank:]
    inverse = (right[:rank].T / values[:rank]) @ left[:, :rank].T
    return inverse, null @ np.linalg.pinv(conjugate.T @ null) @ conjugate.T, null


def _components(tensor: Array) -> Array:
    """Components of a symmetric tensor, or of n ⊗ n for a vector n, in the orthonormal basis, (m,)."""
    tensor = np.outer(tensor, tensor) if tensor.ndim == 1 else tensor
    return strain_components(tensor) / _mandel(len(tensor))


def _unit(elastic: Elasticity, direction: ArrayLike) -> Array:
    n = floats(direction, "a direction")
    if n.ndim == 0:
        _require_plane(elastic)
        n = np.concatenate([[np.cos(n), np.sin(n)], np.zeros(elastic.dimension - 2)])
    size = np.linalg.norm(n) if n.shape == (elastic.dimension,) else 0.0
    if not (np.isfinite(size) and size > 0):
        raise InputError(f"a direction is an angle or a vector of {elastic.dimension} finite components, not all zero")
    return n / size


def _require_plane(elastic: Elasticity) -> None:
    if elastic.dimension < 2:
        raise InputError("a shear needs at least two dimensions")
