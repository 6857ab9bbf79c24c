"""Third derivatives of the relaxed energy at the transition, along any strains, from first-order responses alone.

The boundary depends on parameters, b → b + Σ_a s_a A_a b + ½ Σ_ab s_a s_b M_ab b + …, with any matrices A_a and M_ab.
With σ̂ the unit self-stress, K⁻¹ = |L|²/k, D = σ̂ᵀK⁻¹σ̂ and c_a = σ̂·ḣ_a/D for the affine change A_a L: the response is
ḣ_a = c_a K⁻¹ σ̂, and the zero modes relax to the minimum of P(σ̂),
    P̂ u + Rᵀ λ = −gᵀ(σ̂ ∘ A_a L),   R u = c_a K⁻¹ σ̂ − ḣ_a(affine),   L̇_a = A_a L + g u.
Second and third derivatives of the energy are
    E_ab = c_a c_b D,   E_abc = Σ φ''' ḣ_a ḣ_b ḣ_c + Σ_cyc c_a Σ σ̂ (L̇_b·L̇_c + L·M_bc L),   φ''' = E'''/|L|³ − 3k/|L|⁴.
With λ times the residual of R u = c K⁻¹σ̂ − ḣ added to it, E_abc is stationary in the responses u and λ: their errors
enter by their product alone, and its derivatives by σ, L and k are those at fixed u and λ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from critflow.arguments import of_kind, of_known_kind
from critflow.calls import running
from critflow.deformation import Deformable, Deformation, deformation_of
from critflow.extensions import extensible
from critflow.linear_response import TRUSTED_ERROR, accumulated_rounding
from critflow.manifold import Balance, CriticalConfiguration, CriticalManifold
from critflow.networks import Array, Network
from critflow.numerics import EPS, dot, norms, product
from critflow.quantities import (
    Balanced,
    Partials,
    SpringResponse,
    TransitionModulus,
    dilation,
    largest_value,
    pure_shear,
)
from critflow.refinement import exact_displacement
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.saddles import CondensedFactor, CondensedSaddle, Saddle, SaddleFactor
from critflow.self_stress import require_only_self_stress, stabilises
from critflow.springs import HOOKEAN, SpringLaw, checked_law
from critflow.taut_part import backbone

# Relative residual of a first solution, which a second one corrects.
_FIRST = 1e-12


class Term(NamedTuple):
    """The terms c_a Σ σ̂ (L̇_b·L̇_c + L·M_bc L) of a third derivative E_abc, as many equal ones as `times`."""

    times: int
    a: int
    b: int
    c: int
    curvature: Array

    @property
    def curvature_rounding(self) -> float:
        """Roundings of the curvature's part of a term, in units of |σ̂||L|² EPS."""
        size = float(np.linalg.norm(self.curvature, 2))
        return (1 + (self.b == self.c)) * max(1.0, 4 * size) if size else 0.0


def cubed(a: int, curvature: Array) -> list[Term]:
    """E_aaa, with M_aa."""
    return [Term(3, a, a, a, curvature)]


def squared(a: int, b: int, curvature: Array, mixed: Array) -> list[Term]:
    """E_aab, with M_aa and M_ab."""
    return [Term(1, b, a, a, curvature), Term(2, a, b, a, mixed)]


@dataclass(frozen=True, eq=False)
class Response:
    """First-order response to one strain.

    strain        A (d, d)
    amplitude     c, the strain's amplitude of the self-stress
    work          |σ̂·ḣ| of the affine strain, and its rounding error
    displacement  u (n_free, d)
    rate, speed   L̇ = A L + g u, (N_b, d), and |L̇|
    rounded       numbers (N_b,) whose roundings enter L̇: |L̇|, the velocities of both vertices, |L|
    slip          L·L̇ − c K⁻¹ σ̂, (N_b,), zero but for the error of u, and its derivative by L, (N_b, d)
    multipliers   λ (N_b,) orthogonal to σ̂, along which they are free
    error         product of the remaining errors of u and λ, by which the energy may be off
    residual      relative residual of the first solution
    """

    strain: Array
    amplitude: float
    work: tuple[float, float]
    displacement: Array
    rate: Array
    speed: Array
    rounded: Array
    slip: Array
    slip_by_L: Array
    multipliers: Array
    error: float
    residual: float


