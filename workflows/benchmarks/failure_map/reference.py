"""What small networks really do: the library's questions answered by dense algebra in decimal numbers.

Every input is taken as the floating-point number that it is, every answer carries dozens of correct digits, and nothing
of the library's own numerics is used.  A linear system is solved once and checked by its residual in twice the digits;
where too few are left it is solved again with more, and `Unknown` is raised where that does not help.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, InvalidOperation, localcontext

import numpy as np

# Digits to begin with, digits that an answer must have, and digits after which it is given up.
DIGITS, WANTED, MOST = 60, 30, 2000


class Unknown(Exception):
    """The reference does not know the answer."""


@dataclass(frozen=True)
class Exact:
    """A configuration in decimal numbers: coordinates (N_v, d), bond vectors (N_b, d) and σ (N_b,)."""

    coordinates: np.ndarray
    bond_vectors: np.ndarray
    sigma: np.ndarray


def decimals(values):
    """Floating-point numbers as the decimal numbers that they are, in an array of objects."""
    values = np.asarray(values)
    if values.dtype == object:
        return values
    return np.array([Decimal(float(v)) for v in values.ravel()], dtype=object).reshape(values.shape)


def floats(values):
    """Decimal numbers rounded to floating-point ones."""
    return np.asarray(values, dtype=float)


def distance(values, truth, moved=False):
    """Largest difference between floating-point numbers and decimal ones, as a float; infinite where one is none.

    moved  whether the first row of the numbers (n, d) is the origin of the others
    """
    if not np.isfinite(np.asarray(values, dtype=float)).all():
        return np.inf
    with localcontext(prec=DIGITS):
        values = decimals(values)
        return largest(values - values[0] - truth if moved else values - truth)


def largest(values):
    """Largest magnitude, as a float."""
    return float(max(abs(v) for v in np.ravel(values)))


roots = np.frompyfunc(lambda v: v.sqrt(), 1, 1)


def solved(matrix, right):
    """The solution (n, m) of a dense system with right sides (n, m), to at least `WANTED` digits of its largest entry.

    Raises `Unknown` for a matrix that is singular as far as can be seen.
    """
    with localcontext() as context:
        digits = context.prec
        rows, pivots = _factorized(matrix)
        x = _substituted(rows, pivots, right)
        context.prec = 2 * digits
        rest = right - matrix @ x
        context.prec = digits
        change = _substituted(rows, pivots, rest)
        if max(abs(change).ravel()) > Decimal(10) ** -WANTED * max(abs(x).ravel()):
            raise Unknown(f"{digits} digits do not solve this system")
        return x + change


def _factorized(matrix):
    """L and U of a matrix in one array, with the order of its rows: partial pivoting."""
    rows, n = matrix.copy(), len(matrix)
    order = np.arange(n)
    for k in range(n):
        pivot = k + int(np.argmax(abs(rows[k:, k])))
        if not rows[pivot, k]:
            raise Unknown("the matrix is singular")
        if pivot != k:
            rows[[k, pivot]], order[[k, pivot]] = rows[[pivot, k]], order[[pivot, k]]
        below = k + 1 + np.flatnonzero(rows[k + 1 :, k])
        right = k + 1 + np.flatnonzero(rows[k, k + 1 :])
        rows[below, k] /= rows[k, k]
        rows[np.ix_(below, right)] -= np.multiply.outer(rows[below, k], rows[k, right])
    return rows, order


def _substituted(rows, order, right):
    x = right[order].copy()
    for k in range(1, len(x)):
        x[k] -= rows[k, :k] @ x[:k]
    for k in range(len(x) - 1, -1, -1):
        x[k] = (x[k] - rows[k, k + 1 :] @ x[k + 1 :]) / rows[k, k]
    return x


def precise(answer):
    """The function run with more and more digits until it knows its answer."""

    def run(*arguments, digits=DIGITS):
        while True:
            try:
                with localcontext(prec=digits):
                    return answer(*arguments)
            except (Unknown, InvalidOperation, ZeroDivisionError, OverflowError) as error:
                digits *= 3
                if digits > MOST:
                    raise Unknown(str(error)) from None

    return run


def laplacian(network, weights):
    """P = gᵀ diag(w) g over the free vertices, dense."""
    g = _incidence(network)
    return g.T @ (weights[:, None] * g)


def _incidence(network):
    g = np.full((network.n_edges, network.n_vertices), Decimal(0), dtype=object)
    for edge, (tail, head) in enumerate(network.edges):
        g[edge, head] += 1
        g[edge, tail] -= 1
    return g[:, network.free]


def digits_for(sigma):
    """Digits in which stresses of such a range (N_b,) do not drown each other."""
    magnitude = np.abs(np.asarray(sigma, dtype=float))
    return DIGITS + int(np.ceil(np.ptp(np.log10(magnitude[magnitude > 0]))))


@precise
def configuration(network, sigma):
    """The configuration in balance under σ (N_b,) of any sign: P x = −gᵀ(σ ∘ b)."""
    sigma = decimals(sigma)
    g, b = _incidence(network), decimals(network.boundary_vectors)
    free = solved(laplacian(network, sigma), -(g.T @ (sigma[:, None] * b)))
    return _placed(network, free, sigma)


def _placed(network, free, sigma):
    x = decimals(network.fixed_positions)
    x[network.free] = free
    return Exact(x, _incidence(network) @ free + decimals(network.boundary_vectors), sigma)


def volume(network):
    """V of a cell in two dimensions."""
    (a, b), (c, d) = decimals(network.cell)
    return abs(a * d - b * c)


def affine(L):
    """A L for a dilation and for a pure shear, in two dimensions."""
    half = Decimal("0.5")
    return L * half, L[:, ::-1] * half


def _dot(a, b):
    return (a * b).sum(axis=1)


@precise
def transition_moduli(network, exact):
    """B_0 and G_0 of a configuration with one self-stress: (Σσḣ)²/(V Σσ²|L|²/k)."""
    L, sigma, k = exact.bond_vectors, exact.sigma, decimals(network.stiffness)
    cost = volume(network) * (sigma**2 * _dot(L, L) / k).sum()
    return np.array([(sigma * _dot(L, AL)).sum() ** 2 / cost for AL in affine(L)], dtype=object)


@precise
def largest_bulk_modulus(network):
    """The largest B_0 over all stresses, Σk|L|²/4V at σ = k."""
    L, k = configuration(network, network.stiffness).bond_vectors, decimals(network.stiffness)
    return (k * _dot(L, L)).sum() / (4 * volume(network))


@precise
def moduli_at_rest(network, coordinates):
    """B and G of springs at rest whose edges span every motion, μ = (ḣᵀKḣ − ΞᵀH⁻¹Ξ)/V: any number of self-stresses."""
    L, k = network.bond_vectors(np.asarray(coordinates, dtype=float)), decimals(network.stiffness)
    return _response(network, decimals(L), k / _dot(decimals(L), decimals(L)), decimals(0 * network.stiffness))[0]


@precise
def linear_response(network, L, rest_lengths):
    """B, G and G less half of dE/dV of springs with bond vectors L (N_b, 2) and rest lengths (N_b,)."""
    L, rest, k = decimals(L), decimals(rest_lengths), decimals(network.stiffness)
    length = roots(_dot(L, L))
    sigma = k * (length - rest) / length
    moduli, pressure = _response(network, L, (k - sigma) / length**2, sigma)
    return np.array([*moduli, moduli[1] - pressure / 2], dtype=object)


def _response(network, L, K, sigma):
    """(B, G) of edges that resist by K and carry σ, and dE/dV."""
    R, g, V = _rates(network, L), _incidence(network), volume(network)
    H = R.T @ (K[:, None] * R)
    P = laplacian(network, sigma)
    for axis in range(2):
        H[axis::2, axis::2] += P
    quarter = Decimal("0.25")
    curved = -(sigma * _dot(L, L)).sum() * quarter, 0
    found = []
    for AL, work in zip(affine(L), curved, strict=True):
        rate = _dot(L, AL)
        force = (g.T @ ((K * rate)[:, None] * L + sigma[:, None] * AL)).reshape(-1, 1)
        stiff = (K * rate**2).sum() + (sigma * _dot(AL, AL)).sum() + work
        found.append((stiff - (force.T @ solved(H, force))[0, 0]) / V)
    return np.array(found, dtype=object), (sigma * _dot(L, L)).sum() / (2 * V)


def _rates(network, L):
    """R^h = ∂h/∂x over the free coordinates, (N_b, 2 n_free)."""
    g = _incidence(network)
    R = np.empty((g.shape[0], 2 * g.shape[1]), dtype=object)
    R[:, ::2], R[:, 1::2] = g * L[:, :1], g * L[:, 1:]
    return R


@precise
def equilibrium(network, rest_lengths, coordinates):
    """Coordinates (N_v, 2) at which springs of these rest lengths balance, by Newton's method from the given ones."""
    rest, k = decimals(rest_lengths), decimals(network.stiffness)
    x = decimals(coordinates)
    free = x[network.free] - (x[0] if not network.pins else 0)
    g, b = _incidence(network), decimals(network.boundary_vectors)
    for _ in range(60):
        L = g @ free + b
        length = roots(_dot(L, L))
        sigma = k * (length - rest) / length
        R, P = _rates(network, L), laplacian(network, sigma)
        H = R.T @ (((k - sigma) / length**2)[:, None] * R)
        for axis in range(2):
            H[axis::2, axis::2] += P
        step = solved(H, -(g.T @ (sigma[:, None] * L)).reshape(-1, 1)).reshape(-1, 2)
        # A long step would leave for another equilibrium than the one that is asked about.
        free = free + step * min(Decimal(1), Decimal("0.1") / max(abs(step).ravel()))
        if max(abs(step).ravel()) < Decimal(10) ** -WANTED:
            return _placed(network, free, sigma)
    raise Unknown("Newton's method does not converge")


