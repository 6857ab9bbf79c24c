"""Linear response of springs under stress: relaxations and elasticity with error estimates.

With the total rates L̇_a = E_a L + g u_a of bond vectors under a strain E_a and ḣ_a = L·L̇_a,
    V C_ab = ḣ_aᵀ K ḣ_b + Σ σ L̇_a·L̇_b
is stationary at the relaxations u, so that their errors enter as products (`LinearResponse`).

The strains are dilation, deviators and shears (`unit_strains`), each with a separate relaxation, so that the bulk
modulus is not a difference of larger numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from critflow.deformation import Deformable, deformation_of, strain_basis, strain_components
from critflow.equilibria import FLOPPY_SHIFT, stability_of
from critflow.networks import Array
from critflow.numerics import EPS, product
from critflow.refinement import inverse_norm
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.sparse import Factor, FixedPattern
from critflow.springs import SpringState, times

# The elasticity tensor of a network and the moduli that follow from it.
#
# Strains are ε = Σ_a ε_a E_a in the basis `strain_basis`, m = d(d + 1)/2 components in Voigt's order with engineering
# shears: F = 1 + ε with symmetric ε.  S_ij = Σ σ L_i L_j/V is the stress (Cauchy, tension positive).
#
#     energy            C_ab = (1/V) ∂²E/∂ε_a∂ε_b
#     stress-corrected  c_ab = (1/V) ∂²E/∂η_a∂η_b = C_ab − tr(E_a E_b S), with η = ½(FᵀF − 1), the Green–Lagrange strain
#     stress–strain     B_ab = dS_a/dε_b without rotation, the increment of the stress that an experiment measures
#
# For symmetric ε, η = ε + ½ε², and ∂E/∂η = V S, hence the correction: in the plane a shear has E_a² = ¼ 1, which
# subtracts ¼ tr S = ½ dE/dV.  A stretched volume adds to the stress-strain coefficients (Barron and Klein 1965)
#     B_ijkl = c_ijkl + ½(δ_ik S_jl + δ_jk S_il + δ_il S_jk + δ_jl S_ik) − S_ij δ_kl.
# Without stress all three are equal.  Each is relaxed (vertices follow the strain) or affine (vertices move with b).

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


# Corrections of a relaxation below this part of it have converged; largest number of corrections.
_CONVERGED, _MOST_CORRECTIONS = 0.05, 4
# The contraction of corrections is that observed between two of them times this margin.
_CONTRACTION_MARGIN = 10.0
# Relaxations below this part of the mean length are compared with it instead: all edges then respond affinely.
_NO_RELAXATION = 1e-5


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LinearResponse(Solution[Elasticity]):
    """The elasticity of a state under stress and the responses to strains.

    strains, responses  rows n of `unit_strains`, and dx/dε (n, d, n_free) under them; no rows where not known
    """

    strains: tuple[int, ...]
    responses: Array = field(repr=False)

    def relaxation(self, strain: Array) -> Array:
        """dx/dε (n_free, d) under a strain of components (m,) in `strain_basis`, relative to the affine motion."""
        weights = (basis_change(self.value.dimension) @ strain)[list(self.strains)]
        return (weights @ self.responses.reshape(len(weights), -1)).reshape(self.responses.shape[1:]).T


def linear_response(
    state: SpringState,
    volume: float,
    pattern: FixedPattern | None = None,
    exact: bool = False,
    factor: Factor | None = None,
    condition: bool = True,
    strains: tuple[int, ...] | None = None,
) -> LinearResponse:
    """Elasticity of springs under stress in equilibrium, and the relaxations that strains cause.

    volume     V, to which the moduli refer
    exact      the state is the equilibrium to the rounding of its numbers, as Newton's method returns it; otherwise the
               exact equilibrium is found and the change of the moduli up to it is part of the errors
    factor     of the Hessian at or near the state, if there is one
    condition  whether `stats.condition`, ‖H‖‖H⁻¹‖, is computed, which costs a solve; else it is NaN
    strains    rows of `unit_strains`, such as those of `strains_of`; responses to all others are zero in the result

    Errors (estimate) are those against the exact equilibrium (see `equilibrium`); roundings are summed by
    `accumulated_rounding`.
    `Status.unstable` and NaN where the Hessian has negative eigenvalues: the springs then buckle under any strain;
    `Status.undecided` and NaN where rounding hides whether it has.
    `Status.ill_conditioned` and NaN where an error exceeds a tenth of the larger modulus.
    Floppy parts, such as slack ones, do not resist and contribute nothing.
    """
    d = state.network.dimension
    if d < 2:
        raise InputError("a shear needs at least two dimensions")
    pattern, strains = pattern or state.pattern(), strains or tuple(range(len(unit_strains(d))))
    # Without negative eigenvalues any factor near the state will do; convergence shows whether it is near enough.
    found = _responses(state, factor, volume, strains) if factor is not None and not state.softens else None
    if factor is None or found is None or not found.converged:
        factor = state.factorize(pattern)
        found = _responses(state, factor, volume, strains) if factor.sound and not factor.n_negative else None
    floppy = found is None or not found.converged
    if floppy:
        factor = state.factorize(pattern, FLOPPY_SHIFT * state.stiffness_scale)
        # The shift hides eigenvalues that compression makes negative but small.
        stable, note = (Status.unstable, "") if factor.indefinite else stability_of(state, pattern)
        if stable is not Status.ok:
            nothing, stats = np.zeros((0, d, len(state.network.free))), Stats("linear response", 2)
            return LinearResponse(no_elasticity(d, volume), stable, stats, note, strains=(), responses=nothing)
        found = _responses(state, factor, volume, strains)
    assert found is not None
    errors: Errors | None = found.elasticity.errors if found.converged else None
    if errors is not None and not exact:
        change = _change_to_equilibrium(state, factor, found, floppy, volume, strains)
        errors = change and errors.plus(change)
    number = state.largest_stiffness * inverse_norm(factor, found.last) if condition else np.nan
    stats = Stats("linear response", 1, residual=found.residual, condition=number)
    value, status, note = found.elasticity, Status.ok, ""
    trusted = TRUSTED_ERROR * max(abs(value.bulk), abs(value.shear))
    if errors is None or max(errors.bulk, errors.shear, errors.shear_stress_corrected) > trusted:
        value, status = no_elasticity(d, volume, np.inf), Status.ill_conditioned
        note = "rounding errors exceed a tenth of the response to strain: measure it further from the transition"
    elif not exact:
        value = replace(value, errors=errors)
    return LinearResponse(value, status, stats, note, strains=strains, responses=found.relaxations)


# Strains


@cache
def unit_strains(dimension: int) -> Array:
    """Strains (m, d, d): dilation 1/d, deviators e_i e_iᵀ − 1/d of all axes but the last, shears in Voigt's order."""
    basis, unit = strain_basis(dimension)[1], np.eye(dimension) / dimension
    return np.concatenate([unit[None], basis[: dimension - 1] - unit, basis[dimension:]])


