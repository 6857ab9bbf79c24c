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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property

import numpy as np
from numpy.typing import ArrayLike

from critflow.linalg.tolerances import EPS
from critflow.networks.deformation import Deformable, deformation_of, strain_basis, strain_components
from critflow.networks.network import Array
from critflow.result import InputError, Record

# Largest error of a result, relative to the largest modulus or coefficient: its first digit is correct.
TRUSTED_ERROR = 0.1


@dataclass(frozen=True, eq=False)
class Errors:
    """Largest errors of both tensors and their stress corrections, (m, m), and of the moduli; NaN where unknown."""

    tensor: Array
    bulk: float
    shear: float
    shear_stress_corrected: float

    @classmethod
    def of_tensor(cls, errors: Array, dimension: int) -> Errors:
        """Those of sums over a tensor with the errors (m, m)."""
        bulk, shear = float(errors[:dimension, :dimension].sum()) / dimension**2, float(errors[-1, -1])
        return cls(errors, bulk, shear, shear)

    def plus(self, other: Errors) -> Errors:
        """The sums of both."""
        return Errors(
            self.tensor + other.tensor,
            self.bulk + other.bulk,
            self.shear + other.shear,
            self.shear_stress_corrected + other.shear_stress_corrected,
        )

    def __repr__(self) -> str:
        return f"Errors(bulk={self.bulk:.6g}, shear={self.shear:.6g})"