@precise
def critical_from_lengths(network, lengths, sigma, coordinates):
    """The critical configuration with lengths in proportion to the given ones, by Newton's method from a near one.

    Unknown are x, σ and the ratio t: |L|² = t ℓ², forces balance, Σσ = N_b.  With σ > 0 it is the only one, so that
    finding it proves it.
    """
    square, sigma = decimals(lengths) ** 2, decimals(sigma)
    sigma = sigma * len(sigma) / sigma.sum()
    x = decimals(coordinates)
    free = x[network.free] - (x[0] if not network.pins else 0)
    g, b, (n_edges, n_free) = _incidence(network), decimals(network.boundary_vectors), network.free_incidence.shape
    t = _dot(g @ free + b, g @ free + b).sum() / square.sum()
    size = 2 * n_free + n_edges + 1
    for _ in range(40):
        L = g @ free + b
        R, P = _rates(network, L), laplacian(network, sigma)
        matrix = np.full((size, size), Decimal(0), dtype=object)
        for axis in range(2):
            matrix[axis : 2 * n_free : 2, axis : 2 * n_free : 2] = P
        matrix[: 2 * n_free, 2 * n_free : -1] = R.T
        matrix[2 * n_free : -1, : 2 * n_free] = R
        matrix[2 * n_free : -1, -1] = -square / 2
        matrix[-1, 2 * n_free : -1] = Decimal(1)
        right = np.concatenate(
            [-(g.T @ (sigma[:, None] * L)).ravel(), (t * square - _dot(L, L)) / 2, [n_edges - sigma.sum()]]
        )
        step = solved(matrix, right[:, None])[:, 0]
        free = free + step[: 2 * n_free].reshape(-1, 2)
        sigma, t = sigma + step[2 * n_free : -1], t + step[-1]
        if max(abs(step)) < Decimal(10) ** -WANTED:
            if min(sigma) <= 0:
                raise Unknown("some edge is slack")
            return _placed(network, free, sigma)
    raise Unknown("Newton's method does not converge")