class Derivatives(NamedTuple):
    """E_abc and its derivatives by σ (N_b,), L (N_b, d) and, for springs of Hooke's law, k (N_b,).

    by_length  change per relative error of each bond vector, (N_b,)
    """

    value: float
    by_stress: Array
    by_bonds: Array
    by_stiffness: Array
    by_length: Array


class ThirdDerivative(NamedTuple):
    """E_abc, its error, and the sum of its changes per relative error of each bond vector."""

    value: float
    error: float
    change: float


class ThirdOrderEnergy:
    """Second and third derivatives of the energy in the strains A_a (n, d, d), with errors (estimates).

    responses  to the strains, in their order
    """

    def __init__(
        self,
        network: Network,
        sigma: Array,
        L: Array,
        system: Saddle | CondensedSaddle,
        law: SpringLaw,
        strains: Sequence[Array],
    ):
        self._network, self._L, self._k = network, L, network.stiffness
        self._norm = float(np.linalg.norm(sigma))
        self._s = sigma / self._norm
        square = dot(L, L)
        self._lengths = np.sqrt(square)
        checked = checked_law(law, self._lengths, self._k)
        self._third_of_law = checked.stiffening(np.zeros_like(square), self._lengths, self._k)
        self._flexibility = square / self._k
        self._D = float(self._s**2 @ self._flexibility)
        # The system of σ instead of σ̂: lengths are of order one, so its two kinds of rows then have similar magnitude.
        factor = system.factorize(sigma, L)
        self.responses = tuple(self._respond(A, sigma, factor) for A in strains)

    def second(self, a: int, b: int) -> float:
        """E_ab."""
        return self.responses[a].amplitude * self.responses[b].amplitude * self._D

    def second_error(self, a: int, b: int) -> float:
        """Error (estimate) of E_ab."""
        (work_a, work_b) = (self.responses[i].work[1] for i in (a, b))
        c_a, c_b = (abs(self.responses[i].amplitude) for i in (a, b))
        return c_a * work_b + c_b * work_a + 4 * EPS * c_a * c_b * self._D + work_a * work_b / self._D

    def _respond(self, A: Array, sigma: Array, factor: SaddleFactor | CondensedFactor) -> Response:
        network, L, s, g = self._network, self._L, self._s, self._network.free_incidence
        affine = L @ A.T
        hdot = dot(L, affine)
        c = float(s @ hdot) / self._D
        goal = c * s * self._flexibility
        pull = -product(network.divergence, sigma[:, None] * affine)
        u, multiplier, residual = factor.solve(pull, goal - hdot, _FIRST)
        rate = affine + product(g, u)
        force = -product(network.divergence, sigma[:, None] * rate + multiplier[:, None] * L)
        rest = goal - dot(L, rate)
        change, correction, _ = factor.solve(force, rest)
        error = (abs(float(np.vdot(force, change))) + abs(float(rest @ correction))) / self._norm
        u, multiplier = u + change, (multiplier + correction) / self._norm
        multiplier = multiplier - (s @ multiplier) * s
        rate, velocity = affine + product(g, u), np.zeros(network.n_vertices)
        velocity[network.free], speed = norms(u), norms(rate)
        rounded = speed + velocity[network.edges].sum(axis=1) + self._lengths
        slip, slip_by_L = dot(L, rate) - goal, rate + L @ A - (2 * c * s / self._k)[:, None] * L
        rounding = accumulated_rounding(2 * EPS * np.abs(s) * self._lengths * norms(affine))
        work = abs(c) * self._D, float(rounding)
        return Response(A, c, work, u, rate, speed, rounded, slip, slip_by_L, multiplier, error, residual)

    def third(self, terms: Sequence[Term]) -> Derivatives:
        """E_abc of the terms, and its derivatives, with those by the amplitudes c_a, which are functions of σ̂, L, k."""
        s, L, k, flexibility, responses = self._s, self._L, self._k, self._flexibility, self.responses
        c, m = ([getattr(one, name) for one in responses] for name in ("amplitude", "multipliers"))
        strains = terms[0][1:4]
        product = c[strains[0]] * c[strains[1]] * c[strains[2]]
        # φ''' K⁻³ and its derivative along L, per |L|
        law = self._third_of_law * self._lengths / (k * k**2)
        cube, slope = law * self._lengths**2 - 3 * flexibility / k, 3 * law - 6 / k**2
        third = s * s**2
        edges, by_s = product * third * cube, 3 * product * s**2 * cube
        by_L, by_k = (product * third * slope)[:, None] * L, 6 * product * third * flexibility / k**2
        by_c, cubes = np.zeros(len(c)), float(np.sum(third * cube))
        for n, a in enumerate(strains):
            by_c[a] += cubes * c[strains[n - 1]] * c[strains[n - 2]]
        for times, a, i, j, curvature in terms:
            one, other, size, curved = responses[i], responses[j], times * c[a], L @ (0.5 * (curvature + curvature.T))
            stretch, slipping = dot(one.rate, other.rate) + dot(L, curved), c[i] * m[j] + c[j] * m[i]
            part = s * stretch + m[i] * other.slip + m[j] * one.slip
            edges += size * part
            by_s += size * (stretch - slipping * flexibility)
            by_L += (size * s)[:, None] * (one.rate @ other.strain + other.rate @ one.strain + 2 * curved)
            by_L += size * (m[i][:, None] * other.slip_by_L + m[j][:, None] * one.slip_by_L)
            by_k += size * slipping * s * flexibility / k
            by_c[a] += times * float(np.sum(part))
            by_c[i] -= size * float(np.sum(m[j] * s * flexibility))
            by_c[j] -= size * float(np.sum(m[i] * s * flexibility))
        for response, derivative in zip(responses, by_c / self._D, strict=True):
            AL, cs = L @ (0.5 * (response.strain + response.strain.T)), response.amplitude * s
            by_s += derivative * (dot(L, AL) - 2 * cs * flexibility)
            by_L += (2 * derivative * s)[:, None] * (AL - (cs / k)[:, None] * L)
            by_k += derivative * cs * s * flexibility / k
        by_length = norms(by_L) * self._lengths
        return Derivatives(float(np.sum(edges)), (by_s - (by_s @ s) * s) / self._norm, by_L, by_k, by_length)

    def third_with_error(self, terms: Sequence[Term]) -> ThirdDerivative:
        """E_abc of the terms, with its error (estimate)."""
        derivatives = self.third(terms)
        error = self.third_error(terms, derivatives.by_length)
        return ThirdDerivative(derivatives.value, error, float(np.sum(derivatives.by_length)))

    def third_error(self, terms: Sequence[Term], by_length: Array) -> float:
        """Error (estimate) of E_abc, which changes by `by_length` (N_b,) per relative error of the bond vectors.

        Sources: rates as differences of vertex velocities, which may exceed them; products; bond vectors; the errors of
        the responses, of second order.
        """
        s, length, k, responses = np.abs(self._s), self._lengths, self._k, self.responses
        goals = [abs(response.amplitude) * s * self._flexibility for response in responses]
        weights = [np.abs(response.multipliers) for response in responses]
        rates, slips = ([getattr(one, name) for one in responses] for name in ("speed", "rounded"))
        _, i, j, l, _ = terms[0]
        square = length**2
        noise = (
            4 * (np.abs(self._third_of_law) / (length * square) + 3 * k / square**2) * goals[i] * goals[j] * goals[l]
        )
        remaining = 0.0
        for term in terms:
            b, c, size = term.b, term.c, term.times * abs(responses[term.a].amplitude)
            noise += size * s * (rates[b] * slips[c] + rates[c] * slips[b] + term.curvature_rounding * length**2)
            noise += size * length * (weights[b] * slips[c] + weights[c] * slips[b])
            remaining += 2 * size * float(np.sqrt(responses[b].error * responses[c].error))
        return float(accumulated_rounding(EPS * (noise + 2 * by_length))) + remaining