@cache
def basis_change(dimension: int) -> Array:
    """T (m, m): the strain a of `strain_basis` is Σ_n T_na `unit_strains`_n."""
    units = np.array([strain_components(E) for E in unit_strains(dimension)])
    return np.rint(np.linalg.inv(units).T)  # of whole numbers


def strains_of(rates: Array) -> tuple[int, ...]:
    """Rows of `unit_strains` for the moduli, dilation and the last shear, and for rates A (n, d, d) of a cell."""
    d = rates.shape[1]
    parts = np.array([basis_change(d) @ strain_components(0.5 * (A + A.T)) for A in rates])
    last = parts.shape[1] - 1
    return tuple(n for n in range(last + 1) if n in (0, last) or parts[:, n].any())


@cache
def stress_products(dimension: int) -> Array:
    """Sums of the entries of |E_a||E_b|, (m, m): the effect of an error of the stress on its terms."""
    basis = np.abs(strain_basis(dimension)[1])
    return np.einsum("aij,bjk->ab", basis, basis)


# Responses


@dataclass(frozen=True, eq=False)
class _Responses:
    """Responses to all strains, from one factor.

    elasticity         with rounding errors
    relaxations  u (m, d, n_free) under `unit_strains`
    last         the last correction of the first of them, (n_free·d,)
    """

    elasticity: Elasticity
    relaxations: Array
    last: Array
    residual: float
    converged: bool