class LateErrors(Errors):
    """Errors that functions of no arguments compute at their first use: some take longer than the moduli themselves."""

    def __init__(
        self,
        tensor: Callable[[], Array],
        bulk: Callable[[], float],
        shear: Callable[[], float],
        shear_stress_corrected: Callable[[], float],
    ):
        self._computed = tensor, bulk, shear, shear_stress_corrected

    @cached_property
    def tensor(self) -> Array:
        return self._computed[0]()

    @cached_property
    def bulk(self) -> float:
        return self._computed[1]()

    @cached_property
    def shear(self) -> float:
        return self._computed[2]()

    @cached_property
    def shear_stress_corrected(self) -> float:
        return self._computed[3]()

    @classmethod
    def total(cls, parts: Sequence[Errors]) -> Errors:
        """Sums of errors."""
        return cls(
            lambda: np.sum([part.tensor for part in parts], axis=0),
            lambda: sum(part.bulk for part in parts),
            lambda: sum(part.shear for part in parts),
            lambda: sum(part.shear_stress_corrected for part in parts),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Elasticity(Record):
    """Elasticity tensors, in units of energy per volume, with m = d(d + 1)/2 components, and moduli.

    tensor  relaxed C_ab by the energy, (m, m)
    affine  affine C_ab, (m, m)
    stress  S, (d, d)
    volume  V, of the cell or as named for a pinned network
    errors  of both tensors and of the moduli; at the transition they are computed at their first use
    bulk    B = V d²E/dV²; a response of its own where it is given, since the sum over the tensor may cancel

    Singular tensors, as at the transition, where the rank is one per self-stress, have soft directions: Young's modulus
    is 0 where a uniaxial stress excites one, and compliances are infinite.  Singular values below the errors count as
    zero, and all is NaN where the errors exceed a tenth of the tensor.  Poisson's ratio is NaN where the tensor does
    not determine it.
    """

    tensor: Array
    affine: Array
    stress: Array
    volume: float
    errors: Errors = field(default=None, repr=False)  # type: ignore[assignment]
    bulk: float = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        d = len(self.stress)
        m = d * (d + 1) // 2
        assert self.tensor.shape == self.affine.shape == (m, m) and self.stress.shape == (d, d), "shapes"
        for name in ("tensor", "affine", "stress"):
            # They are symmetric up to rounding.
            object.__setattr__(self, name, 0.5 * (getattr(self, name) + getattr(self, name).T))
        if self.errors is None:
            object.__setattr__(self, "errors", Errors.of_tensor(np.full((m, m), np.nan), d))
        if self.bulk is None:
            bulk = self.tensor[:d, :d].sum() / d**2 + (1 / d) * (1 / d - 1) * np.trace(self.stress)
            object.__setattr__(self, "bulk", float(bulk))

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
        return self.tensor - self._stress_terms

    @cached_property
    def affine_stress_corrected(self) -> Array:
        """Affine c_ab, (m, m)."""
        return self.affine - self._stress_terms

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
        inverse, soft, _ = self._inverse
        scale = np.outer(_mandel(self.dimension), _mandel(self.dimension))
        with np.errstate(divide="ignore", invalid="ignore"):
            limit = np.where(np.abs(soft) > _UNIT_ROUNDING, np.copysign(np.inf, soft), inverse)
        return limit * scale

    # Moduli

    @property
    def shear(self) -> float:
        """G = (1/V) d²E/dε² of the pure shear in the plane xy, energy convention."""
        self._require_plane()
        return float(self.tensor[-1, -1])

    @property
    def shear_stress_corrected(self) -> float:
        """G − ½ dE/dV; in the plane, and under isotropic stress, it is the component xy, xy of `stress_corrected`."""
        return self.shear - 0.5 * float(np.trace(self.stress)) / self.dimension

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

    def young(self, direction: ArrayLike) -> float:
        """Young's modulus, stress over strain along a direction where no other stress changes; 0 where it is soft.

        direction  a vector (d,), or its angle from x in the plane xy
        """
        n = self._tensor_components(self._unit(direction))
        inverse, soft, _ = self._inverse
        return 0.0 if abs(n @ soft @ n) > _UNIT_ROUNDING else float(1 / (n @ inverse @ n))

    def poisson(self, direction: ArrayLike, transverse: ArrayLike | None = None) -> float:
        """Poisson's ratio −(strain along `transverse`)/(strain along `direction`) under uniaxial stress along the last.

        NaN where soft directions leave it undetermined.

        direction, transverse  vectors (d,), or angles from x in the plane xy; `transverse` is by default perpendicular
                               to the direction in that plane

        Raises `InputError` for directions that are not orthogonal.
        """
        along = self._unit(direction)
        if transverse is None:
            self._require_plane()
            transverse = np.concatenate([[-along[1], along[0]], np.zeros(self.dimension - 2)])
        across = self._unit(transverse)
        if abs(along @ across) > 1e-9:
            raise InputError("Poisson's ratio needs a transverse direction orthogonal to the direction of the stress")
        n, t = self._tensor_components(along), self._tensor_components(across)
        inverse, _, null = self._inverse
        if not np.isfinite(inverse).all():
            return np.nan
        n_soft, t_soft = null.T @ n, null.T @ t
        if np.linalg.norm(n_soft) <= _UNIT_ROUNDING:
            return float(-(t @ inverse @ n) / (n @ inverse @ n)) if np.linalg.norm(t_soft) <= _UNIT_ROUNDING else np.nan
        # Soft strains per strain along n; determined where all give the same strain along t.
        ratio = float(t_soft @ n_soft / (n_soft @ n_soft))
        return -ratio if np.linalg.norm(t_soft - ratio * n_soft) <= _UNIT_ROUNDING else np.nan

    @property
    def voigt(self) -> tuple[float, float]:
        """Bulk and shear modulus of a random polycrystal by Voigt, at equal strain: not less than any."""
        d, n_deviators = self.dimension, len(self.tensor) - 1
        one, stiff = self._tensor_components(np.eye(d)), self._mandel_tensor
        bulk = float(one @ stiff @ one) / d**2
        return bulk, float(np.trace(stiff) - d * bulk) / (2 * n_deviators) if n_deviators else np.nan

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
    def _inverse(self) -> tuple[Array, Array, Array]:
        """Pseudo-inverse in the orthonormal basis, and orthonormal strains without resistance, (m, n).

        Between them the matrix whose product with 1/δ the inverse gains with a resistance δ.  NaN where the tensor or
        its errors are not known.
        """
        stiff, weights = self._mandel_tensor, _mandel(self.dimension)
        errors, unknown = self.errors.tensor * np.outer(weights, weights), np.full_like(stiff, np.nan)
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

    def second(self, A: Array, B: Array) -> float:
        """(1/V) ∂²E/∂α∂β of F = 1 + αA + βB."""
        symmetric, other = 0.5 * (A + A.T), 0.5 * (B + B.T)
        a, b = (strain_components(strain) for strain in (symmetric, other))
        turning = np.vdot(self.stress, A.T @ B) - np.vdot(self.stress, symmetric @ other)
        return float(a @ self.tensor @ b + turning)

    def _tensor_components(self, tensor: Array) -> Array:
        """Components of a symmetric tensor, or of n ⊗ n for a vector n, in the orthonormal basis, (m,)."""
        tensor = np.outer(tensor, tensor) if tensor.ndim == 1 else tensor
        return strain_components(tensor) / _mandel(self.dimension)

    def _unit(self, direction: ArrayLike) -> Array:
        n = np.asarray(direction, dtype=float)
        if n.ndim == 0:
            self._require_plane()
            n = np.concatenate([[np.cos(n), np.sin(n)], np.zeros(self.dimension - 2)])
        size = np.linalg.norm(n) if n.shape == (self.dimension,) else 0.0
        if not (np.isfinite(size) and size > 0):
            raise InputError(f"a direction is an angle or a vector of {self.dimension} finite components, not all zero")
        return n / size

    def _require_plane(self) -> None:
        if self.dimension < 2:
            raise InputError("a shear needs at least two dimensions")


def no_elasticity(dimension: int, volume: float = np.nan, error: float = np.nan) -> Elasticity:
    """Tensors of NaN, with one error for all."""
    m = dimension * (dimension + 1) // 2
    unknown = np.full((m, m), np.nan)
    errors = Errors(np.full((m, m), error), error, error, error)
    return Elasticity(unknown, unknown, np.full((dimension, dimension), np.nan), volume, errors)


# Components of unit tensors below this are zero: they carry the errors of singular vectors.
_UNIT_ROUNDING = 1e-7


@cache
def _mandel(dimension: int) -> Array:
    """Factors √2 of shear components, (m,), that make an orthonormal basis of symmetric tensors."""
    return np.sqrt(np.repeat([1.0, 2.0], [dimension, dimension * (dimension - 1) // 2]))
