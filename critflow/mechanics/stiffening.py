"""How the moduli grow past the transition, C_B and C_G, exactly and from the critical configuration alone.

The conventions are those of `moduli`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.objectives import dilation, pure_shear
from critflow.linalg.saddle import CondensedSaddle, Saddle
from critflow.linalg.tolerances import EPS
from critflow.mechanics.laws import HOOKEAN, SpringLaw, checked_law
from critflow.mechanics.moduli import together
from critflow.networks.network import Array, Network
from critflow.precision.residual import exact_displacement
from critflow.result import Solution, Stats, Status
from critflow.rigidity.uniqueness import require_only_self_stress

# Largest error bound, in units of the largest coefficient, of coefficients that are given.
_TRUSTED = 0.1
# Step, in units of a length, of differences that need two digits.
_STEP = 1e-5
# Relative residual of a first answer that a second one corrects.
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


def stiffening(
    network: Network | CriticalManifold,
    critical: CriticalConfiguration,
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

    The answer is that of the configuration in exact balance under the floats σ, found from the given coordinates in
    extended precision; `stats.error_bound` bounds the errors against it, and `stats.condition` is the largest factor
    by which relative errors of bond vectors come back in C_B and C_G.
    `Status.unstable` and NaN where P(σ̂) is not positive on the zero modes, so that no such answer exists;
    `Status.ill_conditioned` and NaN where the bound exceeds a tenth of the largest coefficient.
    Raises `InputError` for configurations with several self-stresses.
    """
    manifold = CriticalManifold.of(network)
    network = critical.springs_of(manifold.network)
    require_only_self_stress(critical, "follow strain_path() and use fit_stiffening()")
    system = manifold.system(critical.sigma)
    if not system.stable(critical.sigma, critical.bond_vectors):
        stats = Stats("exact", 1, 1, details={"note": "the stress does not stabilise all zero modes"})
        solution = Solution(_NO_STIFFENING, Status.unstable, stats)
        return solution.or_raise("no stiffening coefficients") if throw else solution

    factor = manifold.prestress.factorize_signed(critical.sigma)
    balance = exact_displacement(network, critical.coordinates, lambda _: critical.sigma, factor.solve)
    if not np.isfinite(balance.remainder):
        note = "rounding hides which configuration balances this stress exactly"
        stats = Stats("exact", 1, 1, details={"note": note}, error_bound=Stiffening(*[np.inf] * 5))
        solution = Solution(_NO_STIFFENING, Status.ill_conditioned, stats)
        return solution.or_raise("no stiffening coefficients") if throw else solution

    response = _Response(network, critical.sigma, balance.bond_vectors, system, law)
    value, bound = response.value(), response.bound()
    worst = max(bound.bulk_0, bound.shear_0, bound.C_B, bound.C_G, bound.C_G_stress_corrected)
    status, details = Status.ok, {}
    if not response.residual < 1e-9:
        status = Status.singular
    elif not worst < _TRUSTED * max(abs(value.bulk_0), abs(value.C_B), abs(value.C_G)):
        status, details = Status.ill_conditioned, {"note": "rounding may have taken every digit of the coefficients"}
    stats = Stats("exact", 1, 1, response.residual, details, response.condition(), bound)
    solution = Solution(value if status is Status.ok else _NO_STIFFENING, status, stats)
    return solution.or_raise("no stiffening coefficients") if throw else solution


