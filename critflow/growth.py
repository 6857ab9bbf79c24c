"""Growth of the moduli past the transition from the critical configuration alone: C_B, C_G, and C along any path.

Along a path F(γ) with A = F'(0), M = F''(0) and t = tr A (`Deformation`) the moduli of the strained network are, with
volume V(γ) and relaxed energy E, and to first order
    B = V d²E/dV²           of a dilation b → (1 + δ)^{1/d} F(γ) b,                     B = B_0 + C_B γ
    G = (1/V) d²E/dε²       of the shear b → (1 + ε ½(e_x e_yᵀ + e_y e_xᵀ)) F(γ) b,     G = G_0 + C_G γ
    G − ½ dE/dV             stress-corrected
    M = (1/V) d²E/dγ²       along the path itself,                                      M = M_0 + C γ
so that second and third derivatives of E at the transition decide:
    C_B = E_δδγ/V − t B_0,   C_G = E_εεγ/V − t G_0,   C = E_γγγ/V − t M_0,   stress-corrected C_G − ½ E_δγ/V.
Along a dilation these are the C_B and C_G of the paper, with M = B/(1 + γ)² and so C = C_B − 2 B_0.

The derivatives follow from first-order responses (`StrainedEnergy`).  The boundary depends on parameters,
b → b + Σ_a s_a A_a b + ½ Σ_ab s_a s_b M_ab b + …, with any matrices A_a and M_ab.  With σ̂ the unit self-stress,
K⁻¹ = |L|²/k, D = σ̂ᵀK⁻¹σ̂ and c_a = σ̂·ḣ_a/D for the affine change A_a L: the response is ḣ_a = c_a K⁻¹ σ̂, and the zero
modes relax to the minimum of P(σ̂),
    P̂ u + Rᵀ λ = −gᵀ(σ̂ ∘ A_a L),   R u = c_a K⁻¹ σ̂ − ḣ_a(affine),   L̇_a = A_a L + g u,
    E_ab = c_a c_b D,   E_abc = Σ φ''' ḣ_a ḣ_b ḣ_c + Σ_cyc c_a Σ σ̂ (L̇_b·L̇_c + L·M_bc L),   φ''' = E'''/|L|³ − 3k/|L|⁴.
With λ times the residual of R u = c K⁻¹σ̂ − ḣ added to it, E_abc is stationary in the responses u and λ: their errors
enter by their product alone, and its derivatives by σ, L and k are those at fixed u and λ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from functools import singledispatch
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from critflow.arguments import of_kind, of_known_kind
from critflow.calls import running
from critflow.deformation import Deformable, Deformation, deformation_of
from critflow.extensions import from_extras
from critflow.linear_response import TRUSTED_ERROR, accumulated_rounding
from critflow.manifold import CriticalConfiguration, CriticalManifold
from critflow.networks import Array, Network
from critflow.numerics import EPS, dot, norms, product
from critflow.quantities import dilation, pure_shear, pure_shears
from critflow.refinement import exact_displacement
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.self_stress import require_one_stress_by_rank, stabilises
from critflow.springs import HOOKEAN, SpringLaw, checked_law
from critflow.taut_part import backbone

FIRST_RESIDUAL = 1e-12  # relative residual of a first response, which a second solution corrects
# Largest relative residual of the responses that counts; a regular system leaves 1e-14.
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


def failed(status: Status, note: str = "", stats: Stats | None = None) -> StiffeningSolution:
    """No coefficients, for a reason."""
    unlimited = Stiffening(*[np.inf] * 7)
    stats = stats or Stats("exact", 1, error_bound=unlimited if status is Status.ill_conditioned else np.nan)
    return StiffeningSolution(NO_STIFFENING, status, stats, note)


@running("stiffening")
def stiffening(
    critical: Any,
    throw: bool = True,
    *,
    law: SpringLaw = HOOKEAN,
    deformation: Deformable | None = None,
    manifold: CriticalManifold | None = None,
) -> StiffeningSolution:
    """Growth of the moduli along a path exactly, from the critical configuration alone: no strain path.

    The module's docstring defines the moduli and coefficients, and their sums of derivatives of the energy.
    A law adds Σ E''' e_δ² e_γ/V to the C_B of Hookean springs, and likewise to the others, with the elongations
    e_a = ḣ_a/|L| = c_a σ̂|L|/k; the moduli at the transition are the same for all laws.

    deformation  what `deformation_of` accepts; None: that of the onset, else a dilation.  Antisymmetric parts of A
                 rotate the network and change no modulus to first order but G, whose axes do not rotate
    manifold     of the network, with other stiffnesses for instance; that of the configuration by default

    Under tension the mean of C_G over all pure shears has a lower bound, `shear_growth`.

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
    solution: StiffeningSolution = exact_stiffening(
        critical,
        None if deformation is None else deformation_of(deformation, critical.network.dimension),
        law,
        manifold,
    )
    return solution.or_raise("no stiffening coefficients") if throw else solution


@singledispatch
def exact_stiffening(
    critical: Any, path: Deformation | None, law: SpringLaw, manifold: CriticalManifold | None
) -> StiffeningSolution:
    """The coefficients by the kind of springs; those on edges here, which are sums over the disconnected taut parts.

    path  None: that which the kind has by default, a dilation here
    """
    path = Deformation.dilation(critical.network.dimension) if path is None else path
    # 1. The stiffnesses of the manifold, in a fixed cell
    if manifold is not None:
        critical.require_same_geometry(manifold.network)
        critical = replace(critical, network=manifold.network)
    if path.free:
        relaxing = from_extras("relaxing_component", "free components of the cell")
        return failed(Status.floppy, relaxing(critical, path))
    # 2. Each taut part; the first failure decides the status
    solutions = [
        stiffening_of_part((manifold if part is critical else None) or part.manifold, part, law, path)
        for part in backbone(critical).components
    ]
    failures = [solution for solution in solutions if not solution.ok]
    if len(solutions) == 1:
        return solutions[0]
    if failures:
        of_one = f"this is one of {len(solutions)} taut parts: take each of backbone(critical).components"
        return replace(failures[0], note=f"{failures[0].note}; {of_one}" if failures[0].note else of_one)
    if len({solution.loosening for solution in solutions}) > 1:
        return failed(Status.slack_edges, "the strain stretches some taut parts and loosens others: take each part")
    # 3. Their sum
    value, error = (
        Stiffening(*map(float, np.sum([astuple(each) for each in numbers], axis=0)))
        for numbers in zip(*((solution.value, solution.stats.error_bound) for solution in solutions), strict=True)
    )
    residual = max(solution.stats.residual for solution in solutions)
    stats = replace(solutions[0].stats, residual=residual, error_bound=error)
    return replace(solutions[0], value=value, stats=stats)


def stiffening_of_part(
    manifold: CriticalManifold, critical: CriticalConfiguration, law: SpringLaw, path: Deformation
) -> StiffeningSolution:
    """The coefficients of a configuration without slack edges."""
    network, sigma = manifold.network, critical.sigma
    require_one_stress_by_rank(critical, "follow strain_path() and fit its moduli")
    # 1. The stress stabilises the zero modes
    stable = stabilises(network, critical.coordinates, critical.bond_vectors, sigma)
    if stable is None:
        return failed(Status.undecided)
    if not stable:
        return failed(Status.unstable, "the stress does not stabilise all zero modes")
    # 2. The configuration in exact balance
    factor = manifold.prestress.factorize_signed(sigma)
    balance = exact_displacement(network, critical.coordinates, lambda _: sigma, factor.solve)
    if not np.isfinite(balance.remainder):
        return failed(Status.ill_conditioned, "rounding hides which configuration balances this stress exactly")
    # 3. Its responses, and the derivatives of the energy
    system = manifold.system(sigma)

    def energy_along(path: Deformation) -> StrainedEnergy:
        return StrainedEnergy(network, sigma, balance.bond_vectors, system, law, strains_of_growth(path))

    energy, V = energy_along(path), network.volume
    values, errors, condition = coefficients(energy, V, path)
    errors = errors + path.error(values, lambda other: coefficients(energy_along(other), V, other)[0])
    return with_status(energy, values, errors, condition)


class ShearGrowth(NamedTuple):
    """The mean of C_G over all pure shears, and the least value that it can have, in units of k (in space k/ℓ).

    bound  NaN where an edge is under compression: none is known there
    """

    mean: float
    bound: float


@running("shear_growth")
def shear_growth(critical: CriticalConfiguration) -> ShearGrowth:
    """The mean of C_G over all pure shears of a dilated network, and its lower bound (proof).

        ⟨C_G⟩ ≥ B_0 (d + 2)/(2d) [1 + (d/n) s:s − (2d/n) s:s']² + (2/d − 1)⟨G_0⟩ − (⟨G_0⟩/3B_0)(C_B − (3/d − 2)B_0)

    which is B_0 in the plane at G_0 = 0.  The n = (d − 1)(d + 2)/2 shears A are symmetric, without trace, orthogonal
    and have A:A = ½: both pure shears of the plane.  s and s' are Σ σ LLᵀ and Σ (σ²/k) LLᵀ over their traces, less 1/d.
    Springs of Hooke's law, energy convention; the stress-corrected C_G is smaller by B_0/2.  The proof stands in
    docs/theory/relations.md.

    Raises `SolveError` where `stiffening` has no coefficients, and `InputError` for taut parts that are not connected.

    >>> import critflow as cf
    >>> from critflow.growth import shear_growth
    >>> growth = shear_growth(cf.optimize(cf.voronoi_network(n_vertices=20, seed=1), 'B_0'))
    >>> growth.mean > growth.bound > 0
    True
    """
    parts = backbone(of_kind(CriticalConfiguration, critical=critical)).components
    if len(parts) > 1:
        raise InputError(f"the {len(parts)} taut parts are not connected: take each of backbone(critical).components")
    (part,) = parts
    network, sigma, L, found = part.network, part.sigma, part.bond_vectors, stiffening(part).value
    d, V, strains = network.dimension, network.volume, [dilation(network.dimension), *pure_shears(network.dimension)]
    n = len(strains) - 1
    energy = StrainedEnergy(network, sigma, L, part.manifold.system(sigma), HOOKEAN, strains)
    works = np.array([response.amplitude for response in energy.responses[1:]])
    G_0 = float(np.mean(works**2)) * energy.D / V
    thirds = [energy.third([(1, 0, e, e, 0 * A), (2, e, 0, e, A / d)]).value for e, A in enumerate(strains) if e]
    s, t = ((L.T * weight) @ L for weight in (energy.s, energy.s**2 / network.stiffness))
    s, t = (one / np.trace(one) - np.eye(d) / d for one in (s, t))
    affine = 1 + (d / n) * np.sum(s * s) - (2 * d / n) * np.sum(s * t)
    bound = found.bulk_0 * (d + 2) / (2 * d) * affine**2 + (2 / d - 1) * G_0
    bound -= G_0 / (3 * found.bulk_0) * (found.C_B - (3 / d - 2) * found.bulk_0)
    return ShearGrowth(float(np.mean(thirds)) / V - G_0, float(bound) if (sigma > 0).all() else np.nan)


def strains_of_growth(path: Deformation) -> list[Array]:
    """A_a (d, d) of the path γ, a shear ε and a dilation δ; the latter is left out where it is the path itself."""
    d, A = path.dimension, path.rate(0.0)
    curvature = (1 / d) * (1 / d - 1) * np.eye(d)
    dilates = np.allclose(A, dilation(d), rtol=0, atol=1e-15)
    dilates = dilates and np.allclose(path.second_rate(0.0), curvature, rtol=0, atol=1e-15)
    return [dilation(d), pure_shear(d)] if dilates else [A, pure_shear(d), dilation(d)]


def coefficients(energy: StrainedEnergy, volume: float, path: Deformation) -> tuple[Array, Array, float]:
    """The numbers of `Stiffening` and their errors, (7,) each, by an energy with the `strains_of_growth` of the path.

    The last number is the largest factor by which relative errors of bond vectors are amplified in them.
    """
    d, V, A, M = path.dimension, volume, path.rate(0.0), path.second_rate(0.0)
    shear, t = pure_shear(d), float(np.trace(A))
    # 1. E_ab = c_a c_b D, from works σ̂·ḣ = c D with rounding errors
    c, rounding = np.array([(response.amplitude, response.work[1]) for response in energy.responses]).T
    size, second = np.abs(c), c[:, None] * c * energy.D
    mixed = size[:, None] * rounding
    second_error = mixed + mixed.T + 4 * EPS * np.abs(second) + rounding[:, None] * rounding / energy.D
    # 2. E_abc, by the places of the path γ, the shear ε and the dilation δ among the strains
    g, e, b = 0, 1, 2 if len(c) > 2 else 0
    terms: list[list[Term]] = [
        [(1, g, b, b, (1 / d) * (1 / d - 1) * np.eye(d)), (2, b, g, b, A / d)],  # E_δδγ
        [(1, g, e, e, 0 * A), (2, e, g, e, shear @ A)],  # E_εεγ
        [(3, g, g, g, M)],  # E_γγγ
    ]
    thirds = [energy.third(each) for each in terms]
    errors = [energy.third_error(each, third.by_length) for each, third in zip(terms, thirds, strict=True)]
    # 3. Moduli, and their growth
    own = [b, e, g]
    zeroth, zeroth_error = second[own, own] / V, second_error[own, own] / V
    first = np.array([third.value for third in thirds]) / V - t * zeroth
    first_error = np.array(errors) / V + abs(t) * zeroth_error
    half, half_error = 0.5 * second[b, g] / V, 0.5 * second_error[b, g] / V
    change = np.array([float(np.sum(third.by_length)) for third in thirds]) / V
    values = np.array([*zeroth[:2], *first[:2], first[1] - half, zeroth[2], first[2]])
    error = np.array(
        [*zeroth_error[:2], *first_error[:2], first_error[1] + half_error, zeroth_error[2], first_error[2]]
    )
    return values, error, float(np.max(change / np.maximum(np.abs(first), 1e-300)))


def with_status(energy: StrainedEnergy, values: Array, errors: Array, condition: float) -> StiffeningSolution:
    """Coefficients (7,) with the status that their residual, work and errors allow."""
    residual = max(response.residual for response in energy.responses)
    bound = Stiffening(*errors.tolist())
    stats = Stats("exact", 1, residual=residual, condition=condition, error_bound=bound)
    if not residual < CONSISTENT_RESPONSE:
        return failed(Status.singular, "", stats)
    along = energy.responses[0]
    work, rounding = along.work
    if not work > NO_WORK * rounding:
        return failed(Status.floppy, "the strain does no work on the self-stress, so nothing resists it to first order")
    if not errors.max() < TRUSTED_ERROR * np.abs(values[[0, 2, 3, 6]]).max():
        note = "rounding errors may exceed the coefficients: choose stresses of more similar magnitude"
        return failed(Status.ill_conditioned, note, stats)
    loosening = along.amplitude < 0
    note = "positive strains loosen the network: the coefficients hold at negative ones" if loosening else ""
    return StiffeningSolution(Stiffening(*values.tolist()), Status.ok, stats, note, loosening=loosening)


# Derivatives of the energy


Term: TypeAlias = tuple[int, int, int, int, Array]
"""(n, a, b, c, M): n equal terms c_a Σ σ̂ (L̇_b·L̇_c + L·M L) of a third derivative E_abc, with a curvature M (d, d)."""


@dataclass(frozen=True, eq=False)
class Response:
    """First-order response to one strain.

    strain       A (d, d)
    amplitude    c, the strain's amplitude of the self-stress
    work         |σ̂·ḣ| of the affine strain, and its rounding error
    rate, speed  L̇ = A L + g u, (N_b, d), and |L̇|
    rounded      numbers (N_b,) whose roundings enter L̇: |L̇|, the velocities of both vertices, |L|
    slip         L·L̇ − c K⁻¹ σ̂, (N_b,), zero but for the error of u, and its derivative by L, (N_b, d)
    multipliers  λ (N_b,) orthogonal to σ̂, along which they are free
    error        product of the remaining errors of u and λ, by which the energy may be off
    residual     relative residual of the first solution
    """

    strain: Array
    amplitude: float
    work: tuple[float, float]
    rate: Array
    speed: Array
    rounded: Array
    slip: Array
    slip_by_L: Array
    multipliers: Array
    error: float
    residual: float


class Third(NamedTuple):
    """E_abc and its derivatives by σ (N_b,), L (N_b, d) and, for springs of Hooke's law, k (N_b,).

    by_length  change per relative error of each bond vector, (N_b,)
    """

    value: float
    by_stress: Array
    by_bonds: Array
    by_stiffness: Array
    by_length: Array


class StrainedEnergy:
    """Third derivatives of the relaxed energy in strains A_a (d, d), with errors (estimates).

    Springs on edges of the stress σ (N_b,) and bond vectors L (N_b, d); others override `third` and `third_error`, and
    have D and `responses` to the strains with an amplitude, a work and a residual.

    system  `CriticalManifold.system` at σ
    """

    def __init__(
        self,
        network: Network,
        sigma: Array,
        L: Array,
        system: Any,
        law: SpringLaw,
        strains: Sequence[Array],
    ):
        self.network, self.L, self.k, self.norm = network, L, network.stiffness, float(np.linalg.norm(sigma))
        self.s, square = sigma / self.norm, dot(L, L)
        self.lengths, self.flexibility = np.sqrt(square), square / self.k
        checked = checked_law(law, self.lengths, self.k)
        self.third_of_law = checked.stiffening(np.zeros_like(square), self.lengths, self.k)
        self.D = float(self.s**2 @ self.flexibility)
        # The system of σ instead of σ̂: lengths are of order one, so its two kinds of rows then have similar magnitude.
        factor = system.factorize(sigma, L)
        self.responses: Sequence[Any] = [self.respond(A, sigma, factor) for A in strains]

    def respond(self, A: Array, sigma: Array, factor: Any) -> Response:
        """The response to a strain: a solution, and a second one of what is left by the first."""
        network, L, s, g = self.network, self.L, self.s, self.network.free_incidence
        affine = L @ A.T
        hdot = dot(L, affine)
        c = float(s @ hdot) / self.D
        goal = c * s * self.flexibility
        pull = -product(network.divergence, sigma[:, None] * affine)
        u, multiplier, residual = factor.solve(pull, goal - hdot, FIRST_RESIDUAL)
        rate = affine + product(g, u)
        force = -product(network.divergence, sigma[:, None] * rate + multiplier[:, None] * L)
        rest = goal - dot(L, rate)
        change, correction, _ = factor.solve(force, rest)
        error = (abs(float(np.vdot(force, change))) + abs(float(rest @ correction))) / self.norm
        u, multiplier = u + change, (multiplier + correction) / self.norm
        multiplier = multiplier - (s @ multiplier) * s
        rate, velocity = affine + product(g, u), np.zeros(network.n_vertices)
        velocity[network.free], speed = norms(u), norms(rate)
        rounded = speed + velocity[network.edges].sum(axis=1) + self.lengths
        slip, slip_by_L = dot(L, rate) - goal, rate + L @ A - (2 * c * s / self.k)[:, None] * L
        rounding = accumulated_rounding(2 * EPS * np.abs(s) * self.lengths * norms(affine))
        work = abs(c) * self.D, float(rounding)
        return Response(A, c, work, rate, speed, rounded, slip, slip_by_L, multiplier, error, residual)

    def third(self, terms: Sequence[Term]) -> Third:
        """E_abc of the terms, and its derivatives, with those by the amplitudes c_a, which are functions of σ̂, L, k."""
        s, L, k, flexibility, responses = self.s, self.L, self.k, self.flexibility, self.responses
        c, m, strains = [r.amplitude for r in responses], [r.multipliers for r in responses], terms[0][1:4]
        # 1. φ''' K⁻³ and its derivative along L, per |L|
        law, third = self.third_of_law * self.lengths / (k * k**2), s * s**2
        cube, slope = law * self.lengths**2 - 3 * flexibility / k, 3 * law - 6 / k**2
        amplitudes, by_c = c[strains[0]] * c[strains[1]] * c[strains[2]], np.zeros(len(c))
        edges, by_s = amplitudes * third * cube, 3 * amplitudes * s**2 * cube
        by_L, by_k = (amplitudes * third * slope)[:, None] * L, 6 * amplitudes * third * flexibility / k**2
        for n, a in enumerate(strains):
            by_c[a] += float(np.sum(third * cube)) * c[strains[n - 1]] * c[strains[n - 2]]
        # 2. The terms of the stress
        for times, a, i, j, M in terms:
            one, other, size, curved = responses[i], responses[j], times * c[a], L @ (0.5 * (M + M.T))
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
        # 3. The amplitudes
        for response, derivative in zip(responses, by_c / self.D, strict=True):
            AL, cs = L @ (0.5 * (response.strain + response.strain.T)), response.amplitude * s
            by_s += derivative * (dot(L, AL) - 2 * cs * flexibility)
            by_L += (2 * derivative * s)[:, None] * (AL - (cs / k)[:, None] * L)
            by_k += derivative * cs * s * flexibility / k
        by_stress = (by_s - (by_s @ s) * s) / self.norm
        return Third(float(np.sum(edges)), by_stress, by_L, by_k, norms(by_L) * self.lengths)

    def third_error(self, terms: Sequence[Term], by_length: Array) -> float:
        """Error of E_abc, which changes by `by_length` (N_b,) per relative error of the bond vectors.

        Sources: rates as differences of vertex velocities, which may exceed them; products; bond vectors; the errors of
        the responses, of second order.
        """
        s, length, k, responses = np.abs(self.s), self.lengths, self.k, self.responses
        square, stretched, remaining = length**2, s * self.flexibility, 0.0
        size = [abs(response.amplitude) for response in responses]
        _, i, j, l, _ = terms[0]
        noise = 4 * (np.abs(self.third_of_law) / (length * square) + 3 * k / square**2)
        noise = noise * (size[i] * stretched) * (size[j] * stretched) * (size[l] * stretched)
        for times, a, b, c, M in terms:
            one, other, weight, bent = responses[b], responses[c], times * size[a], float(np.linalg.norm(M, 2))
            # Of the curvature's part, in units of |σ̂||L|² EPS.
            curved = (1 + (b == c)) * max(1.0, 4 * bent) if bent else 0.0
            noise += weight * s * (one.speed * other.rounded + other.speed * one.rounded + curved * square)
            pulled = np.abs(one.multipliers) * other.rounded + np.abs(other.multipliers) * one.rounded
            noise += weight * length * pulled
            remaining += 2 * weight * float(np.sqrt(one.error * other.error))
        return float(accumulated_rounding(EPS * (noise + 2 * by_length))) + remaining