def _change_to_equilibrium(
    state: SpringState, factor: Factor, found: _Responses, floppy: bool, volume: float, strains: tuple[int, ...]
) -> Errors | None:
    """Twice the change of the elasticity up to the exact equilibrium; None where that is not found."""
    correction = state.exact_displacement(factor, regularised=floppy)
    if not np.isfinite(correction.remainder):
        return None
    here = found.elasticity
    apart = np.abs(correction.bond_vectors - state.bond_vectors)
    if not (apart > EPS * state.lengths[:, None]).any():
        return Errors(np.zeros_like(here.tensor), 0.0, 0.0, 0.0)
    moved = replace(state, bond_vectors=correction.bond_vectors)
    responses = _responses(moved, factor, volume, strains)
    if not responses.converged:
        return None
    there = responses.elasticity
    return Errors(
        2 * np.abs(there.tensor - here.tensor),
        2 * abs(there.bulk - here.bulk),
        2 * abs(there.shear - here.shear),
        2 * abs(there.shear_stress_corrected - here.shear_stress_corrected),
    )


def _responses(state: SpringState, factor: Factor, volume: float, strains: tuple[int, ...]) -> _Responses:
    """The responses to some rows of `unit_strains` by a factor of the Hessian, refined until corrections are small.

    The first of them is the dilation, the last one the last shear.
    """
    network, sigma = state.network, state.sigma
    d, m, n = network.dimension, len(strains), network.n_edges
    # Edges are the last axis: NumPy is several times slower where that is short.
    L, K = np.ascontiguousarray(state.bond_vectors.T), state.modified_stiffness
    affine = (unit_strains(d)[list(strains)].reshape(m * d, d) @ L).reshape(m, d, n)
    divergence, incidence = network.divergence, network.free_incidence
    rate, direct, least = affine, np.zeros((m, m)), _NO_RELAXATION * state.length_scale
    u, scale, energy = np.zeros((m, d * len(network.free))), np.zeros(m), np.zeros(m)
    for refinement in range(_MOST_CORRECTIONS + 1):
        hdot = np.add.reduce(L * rate, axis=1)
        tension = times(K, hdot)
        stressed = sigma * rate
        pulls = tension[:, None] * L + stressed
        # The forces of all strains in one product.
        force = -product(divergence, pulls.reshape(m * d, n).T)
        force = force.reshape(-1, m, d).swapaxes(0, 1).reshape(m, -1)
        stretching = hdot @ tension.T
        form = stretching + stressed.reshape(m, -1) @ rate.reshape(m, -1).T
        direct = direct if refinement else form
        correction = np.array([factor.solve(each) for each in force])
        gained = force @ correction.T
        size, u = _largest(force), u + correction
        scale = np.maximum(scale, size)
        small = bool((_largest(correction) <= _CONVERGED * np.maximum(_largest(u), least)).all())
        before, energy = energy, np.abs(gained.diagonal())
        # The energy that a correction leaves is its gain times the contraction, and must be rounding.
        unfinished = energy * _contraction(energy, before)
        if refinement and small and (unfinished <= 4 * EPS * stretching.diagonal()).all():
            break
        motion = u.reshape(m, -1, d).swapaxes(0, 1).reshape(-1, m * d)
        rate = affine + np.ascontiguousarray(product(incidence, motion).T).reshape(m, d, n)
    relaxations = u.reshape(m, -1, d).swapaxes(1, 2)
    speed = np.sqrt(np.add.reduce(rate * rate, axis=1))
    noise, first = _rounding(state, speed, relaxations, tension)
    unfinished = np.sqrt(np.outer(unfinished, unfinished))
    return _Responses(
        _elasticity(state, volume, strains, (form - gained, direct), (noise, unfinished), first),
        relaxations,
        correction[0],
        float((size / np.maximum(scale, 1e-300)).max()),
        small,
    )


