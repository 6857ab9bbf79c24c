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

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from critflow.linalg.saddle import CondensedFactor, CondensedSaddle, Saddle, SaddleFactor
from critflow.linalg.tolerances import EPS
from critflow.linalg.vectors import dot, norms, product
from critflow.networks.network import Array, Network
from critflow.response.linear_response import accumulated_rounding
from critflow.springs.laws import SpringLaw, checked_law

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
