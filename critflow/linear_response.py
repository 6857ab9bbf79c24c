"""The record of elasticity, and the linear response of springs under stress with error estimates.

Strains are ε = Σ_a ε_a E_a in the basis `strain_basis`, m = d(d + 1)/2 components in Voigt's order with engineering
shears: F = 1 + ε with symmetric ε.  The elasticity tensor is C_ab = (1/V) ∂²E/∂ε_a∂ε_b, and S_ij = Σ σ L_i L_j/V is the
stress (Cauchy, tension positive).  The tensor is relaxed (vertices follow the strain) or affine (vertices move with b).

With the total rates L̇_a = E_a L + g u_a of bond vectors under a strain E_a and ḣ_a = L·L̇_a,
    V C_ab = ḣ_aᵀ K ḣ_b + Σ σ L̇_a·L̇_b
is stationary at the relaxations u, so that their errors enter as products (`LinearResponse`).  The strains are
dilation, deviators and shears (`unit_strains`), each with a separate relaxation, so that the bulk modulus is not a
difference of larger numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from critflow.deformation import Deformable, deformation_of, strain_basis, strain_components
from critflow.equilibria import FLOPPY_SHIFT, stability_of
from critflow.extensions import from_extras
from critflow.networks import Array
from critflow.numerics import EPS, dot, product
from critflow.refinement import ROUNDED_FORCE, inverse_norm
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.sparse import Factor
from critflow.springs import SpringState

TRUSTED_ERROR = 0.1  # largest error of a result, relative to the largest modulus or coefficient: one digit is correct
# Corrections of a relaxation below this part of it have converged; largest number of corrections.
CONVERGED, MOST_CORRECTIONS = 0.05, 4
# The contraction of corrections is that observed between two of them times this margin.
CONTRACTION_MARGIN = 10.0
SLOWEST = 0.99  # largest contraction that counts: corrections of the size of rounding do not shrink
# Relaxations below this part of the mean length are compared with it instead: all edges then respond affinely.
NO_RELAXATION = 1e-5

_HIDDEN = "rounding errors exceed a tenth of the response to strain: measure it further from the transition"
_BY_DIRECTION = "Young's modulus and Poisson's ratio"


class Errors:
    """Largest errors of both tensors, (m, m), and of the moduli; NaN where unknown.

    An error may be a function of no arguments, which is called at its first use: some take longer than the moduli.
    """

    def __init__(self, tensor: Any, bulk: Any, shear: Any, shear_stress_corrected: Any):
        self._tensor, self._bulk, self._shear, self._corrected = tensor, bulk, shear, shear_stress_corrected

    @cached_property
    def tensor(self) -> Array:
        return np.asarray(self._tensor() if callable(self._tensor) else self._tensor)

    @cached_property
    def bulk(self) -> float:
        return float(self._bulk() if callable(self._bulk) else self._bulk)

    @cached_property
    def shear(self) -> float:
        return float(self._shear() if callable(self._shear) else self._shear)

    @cached_property
    def shear_stress_corrected(self) -> float:
        return float(self._corrected() if callable(self._corrected) else self._corrected)

    def __repr__(self) -> str:
        return f"Errors(bulk={self.bulk:.6g}, shear={self.shear:.6g})"


@dataclass(frozen=True, eq=False, repr=False)
class Elasticity(Record):
    """Elasticity tensors, in units of energy per volume, with m = d(d + 1)/2 components, and moduli.

    tensor  relaxed C_ab by the energy, (m, m)
    affine  affine C_ab, (m, m)
    stress  S, (d, d)
    volume  V, of the cell or as named for a pinned network
    errors  of both tensors and of the moduli; at the transition they are computed at their first use
    bulk    B = V d²E/dV², by a response of its own under stress, since the sum over the tensor may cancel
    """

    tensor: Array
    affine: Array
    stress: Array
    volume: float
    errors: Errors = field(repr=False)
    bulk: float

    def __post_init__(self) -> None:
        d = len(self.stress)
        m = d * (d + 1) // 2
        assert self.tensor.shape == self.affine.shape == (m, m) and self.stress.shape == (d, d), "shapes"
        for name in ("tensor", "affine", "stress"):
            # They are symmetric up to rounding.
            object.__setattr__(self, name, 0.5 * (getattr(self, name) + getattr(self, name).T))

    @property
    def dimension(self) -> int:
        return len(self.stress)

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the components, such as ("xx", "yy", "xy")."""
        return strain_basis(self.dimension)[0]

    @property
    def shear(self) -> float:
        """G = (1/V) d²E/dε² of the pure shear in the plane xy, energy convention."""
        if self.dimension < 2:
            raise InputError("a shear needs at least two dimensions")
        return float(self.tensor[-1, -1])

    @property
    def shear_stress_corrected(self) -> float:
        """G − ½ dE/dV; in the plane, and under isotropic stress, C_xyxy by derivatives in the Green–Lagrange strain."""
        return self.shear - 0.5 * float(np.trace(self.stress)) / self.dimension

    @property
    def trusted(self) -> bool:
        """Whether the errors of all moduli are known, and below a tenth of the larger modulus."""
        errors = np.array([self.errors.bulk, self.errors.shear, self.errors.shear_stress_corrected])
        return bool((errors <= TRUSTED_ERROR * max(abs(self.bulk), abs(self.shear))).all())

    def modulus(self, deformation: Deformable) -> float:
        """(1/V) d²E/dγ² at γ = 0 of any deformation, or of F = 1 + γA for a matrix A (d, d) that may rotate.

        Free components of the cell relax: the uniaxial deformation with free sides has Young's modulus, without stress.
        Raises `InputError` for what is not a deformation.
        """
        path = deformation_of(deformation, self.dimension)
        S, A, free = self.stress, path.velocity(0.0), path.free_strains
        # 1. (1/V) ∂²E/∂α_a∂α_b of F = 1 + Σ α_a A_a, of the path and the free components
        rates = np.array([A, *free])
        strains = 0.5 * (rates + rates.swapaxes(1, 2))
        components = np.array([strain_components(E) for E in strains])
        turning = np.einsum("ij,aki,bkj->ab", S, rates, rates) - np.einsum("ij,aik,bkj->ab", S, strains, strains)
        second = components @ self.tensor @ components.T + turning
        # 2. The free components multiply F from the left, ∂²F/∂q∂γ = E_m A, and relax
        coupling = second[1:, 0] + np.einsum("ij,mij->m", S, free @ A)
        relaxed = coupling @ np.linalg.pinv(second[1:, 1:], hermitian=True) @ coupling
        return float(second[0, 0] + np.vdot(S, path.acceleration(0.0)) - relaxed)

    def young(self, direction: ArrayLike) -> float:
        """Young's modulus, stress over strain along a direction where no other stress changes; 0 where it is soft.

        direction  a vector (d,), or its angle from x in the plane xy
        """
        return float(from_extras("young", _BY_DIRECTION)(self, direction))

    def poisson(self, direction: ArrayLike, transverse: ArrayLike | None = None) -> float:
        """Poisson's ratio −(strain along `transverse`)/(strain along `direction`) under uniaxial stress along the last.

        NaN where soft directions leave it undetermined.

        direction, transverse  vectors (d,), or angles from x in the plane xy; `transverse` is by default perpendicular
                               to the direction in that plane

        Raises `InputError` for directions that are not orthogonal.
        """
        return float(from_extras("poisson", _BY_DIRECTION)(self, direction, transverse))