# Stiffening coefficients from second and third derivatives E_ab and E_abc of the relaxed energy.
#
# Along a dilation δ, a shear ε and a path γ with A = F'(0), M = F''(0) and t = tr A,
#     C_B = E_δδγ/V − t B_0,   C_G = E_εεγ/V − t G_0,   C = E_γγγ/V − t M_0,   stress-corrected C_G − ½ E_δγ/V.
# The springs bring the derivatives: those on edges by `ThirdOrderEnergy`, others by an energy of their own.

# Largest relative residual of the linear system of the stiffening coefficients; a regular system leaves 1e-14.
CONSISTENT_RESPONSE = 1e-9
NO_WORK = 100.0  # A strain that does less work on the self-stress than this number times its rounding does none


@dataclass(frozen=True, repr=False)
class Stiffening(Record):
    """Moduli at the transition and their first derivatives with strain.

    modulus_0, C  of the modulus (1/V) d²E/dγ² along the path
    """

    bulk_0: float
    shear_0: float
    C_B: float
    C_G: float
    C_G_stress_corrected: float
    modulus_0: float
    C: float


@dataclass(frozen=True, kw_only=True, repr=False)
class StiffeningSolution(Solution[Stiffening]):
    """Coefficients of the moduli.

    loosening  whether positive strains loosen the network: it is then rigid at negative ones, where the coefficients
               hold as well
    """

    loosening: bool = False


