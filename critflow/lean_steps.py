"""A strain step of springs in tension under a convex law, with as few operations as its numbers need.

Such springs have one equilibrium, the global minimum of the energy (`SpringState.unique`), and a Hessian
    H = Σ_α g_α g_αᵀ ⊗ (K_α L_α L_αᵀ + σ_α 1)
that is positive definite.  A step from predicted coordinates therefore needs no shifts of H, no shorter steps and no
tests of its branch:

1. Newton's method, H u = f, until the forces f are below `LOOSEST_TOLERANCE`; a close prediction needs no step
2. corrections by the last factor onto the exact equilibrium, as `refinement.exact_displacement`
3. responses u_a to strains, H u_a = −∂E_a/∂x, as `linear_response.responses`, extrapolated from the last strains
4. their errors, and the moduli

Where any of them does not apply the result is None, and the general step of `critflow.paths` follows.

Arrays are rows: coordinates x (d, N_v), bond vectors L (d, N_b), rates (m, d, N_b) under m strains, since NumPy is
several times slower where the last axis is short.  Unknowns (n_free·d,) are in the order of the Hessian, vertex by
vertex.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from critflow.double_double import Extended, less_squares, two_product, two_square, two_sum
from critflow.equilibria import FORCE_DECREASE, LONGEST_STEP, LOOSEST_TOLERANCE, REUSE_AFTER, REUSE_DECREASE
from critflow.linear_response import (
    CONTRACTION_MARGIN,
    CONVERGED,
    NO_RELAXATION,
    Elasticity,
    elasticity_of_form,
    form_rounding,
    largest_each,
    remaining,
    unit_strains,
)
from critflow.linear_response import MOST_CORRECTIONS as MOST_RESPONSES
from critflow.networks import Array, Network
from critflow.numerics import EPS, KERNELS, largest, mean
from critflow.refinement import CONTRACTION, MOST_CORRECTIONS, ROUNDED_FORCE, UNSEEN, leading_half
from critflow.sparse import Factor, edge_blocks
from critflow.springs import TAUT, SpringState

csr_matvec, csc_matvec = KERNELS["csr"][0], KERNELS["csc"][0]

LeanBalance: TypeAlias = tuple[Array, Array, Array, Array, Array]
"""Edges and forces near the equilibrium: L = high + low, both (d, N_b), |L|² − ℓ² and σ (N_b,), f (n_free·d,)."""

Relaxed: TypeAlias = tuple[SpringState, float, int, Factor, float]
"""An equilibrium, the error (estimate) of its coordinates, steps of Newton's method, and a factor of H near it with the
contraction of corrections by it."""


class LeanSteps:
    """What the steps of a path share: its springs at γ = 0 and sums over edges of rows.

    known  strains and responses of the last four steps
    """

    def __init__(self, springs: SpringState):
        network, g, d = springs.network, springs.network.free_incidence, springs.network.dimension
        self.springs, self.size, self.ground = springs, d * g.shape[1], springs.coordinates.T.copy()
        self.tail, self.head = np.ascontiguousarray(network.edges.T)
        self.offsets = np.ascontiguousarray(network.offsets.T, float)
        self.rest_squares, self.stiffness_mean = two_square(springs.rest_lengths), mean(springs.stiffness)
        self.known: list[tuple[float, Array]] = []
        # g for all strains at once, a matrix by rows from unknowns (m, n_free, d) to edges (m, d, N_b); its first rows
        # are that for fewer.
        m = len(unit_strains(d))
        columns = np.add.outer(np.arange(m) * (d * g.shape[1]), np.arange(d)).ravel()
        starts = np.add.outer(np.arange(m * d) * g.nnz, g.indptr[:-1])
        self.starts = np.append(starts, m * d * g.nnz).astype(np.intc)
        self.columns = np.add.outer(columns, g.indices * d).ravel().astype(np.intc)
        self.signs = np.tile(g.data, m * d)

    def rates(self, u: Array, affine: Array) -> Array:
        """L̇ + g u of affine rates L̇ (..., d, N_b) and motions u (..., n_free·d)."""
        rate = affine.copy()
        csr_matvec(rate.size, u.size, self.starts, self.columns, self.signs, u.ravel(), rate.ravel())
        return rate

    def forces(self, pulls: Array) -> Array:
        """−gᵀ p, (..., n_free·d), of edge vectors p (..., d, N_b)."""
        total = np.zeros((*pulls.shape[:-2], self.size))
        csc_matvec(total.size, pulls.size, self.starts, self.columns, self.signs, pulls.ravel(), total.ravel())
        return -total

    def balance(self, x: Array, b: Array) -> LeanBalance | None:
        """Edges at x, with b (d, N_b), and forces, to the rounding of σ and of the results; None in compression."""
        springs, rest = self.springs, self.springs.rest_lengths
        if springs.network.pins:
            # They are part of b.
            x = x.copy()
            x[:, list(springs.network.pins)] = 0.0
        ends, lost = two_sum(x.take(self.head, 1), -x.take(self.tail, 1))
        high, low = two_sum(ends, b)
        high, low = two_sum(high, low + lost)
        # |L| − ℓ = (|L|² − ℓ²)/(|L| + ℓ)
        excess, length = less_squares(Extended(high.T, low.T), self.rest_squares), np.sqrt(np.add.reduce(high * high))
        sigma = springs.law.tension(excess / (length + rest), rest, springs.stiffness) / length
        if not 0 < np.minimum.reduce(sigma) <= np.maximum.reduce(sigma) < np.inf:
            return None
        # Sums of the leading parts of σ L are exact, as in `refinement.exact_forces`.
        pull = two_product(sigma, high)
        leading = leading_half(pull.high)
        force = self.forces(leading) + self.forces((pull.high - leading) + (pull.low + sigma * low))
        return high, low, excess, sigma, force

    def equilibrium(self, F: Array, y: Array) -> Relaxed | None:
        """The exact equilibrium in the cell of F from coordinates y (n_free·d,), x = F y, of springs in tension."""
        springs, network, rest = self.springs, self.springs.network.deformed(F), self.springs.rest_lengths
        free, law, k = network.free_rows, springs.law, springs.stiffness
        self.ground[:, free] = y.reshape(-1, len(F)).T
        x = F @ self.ground
        if network.cell is None or network.pins:
            b = np.ascontiguousarray(network.boundary_vectors.T)
        else:
            b = network.cell.T @ self.offsets
        # 1. Newton's method, with the factor of the last step while that brings forces down fast
        factor, steps, reuse, before = None, 0, False, np.inf
        while (at := self.balance(x, b)) is not None:
            L, _, _, sigma, force = at
            size, length = largest(force), np.sqrt(np.add.reduce(L * L))
            if not size < (REUSE_DECREASE if reuse else FORCE_DECREASE) * before:
                return None
            stiffness = law.stiffness(length - rest, rest, k)
            scale = self.stiffness_mean * (1.0 if stiffness is k else max(1.0, float(np.max(stiffness / k))))
            balanced = size <= LOOSEST_TOLERANCE * (scale * springs.length_scale)
            reuse = factor is not None and (balanced or size < REUSE_AFTER * before)
            if not reuse:
                factor = None  # its solver, with the memory of its numbers, then serves the next one
                K = (stiffness - sigma) / length**2
                factor = springs.pattern.factorize(edge_blocks(K, L.T, sigma))
                if not np.minimum.reduce(sigma) > TAUT * scale and factor.indefinite:
                    return None
            assert factor is not None
            if balanced:
                return self.corrected(at, x, factor, steps, network)
            u, before, steps = factor.solve(force), size, steps + 1
            if not largest(u) <= LONGEST_STEP * mean(length):
                return None
            x[:, free] += u.reshape(-1, len(F)).T
        return None

    def corrected(self, at: LeanBalance, x: Array, factor: Factor, steps: int, network: Network) -> Relaxed | None:
        """2. The exact equilibrium by corrections D of coordinates x, which change; None where they do not converge."""
        (L, low, excess, sigma, force), springs, rest = at, self.springs, self.springs.rest_lengths
        D, before, compliance, contraction = np.zeros_like(force), np.inf, 0.0, 1.0
        rounding, free = EPS * largest(x), network.free_rows
        for number in range(MOST_CORRECTIONS):
            u = factor.solve(force)
            size, change = largest(u), self.rates(u, np.zeros_like(L))
            if size == 0.0:
                remainder = 0.0
                break
            compliance, contraction = max(compliance, size / largest(force)), min(1.0, size / before) if number else 1.0
            if not size < CONTRACTION * before:
                # Corrections of the size of rounding do not shrink.
                if not size <= rounding:
                    return None
                remainder = 2 * size
                break
            # A first correction may shrink faster than those after it.
            D, before, remainder = D + u, size, 0.5 * size
            if number and remainder <= UNSEEN * rounding:
                break
            # Increments of |L|², σ and f have all digits that count.
            excess, moved, old = excess + np.add.reduce((L + L + change) * change), L + change, sigma
            length = np.sqrt(np.add.reduce(moved * moved))
            sigma = springs.law.tension(excess / (length + rest), rest, springs.stiffness) / length
            force = force + self.forces((sigma - old) * moved + old * change)
            L, low = two_sum(L, low + change)
        else:
            return None
        remainder += EPS * compliance * largest(sigma * L)
        L = L + (low + change)
        x[:, free], low = two_sum(x[:, free], D.reshape(-1, len(x)).T)
        error = max(largest(low), 0.5 * EPS * largest(L)) + 2 * remainder
        state = SpringState(network, rest, x.T, L.T, springs.law, backend=springs.backend)
        return state, error, steps, factor, contraction

    def response(
        self, state: SpringState, factor: Factor, contraction: float, strain: float, strains: tuple[int, ...]
    ) -> tuple[Elasticity, Array] | None:
        """The response to these rows of `unit_strains`; None where corrections do not converge or errors hide it."""
        L, m, volume = state.bond_vectors.T, len(strains), state.network.volume
        d, K, sigma, least = len(L), state.modified_stiffness, state.sigma, NO_RELAXATION * self.springs.length_scale
        # 3. Responses: forces of all strains at once, and corrections of each u
        affine = (unit_strains(d)[list(strains)].reshape(m * d, d) @ L).reshape(m, d, -1)
        stretching = np.add.reduce(L * affine, axis=1)
        direct = (K * stretching) @ stretching.T + (sigma * affine).reshape(m, -1) @ affine.reshape(m, -1).T
        # The polynomial through the last ones
        last, u = [(here, known) for here, known in self.known if len(known) == m], np.zeros((m, self.size))
        for here, known in last:
            u += math.prod((strain - other) / (here - other) for other, _ in last if other != here) * known
        rate, before, size = self.rates(u, affine), np.zeros(m), np.full(m, np.inf)
        for number in range(MOST_RESPONSES + 1):
            tension = K * np.add.reduce(L * rate, axis=1)
            pulls = sigma * rate + tension[:, None] * L
            form, force = pulls.reshape(m, -1) @ rate.reshape(m, -1).T, self.forces(pulls)
            # Forces of rounding alone, as of a dilation where σ = k, need no solve.
            loaded = largest_each(force) > ROUNDED_FORCE * largest_each(pulls.reshape(m, -1))
            correction = np.zeros_like(force)
            for each in loaded.nonzero()[0]:
                correction[each] = factor.solve(force[each])
            u, gained = u + correction, force @ correction.T
            gain, former, size = np.abs(gained.diagonal()), size, largest_each(correction)
            # What a correction leaves is its gain times the contraction, at first that of the equilibrium.
            if number:
                contraction = float(np.sqrt(np.maximum.reduce(gain / np.maximum(before, 1e-300))))
            unfinished = gain * min(1.0, CONTRACTION_MARGIN * contraction)
            small = (size <= CONVERGED * np.maximum(largest_each(u), least)).all()
            if small and (unfinished <= (4 if number else 1) * EPS * form.diagonal()).all():
                break
            before, rate = gain, self.rates(u, affine)
        if not small:
            return None
        self.known = [*self.known[-3:], (strain, u)]
        # 4. Errors and moduli
        unfinished = remaining(gain, unfinished, size, former)
        relaxations, speed = u.reshape(m, -1, d).swapaxes(1, 2), np.sqrt(np.add.reduce(rate * rate, axis=1))
        errors = *form_rounding(state, speed, relaxations, tension), np.sqrt(np.outer(unfinished, unfinished))
        C = elasticity_of_form(state, volume, strains, form - gained, direct, errors)
        return (C, relaxations) if C.trusted else None
