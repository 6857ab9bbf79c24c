"""Springs with fifty digits: dense elimination in decimal numbers, from the floats of a network and nothing else."""

from __future__ import annotations

from decimal import Decimal, getcontext

import numpy as np
from problems import dense_free

getcontext().prec = 50


def decimals(values) -> np.ndarray:
    """Floats as the decimal numbers they are."""
    return np.frompyfunc(lambda v: Decimal(float(v)), 1, 1)(np.asarray(values))


def solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Gaussian elimination with partial pivoting."""
    A = np.concatenate([matrix, right[:, None]], axis=1)
    for column in range(len(A)):
        pivot = column + int(np.argmax(np.abs(A[column:, column])))
        A[[column, pivot]] = A[[pivot, column]]
        A[column] = A[column] / A[column, column]
        for row in range(len(A)):
            if row != column and A[row, column]:
                A[row] = A[row] - A[row, column] * A[column]
    return A[:, -1]


def roots(values: np.ndarray) -> np.ndarray:
    return np.frompyfunc(Decimal.sqrt, 1, 1)(values)


def rows(edge_vectors: np.ndarray, g: np.ndarray) -> np.ndarray:
    """R = g L, (N_b, n_free d)."""
    return np.array([np.outer(a, v).ravel() for a, v in zip(g, edge_vectors, strict=True)])


def free_graph(network) -> tuple[np.ndarray, np.ndarray]:
    """Dense g (N_b, n_free) and b (N_b, d) as decimals."""
    g, b = dense_free(network)
    return decimals(g if network.pins else g[:, 1:]), decimals(b)


def strains(d: int) -> tuple[np.ndarray, np.ndarray]:
    """Dilation 1/d and pure shear."""
    shear = decimals(np.zeros((d, d)))
    shear[0, 1] = shear[1, 0] = Decimal("0.5")
    return decimals(np.eye(d)) / d, shear


def volume(network) -> Decimal:
    (a, b), (c, d) = decimals(network.cell)
    return abs(a * d - b * c)


def equilibrium(state) -> tuple[np.ndarray, np.ndarray]:
    """Exact free coordinates and bond vectors by Newton's method, from a Hookean state close by; ground where it is."""
    network = state.network
    g, b = free_graph(network)
    k, rest = decimals(network.stiffness), decimals(state.rest_lengths)
    ground = decimals(0 * state.coordinates[0] if network.pins else state.coordinates[0])
    x = decimals(state.coordinates[network.free]) - ground
    for _ in range(20):
        L = g @ x + b
        H, sigma, _ = hessian(g, L, k, rest)
        step = solve(H, -rows(L, g).T @ sigma).reshape(x.shape)
        x = x + step
        if max(abs(step.ravel())) < Decimal("1e-36"):
            return x + ground, g @ x + b
    raise AssertionError("no equilibrium near this state")


def hessian(g, L, k, rest):
    """H, σ and K."""
    length = roots((L * L).sum(axis=1))
    sigma = k * (length - rest) / length
    K = (k - sigma) / length**2
    R, d = rows(L, g), L.shape[1]
    P = g.T @ (sigma[:, None] * g)
    return R.T @ (K[:, None] * R) + np.kron(P, decimals(np.eye(d))), sigma, K


def moduli(state) -> list[Decimal]:
    """B, G and the stress-corrected G of the exact equilibrium next to a Hookean state in two dimensions."""
    network = state.network
    g, _ = free_graph(network)
    _, L = equilibrium(state)
    H, sigma, K = hessian(g, L, decimals(network.stiffness), decimals(state.rest_lengths))
    V, square, values = volume(network), (L * L).sum(axis=1), []
    for A, curvature in zip(strains(2), (Decimal("-0.25"), Decimal(0)), strict=True):
        affine = L @ A
        hdot = (L * affine).sum(axis=1)
        xi = rows(L, g).T @ (K * hdot) + (g.T @ (sigma[:, None] * affine)).ravel()
        direct = sigma @ ((affine * affine).sum(axis=1) + curvature * square) + K @ hdot**2
        values.append((direct - xi @ solve(H, xi)) / V)
    return [*values, values[1] - sigma @ square / (4 * V)]


def stiffening(network, stress) -> list[Decimal]:
    """B_0, G_0, C_B, C_G and the stress-corrected C_G of Hookean springs, by the bordered system in two dimensions."""
    g, b = free_graph(network)
    s, k = decimals(stress), decimals(network.stiffness)
    s = s / (s @ s).sqrt()
    P = g.T @ (s[:, None] * g)
    x = np.stack([solve(P, -(g.T @ (s * b[:, axis]))) for axis in range(2)], axis=1)
    L = g @ x + b
    square, R, V = (L * L).sum(axis=1), rows(L, g), volume(network)
    n, N_b = R.shape[1], len(s)
    zero = decimals(np.zeros((N_b + 1, N_b + 1)))
    zero[:-1, -1] = zero[-1, :-1] = s
    column = np.concatenate([R, decimals(np.zeros((1, n)))])
    system = np.block([[np.kron(P, decimals(np.eye(2))), column.T], [column, zero]])
    D = s**2 @ (square / k)
    c, q, rates = [], [], []
    for A in strains(2):
        affine = L @ A
        hdot = (L * affine).sum(axis=1)
        c.append(s @ hdot / D)
        q.append(c[-1] * s * square / k)
        force = -(g.T @ (s[:, None] * affine)).ravel()
        u = solve(system, np.concatenate([force, q[-1] - hdot, decimals([0.0])]))[:n]
        rates.append(affine + g @ u.reshape(-1, 2))
    third, (bulk, shear) = -3 * k / square**2, rates
    E_ggg = third @ q[0] ** 3 + 3 * c[0] * (s @ ((bulk * bulk).sum(axis=1) - square / 4))
    mixed = s @ ((bulk * shear).sum(axis=1) + L[:, 0] * L[:, 1] / 2)
    E_gee = third @ (q[0] * q[1] ** 2) + c[0] * (s @ (shear * shear).sum(axis=1)) + 2 * c[1] * mixed
    E_gg, E_ee = c[0] ** 2 * D, c[1] ** 2 * D
    C_G = (E_gee - E_ee) / V
    return [E_gg / V, E_ee / V, (E_gg + E_ggg) / V, C_G, C_G - E_gg / (2 * V)]