def no_elasticity(dimension: int, volume: float = np.nan, error: float = np.nan) -> Elasticity:
    """Tensors of NaN, with one error for all."""
    m = dimension * (dimension + 1) // 2
    unknown, errors = np.full((m, m), np.nan), Errors(np.full((m, m), error), error, error, error)
    return Elasticity(unknown, unknown, np.full((dimension, dimension), np.nan), volume, errors, np.nan)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LinearResponse(Solution[Elasticity]):
    """The elasticity of springs, by their self-stresses or by the responses to strains.

    n_self_stresses     independent self-stresses of springs without stress, which resist by them; those that no strain
                        excites contribute nothing.  None: under stress
    strains, responses  rows n of `unit_strains`, and dx/dε (n, d, n_free) under them; no rows where not known
    """

    n_self_stresses: int | None = None
    strains: tuple[int, ...] = ()
    responses: Array = field(default_factory=lambda: np.zeros((0, 0, 0)), repr=False)


def combined(responses: Array, strains: tuple[int, ...], strain: Array) -> Array:
    """dx/dε (n_free, d) under a strain of components (m,), from those (n, d, n_free) under rows of `unit_strains`."""
    weights = (basis_change(responses.shape[1]) @ strain)[list(strains)]
    return (weights @ responses.reshape(len(weights), -1)).reshape(responses.shape[1:]).T


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