def _elasticity(
    state: SpringState,
    volume: float,
    strains: tuple[int, ...],
    forms: tuple[Array, Array],
    errors: tuple[Array, Array],
    first: Array,
) -> Elasticity:
    """Tensor, moduli and their errors from V C_ab (m, m), relaxed and affine, rounding and unfinished relaxation.

    first  parts (N_b,) of the rounding of the first form, that of the dilation
    """
    (noise, unfinished), d, form = errors, state.network.dimension, forms[0] / volume
    sigma, square, L = state.sigma, state.lengths**2, state.bond_vectors.T
    form_rounding = (noise + unfinished) / volume + 4 * EPS * np.abs(form)
    T, stress = basis_change(d)[list(strains)], (sigma * L) @ L.T / volume
    stress_rounding = float(accumulated_rounding(2 * state.stress_rounding * square)) / volume
    # Dilation (1 + γ)^{1/d} is curved: b̈ = (1/d)(1/d − 1) b.
    trace, curvature = float(sigma @ square) / volume, (1 / d) * (1 / d - 1)
    bulk = float(form[0, 0] + curvature * trace)
    stretched = first + (state.stress_rounding + 4 * EPS * np.abs(sigma)) * abs(curvature) * square
    bulk_rounding = (float(accumulated_rounding(stretched)) + float(unfinished[0, 0])) / volume + 4 * EPS * abs(bulk)
    shear_rounding = float(form_rounding[-1, -1])
    corrected_rounding = shear_rounding + 0.5 * stress_rounding / d + 4 * EPS * abs(trace / d)
    tensor = T.T @ form @ T
    rounding = np.abs(T).T @ form_rounding @ np.abs(T) + 4 * EPS * np.abs(tensor)
    rounding += (stress_rounding + 4 * EPS * float(np.abs(stress).max())) * stress_products(d)
    bounds = Errors(0.5 * (rounding + rounding.T), bulk_rounding, shear_rounding, corrected_rounding)
    return Elasticity(tensor, T.T @ forms[1] @ T / volume, stress, volume, bounds, bulk)


def _contraction(energy: Array, before: Array) -> float:
    """The part of an error that a correction leaves, from the energies (m,) of two; at most 1.

    The largest of all strains with a margin, since the first correction may shrink faster than those after it.
    """
    positive = before > 0
    ratio = float(np.maximum.reduce(np.where(positive, energy, 1.0) / np.where(positive, before, 1.0)))
    return min(1.0, _CONTRACTION_MARGIN * float(np.sqrt(ratio)))


def _rounding(state: SpringState, speed: Array, u: Array, tension: Array) -> tuple[Array, Array]:
    """Rounding errors of V C_ab, (m, m), and the parts (N_b,) of the first one.

    Sources: σ; rates |L̇| (m, N_b) as differences of vertex velocities u (m, d, n_free), which may exceed them; products
    with K ḣ (m, N_b).
    """
    network, sigma, length = state.network, np.abs(state.sigma), state.lengths
    vertex_speed = np.zeros((len(u), network.n_vertices))
    vertex_speed[:, network.free_rows] = np.sqrt(np.add.reduce(u * u, axis=1))
    tail, head = np.ascontiguousarray(network.edges.T)
    rate_rounding = EPS * (speed + vertex_speed.take(tail, 1) + vertex_speed.take(head, 1) + length)
    pull = np.abs(tension) * length + sigma * speed
    loose = state.stress_rounding * speed
    mixed = _accumulated_products(pull, rate_rounding)
    return _accumulated_products(loose, speed) + mixed + mixed.T, loose[0] * speed[0] + 2 * pull[0] * rate_rounding[0]


def _accumulated_products(one: Array, other: Array) -> Array:
    """`accumulated_rounding` of all products of rows of two arrays (m, n) without negative entries, (m, m)."""
    return np.asarray(3 * np.sqrt(one**2 @ (other**2).T) + 0.25 * one @ other.T)


def _largest(vectors: Array) -> Array:
    """Largest component of each of the vectors (m, n), (m,)."""
    return np.maximum.reduce(np.abs(vectors), axis=-1, initial=0.0)


def accumulated_rounding(errors: Array) -> Any:
    """Error (estimate) of sums whose terms have roundings of these magnitudes (..., n): 3‖e‖₂ + ¼ Σ e.

    Independent roundings of mean zero add up to ‖e‖₂ or less (one standard deviation), so 3‖e‖₂ is exceeded in less
    than 1 % of sums.  On lattices symmetric edges round alike and their errors add coherently, of which ¼ Σ e allows
    for a quarter.  The rigorous bound Σ e exceeds typical errors by √n.
    """
    return 3 * np.sqrt(np.add.reduce(errors * errors, axis=-1)) + 0.25 * np.add.reduce(errors, axis=-1)
