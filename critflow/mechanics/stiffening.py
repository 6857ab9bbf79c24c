"""Stiffening coefficients C_B and C_G: growth of the moduli past the transition, from the critical configuration alone.

The conventions are those of `moduli`.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from critflow.arguments import checked
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.objectives import dilation, pure_shear
from critflow.linalg.saddle import CondensedFactor, CondensedSaddle, Saddle, SaddleFactor
from critflow.linalg.tolerances import EPS
from critflow.mechanics.laws import HOOKEAN, SpringLaw, checked_law
from critflow.mechanics.response import accumulated_rounding
from critflow.mechanics.tolerances import CONSISTENT_RESPONSE, TRUSTED_ERROR
from critflow.networks.network import Array, Network
from critflow.precision.residual import exact_displacement
from critflow.result import Solution, Stats, Status
from critflow.rigidity.prestress import stabilises
from critflow.rigidity.uniqueness import require_only_self_stress

# Step, in units of a length, of difference quotients that need two digits.
_STEP = 1e-5
# Relative residual of a first solution, which a second one corrects.
_FIRST = 1e-12


@dataclass(frozen=True)
class Stiffening:
    """Moduli at the transition and their first derivatives with strain: C_B, C_G, C_G stress-corrected."""

    bulk_0: float
    shear_0: float
    C_B: float
    C_G: float
    C_G_stress_corrected: float


_NO_STIFFENING = Stiffening(np.nan, np.nan, np.nan, np.nan, np.nan)
_UNBOUNDED = Stiffening(np.inf, np.inf, np.inf, np.inf, np.inf)


@checked
def stiffening(
    network: Network | CriticalManifold,
    critical: CriticalConfiguration,
    throw: bool = True,
    *,
    law: SpringLaw = HOOKEAN,
) -> Solution[Stiffening]:
    """C_B and C_G of a network exactly, from its critical configuration alone: no strain path.

    With σ̂ the unit self-stress, K⁻¹ = |L|²/k, D = σ̂ᵀK⁻¹σ̂ and, for each strain a, affine change A_a L and c_a = σ̂·ḣ_a/D:
    the response is ḣ_a = c_a K⁻¹ σ̂, and the zero modes relax to the minimum of P(σ̂),
        P̂ u + Rᵀ λ = −gᵀ(σ̂ ∘ A_a L),   R u = c_a K⁻¹ σ̂ − ḣ_a(affine),   L̇_a = A_a L + g u.
    Third derivatives of the energy follow from these first-order responses,
        E_abc = Σ φ''' ḣ_a ḣ_b ḣ_c + Σ_cyc c_a Σ σ̂ (L̇_b·L̇_c + L·b̈_bc),   φ''' = E'''/|L|³ − 3k/|L|⁴,
    and B_0 = E_γγ/V, C_B = (E_γγ + E_γγγ)/V, G_0 = E_εε/V, C_G = (E_γεε − E_εε)/V.
    So a law adds Σ E''' e_γ³/V to the C_B of Hookean springs and Σ E''' e_γ e_ε²/V to C_G, with the elongations
    e_a = ḣ_a/|L| = c_a σ̂|L|/k; B_0 and G_0 are the same for all laws.

    The value is that of the configuration in exact balance under the floating-point σ, found from the given
    coordinates in extended precision.

    Error bound (estimate): `stats.error_bound` limits the errors against it; errors of first order are exact, roundings
    are summed by `accumulated_rounding`.  `stats.condition` is the largest factor by which relative errors of bond
    vectors are amplified in C_B and C_G.

    `Status.unstable` and NaN where P(σ̂) is not positive on the zero modes, so that no response exists;
    `Status.undecided` where rounding hides whether it is;
    `Status.ill_conditioned` and NaN where the bound exceeds a tenth of the largest coefficient.
    Raises `InputError` for configurations with several self-stresses.
    """
    solution = _stiffening(CriticalManifold.of(network), critical, law)
    return solution.or_raise("no stiffening coefficients") if throw else solution


def _stiffening(manifold: CriticalManifold, critical: CriticalConfiguration, law: SpringLaw) -> Solution[Stiffening]:
    network = critical.springs_of(manifold.network)
    require_only_self_stress(critical, "follow strain_path() and use fit_stiffening()")
    system = manifold.system(critical.sigma)
    stable = stabilises(network, critical.coordinates, critical.bond_vectors, critical.sigma)
    if not stable:
        status = Status.unstable if stable is False else Status.undecided
        note = "the stress does not stabilise all zero modes" if stable is False else ""
        return Solution(_NO_STIFFENING, status, Stats("exact", 1), note)

    factor = manifold.prestress.factorize_signed(critical.sigma)
    balance = exact_displacement(network, critical.coordinates, lambda _: critical.sigma, factor.solve)
    if not np.isfinite(balance.remainder):
        note = "rounding hides which configuration balances this stress exactly"
        stats = Stats("exact", 1, error_bound=_UNBOUNDED)
        return Solution(_NO_STIFFENING, Status.ill_conditioned, stats, note)

    energy = _ThirdOrderEnergy(network, critical.sigma, balance.bond_vectors, system, law)
    value, bound = energy.coefficients(), energy.error_bounds()
    residual = max(response.residual for response in energy.responses)
    stats = Stats("exact", 1, residual=residual, condition=energy.condition(), error_bound=bound)
    if not residual < CONSISTENT_RESPONSE:
        return Solution(_NO_STIFFENING, Status.singular, stats)
    if not max(astuple(bound)) < TRUSTED_ERROR * max(abs(value.bulk_0), abs(value.C_B), abs(value.C_G)):
        note = "rounding errors may exceed the coefficients: choose stresses of more similar magnitude"
        return Solution(_NO_STIFFENING, Status.ill_conditioned, stats, note)
    return Solution(value, Status.ok, stats)


@dataclass(frozen=True, eq=False)
class _Response:
    """First-order response to one strain.

    strain        A (d, d)
    amplitude     c, the strain's amplitude of the self-stress
    displacement  u (n_free, d), and its bond vectors g u (N_b, d)
    multipliers   λ (N_b,) orthogonal to σ̂, along which they are free
    error         product of the remaining errors of u and λ, by which the energy may be off
    residual      relative residual of the first solution
    """

    strain: Array
    amplitude: float
    displacement: Array
    bond_displacement: Array
    multipliers: Array
    error: float
    residual: float


class _ThirdOrderEnergy:
    """Derivatives of the energy up to third order, from the responses to dilation (0) and shear (1).

    Each third derivative is stationary in u and λ when λ times the residual of R u = c K⁻¹σ̂ − ḣ is added to it, so the
    errors of both enter by their product alone, and its derivative by L at fixed u and λ is the effect of errors of
    the bond vectors.
    """

    def __init__(self, network: Network, sigma: Array, L: Array, system: Saddle | CondensedSaddle, law: SpringLaw):
        self._network, self._L, self._k, self._V = network, L, network.stiffness, network.volume
        self._norm = float(np.linalg.norm(sigma))
        self._s = sigma / self._norm
        lengths = np.linalg.norm(L, axis=1)
        checked = checked_law(law, lengths, self._k)
        self._third_of_law = checked.stiffening(np.zeros_like(lengths), lengths, self._k)
        self._flexibility = lengths**2 / self._k
        self._D = float(self._s**2 @ self._flexibility)
        # The system of σ instead of σ̂: lengths are of order one, so its two kinds of rows then have similar magnitude.
        factor = system.factorize(sigma, L)
        d = network.dimension
        self.responses = tuple(self._respond(A, sigma, factor) for A in (dilation(d), pure_shear(d)))
        self._parts = self._edge_parts(L, *(response.amplitude for response in self.responses))
        self._sensitivity = [np.linalg.norm(gradient, axis=1) * lengths for gradient in self._gradients()]

    def _respond(self, A: Array, sigma: Array, factor: SaddleFactor | CondensedFactor) -> _Response:
        network, L, s = self._network, self._L, self._s
        affine = L @ A
        hdot = np.einsum("ad,ad->a", L, affine)
        c = float(s @ hdot) / self._D
        goal = c * s * self._flexibility
        pull = -(network.divergence @ (sigma[:, None] * affine))
        u, multiplier, residual = factor.solve(pull, goal - hdot, _FIRST)
        rate = affine + network.free_incidence @ u
        force = -(network.divergence @ (sigma[:, None] * rate + multiplier[:, None] * L))
        rest = goal - np.einsum("ad,ad->a", L, rate)
        change, correction, _ = factor.solve(force, rest)
        error = (abs(float(np.vdot(force, change))) + abs(float(rest @ correction))) / self._norm
        u, multiplier = u + change, (multiplier + correction) / self._norm
        multiplier = multiplier - (s @ multiplier) * s
        return _Response(A, c, u, network.free_incidence @ u, multiplier, error, residual)

    def _edge_parts(self, L: Array, c: float, e: float) -> tuple[Array, Array]:
        """Contributions of the edges to E_γγγ and to E_γεε, (N_b,), at other bond vectors and amplitudes c, e."""
        s, d, amplitudes = self._s, self._network.dimension, (c, e)
        square = np.einsum("ad,ad->a", L, L)
        third = self._third_of_law / square**1.5 - 3 * self._k / square**2
        rates = [L @ response.strain + response.bond_displacement for response in self.responses]
        goals = [amplitude * s * square / self._k for amplitude in amplitudes]
        rests = [np.einsum("ad,ad->a", L, rate) - goal for rate, goal in zip(rates, goals, strict=True)]
        # b̈ of γγ and γε, mapped on L; that of εε is zero.
        dilating = np.einsum("ad,ad->a", rates[0], rates[0]) + (1 / d) * (1 / d - 1) * square
        mixed = np.einsum("ad,ad->a", rates[0], rates[1])
        mixed = mixed + np.einsum("ad,ad->a", L, L @ self.responses[1].strain) / d
        shearing = np.einsum("ad,ad->a", rates[1], rates[1])
        m, n = (response.multipliers for response in self.responses)
        bulk = third * goals[0] ** 3 + 3 * c * (s * dilating + 2 * m * rests[0])
        shear = third * goals[0] * goals[1] ** 2 + c * (s * shearing + 2 * n * rests[1])
        shear += 2 * e * (s * mixed + n * rests[0] + m * rests[1])
        return bulk, shear

    def coefficients(self) -> Stiffening:
        """B_0, G_0, C_B and C_G."""
        c, e = (response.amplitude for response in self.responses)
        bulk, shear = (float(np.sum(edges)) for edges in self._parts)
        E_gg, E_ee = c**2 * self._D, e**2 * self._D
        bulk_0, shear_0 = E_gg / self._V, E_ee / self._V
        C_B, C_G = (E_gg + bulk) / self._V, (shear - E_ee) / self._V
        return Stiffening(bulk_0, shear_0, C_B, C_G, C_G - 0.5 * bulk_0)

    def _gradients(self) -> list[Array]:
        """Derivatives of E_γγγ and E_γεε by L, (N_b, d) each, directly and through the amplitudes c(L), e(L)."""
        L, (c, e) = self._L, (response.amplitude for response in self.responses)
        steps = _STEP * np.linalg.norm(L, axis=1)
        gradients = [np.zeros_like(L), np.zeros_like(L)]
        for axis in range(L.shape[1]):
            ahead = L.copy()
            ahead[:, axis] += steps
            for gradient, there, here in zip(gradients, self._edge_parts(ahead, c, e), self._parts, strict=True):
                gradient[:, axis] = (there - here) / steps
        step = _STEP * (abs(c) + abs(e))
        for response, moved in zip(self.responses, ((c + step, e), (c, e + step)), strict=True):
            dc = 2 * self._s[:, None] * (L @ response.strain - response.amplitude * (self._s / self._k)[:, None] * L)
            dc /= self._D
            for gradient, there, here in zip(gradients, self._edge_parts(L, *moved), self._parts, strict=True):
                gradient += float(np.sum(there - here)) / step * dc
        return gradients

    def _edge_rounding(self) -> tuple[Array, Array]:
        """Rounding errors of the edges' contributions to E_γγγ and E_γεε, (N_b,) each.

        Sources: rates as differences of vertex velocities, which may exceed them; products; bond vectors.
        """
        s, length = np.abs(self._s), np.linalg.norm(self._L, axis=1)
        c, e = (abs(response.amplitude) for response in self.responses)
        m, n = (np.abs(response.multipliers) for response in self.responses)
        (rate_c, slip_c), (rate_e, slip_e) = (self._rates(response) for response in self.responses)
        goal_c, goal_e = (amplitude * s * length**2 / self._k for amplitude in (c, e))
        third = np.abs(self._third_of_law) / length**3 + 3 * self._k / length**4
        bulk = 4 * third * goal_c**3 + 6 * c * (s * (rate_c * slip_c + length**2) + m * length * slip_c)
        shear = 4 * third * goal_c * goal_e**2 + 2 * c * (s * rate_e + n * length) * slip_e
        shear += 2 * e * (s * (rate_c * slip_e + rate_e * slip_c + length**2))
        shear += 2 * e * length * (n * slip_c + m * slip_e)
        by_bonds, by_bonds_shear = self._sensitivity
        return EPS * (bulk + 2 * by_bonds), EPS * (shear + 2 * by_bonds_shear)

    def _rates(self, response: _Response) -> tuple[Array, Array]:
        """|L̇| (N_b,), and the numbers whose roundings enter it: |L̇|, the velocities of both vertices, |L|."""
        network = self._network
        velocity = np.zeros(network.n_vertices)
        velocity[network.free] = np.linalg.norm(response.displacement, axis=1)
        rate = np.linalg.norm(self._L @ response.strain + response.bond_displacement, axis=1)
        return rate, rate + velocity[network.edges].sum(axis=1) + np.linalg.norm(self._L, axis=1)

    def error_bounds(self) -> Stiffening:
        """Error bounds (estimates) of the coefficients."""
        L, s, V, D = self._L, np.abs(self._s), self._V, self._D
        length = np.linalg.norm(L, axis=1)
        seconds = []
        for response in self.responses:
            c, stretch = abs(response.amplitude), np.linalg.norm(L @ response.strain, axis=1)
            work = accumulated_rounding(2 * EPS * s * length * stretch)
            seconds.append(2 * c * work + 4 * EPS * c**2 * D + work**2 / D)
        bulk_0, shear_0 = (second / V for second in seconds)
        c, e = (abs(response.amplitude) for response in self.responses)
        gg, ee = (response.error for response in self.responses)
        mixed = float(np.sqrt(gg * ee))
        noise, noise_shear = map(accumulated_rounding, self._edge_rounding())
        C_B = (noise + 6 * c * gg + seconds[0]) / V
        C_G = (noise_shear + 2 * c * ee + 4 * e * mixed + seconds[1]) / V
        return Stiffening(bulk_0, shear_0, C_B, C_G, C_G + 0.5 * bulk_0)

    def condition(self) -> float:
        """The larger ratio of a relative error of C_B or C_G to the relative errors of bond vectors that cause it."""
        value = self.coefficients()
        changes = [float(np.sum(sensitivity)) / self._V for sensitivity in self._sensitivity]
        return max(change / max(abs(C), 1e-300) for change, C in zip(changes, (value.C_B, value.C_G), strict=True))
