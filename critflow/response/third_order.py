"""Third derivatives of the relaxed energy at the transition, along any strains, from first-order responses alone.

The boundary depends on parameters, b → b + Σ_a s_a A_a b + ½ Σ_ab s_a s_b M_ab b + …, with any matrices A_a and M_ab.
With σ̂ the unit self-stress, K⁻¹ = |L|²/k, D = σ̂ᵀK⁻¹σ̂ and c_a = σ̂·ḣ_a/D for the affine change A_a L: the response is
ḣ_a = c_a K⁻¹ σ̂, and the zero modes relax to the minimum of P(σ̂),
    P̂ u + Rᵀ λ = −gᵀ(σ̂ ∘ A_a L),   R u = c_a K⁻¹ σ̂ − ḣ_a(affine),   L̇_a = A_a L + g u.
Second and third derivatives of the energy are
    E_ab = c_a c_b D,   E_abc = Σ φ''' ḣ_a ḣ_b ḣ_c + Σ_cyc c_a Σ σ̂ (L̇_b·L̇_c + L·M_bc L),   φ''' = E'''/|L|³ − 3k/|L|⁴.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from critflow.linalg.saddle import CondensedFactor, CondensedSaddle, Saddle, SaddleFactor
from critflow.linalg.tolerances import EPS
from critflow.networks.network import Array, Network
from critflow.response.linear_response import accumulated_rounding
from critflow.springs.laws import SpringLaw, checked_law

# Step, in units of a length, of difference quotients that need two digits.
_STEP = 1e-5
# Relative residual of a first solution, which a second one corrects.
_FIRST = 1e-12


@dataclass(frozen=True, eq=False)
class Term:
    """One term c_a Σ σ̂ (L̇_b·L̇_c + L·M_bc L) of a third derivative, with the number of equal ones."""

    count: int
    a: int
    b: int
    c: int
    curvature: Array

    @property
    def curvature_rounding(self) -> float:
        """Roundings of the curvature's part of a term, in units of |σ̂||L|² EPS."""
        size = float(np.linalg.norm(self.curvature, 2))
        return (1 + (self.b == self.c)) * max(1.0, 4 * size) if size else 0.0


@dataclass(frozen=True)
class Triple:
    """The strains (a, b, c) of one third derivative, and its terms."""

    strains: tuple[int, int, int]
    terms: tuple[Term, ...]

    @classmethod
    def cubed(cls, a: int, curvature: Array) -> Triple:
        """E_aaa, with M_aa."""
        return cls((a, a, a), (Term(3, a, a, a, curvature),))

    @classmethod
    def squared(cls, a: int, b: int, curvature: Array, mixed: Array) -> Triple:
        """E_aab, with M_aa and M_ab."""
        return cls((a, a, b), (Term(1, b, a, a, curvature), Term(2, a, b, a, mixed)))


@dataclass(frozen=True, eq=False)
class Response:
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


