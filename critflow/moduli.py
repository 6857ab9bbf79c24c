"""Elastic moduli by linear response at any strain, and how they grow past the transition, exactly and by fits.

Conventions.  Strain γ is volumetric, V → V(1 + γ) with b → (1 + γ)^{1/d} b; strain ε is a pure shear, b → (1 + εA) b.
  bulk modulus                    B = V d²E/dV²
  shear modulus (energy)          G = (1/V) d²E/dε²
  shear modulus (stress-corrected)  G − ½ dE/dV
The moduli are relaxed: vertices follow the strain, μ_ab = (E_ab − Ξ_aᵀ H⁻¹ Ξ_b)/V.  Past the transition
B = B_0 + C_B γ and G = G_0 + C_G γ to first order (`ModulusStrainScaling`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from critflow.laws import HOOKEAN, SpringLaw, checked_law
from critflow.linalg import FixedPattern, Saddle
from critflow.manifold import CriticalConfiguration, require_one_self_stress
from critflow.network import Array, Network
from critflow.objectives import dilation, pure_shear, transition_modulus
from critflow.result import InputError, Solution, Stats, Status
from critflow.rigidity import rigidity
from critflow.springs import FLOPPY_REST, ElasticState, spring_state


@dataclass(frozen=True)
class Moduli:
    """Bulk and shear modulus in units of k (two dimensions), by the conventions of this module."""

    bulk: float
    shear: float
    shear_stress_corrected: float


@dataclass(frozen=True)
class Stiffening:
    """Moduli at the transition and their first derivatives with strain: C_B, C_G, C_G stress-corrected."""

    bulk_0: float
    shear_0: float
    C_B: float
    C_G: float
    C_G_stress_corrected: float


@dataclass(frozen=True)
class Fit:
    """A least-squares polynomial in strain: value and slope at the transition with their standard errors."""

    value: float
    slope: float
    value_error: float
    slope_error: float


_NO_MODULI = Moduli(np.nan, np.nan, np.nan)
FLOPPY = Moduli(0.0, 0.0, 0.0)
_NO_STIFFENING = Stiffening(np.nan, np.nan, np.nan, np.nan, np.nan)


def linear_response(state: ElasticState, pattern: FixedPattern | None = None) -> tuple[Solution[Moduli], Array]:
    """Moduli of springs under stress in equilibrium, and the relaxation dx/dγ (n_free, d) that dilation causes.

    `Status.unstable` and NaN where the Hessian has negative eigenvalues: the springs then buckle under any strain.
    Parts that are floppy, as slack ones are, do not resist and take no share; `stats.details["floppy"]` says so.
    """
    network, L, sigma = state.network, state.bond_vectors, state.sigma
    V, d = network.volume, network.dimension
    pattern = pattern or state.pattern()
    factor = state.factorize(pattern)
    floppy = factor.indefinite
    if floppy:
        factor = state.factorize(pattern, FLOPPY_REST * state.stiffness_scale)
        if factor.indefinite:
            stats = Stats("linear response", 2, 2, details={"negative_pivots": factor.n_negative})
            return Solution(_NO_MODULI, Status.unstable, stats), np.zeros_like(state.forces)

    affine = [L @ dilation(d), L @ pure_shear(d)]
    # dilation has a second derivative of its own, (1 + γ)^{1/d} being curved: b̈ = (1/d)(1/d − 1) b.
    stress_work = [
        float(sigma @ np.sum(affine[0] ** 2 + (1 / d) * (1 / d - 1) * L**2, axis=1)),
        float(sigma @ np.sum(affine[1] ** 2, axis=1)),
    ]
    moduli, relaxations, errors = [], [], []
    for dL, work in zip(affine, stress_work, strict=True):
        hdot = np.einsum("ad,ad->a", L, dL)
        stress, energy = state.resistance(hdot)
        force = -(network.divergence @ (stress[:, None] * L + sigma[:, None] * dL))
        u = factor.solve(force.ravel())
        errors.append(float(np.abs(factor.multiply(u) - force.ravel()).max() / max(np.abs(force).max(), 1e-300)))
        moduli.append(float((energy + work - force.ravel() @ u) / V))
        relaxations.append(u.reshape(force.shape))
    dE_dV = float(sigma @ state.lengths**2) / (d * V)
    value = Moduli(moduli[0], moduli[1], moduli[1] - 0.5 * dE_dV)
    stats = Stats("linear response", 1, 1, max(errors), {"floppy": floppy})
    return Solution(value, Status.ok, stats), relaxations[0]


def transition_moduli(critical: CriticalConfiguration) -> Moduli:
    """B_0 and G_0 of a critical configuration, where the stress is about to appear (`BulkModulus`, `ShearModulus`).

    Raises `InputError` for overconstrained networks, where one stress does not tell how the others answer.
    """
    require_one_self_stress(critical.network, "use elastic_moduli(network, coordinates), which takes all of them")
    network, d = critical.network, critical.network.dimension
    bulk, shear = (
        transition_modulus(network, A).evaluate(critical.sigma, critical.bond_vectors)[0]
        for A in (dilation(d), pure_shear(d))
    )
    return Moduli(bulk, shear, shear)


def stiffening(
    network: Network,
    critical: CriticalConfiguration,
    saddle: Saddle | None = None,
    throw: bool = True,
    *,
    law: SpringLaw = HOOKEAN,
) -> Solution[Stiffening]:
    """C_B and C_G of a network exactly, from its critical configuration alone: no strain path.

    With σ̂ the unit self-stress, K⁻¹ = |L|²/k, D = σ̂ᵀK⁻¹σ̂ and, for each strain a, affine change A_a L and c_a = σ̂·ḣ_a/D:
    the network answers with ḣ_a = c_a K⁻¹ σ̂, and the zero modes settle where P(σ̂) is least,
        P̂ u + Rᵀ λ = −gᵀ(σ̂ ∘ A_a L),   R u = c_a K⁻¹ σ̂ − ḣ_a(affine),   L̇_a = A_a L + g u.
    Third derivatives of the energy need no more than these first-order answers,
        E_abc = Σ φ''' ḣ_a ḣ_b ḣ_c + Σ_cyc c_a Σ σ̂ (L̇_b·L̇_c + L·b̈_bc),   φ''' = E'''/|L|³ − 3k/|L|⁴,
    and B_0 = E_γγ/V, C_B = (E_γγ + E_γγγ)/V, G_0 = E_εε/V, C_G = (E_γεε − E_εε)/V.
    So a law adds Σ E''' e_γ³/V to the C_B of Hookean springs and Σ E''' e_γ e_ε²/V to C_G, with the elongations
    e_a = ḣ_a/|L| = c_a σ̂|L|/k; B_0 and G_0 are the same for all laws.

    `Status.unstable` and NaN where P(σ̂) is not positive on the zero modes, so that no such answer exists.
    """
    network, L = critical.springs_of(network), critical.bond_vectors
    require_one_self_stress(network, "follow strain_path() and use fit_stiffening()")
    V, d, k = network.volume, network.dimension, network.stiffness
    # Lengths are of order one, so the stress is scaled to balance the system's two kinds of rows.
    norm = float(np.linalg.norm(critical.sigma))
    sigma = critical.sigma / norm
    flexibility = np.sum(L**2, axis=1) / k
    D = float(sigma**2 @ flexibility)
    system = saddle or Saddle(network)
    if not system.stable(critical.sigma, L):
        stats = Stats("exact", 1, 1, details={"note": "the stress does not stabilise all zero modes"})
        solution = Solution(_NO_STIFFENING, Status.unstable, stats)
        return solution.or_raise("no stiffening coefficients") if throw else solution

    system.factorize(critical.sigma, L)
    amplitudes, changes, responses, errors = [], [], [], []
    for A in (dilation(d), pure_shear(d)):
        affine = L @ A
        hdot = np.einsum("ad,ad->a", L, affine)
        c = float(sigma @ hdot) / D
        force = -(network.divergence @ (critical.sigma[:, None] * affine))
        u, _, error = system.solve(force, c * sigma * flexibility - hdot)
        amplitudes.append(c)
        changes.append(c * sigma * flexibility)
        responses.append(affine + network.free_incidence @ u)
        errors.append(error)

    lengths = critical.lengths
    steepening = checked_law(law, lengths, k).stiffening(np.zeros_like(lengths), lengths, k)
    third = steepening / lengths**3 - 3 * k / np.sum(L**2, axis=1) ** 2
    identity = np.eye(d)
    # b̈ of γγ, γε and εε, mapped on L.
    curvature = {(0, 0): (1 / d) * (1 / d - 1) * identity, (0, 1): pure_shear(d) / d, (1, 1): 0 * identity}

    def energy(a: int, b: int, c: int) -> float:
        total = float(third @ (changes[a] * changes[b] * changes[c]))
        for first, (second, last) in ((a, (b, c)), (b, (a, c)), (c, (a, b))):
            bending = np.sum(
                responses[second] * responses[last] + L * (L @ curvature[min(second, last), max(second, last)]), axis=1
            )
            total += amplitudes[first] * float(sigma @ bending)
        return total

    E_gg, E_ee = amplitudes[0] ** 2 * D, amplitudes[1] ** 2 * D
    bulk_0, shear_0 = E_gg / V, E_ee / V
    C_B, C_G = (E_gg + energy(0, 0, 0)) / V, (energy(0, 1, 1) - E_ee) / V
    value = Stiffening(bulk_0, shear_0, C_B, C_G, C_G - 0.5 * bulk_0)
    status = Status.ok if max(errors) < 1e-9 else Status.singular
    solution = Solution(value if status is Status.ok else _NO_STIFFENING, status, Stats("exact", 1, 1, max(errors)))
    return solution.or_raise("no stiffening coefficients") if throw else solution


def fit_stiffening(strains: ArrayLike, moduli: ArrayLike, window: float = np.inf, degree: int = 1) -> Fit:
    """Least-squares polynomial of a modulus over 0 ≤ γ ≤ window; its slope at γ = 0 is C with a standard error.

    A straight line over a window w has a bias of order w, a parabola of order w².  Raises `InputError` where fewer
    points than degree + 2 lie in the window: there would be no error to state.
    """
    gamma, values = np.asarray(strains, dtype=float), np.asarray(moduli, dtype=float)
    if gamma.ndim != 1 or gamma.shape != values.shape:
        raise InputError(
            f"strains and moduli must be lists of one length, not of shapes {gamma.shape} and {values.shape}"
        )
    inside = (gamma >= 0) & (gamma <= window * (1 + 1e-12))
    gamma, values = gamma[inside], values[inside]
    if len(gamma) < degree + 2:
        raise InputError(
            f"a fit of degree {degree} needs {degree + 2} strains in its window, not {len(gamma)}: widen it"
        )
    if not np.isfinite(values).all():
        return Fit(np.nan, np.nan, np.nan, np.nan)
    # Scaled strains keep the normal equations well conditioned.
    scale = float(gamma.max())
    design = np.vander(gamma / scale, degree + 1, increasing=True)
    coefficients, *_ = np.linalg.lstsq(design, values, rcond=None)
    residual = values - design @ coefficients
    variance = float(residual @ residual) / (len(gamma) - degree - 1)
    error = np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))
    return Fit(float(coefficients[0]), float(coefficients[1]) / scale, float(error[0]), float(error[1]) / scale)


def elastic_moduli(
    network: Network,
    coordinates: ArrayLike,
    rest_lengths: ArrayLike | None = None,
    tolerance: float = 1e-9,
    *,
    law: SpringLaw = HOOKEAN,
) -> Solution[Moduli]:
    """Relaxed B and G of springs at coordinates (N_v, d) in equilibrium, on either side of the transition.

    rest_lengths  ℓ (N_b,); None: the springs are at rest

    Stressed springs answer by linear response.  Springs at rest answer through their self-stresses S,
    μ_a = ḣ_aᵀ S (Sᵀ K⁻¹ S)⁻¹ Sᵀ ḣ_a/V; without any the network is floppy: moduli exactly 0 and `Status.floppy`.
    Raises `InputError` when the forces do not balance.
    """
    x = np.asarray(coordinates, dtype=float)
    at_rest = np.linalg.norm(network.bond_vectors(x), axis=1)
    state = spring_state(network, at_rest if rest_lengths is None else rest_lengths, x, law)
    stress = float(np.max(np.abs(state.sigma) / network.stiffness))
    if state.max_force > tolerance * float(np.mean(network.stiffness) * np.mean(state.lengths)):
        raise InputError(
            f"the springs are not in equilibrium, a force of {state.max_force:.2g} is left: call equilibrium() first"
        )
    if stress > tolerance:
        return linear_response(state)[0]
    counts = rigidity(network, x)
    if counts.status is not Status.ok:
        return Solution(FLOPPY if counts.status is Status.floppy else _NO_MODULI, counts.status, counts.stats)
    L, S, d = state.bond_vectors, counts.value.self_stresses, network.dimension
    rates = (np.einsum("ad,ad->a", L, L @ A) for A in (dilation(d), pure_shear(d)))
    value = self_stress_moduli(S, np.sum(L**2, axis=1) / network.stiffness, rates, network.volume)
    return Solution(value, Status.ok, Stats("self-stress", 1, 1, counts.stats.residual))


def self_stress_moduli(stresses: Array, flexibility: Array, rates: Iterable[Array], volume: float) -> Moduli:
    """Moduli at rest through self-stresses S (N_s, n), K⁻¹ (n,) and the rates (n,) of dilation and of shear."""
    compliance = (stresses * flexibility) @ stresses.T
    works = [stresses @ rate for rate in rates]
    bulk, shear = (float(work @ np.linalg.solve(compliance, work)) / volume for work in works)
    return Moduli(bulk, shear, shear)