@precise
def stiffening(network, exact):
    """B_0, G_0, C_B, C_G and C_G less half of B_0 of Hookean springs, from one bordered dense system."""
    L, k, V = exact.bond_vectors, decimals(network.stiffness), volume(network)
    sigma = exact.sigma / (exact.sigma**2).sum().sqrt()
    square = _dot(L, L)
    soft = square / k
    D = (sigma**2 * soft).sum()
    R, g, P = _rates(network, L), _incidence(network), laplacian(network, sigma)
    n, n_edges = R.shape[1], len(L)
    matrix = np.full((n + n_edges + 1,) * 2, Decimal(0), dtype=object)
    for axis in range(2):
        matrix[axis:n:2, axis:n:2] = P
    matrix[:n, n:-1], matrix[n:-1, :n] = R.T, R
    matrix[n:-1, -1] = matrix[-1, n:-1] = sigma
    amplitudes = [(sigma * _dot(L, AL)).sum() / D for AL in affine(L)]
    right = [
        np.concatenate([-(g.T @ (sigma[:, None] * AL)).ravel(), c * sigma * soft - _dot(L, AL), [Decimal(0)]])
        for c, AL in zip(amplitudes, affine(L), strict=True)
    ]
    found = solved(matrix, np.stack(right, axis=1))
    changes = [c * sigma * soft for c in amplitudes]
    responses = [AL + g @ found[:n, a].reshape(-1, 2) for a, AL in enumerate(affine(L))]
    quarter = Decimal("0.25")
    # L·b̈ for γγ, γε and εε: b̈ is −¼L, ½AL and 0.
    bends = {(0, 0): -quarter * square, (0, 1): _dot(L, affine(L)[1]) / 2, (1, 1): 0 * square}

    def third(a, b, c):
        total = -3 * (k / square**2 * changes[a] * changes[b] * changes[c]).sum()
        for one, pair in ((a, (b, c)), (b, (a, c)), (c, (a, b))):
            bend = bends[min(pair), max(pair)]
            total += amplitudes[one] * (sigma * (_dot(responses[pair[0]], responses[pair[1]]) + bend)).sum()
        return total

    E_gg, E_ee = amplitudes[0] ** 2 * D, amplitudes[1] ** 2 * D
    C_G = (third(0, 1, 1) - E_ee) / V
    return np.array([E_gg / V, E_ee / V, (E_gg + third(0, 0, 0)) / V, C_G, C_G - E_gg / V / 2], dtype=object)


@precise
def objective(network, name, exact, threshold=None):
    """Value of an objective at a configuration; a shear modulus without threshold has no penalty."""
    L, sigma = exact.bond_vectors, exact.sigma
    if name in ("length_variance", "tension_variance"):
        length = roots(_dot(L, L))
        values = length if name == "length_variance" else length * sigma
        mean = values.sum() / len(values)
        return ((values - mean) ** 2).sum() / len(values) / mean**2
    bulk, shear = transition_moduli(network, exact)
    if name == "bulk_modulus":
        return bulk
    if threshold is None:
        return shear
    scaled = sigma * (len(sigma) / (sigma**2).sum()).sqrt() / Decimal(threshold)
    return shear - (scaled**-10).sum() / len(sigma)