class ThirdOrderEnergy:
    """Second and third derivatives of the energy in the strains A_a (n, d, d), with errors (estimates).

    Each third derivative is stationary in u and λ when λ times the residual of R u = c K⁻¹σ̂ − ḣ is added to it, so the
    errors of both enter by their product alone, and its derivative by L at fixed u and λ is the effect of errors of
    the bond vectors.

    responses    to the strains, in their order
    third        E_abc of each triple
    """

    def __init__(
        self,
        network: Network,
        sigma: Array,
        L: Array,
        system: Saddle | CondensedSaddle,
        law: SpringLaw,
        strains: Sequence[Array],
        triples: Sequence[Triple],
    ):
        self._network, self._L, self._k, self._triples = network, L, network.stiffness, triples
        self._norm = float(np.linalg.norm(sigma))
        self._s = sigma / self._norm
        lengths = np.linalg.norm(L, axis=1)
        checked = checked_law(law, lengths, self._k)
        self._third_of_law = checked.stiffening(np.zeros_like(lengths), lengths, self._k)
        self._flexibility = lengths**2 / self._k
        self._D = float(self._s**2 @ self._flexibility)
        # The system of σ instead of σ̂: lengths are of order one, so its two kinds of rows then have similar magnitude.
        factor = system.factorize(sigma, L)
        self.responses = tuple(self._respond(A, sigma, factor) for A in strains)
        self._parts = self._edge_parts(L, [response.amplitude for response in self.responses])
        self.third = [float(np.sum(edges)) for edges in self._parts]

    @cached_property
    def _by_bonds(self) -> list[Array]:
        """Change of each third derivative per relative error of each bond vector, (N_b,) each."""
        lengths = np.linalg.norm(self._L, axis=1)
        return [np.linalg.norm(gradient, axis=1) * lengths for gradient in self._gradients()]

    @cached_property
    def sensitivity(self) -> list[float]:
        """Change of each E_abc per relative error of the bond vectors."""
        return [float(np.sum(edges)) for edges in self._by_bonds]

    def second(self, a: int, b: int) -> float:
        """E_ab."""
        return self.responses[a].amplitude * self.responses[b].amplitude * self._D

    def work(self, a: int) -> tuple[float, float]:
        """|σ̂·ḣ_a| of the affine strain, and its rounding error."""
        response, s = self.responses[a], np.abs(self._s)
        stretch = np.linalg.norm(self._L @ response.strain.T, axis=1)
        rounding = accumulated_rounding(2 * EPS * s * np.linalg.norm(self._L, axis=1) * stretch)
        return abs(response.amplitude) * self._D, rounding

    def second_error(self, a: int, b: int) -> float:
        """Error (estimate) of E_ab."""
        (_, work_a), (_, work_b) = self.work(a), self.work(b)
        c_a, c_b = (abs(self.responses[i].amplitude) for i in (a, b))
        return c_a * work_b + c_b * work_a + 4 * EPS * c_a * c_b * self._D + work_a * work_b / self._D

    def _respond(self, A: Array, sigma: Array, factor: SaddleFactor | CondensedFactor) -> Response:
        network, L, s = self._network, self._L, self._s
        affine = L @ A.T
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
        return Response(A, c, u, network.free_incidence @ u, multiplier, error, residual)

    def _edge_parts(self, L: Array, amplitudes: list[float]) -> list[Array]:
        """Contributions (N_b,) of the edges to each third derivative, at other bond vectors and amplitudes."""
        s, multipliers = self._s, [response.multipliers for response in self.responses]
        square = np.einsum("ad,ad->a", L, L)
        third = self._third_of_law / square**1.5 - 3 * self._k / square**2
        rates = [L @ response.strain.T + response.bond_displacement for response in self.responses]
        goals = [amplitude * s * square / self._k for amplitude in amplitudes]
        rests = [np.einsum("ad,ad->a", L, rate) - goal for rate, goal in zip(rates, goals, strict=True)]
        parts = []
        for triple in self._triples:
            i, j, k = triple.strains
            part = third * goals[i] * goals[j] * goals[k]
            for term in triple.terms:
                b, c = term.b, term.c
                stretch = np.einsum("ad,ad->a", rates[b], rates[c])
                if term.curvature.any():
                    stretch += np.einsum("ad,ad->a", L, L @ term.curvature.T)
                part += (
                    term.count
                    * amplitudes[term.a]
                    * (s * stretch + multipliers[b] * rests[c] + multipliers[c] * rests[b])
                )
            parts.append(part)
        return parts

    def _gradients(self) -> list[Array]:
        """Derivatives of the third derivatives by L, (N_b, d) each, directly and through the amplitudes c(L)."""
        L, amplitudes = self._L, [response.amplitude for response in self.responses]
        steps = _STEP * np.linalg.norm(L, axis=1)
        gradients = [np.zeros_like(L) for _ in self._triples]
        for axis in range(L.shape[1]):
            ahead = L.copy()
            ahead[:, axis] += steps
            for gradient, there, here in zip(gradients, self._edge_parts(ahead, amplitudes), self._parts, strict=True):
                gradient[:, axis] = (there - here) / steps
        step = _STEP * sum(abs(c) for c in amplitudes)
        for a, response in enumerate(self.responses):
            moved = [c + step * (b == a) for b, c in enumerate(amplitudes)]
            A, c = 0.5 * (response.strain + response.strain.T), response.amplitude
            dc = 2 * self._s[:, None] * (L @ A - c * (self._s / self._k)[:, None] * L) / self._D
            for gradient, there, here in zip(gradients, self._edge_parts(L, moved), self._parts, strict=True):
                gradient += float(np.sum(there - here)) / step * dc
        return gradients

    @cached_property
    def third_error(self) -> list[float]:
        """Errors (estimates) of the third derivatives.

        Sources: rates as differences of vertex velocities, which may exceed them; products; bond vectors; the errors of
        the responses, of second order.
        """
        s, length = np.abs(self._s), np.linalg.norm(self._L, axis=1)
        sizes = [abs(response.amplitude) for response in self.responses]
        weights = [np.abs(response.multipliers) for response in self.responses]
        rates, slips = zip(*(self._rates(response) for response in self.responses), strict=True)
        goals = [size * s * length**2 / self._k for size in sizes]
        third = np.abs(self._third_of_law) / length**3 + 3 * self._k / length**4
        errors = []
        for triple, bonds in zip(self._triples, self._by_bonds, strict=True):
            i, j, k = triple.strains
            noise, remaining = 4 * third * goals[i] * goals[j] * goals[k], 0.0
            for term in triple.terms:
                b, c, size = term.b, term.c, term.count * sizes[term.a]
                noise += size * s * (rates[b] * slips[c] + rates[c] * slips[b] + term.curvature_rounding * length**2)
                noise += size * length * (weights[b] * slips[c] + weights[c] * slips[b])
                remaining += 2 * size * float(np.sqrt(self.responses[b].error * self.responses[c].error))
            errors.append(accumulated_rounding(EPS * (noise + 2 * bonds)) + remaining)
        return errors

    def _rates(self, response: Response) -> tuple[Array, Array]:
        """|L̇| (N_b,), and the numbers whose roundings enter it: |L̇|, the velocities of both vertices, |L|."""
        network = self._network
        velocity = np.zeros(network.n_vertices)
        velocity[network.free] = np.linalg.norm(response.displacement, axis=1)
        rate = np.linalg.norm(self._L @ response.strain.T + response.bond_displacement, axis=1)
        return rate, rate + velocity[network.edges].sum(axis=1) + np.linalg.norm(self._L, axis=1)