# Responses


def linear_response(
    state: SpringState,
    volume: float,
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
    strains, solution = strains or tuple(range(len(unit_strains(d)))), None
    # 1. A factor near the state: without negative eigenvalues any will do, and convergence shows whether it is near
    if factor is not None and not state.softens:
        solution, last = responses(state, factor, volume, strains)
    # 2. A factor at the state
    if factor is None or not solution:
        factor = state.factorize()
        if factor.sound and not factor.n_negative:
            solution, last = responses(state, factor, volume, strains)
    # 3. With a shift that floppy modes need, which hides eigenvalues that compression makes negative but small
    if floppy := not solution:
        factor = state.factorize(FLOPPY_SHIFT * state.stiffness_scale)
        stable, note = (Status.unstable, "") if factor.indefinite else stability_of(state)
        if stable is not Status.ok:
            return LinearResponse(no_elasticity(d, volume), stable, Stats("linear response", 2), note)
        solution, last = responses(state, factor, volume, strains)
    assert solution is not None
    # 4. The change up to the exact equilibrium is part of the errors
    value, converged = solution.value, solution.ok
    if converged and not exact:
        change = change_to_equilibrium(state, factor, value, floppy, strains)
        value, converged = change or value, change is not None
    # 5. Errors that hide the moduli
    if condition:
        number = state.largest_stiffness * inverse_norm(factor, last)
        solution = replace(solution, stats=replace(solution.stats, condition=number))
    if not (converged and value.trusted):
        return replace(solution, value=no_elasticity(d, volume, np.inf), status=Status.ill_conditioned, note=_HIDDEN)
    return solution if value is solution.value else replace(solution, value=value)


def change_to_equilibrium(
    state: SpringState, factor: Factor, here: Elasticity, floppy: bool, strains: tuple[int, ...]
) -> Elasticity | None:
    """The elasticity with twice its change up to the exact equilibrium in its errors; None where that is not found.

    floppy  whether the factor has a shift that resists floppy modes
    """
    correction = state.exact_displacement(factor, regularised=floppy)
    if not np.isfinite(correction.remainder):
        return None
    apart = np.abs(correction.bond_vectors - state.bond_vectors)
    if not (apart > EPS * state.lengths[:, None]).any():
        return here
    moved = replace(state, bond_vectors=correction.bond_vectors)
    response, _ = responses(moved, factor, here.volume, strains)
    if not response.ok:
        return None
    there, errors = response.value, here.errors
    changed = Errors(
        errors.tensor + 2 * np.abs(there.tensor - here.tensor),
        errors.bulk + 2 * abs(there.bulk - here.bulk),
        errors.shear + 2 * abs(there.shear - here.shear),
        errors.shear_stress_corrected + 2 * abs(there.shear_stress_corrected - here.shear_stress_corrected),
    )
    return replace(here, errors=changed)


def responses(
    state: SpringState, factor: Factor, volume: float, strains: tuple[int, ...]
) -> tuple[LinearResponse, Array]:
    """The responses to some rows of `unit_strains` by a factor of the Hessian, and the last correction of the first.

    The first strain is the dilation, the last one the last shear.  `Status.stalled` where the corrections do not become
    small.
    """
    network, sigma = state.network, state.sigma
    d, m, n = network.dimension, len(strains), network.n_edges
    # Edges are the last axis: NumPy is several times slower where that is short.
    L = np.ascontiguousarray(state.bond_vectors.T)
    affine = (unit_strains(d)[list(strains)].reshape(m * d, d) @ L).reshape(m, d, n)
    rate, direct, least, relaxing = affine, np.zeros((m, m)), NO_RELAXATION * state.length_scale, np.arange(m)
    u, scale, energy, left = np.zeros((m, d * len(network.free))), np.zeros(m), np.zeros(m), np.full(m, np.inf)
    for refinement in range(MOST_CORRECTIONS + 1):
        # 1. The form and the forces of all strains, in one product
        hdot = np.add.reduce(L * rate, axis=1)
        tension = state.resistance(hdot)
        stressed = sigma * rate
        pulls = tension[:, None] * L + stressed
        force = -product(network.divergence, pulls.reshape(m * d, n).T)
        force = force.reshape(-1, m, d).swapaxes(0, 1).reshape(m, -1)
        stretching = hdot @ tension.T
        form = stretching + stressed.reshape(m, -1) @ rate.reshape(m, -1).T
        direct = direct if refinement else form
        # 2. A correction of each relaxation; forces of rounding alone, as of a dilation where σ = k, need no solve
        size, correction = largest_each(force), np.zeros_like(force)
        relaxing = relaxing if refinement else np.flatnonzero(size > ROUNDED_FORCE * largest_each(pulls.reshape(m, -1)))
        for each in relaxing:
            correction[each] = factor.solve(force[each])
        gained, u = force @ correction.T, u + correction
        moved, last, left = largest_each(u), left, largest_each(correction)
        scale = np.maximum(scale, size)
        small = bool((left <= CONVERGED * np.maximum(moved, least)).all())
        # 3. The energy that it leaves is its gain times the contraction, and must be rounding.  The contraction is the
        # largest of all strains with a margin, since the first correction may shrink faster than those after it
        before, energy = energy, np.abs(gained.diagonal())
        positive = before > 0
        ratio = float(np.maximum.reduce(np.where(positive, energy, 1.0) / np.where(positive, before, 1.0)))
        unfinished = energy * min(1.0, CONTRACTION_MARGIN * float(np.sqrt(ratio)))
        if refinement and small and (unfinished <= 4 * EPS * stretching.diagonal()).all():
            break
        motion = u.reshape(m, -1, d).swapaxes(0, 1).reshape(-1, m * d)
        rate = affine + np.ascontiguousarray(product(network.free_incidence, motion).T).reshape(m, d, n)
    unfinished = remaining(energy, unfinished, left, last)
    relaxations, speed = u.reshape(m, -1, d).swapaxes(1, 2), np.sqrt(np.add.reduce(rate * rate, axis=1))
    errors = *form_rounding(state, speed, relaxations, tension), np.sqrt(np.outer(unfinished, unfinished))
    value = elasticity_of_form(state, volume, strains, form - gained, direct, errors)
    stats = Stats("linear response", 1, residual=float((size / np.maximum(scale, 1e-300)).max()))
    status = Status.ok if small else Status.stalled
    return LinearResponse(value, status, stats, strains=strains, responses=relaxations), correction[0]


def remaining(gain: Array, unfinished: Array, size: Array, before: Array) -> Array:
    """The energy that the last corrections leave, (m,): modes that shrink by c a correction leave c/(1 − c) of theirs.

    Stiff modes have most of the energy; soft ones, which shrink more slowly, have most of the size.

    gain          energy of the last corrections, and `unfinished` what they leave by the decrease of that energy
    size, before  of the last corrections and of those before them, (m,)
    """
    c = np.minimum(size / np.maximum(before, 1e-300), SLOWEST)
    return np.maximum(unfinished, gain * CONTRACTION_MARGIN * c / (1 - c) ** 2)


def largest_each(vectors: Array) -> Array:
    """Largest component of each of the vectors (m, n), (m,)."""
    return np.maximum.reduce(np.abs(vectors), axis=-1, initial=0.0)


def form_rounding(state: SpringState, speed: Array, u: Array, tension: Array) -> tuple[Array, Array]:
    """Rounding errors of V C_ab, (m, m), and the parts (N_b,) of the first one.

    Sources: σ; rates |L̇| (m, N_b) as differences of vertex velocities u (m, d, n_free), which may exceed them; products
    with K ḣ (m, N_b).
    """
    network, sigma, length = state.network, np.abs(state.sigma), state.lengths
    vertex_speed = np.zeros((len(u), network.n_vertices))
    moving = u.swapaxes(1, 2)
    vertex_speed[:, network.free_rows] = np.sqrt(dot(moving, moving))
    tail, head = np.ascontiguousarray(network.edges.T)
    rate_rounding = EPS * (speed + vertex_speed.take(tail, 1) + vertex_speed.take(head, 1) + length)
    pull = np.abs(tension) * length + sigma * speed
    loose = state.stress_rounding * speed
    mixed = accumulated_products(pull, rate_rounding)
    return accumulated_products(loose, speed) + mixed + mixed.T, loose[0] * speed[0] + 2 * pull[0] * rate_rounding[0]


def elasticity_of_form(
    state: SpringState,
    volume: float,
    strains: tuple[int, ...],
    relaxed: Array,
    affine: Array,
    errors: tuple[Array, Array, Array],
) -> Elasticity:
    """Tensor, stress and moduli from V C_ab of the strains, (m, m), relaxed and affine.

    errors  rounding (m, m), its parts (N_b,) of the first strain, the dilation, and unfinished relaxation (m, m)
    """
    (noise, first, unfinished), d, form = errors, state.network.dimension, relaxed / volume
    sigma, square, L = state.sigma, state.lengths**2, state.bond_vectors.T
    form_error = (noise + unfinished) / volume + 4 * EPS * np.abs(form)
    stress = (sigma * L) @ L.T / volume
    stress_error = float(accumulated_rounding(2 * state.stress_rounding * square)) / volume
    # 1. Moduli: dilation (1 + γ)^{1/d} is curved, b̈ = (1/d)(1/d − 1) b
    trace, curvature = float(sigma @ square) / volume, (1 / d) * (1 / d - 1)
    bulk, shear_error = float(form[0, 0] + curvature * trace), float(form_error[-1, -1])
    stretched = first + (state.stress_rounding + 4 * EPS * np.abs(sigma)) * abs(curvature) * square
    bulk_error = (float(accumulated_rounding(stretched)) + float(unfinished[0, 0])) / volume + 4 * EPS * abs(bulk)
    corrected_error = shear_error + 0.5 * stress_error / d + 4 * EPS * abs(trace / d)
    # 2. Tensors in the basis
    T = basis_change(d)[list(strains)]
    tensor = T.T @ form @ T
    error = np.abs(T).T @ form_error @ np.abs(T) + 4 * EPS * np.abs(tensor)
    error += (stress_error + 4 * EPS * float(np.abs(stress).max())) * stress_products(d)
    bounds = Errors(0.5 * (error + error.T), bulk_error, shear_error, corrected_error)
    return Elasticity(tensor, T.T @ affine @ T / volume, stress, volume, bounds, bulk)


@cache
def stress_products(dimension: int) -> Array:
    """Sums of the entries of |E_a||E_b|, (m, m): the effect of an error of the stress on its terms."""
    basis = np.abs(strain_basis(dimension)[1])
    return np.einsum("aij,bjk->ab", basis, basis)


def accumulated_products(one: Array, other: Array) -> Array:
    """`accumulated_rounding` of all products of rows of two arrays (m, n) without negative entries, (m, m)."""
    return np.asarray(3 * np.sqrt(one**2 @ (other**2).T) + 0.25 * one @ other.T)


def accumulated_rounding(errors: Array) -> Any:
    """Error (estimate) of sums whose terms have roundings of these magnitudes (..., n): 3‖e‖₂ + ¼ Σ e.

    Independent roundings of mean zero add up to ‖e‖₂ or less (one standard deviation), so 3‖e‖₂ is exceeded in less
    than 1 % of sums.  On lattices symmetric edges round alike and their errors add coherently, of which ¼ Σ e allows
    for a quarter.  The rigorous bound Σ e exceeds typical errors by √n.
    """
    return 3 * np.sqrt(np.add.reduce(errors * errors, axis=-1)) + 0.25 * np.add.reduce(errors, axis=-1)