NO_STIFFENING = Stiffening(*[np.nan] * 7)


class StrainResponse(Protocol):
    """First-order response to one strain: amplitude c of the self-stress, work with its rounding error, residual."""

    @property
    def amplitude(self) -> float: ...
    @property
    def work(self) -> tuple[float, float]: ...
    @property
    def residual(self) -> float: ...


class RelaxedEnergy(Protocol):
    """Second and third derivatives of an energy in strains of which the vertices follow, with errors (estimates)."""

    @property
    def responses(self) -> Sequence[StrainResponse]:
        """Those to the strains, in their order."""

    def second(self, a: int, b: int) -> float:
        """E_ab."""

    def second_error(self, a: int, b: int) -> float:
        """Error of E_ab."""

    def third_with_error(self, terms: Sequence[Term]) -> ThirdDerivative:
        """E_abc of the terms."""


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Coefficients with their errors and condition, the energy behind them, and the index of γ among its strains."""

    energy: RelaxedEnergy
    gamma: int
    value: Stiffening
    error: Stiffening
    condition: float


def with_status(exact: Coefficients) -> StiffeningSolution:
    """The coefficients with the status that their residual, work and errors allow."""
    value, responses = exact.value, exact.energy.responses
    residual = max(response.residual for response in responses)
    stats = Stats("exact", 1, residual=residual, condition=exact.condition, error_bound=exact.error)
    if not residual < CONSISTENT_RESPONSE:
        return failed(Status.singular, "", stats)
    work, rounding = responses[exact.gamma].work
    if not work > NO_WORK * rounding:
        return failed(Status.floppy, "the strain does no work on the self-stress, so nothing resists it to first order")
    largest = max(abs(value.bulk_0), abs(value.C_B), abs(value.C_G), abs(value.C))
    if not max(astuple(exact.error)) < TRUSTED_ERROR * largest:
        note = "rounding errors may exceed the coefficients: choose stresses of more similar magnitude"
        return failed(Status.ill_conditioned, note, stats)
    loosening = responses[exact.gamma].amplitude < 0
    note = "positive strains loosen the network: the coefficients hold at negative ones" if loosening else ""
    return StiffeningSolution(value, Status.ok, stats, note, loosening=loosening)


def coefficients(energy_of: Callable[[list[Array]], RelaxedEnergy], volume: float, path: Deformation) -> Coefficients:
    """Those of a dilation δ, a shear ε and the path γ of the strained network, which may be the dilation itself."""
    d, V, A, shear = path.dimension, volume, path.rate(0.0), pure_shear(path.dimension)
    gamma = 0 if _dilates(path) else 2
    energy = energy_of([dilation(d), shear] if gamma == 0 else [dilation(d), shear, A])
    thirds = [
        squared(0, gamma, (1 / d) * (1 / d - 1) * np.eye(d), A / d),
        squared(1, gamma, 0 * A, shear @ A),
        cubed(gamma, path.second_rate(0.0)),
    ]
    derivatives = [energy.third_with_error(terms) for terms in thirds]
    third = np.array([one.value for one in derivatives]) / V
    errors = [one.error for one in derivatives]
    zeroth = np.array([energy.second(a, a) for a in (0, 1, gamma)]) / V
    zeroth_error = np.array([energy.second_error(a, a) for a in (0, 1, gamma)]) / V
    growth = float(np.trace(A))
    half_pressure, pressure_error = 0.5 * energy.second(0, gamma) / V, 0.5 * energy.second_error(0, gamma) / V
    first = third - growth * zeroth
    change = np.array([one.change for one in derivatives]) / V
    return Coefficients(
        energy,
        gamma,
        _ordered(zeroth, first, -half_pressure),
        _ordered(zeroth_error, np.array(errors) / V + abs(growth) * zeroth_error, pressure_error),
        condition=float(np.max(change / np.maximum(np.abs(first), 1e-300))),
    )


def _ordered(zeroth: Array, first: Array, correction: float) -> Stiffening:
    (bulk, shear, modulus), (C_B, C_G, C) = zeroth.tolist(), first.tolist()
    return Stiffening(bulk, shear, C_B, C_G, C_G + correction, modulus, C)


def _dilates(path: Deformation) -> bool:
    """Whether the path is the dilation whose coefficients are C_B and C_G of the paper."""
    d = path.dimension
    return bool(
        np.allclose(path.rate(0.0), dilation(d), rtol=0, atol=1e-15)
        and np.allclose(path.second_rate(0.0), (1 / d) * (1 / d - 1) * np.eye(d), rtol=0, atol=1e-15)
    )


def failed(status: Status, note: str, stats: Stats | None = None) -> StiffeningSolution:
    """No coefficients, for a reason."""
    unlimited = Stiffening(*[np.inf] * 7)
    stats = stats or Stats("exact", 1, error_bound=unlimited if status is Status.ill_conditioned else np.nan)
    return StiffeningSolution(NO_STIFFENING, status, stats, note)


# Stiffening coefficients: growth of the moduli past the transition, from the critical configuration alone.
#
# Along a path F(γ) with A = F'(0) and M = F''(0) (`Deformation`) the moduli of the strained network are, with volume
# V(γ) and relaxed energy E, and to first order
#     B = V d²E/dV²                     of a dilation b → (1 + δ)^{1/d} F(γ) b,        B = B_0 + C_B γ
#     G = (1/V) d²E/dε²                 of the shear b → (1 + ε ½(e_x e_yᵀ + e_y e_xᵀ)) F(γ) b,   G = G_0 + C_G γ
#     G − ½ dE/dV  (stress-corrected)
#     M = (1/V) d²E/dγ²                 along the path itself,                         M = M_0 + C γ
# Those of dilation are the C_B and C_G of `moduli`, with M = B/(1 + γ)² and so C = C_B − 2 B_0.


@running("stiffening")
def stiffening(
    critical: Any,
    throw: bool = True,
    *,
    law: SpringLaw = HOOKEAN,
    deformation: Deformable = "dilation",
    manifold: CriticalManifold | None = None,
) -> StiffeningSolution:
    """Growth of the moduli along a path exactly, from the critical configuration alone: no strain path.

    The module's docstring defines the moduli and coefficients, `coefficients` their sums of derivatives of the energy.
    A law adds Σ E''' e_δ² e_γ/V to the C_B of Hookean springs, and likewise to the others, with the elongations
    e_a = ḣ_a/|L| = c_a σ̂|L|/k; the moduli at the transition are the same for all laws.

    deformation  what `deformation_of` accepts; antisymmetric parts of A rotate the network and change no modulus
                 to first order but G, whose axes do not rotate
    manifold     of the network, with other stiffnesses for instance; that of the configuration by default

    A tissue, of `critical_from_perimeters`, has the same coefficients; their errors are ten times the largest change in
    two samples of bond vectors perturbed by their errors.

    Slack edges, σ = 0, resist nothing; disconnected taut parts add up.  The value is that of the configuration in exact
    balance under the floating-point σ, found from the given coordinates in extended precision.

    Errors (estimate): `stats.error_bound` limits those of the value; errors of first order are exact, roundings are
    summed by `accumulated_rounding`.  `stats.condition` is the largest factor by which relative errors of bond
    vectors are amplified in the coefficients.

    `Status.unstable` and NaN where P(σ̂) is not positive on the zero modes, so that no response exists;
    `Status.undecided` where rounding hides whether it is;
    `Status.ill_conditioned` and NaN where an error exceeds a tenth of the largest coefficient;
    `Status.floppy` and NaN where the strain does no work on the self-stress, or free components of the cell relax it.
    Raises `InputError` for configurations with several self-stresses, and for free components that leave it as it is.

    >>> import critflow as cf
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> found = cf.stiffening(cf.optimize(network, 'B_0')).value
    >>> round(found.C_B / found.bulk_0, 6)  # −1/2 of springs as stiff as their stress
    -0.5
    """
    critical = of_known_kind(exact_stiffening, CriticalConfiguration, critical=critical)
    of_kind(bool, throw=throw)
    of_kind(SpringLaw, law=law)
    manifold = of_kind(CriticalManifold, None, manifold=manifold)
    path = deformation_of(deformation, critical.network.dimension)
    solution: StiffeningSolution = exact_stiffening(critical, path, law, manifold)
    return solution.or_raise("no stiffening coefficients") if throw else solution


@extensible
def exact_stiffening(
    critical: CriticalConfiguration, path: Deformation, law: SpringLaw, manifold: CriticalManifold | None
) -> StiffeningSolution:
    """The coefficients by the kind of springs; those on edges here."""
    if manifold is not None:
        critical.require_same_geometry(manifold.network)
        critical = replace(critical, network=manifold.network)
    if relaxing := _relaxing(critical, path):
        return failed(Status.floppy, relaxing)
    parts = backbone(critical).components
    return _total(
        [_of_part((manifold if part is critical else None) or part.manifold, part, law, path) for part in parts]
    )


def _of_part(
    manifold: CriticalManifold, critical: CriticalConfiguration, law: SpringLaw, path: Deformation
) -> StiffeningSolution:
    """The coefficients of a configuration without slack edges."""
    network = manifold.network
    require_only_self_stress(critical, "follow strain_path() and fit its moduli")
    system = manifold.system(critical.sigma)
    stable = stabilises(network, critical.coordinates, critical.bond_vectors, critical.sigma)
    if not stable:
        undecided = stable is not False
        note = "" if undecided else "the stress does not stabilise all zero modes"
        return failed(Status.undecided if undecided else Status.unstable, note)
    factor = manifold.prestress.factorize_signed(critical.sigma)
    balance = exact_displacement(network, critical.coordinates, lambda _: critical.sigma, factor.solve)
    if not np.isfinite(balance.remainder):
        return failed(Status.ill_conditioned, "rounding hides which configuration balances this stress exactly")

    energy_of = partial(ThirdOrderEnergy, network, critical.sigma, balance.bond_vectors, system, law)
    return with_status(coefficients(energy_of, network.volume, path))


def _relaxing(critical: CriticalConfiguration, path: Deformation) -> str:
    """The reason why free components of the cell leave the network floppy, or an empty string without any."""
    if not path.free:
        return ""
    sigma, L = critical.sigma, critical.bond_vectors
    stress = (sigma[:, None] * L).T @ L
    works = np.abs(np.einsum("mij,ij->m", path.free_strains, stress))
    if works.max() > 1e-9 * np.linalg.norm(stress):
        free = path.free[int(works.argmax())]
        return (
            f"the free component {free} of the cell relaxes the only self-stress, so the network is floppy along this "
            "path at the transition: fix the cell, or follow strain_path() from a rigid state"
        )
    raise InputError(
        "the free components of the cell do not relax the self-stress: fix the cell, or use strain_path() and fit its "
        "moduli"
    )


def _total(parts: list[StiffeningSolution]) -> StiffeningSolution:
    """The sum over taut parts, which are disconnected; the first failure decides the status."""
    for part in parts:
        if not part.ok:
            return part
    if len({part.loosening for part in parts}) > 1:
        return failed(Status.slack_edges, "the strain stretches some taut parts and loosens others: take each part")
    value, error = (
        Stiffening(*map(float, np.sum([astuple(each) for each in numbers], axis=0)))
        for numbers in ([part.value for part in parts], [part.stats.error_bound for part in parts])
    )
    residual = max(part.stats.residual for part in parts)
    return replace(parts[0], value=value, stats=replace(parts[0].stats, residual=residual, error_bound=error))


# StiffeningQuantity coefficients as quantities with exact gradients: growth past the transition can be designed.
#
# A third derivative of the energy is stationary in the responses u and λ, so its derivative by σ needs none of theirs:
#     dC/dσ = ∂C/∂σ|_(L,u,λ) + pull-back of ∂C/∂L|_(σ,u,λ),   dC/dk = ∂C/∂k|_(σ,L,u,λ),
# one bordered solve for the responses and one with P for the pull-back (`third_order`).


@dataclass(frozen=True, eq=False, repr=False)
class StiffeningQuantity(SpringResponse):
    """C of the modulus (1/V) d²E/dγ² = M_0 + Cγ along a path of deformations, C = E_γγγ/V − M_0 tr A (`stiffening`).

    deformation  the path, without free components; None: C_B = dB/dγ, or C_G = dG/dγ by the energy convention
                 (`of_shear`), under dilation (`ModulusStrainScaling`)
    maximise     whether the largest value is the best
    """

    analytic: ClassVar[bool] = False
    deformation: Deformation | None = None
    of_shear: bool = False
    maximise: bool = False

    def __post_init__(self) -> None:
        if self.deformation is not None and self.deformation.free:
            raise InputError(f"free components of {self.deformation.name} relax the self-stress: fix the cell")

    @property
    def name(self) -> str:
        if self.deformation is not None:
            return f"stiffening[{self.deformation.name}]"
        return "C_G" if self.of_shear else "C_B"

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        energy, terms, V = *self._energy(balance), balance.network.volume
        third, (growth, modulus) = energy.third(terms), self._growth(balance.network.dimension)
        M_0, (M_sigma, M_L) = modulus.evaluate(balance)
        partials = third.by_stress / V - growth * M_sigma, third.by_bonds / V - growth * M_L
        return third.value / V - growth * M_0, partials

    def error(self, critical: CriticalConfiguration) -> float:
        """That of the partial derivatives, and the error (estimate) of the third derivative for exact bond vectors."""
        energy, terms = self._energy(critical)
        third = energy.third_error(terms, energy.third(terms).by_length)
        return super().error(critical) + third / critical.network.volume

    def by_stiffness(self, balance: Balanced) -> Array:
        """dC/dk (N_b,) at constant σ: the configuration does not depend on k."""
        energy, terms = self._energy(balance)
        growth, modulus = self._growth(balance.network.dimension)
        return energy.third(terms).by_stiffness / balance.network.volume - growth * modulus.by_stiffness(balance)

    def extreme(self, manifold: CriticalManifold, positive: bool = True) -> tuple[float, float]:
        """C_B ≥ (3/d − 2) max B_0 for σ > 0: −½ max B_0 in the plane, −max B_0 in space.

        Springs of Hooke's law satisfy  C_B = (3/d − 2) B_0 + (3c/V) Σ σ̂|L̇_⊥|²  with the amplitude c = σ̂·ḣ/D > 0 of
        the stress and the rates L̇_⊥ at which edges turn under dilation.  No term of the sum is negative for σ > 0, and
        all vanish only at the largest B_0.  Compressed edges can have any C_B.
        """
        if not positive or self.of_shear or self.deformation is not None:
            return -np.inf, np.inf
        d = manifold.network.dimension
        return (3 / d - 2) * largest_value(manifold, dilation(d)), np.inf

    def best_stress(self, manifold: CriticalManifold) -> Array | None:
        """σ = k of the least C_B in the plane and in space, where B_0 is largest: C_B = (3/d − 2) B_0."""
        least = not (self.maximise or self.of_shear or self.deformation is not None)
        return manifold.network.stiffness if least and manifold.network.dimension > 1 else None

    def _growth(self, dimension: int) -> tuple[float, TransitionModulus]:
        """The growth of the volume, and the modulus that loses by it."""
        if self.of_shear:
            return 1.0, TransitionModulus(pure_shear(dimension))
        if self.deformation is None:
            # C_B has B itself in place of E_γγ.
            return -1.0, TransitionModulus(dilation(dimension))
        A = self.deformation.rate(0.0)
        return float(np.trace(A)), TransitionModulus(A)

    def _energy(self, balance: Balanced) -> tuple[ThirdOrderEnergy, list[Term]]:
        """The energy of Hooke's law and the terms of the third derivative; C_B and C_G share responses at a balance."""
        d = balance.network.dimension
        if self.deformation is not None:
            return _energy(balance, [self.deformation.rate(0.0)]), cubed(0, self.deformation.second_rate(0.0))
        shared = balance.shared if isinstance(balance, Balance) else {}
        if "dilation and shear" not in shared:
            shared["dilation and shear"] = _energy(balance, [dilation(d), pure_shear(d)])
        terms = cubed(0, (1 / d) * (1 / d - 1) * np.eye(d))
        if self.of_shear:
            terms = squared(1, 0, np.zeros((d, d)), pure_shear(d) / d)
        return shared["dilation and shear"], terms


def volumetric_stiffening(network: Network, name: str) -> StiffeningQuantity:
    """C_B or C_G."""
    return StiffeningQuantity(of_shear=name == "C_G")


def stiffening_along(network: Network, deformation: str) -> StiffeningQuantity:
    """stiffening[D] of a deformation D."""
    return StiffeningQuantity(deformation_of(deformation, network.dimension))


def _energy(balance: Balanced, strains: list[Array]) -> ThirdOrderEnergy:
    system = balance.manifold.system(balance.sigma)
    return ThirdOrderEnergy(balance.network, balance.sigma, balance.bond_vectors, system, HOOKEAN, strains)
