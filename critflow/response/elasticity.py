"""The elasticity tensor of a network and the moduli that follow from it.

Strains are ε = Σ_a ε_a E_a in the basis `strain_basis`, m = d(d + 1)/2 components in Voigt's order with engineering
shears: F = 1 + ε with symmetric ε.  S_ij = Σ σ L_i L_j/V is the stress (Cauchy, tension positive).

    energy            C_ab = (1/V) ∂²E/∂ε_a∂ε_b
    stress-corrected  c_ab = (1/V) ∂²E/∂η_a∂η_b = C_ab − tr(E_a E_b S), with η = ½(FᵀF − 1), the Green–Lagrange strain
    stress–strain     B_ab = dS_a/dε_b without rotation, the increment of the stress that an experiment measures

For symmetric ε, η = ε + ½ε², and ∂E/∂η = V S, hence the correction: in the plane a shear has E_a² = ¼ 1, which
subtracts ¼ tr S = ½ dE/dV.  A stretched volume adds to the stress-strain coefficients (Barron and Klein 1965)
    B_ijkl = c_ijkl + ½(δ_ik S_jl + δ_jk S_il + δ_il S_jk + δ_jl S_ik) − S_ij δ_kl.
Without stress all three are equal.  Each is relaxed (vertices follow the strain) or affine (vertices move with b).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from critflow.linalg.tolerances import EPS
from critflow.networks.deformation import Deformable, deformation_of, strain_basis
from critflow.networks.network import Array
from critflow.result import InputError, Record

# Largest error bound of a result, relative to the largest modulus or coefficient: its first digit is correct.
TRUSTED_ERROR = 0.1


@dataclass(frozen=True)
class Moduli(Record):
    """Bulk and shear modulus in units of k (two dimensions), by the conventions of `critflow.response.moduli`."""

    bulk: float
    shear: float
    shear_stress_corrected: float


NO_MODULI = Moduli(np.nan, np.nan, np.nan)
FLOPPY = Moduli(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Averages(Record):
    """Bulk and shear modulus of a random polycrystal: bounds of Voigt (equal strain) and Reuss (equal stress)."""

    bulk_voigt: float
    bulk_reuss: float
    shear_voigt: float
    shear_reuss: float

    @property
    def bulk_hill(self) -> float:
        """Mean of the bounds of Voigt and Reuss."""
        return 0.5 * (self.bulk_voigt + self.bulk_reuss)

    @property
    def shear_hill(self) -> float:
        """Mean of the bounds of Voigt and Reuss."""
        return 0.5 * (self.shear_voigt + self.shear_reuss)


@dataclass(frozen=True, eq=False)
class Elasticity(Record):
    """Elasticity tensors, in units of energy per volume, with m = d(d + 1)/2 components.

    energy         relaxed C_ab, (m, m)
    affine_energy  affine C_ab, (m, m)
    stress         S, (d, d)
    volume         V, of the cell or as named for a pinned network
    bounds         error bounds of both energy tensors and of the stress corrections, (m, m)

    Singular tensors, as at the transition, where the rank is one per self-stress, have soft directions: Young's modulus
    is 0 where a uniaxial stress excites one, compliances are infinite, Reuss averages 0.  Singular values below the
    error bounds count as zero, and all is NaN where the bounds exceed a tenth of the tensor.  Poisson's ratio is NaN
    where the tensor does not determine it.
    """

    energy: Array
    affine_energy: Array
    stress: Array
    volume: float
    bounds: Array = field(repr=False)

    def __post_init__(self) -> None:
        d = len(self.stress)
        m = d * (d + 1) // 2
        tensors = (self.energy, self.affine_energy, self.bounds)
        assert all(tensor.shape == (m, m) for tensor in tensors) and self.stress.shape == (d, d), "shapes"
        assert all(np.array_equal(t, t.T, equal_nan=True) for t in (*tensors, self.stress)), "tensors are symmetric"

    # Tensors

    @property
    def dimension(self) -> int:
        return len(self.stress)

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the components, such as ("xx", "yy", "xy")."""
        return strain_basis(self.dimension)[0]

    @cached_property
    def stress_corrected(self) -> Array:
        """Relaxed c_ab, the derivatives by the Green–Lagrange strain, (m, m)."""
        return self.energy - self._stress_terms

    @cached_property
    def affine_stress_corrected(self) -> Array:
        """Affine c_ab, (m, m)."""
        return self.affine_energy - self._stress_terms

    @cached_property
    def stress_strain(self) -> Array:
        """Relaxed B_ab, the stress S_a by the strain ε_b, (m, m); not symmetric under anisotropic stress."""
        basis = strain_basis(self.dimension)[1]
        S = self.stress
        # ½(δ_ik S_jl + …) contracted with E_b is S E_b + E_b S.
        turned = np.einsum("ij,bjk->bik", S, basis) + np.einsum("bij,jk->bik", basis, S)
        grown = turned - np.einsum("ij,bkk->bij", S, basis)
        # Components of a stress are its entries: the contraction with E_a, whose shear entries are halves.
        return self.stress_corrected + np.einsum("aij,bij->ab", basis, grown)

    @cached_property
    def compliance(self) -> Array:
        """Inverse of the stress–strain tensor, (m, m), its limit with vanishing resistance added where it is singular.

        Infinite in soft directions.
        """
        inverse, soft = self._inverse
        scale = np.outer(_mandel(self.dimension), _mandel(self.dimension))
        with np.errstate(divide="ignore", invalid="ignore"):
            limit = np.where(np.abs(soft) > _UNIT_ROUNDING, np.copysign(np.inf, soft), inverse)
        return limit * scale

    # Moduli

    @property
    def bulk(self) -> float:
        """B = V d²E/dV²."""
        d = self.dimension
        return float(self.energy[:d, :d].sum() / d**2 + (1 / d) * (1 / d - 1) * np.trace(self.stress))

    @property
    def shear(self) -> float:
        """G = (1/V) d²E/dε² of the pure shear in the plane xy, energy convention."""
        self._require_plane()
        return float(self.energy[-1, -1])

    @property
    def shear_stress_corrected(self) -> float:
        """G − ½ dE/dV; in the plane, and under isotropic stress, it is the component xy, xy of `stress_corrected`."""
        return self.shear - 0.5 * float(np.trace(self.stress)) / self.dimension

    @property
    def moduli(self) -> Moduli:
        """B, G and the stress-corrected G."""
        return Moduli(self.bulk, self.shear, self.shear_stress_corrected)

    def modulus(self, deformation: Deformable) -> float:
        """(1/V) d²E/dγ² at γ = 0 of any deformation, or of F = 1 + γA for a matrix A (d, d) that may rotate.

        Free components of the cell relax: the uniaxial deformation with free sides has Young's modulus, without stress.
        Raises `InputError` for what is not a deformation.
        """
        path = deformation_of(deformation, self.dimension)
        A, W = path.velocity(0.0), path.acceleration(0.0)
        value = self.second(A, A) + float(np.vdot(self.stress, W))
        free = path.free_strains
        if not len(free):
            return value
        # The free components multiply F from the left: ∂²F/∂q∂γ = E_m A.
        coupling = np.array([self.second(E, A) + float(np.vdot(self.stress, E @ A)) for E in free])
        resistance = np.array([[self.second(E, F) for F in free] for E in free])
        return value - float(coupling @ np.linalg.pinv(resistance, hermitian=True) @ coupling)

    def youngs_modulus(self, direction: ArrayLike) -> float:
        """Stress over strain along a direction (d,) where no other stress component changes; 0 where it is soft."""
        n = self._tensor_components(self._unit(direction))
        inverse, soft = self._inverse
        if not np.isfinite(inverse).all():
            return np.nan
        if abs(n @ soft @ n) > _UNIT_ROUNDING:
            return 0.0
        return float(1 / (n @ inverse @ n))

    def poissons_ratio(self, direction: ArrayLike, transverse: ArrayLike) -> float:
        """−(strain along `transverse`)/(strain along `direction`), (d,) each, under uniaxial stress along `direction`.

        NaN where soft directions leave it undetermined.
        Raises `InputError` for directions that are not orthogonal.
        """
        along, across = self._unit(direction), self._unit(transverse)
        if abs(along @ across) > 1e-9:
            raise InputError("Poisson's ratio needs a transverse direction orthogonal to the direction of the stress")
        n, t = self._tensor_components(along), self._tensor_components(across)
        inverse, _ = self._inverse
        if not np.isfinite(inverse).all():
            return np.nan
        null = self._null_space
        n_soft, t_soft = null.T @ n, null.T @ t
        if np.linalg.norm(n_soft) <= _UNIT_ROUNDING:
            return float(-(t @ inverse @ n) / (n @ inverse @ n)) if np.linalg.norm(t_soft) <= _UNIT_ROUNDING else np.nan
        # Soft strains per strain along n; determined where all give the same strain along t.
        ratio = float(t_soft @ n_soft / (n_soft @ n_soft))
        return -ratio if np.linalg.norm(t_soft - ratio * n_soft) <= _UNIT_ROUNDING else np.nan

    def voigt_reuss_hill(self) -> Averages:
        """Voigt, Reuss and Hill averages of the bulk and the shear modulus."""
        d, n_deviators = self.dimension, len(self.energy) - 1
        one = self._tensor_components(np.eye(d))
        stiff = self._mandel_tensor
        inverse, soft = self._inverse
        bulk = float(one @ stiff @ one) / d**2
        shear = float(np.trace(stiff) - d * bulk) / (2 * n_deviators) if n_deviators else np.nan
        if not np.isfinite(inverse).all():
            return Averages(bulk, np.nan, shear, np.nan)
        softness, compressed = float(np.trace(soft)), float(one @ soft @ one)
        bulk_compliance = float(one @ inverse @ one)
        shear_compliance = float(np.trace(inverse)) - bulk_compliance / d
        bulk_reuss = 0.0 if abs(compressed) > _UNIT_ROUNDING else 1 / bulk_compliance
        soft_shear = abs(softness - compressed / d) > _UNIT_ROUNDING
        shear_reuss = np.nan if not n_deviators else 0.0 if soft_shear else 0.5 * n_deviators / shear_compliance
        return Averages(bulk, bulk_reuss, shear, shear_reuss)

    # Parts

    @cached_property
    def _stress_terms(self) -> Array:
        """tr(E_a E_b S), (m, m)."""
        basis = strain_basis(self.dimension)[1]
        terms = np.einsum("aij,bjk,ki->ab", basis, basis, self.stress)
        return 0.5 * (terms + terms.T)

    @cached_property
    def _mandel_tensor(self) -> Array:
        """The stress–strain tensor in an orthonormal basis of symmetric tensors, (m, m)."""
        return self.stress_strain * np.outer(_mandel(self.dimension), _mandel(self.dimension))

    @cached_property
    def _decomposition(self) -> tuple[Array, Array, Array, int]:
        """Singular value decomposition of the tensor in the orthonormal basis and its rank, −1 if unknown."""
        left, values, right = np.linalg.svd(self._mandel_tensor)
        weights = _mandel(self.dimension)
        error = np.linalg.norm(self.bounds * np.outer(weights, weights)) + 8 * len(values) * EPS * values[0]
        rank = int(np.count_nonzero(values > error)) if error <= TRUSTED_ERROR * values[0] else -1
        return left, values, right, rank

    @property
    def _null_space(self) -> Array:
        """Orthonormal strains without resistance, (m, n)."""
        _, _, right, rank = self._decomposition
        return right[rank:].T

    @cached_property
    def _inverse(self) -> tuple[Array, Array]:
        """Pseudo-inverse in the orthonormal basis, and the matrix whose product with 1/δ it gains with a resistance δ.

        NaN where the tensor or its bounds are not known.
        """
        m = len(self.energy)
        unknown = np.full((m, m), np.nan)
        if not (np.isfinite(self._mandel_tensor).all() and np.isfinite(self.bounds).all()):
            return unknown, unknown
        left, values, right, rank = self._decomposition
        if rank < 0:
            return unknown, unknown
        inverse = (right[:rank].T / values[:rank]) @ left[:, :rank].T
        null, conjugate = right[rank:].T, left[:, rank:]
        return inverse, null @ np.linalg.pinv(conjugate.T @ null) @ conjugate.T

    def second(self, A: Array, B: Array) -> float:
        """(1/V) ∂²E/∂α∂β of F = 1 + αA + βB."""
        symmetric, other = 0.5 * (A + A.T), 0.5 * (B + B.T)
        a, b = (strain_components(strain) for strain in (symmetric, other))
        turning = np.vdot(self.stress, A.T @ B) - np.vdot(self.stress, symmetric @ other)
        return float(a @ self.energy @ b + turning)

    def _tensor_components(self, tensor: Array) -> Array:
        """Components of a symmetric tensor, or of n ⊗ n for a vector n, in the orthonormal basis, (m,)."""
        tensor = np.outer(tensor, tensor) if tensor.ndim == 1 else tensor
        return strain_components(tensor) / _mandel(self.dimension)

    def _unit(self, direction: ArrayLike) -> Array:
        n = np.asarray(direction, dtype=float)
        size = np.linalg.norm(n) if n.shape == (self.dimension,) else 0.0
        if not (np.isfinite(size) and size > 0):
            raise InputError(f"a direction is a vector of {self.dimension} finite components, not all zero")
        return n / size

    def _require_plane(self) -> None:
        if self.dimension < 2:
            raise InputError("a shear needs at least two dimensions")


def no_elasticity(dimension: int, volume: float = np.nan) -> Elasticity:
    """Tensors of NaN."""
    m = dimension * (dimension + 1) // 2
    unknown = np.full((m, m), np.nan)
    return Elasticity(unknown, unknown, np.full((dimension, dimension), np.nan), volume, unknown)


# Components of unit tensors below this are zero: they carry the errors of singular vectors.
_UNIT_ROUNDING = 1e-7


def _engineering(dimension: int) -> Array:
    """2 for shear components and 1 for normal ones, (m,)."""
    return np.repeat([1.0, 2.0], [dimension, dimension * (dimension - 1) // 2])


def _mandel(dimension: int) -> Array:
    """Factors √2 of shear components, (m,), that make an orthonormal basis of symmetric tensors."""
    return np.sqrt(_engineering(dimension))


def strain_components(strain: Array) -> Array:
    """Components ε_a of a symmetric strain (d, d), engineering shears, (m,)."""
    basis = strain_basis(len(strain))[1]
    return np.einsum("aij,ij->a", basis, strain) * _engineering(len(strain))
