"""References for σ → configuration and its gradient: 32 digits by refinement, and 50 by dense elimination.

The gradient is that of the bulk modulus at the transition with unit stiffness, B_0 = W²/(4V C), W = Σσ|L|²,
C = Σσ²|L|²: its partial derivatives are rational, so they can be had in any precision.  With q = W/C

    4V ∂B_0/∂σ = 2q|L|² − 2q²σ|L|²,     4V ∂B_0/∂L = 4qσL − 2q²σ²L.
"""

from __future__ import annotations

import numpy as np

from critflow import CriticalManifold
from critflow.precision.double_double import Extended, ExtendedGeometry, add, divide, extended, multiply, subtract

from ..timing import peer

DIGITS = 50
# Every step of refinement gains about 13 digits.
REFINEMENTS = 5


def refined(manifold: CriticalManifold, sigma) -> tuple[Extended, Extended]:
    """Bond vectors L (N_b, d) and dB_0/dσ (N_b,) for k = 1, right to about 30 digits."""
    network, geometry = manifold.network, ExtendedGeometry(manifold.network)
    free, _, factor = manifold.balance(sigma)
    s, b, none = extended(sigma[:, None]), network.boundary_vectors, np.zeros_like(network.boundary_vectors)
    x, y = extended(free), extended(np.zeros_like(free))
    for _ in range(REFINEMENTS):
        force = geometry.divergence(multiply(s, geometry.bond_vectors(x, b)))
        x = add(x, extended(-factor.solve(force.high)))
    L = geometry.bond_vectors(x, b)

    by_sigma, by_L = _partials(s, L, network.volume)
    load = geometry.divergence(by_L)
    for _ in range(REFINEMENTS):
        rest = subtract(load, geometry.divergence(multiply(s, geometry.bond_vectors(y, none))))
        y = add(y, extended(factor.solve(rest.high)))
    along = multiply(L, geometry.bond_vectors(y, none))
    return L, subtract(by_sigma, over_axes(along))


def _partials(s: Extended, L: Extended, volume: float) -> tuple[Extended, Extended]:
    """∂B_0/∂σ and ∂B_0/∂L, as (q/2V)(1 − qσ)|L|² and (q/2V)(2 − qσ)σL."""
    sigma, square = Extended(s.high[:, 0], s.low[:, 0]), over_axes(multiply(L, L))
    work = multiply(sigma, square)
    ratio = divide(total(work), total(multiply(sigma, work)))
    scale = divide(ratio, extended(np.array([2 * volume])))
    share = multiply(ratio, sigma)
    one, two = (subtract(extended(np.array([number])), share) for number in (1.0, 2.0))
    by_sigma = multiply(multiply(scale, one), square)
    along = multiply(multiply(scale, two), sigma)
    return by_sigma, multiply(Extended(along.high[:, None], along.low[:, None]), L)


def over_axes(vectors: Extended) -> Extended:
    """Sum over the axes of vectors (n, d), (n,)."""
    total = Extended(vectors.high[:, 0], vectors.low[:, 0])
    for axis in range(1, vectors.high.shape[1]):
        total = add(total, Extended(vectors.high[:, axis], vectors.low[:, axis]))
    return total


def total(values: Extended) -> Extended:
    """Sum of all values (n,), as one value (1,), by halves."""
    high, low = values
    while len(high) > 1:
        if len(high) % 2:
            high, low = np.append(high, 0.0), np.append(low, 0.0)
        high, low = add(Extended(high[::2], low[::2]), Extended(high[1::2], low[1::2]))
    return Extended(high, low)


def exact(manifold: CriticalManifold, sigma) -> tuple[Extended, Extended]:
    """As `refined`, by dense elimination with 50 digits: for few vertices, by other arithmetic and other formulas."""
    network, mpmath = manifold.network, peer("mpmath")
    with mpmath.workdps(DIGITS):
        number = np.vectorize(mpmath.mpf, otypes=[object])
        g, b, s = number(network.free_incidence.toarray()), number(network.boundary_vectors), number(sigma)
        P = g.T @ (s[:, None] * g)
        L = b - g @ _solved(P, g.T @ (s[:, None] * b))
        square = (L * L).sum(axis=1)
        q = (s * square).sum() / (s * s * square).sum()
        volume = 4 * mpmath.mpf(network.volume)
        by_sigma, by_L = (2 * q - 2 * q**2 * s) * square / volume, ((4 * q - 2 * q**2 * s) * s)[:, None] * L / volume
        slope = by_sigma - (L * (g @ _solved(P, g.T @ by_L))).sum(axis=1)
        return _halved(L), _halved(slope)


def _solved(A, right):
    """A⁻¹ right, by Gaussian elimination without pivoting, of a positive definite A."""
    A, x = A.copy(), right.copy()
    for k in range(len(A)):
        part = A[k + 1 :, k] / A[k, k]
        A[k + 1 :, k:] -= part[:, None] * A[k, k:]
        x[k + 1 :] -= part[:, None] * x[k]
    for k in reversed(range(len(A))):
        x[k] = (x[k] - A[k, k + 1 :] @ x[k + 1 :]) / A[k, k]
    return x


def _halved(values) -> Extended:
    high = values.astype(float)
    return Extended(high, (values - high).astype(float))
