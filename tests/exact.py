"""Exact answers for the same input: in rational numbers, or in 60 digits where equations are nonlinear."""

from __future__ import annotations

from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np

from critflow import Network


def fractions(values) -> np.ndarray:
    """An array of doubles as the rational numbers that they are."""
    array = np.asarray(values, dtype=float)
    return np.array([Fraction(float(v)) for v in array.ravel()], dtype=object).reshape(array.shape)


def eliminated(A: np.ndarray, right: np.ndarray) -> np.ndarray:
    """A⁻¹ right of rational matrices by elimination; `ZeroDivisionError` where A is singular."""
    n, rows = len(A), np.hstack([A, right])
    for k in range(n):
        pivot = next((i for i in range(k, n) if rows[i, k]), k)
        rows[[k, pivot]] = rows[[pivot, k]]
        rows[k, k:] = rows[k, k:] / rows[k, k]
        for i in range(n):
            if i != k and rows[i, k]:
                rows[i, k:] = rows[i, k:] - rows[i, k] * rows[k, k:]
    return rows[:, n:]


def configuration(network: Network, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Free coordinates and bond vectors in balance under σ."""
    g = np.vectorize(Fraction, otypes=[object])(network.free_incidence.toarray().astype(int))
    stress, b = fractions(sigma)[:, None], fractions(network.boundary_vectors)
    x = eliminated(g.T @ (stress * g), -(g.T @ (stress * b)))
    return x, g @ x + b


def distance(found: np.ndarray, exact: np.ndarray) -> Fraction:
    """The largest error of a component."""
    return max(np.abs(fractions(found) - exact).ravel())


def moduli(network: Network, sigma: np.ndarray, L: np.ndarray) -> tuple[Fraction, Fraction]:
    """B_0 and G_0 in two dimensions, (Σσḣ)²/(V Σσ²|L|²/k) with ḣ = |L|²/2 and L_x L_y."""
    stress, stiffness, cell = fractions(sigma), fractions(network.stiffness), fractions(network.cell)
    square = (L**2).sum(axis=1)
    cost = (stress**2 * square / stiffness).sum() * abs(cell[0, 0] * cell[1, 1] - cell[0, 1] * cell[1, 0])
    return (stress * square / 2).sum() ** 2 / cost, (stress * L[:, 0] * L[:, 1]).sum() ** 2 / cost


def from_lengths(network: Network, lengths: np.ndarray, x: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Free coordinates in balance with |L| ∝ ℓ, by Newton's method on (x, σ, λ) from a configuration near it."""
    decimal = np.vectorize(lambda v: Decimal(float(v)), otypes=[object])
    with localcontext() as context:
        context.prec = 60
        g, b, d = decimal(network.free_incidence.toarray()), decimal(network.boundary_vectors), network.dimension
        x, sigma, target = decimal(x[network.free]), decimal(sigma), decimal(lengths) ** 2 / 2
        n, m, scale = x.size, network.n_edges, (sigma**2).sum()
        ratio = sigma @ ((g @ x + b) ** 2).sum(axis=1) / (2 * (sigma @ target))
        for _ in range(4):
            L = g @ x + b
            R = (L[:, None, :] * g[:, :, None]).reshape(m, n)
            A = np.zeros((n + m + 1, n + m + 1), dtype=object) + Decimal(0)
            A[:n, :n] = np.kron(g.T @ (sigma[:, None] * g), decimal(np.eye(d)))
            A[:n, n : n + m], A[n : n + m, :n], A[n : n + m, -1], A[-1, n : n + m] = R.T, R, -target, 2 * sigma
            left = [(g.T @ (sigma[:, None] * L)).ravel(), (L**2).sum(axis=1) / 2 - ratio * target]
            step = -eliminated(A, np.concatenate([*left, [(sigma**2).sum() - scale]])[:, None])[:, 0]
            x, sigma, ratio = x + step[:n].reshape(x.shape), sigma + step[n : n + m], ratio + step[-1]
        assert max(abs(step)) < Decimal(10) ** -40
    return np.vectorize(Fraction, otypes=[object])(x)