class _Response:
    """First-order answers to dilation (0) and shear (1), and the third derivatives of the energy that follow.

    Each third derivative is stationary in u and λ when λ times what is left of R u = c K⁻¹σ̂ − ḣ is added to it, so
    the errors of both count by their product alone, and its derivative by L at fixed u and λ tells what errors of the
    bond vectors do.
    """

    def __init__(self, network: Network, sigma: Array, L: Array, system: Saddle | CondensedSaddle, law: SpringLaw):
        self._network, self._L, self._k, self._V = network, L, network.stiffness, network.volume
        d = network.dimension
        self._strains = (dilation(d), pure_shear(d))
        # Lengths are of order one, so the stress is scaled to balance the system's two kinds of rows.
        norm = float(np.linalg.norm(sigma))
        self._s = s = sigma / norm
        lengths = np.linalg.norm(L, axis=1)
        checked = checked_law(law, lengths, self._k)
        self._steepening = checked.stiffening(np.zeros_like(lengths), lengths, self._k)
        flexibility = lengths**2 / self._k
        self._D = float(s**2 @ flexibility)
        factor = system.factorize(sigma, L)
        self._u, self._gu, self._multipliers, self._c, self._missed, errors = [], [], [], [], [], []
        for A in self._strains:
            affine = L @ A
            hdot = np.einsum("ad,ad->a", L, affine)
            c = float(s @ hdot) / self._D
            goal = c * s * flexibility
            pull = -(network.divergence @ (sigma[:, None] * affine))
            u, multiplier, error = factor.solve(pull, goal - hdot, _FIRST)
            rate = affine + network.free_incidence @ u
            force = -(network.divergence @ (sigma[:, None] * rate + multiplier[:, None] * L))
            rest = goal - np.einsum("ad,ad->a", L, rate)
            change, correction, _ = factor.solve(force, rest)
            self._missed.append((abs(float(np.vdot(force, change))) + abs(float(rest @ correction))) / norm)
            u, multiplier = u + change, (multiplier + correction) / norm
            self._u.append(u)
            self._gu.append(network.free_incidence @ u)
            # Along σ̂ the multiplier is free.
            self._multipliers.append(multiplier - (s @ multiplier) * s)
            self._c.append(c)
            errors.append(error)
        self.residual = max(errors)
        self._parts = self._edges(L, (self._c[0], self._c[1]))
        self._noise, self._sensitivity = self._errors()

    def _edges(self, L: Array, c: tuple[float, float]) -> tuple[Array, Array]:
        """What each edge adds to E_γγγ and to E_γεε, (N_b,), at other bond vectors and amplitudes c_a."""
        s, d = self._s, self._network.dimension
        square = np.einsum("ad,ad->a", L, L)
        third = self._steepening / square**1.5 - 3 * self._k / square**2
        rates = [L @ A + gu for A, gu in zip(self._strains, self._gu, strict=True)]
        goals = [c_a * s * square / self._k for c_a in c]
        rests = [np.einsum("ad,ad->a", L, rate) - goal for rate, goal in zip(rates, goals, strict=True)]
        # b̈ of γγ and γε, mapped on L; that of εε is none.
        dilating = np.einsum("ad,ad->a", rates[0], rates[0]) + (1 / d) * (1 / d - 1) * square
        mixed = np.einsum("ad,ad->a", rates[0], rates[1]) + np.einsum("ad,ad->a", L, L @ self._strains[1]) / d
        shearing = np.einsum("ad,ad->a", rates[1], rates[1])
        m = self._multipliers
        bulk = third * goals[0] ** 3 + 3 * c[0] * (s * dilating + 2 * m[0] * rests[0])
        shear = third * goals[0] * goals[1] ** 2 + c[0] * (s * shearing + 2 * m[1] * rests[1])
        shear += 2 * c[1] * (s * mixed + m[1] * rests[0] + m[0] * rests[1])
        return bulk, shear

    def value(self) -> Stiffening:
        """The coefficients."""
        c, V = self._c, self._V
        bulk, shear = (float(np.sum(edges)) for edges in self._parts)
        E_gg, E_ee = c[0] ** 2 * self._D, c[1] ** 2 * self._D
        bulk_0, shear_0 = E_gg / V, E_ee / V
        C_B, C_G = (E_gg + bulk) / V, (shear - E_ee) / V
        return Stiffening(bulk_0, shear_0, C_B, C_G, C_G - 0.5 * bulk_0)

    def _gradients(self) -> list[Array]:
        """Derivatives by L, (N_b, d) each, through L itself and through the amplitudes c_a(L)."""
        L, (c, e) = self._L, self._c
        steps = _STEP * np.linalg.norm(L, axis=1)
        gradients = [np.zeros_like(L), np.zeros_like(L)]
        for axis in range(L.shape[1]):
            ahead = L.copy()
            ahead[:, axis] += steps
            for gradient, there, here in zip(gradients, self._edges(ahead, (c, e)), self._parts, strict=True):
                gradient[:, axis] = (there - here) / steps
        for a, A in enumerate(self._strains):
            step = _STEP * (abs(c) + abs(e))
            up = [c, e]
            up[a] += step
            dc = 2 * self._s[:, None] * (L @ A - self._c[a] * (self._s / self._k)[:, None] * L) / self._D
            for gradient, there, here in zip(gradients, self._edges(L, (up[0], up[1])), self._parts, strict=True):
                gradient += float(np.sum(there - here)) / step * dc
        return gradients

    def _errors(self) -> tuple[list[Array], list[Array]]:
        """What rounding does to each edge's part of E_γγγ and E_γεε, and what relative errors of L do, (N_b,) each."""
        network, s, length = self._network, self._s, np.linalg.norm(self._L, axis=1)
        sensitivity = [np.linalg.norm(gradient, axis=1) * length for gradient in self._gradients()]
        c = [abs(c_a) for c_a in self._c]
        m = [np.abs(multiplier) for multiplier in self._multipliers]
        rates, slips = [], []
        for A, u, gu in zip(self._strains, self._u, self._gu, strict=True):
            moved = np.zeros(network.n_vertices)
            moved[network.free] = np.linalg.norm(u, axis=1)
            rates.append(np.linalg.norm(self._L @ A + gu, axis=1))
            slips.append(rates[-1] + moved[network.edges].sum(axis=1) + length)
        goals = [c_a * np.abs(s) * length**2 / self._k for c_a in c]
        third = np.abs(self._steepening) / length**3 + 3 * self._k / length**4
        s = np.abs(s)
        # Rates from vertices that move further than edges do, and products of them.
        bulk = 4 * third * goals[0] ** 3 + 6 * c[0] * (s * (rates[0] * slips[0] + length**2) + m[0] * length * slips[0])
        shear = 4 * third * goals[0] * goals[1] ** 2 + 2 * c[0] * (s * rates[1] + m[1] * length) * slips[1]
        shear += 2 * c[1] * (s * (rates[0] * slips[1] + rates[1] * slips[0] + length**2))
        shear += 2 * c[1] * length * (m[1] * slips[0] + m[0] * slips[1])
        return [EPS * (part + 2 * change) for part, change in zip((bulk, shear), sensitivity, strict=True)], sensitivity

    def bound(self) -> Stiffening:
        """Bounds on the errors of the coefficients."""
        L, s, V, D = self._L, np.abs(self._s), self._V, self._D
        length = np.linalg.norm(L, axis=1)
        seconds = []
        for A, c in zip(self._strains, self._c, strict=True):
            work = together(2 * EPS * s * length * np.linalg.norm(L @ A, axis=1))
            seconds.append(2 * abs(c) * work + 4 * EPS * c**2 * D + work**2 / D)
        bulk_0, shear_0 = (second / V for second in seconds)
        c, e = abs(self._c[0]), abs(self._c[1])
        (gg, ee), mixed = self._missed, float(np.sqrt(np.prod(self._missed)))
        C_B = (together(self._noise[0]) + 6 * c * gg + seconds[0]) / V
        C_G = (together(self._noise[1]) + 2 * c * ee + 4 * e * mixed + seconds[1]) / V
        return Stiffening(bulk_0, shear_0, C_B, C_G, C_G + 0.5 * bulk_0)

    def condition(self) -> float:
        """How much larger relative errors of C_B and C_G are than those of bond vectors that cause them."""
        value = self.value()
        changes = [float(np.sum(sensitivity)) / self._V for sensitivity in self._sensitivity]
        return max(change / max(abs(C), 1e-300) for change, C in zip(changes, (value.C_B, value.C_G), strict=True))
