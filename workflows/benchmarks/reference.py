"""High-precision reference for small networks: dense linear algebra in mpmath, no code shared with critflow.

Of a `Network` only data are read: edges, free vertices, boundary vectors, stiffness, cell and pins.  Floating-point
input is exact input; an answer has at least `WANTED` correct digits, or `Unknown` is raised (`high_precision.py`).
References of large networks are in double-double arithmetic (`references.py`), which tests compare with
this module on small ones.

Symbols: g incidence (N_b, n_free), b boundary vectors, L = g x + b, σ stress, k stiffness, ℓ rest lengths, R = ∂h/∂x
with h = |L|²/2, P = gᵀ diag(σ) g, A the strain (½1 for dilation, offdiagonal ½ for pure shear), V the volume.
"""

from dataclasses import dataclass

import numpy as np

from .high_precision import DIGITS, MP, WANTED, Unknown, dot, largest, numbers, precise, roots, solve, zeros
from .high_precision import largest_error as largest_error

_NEWTON_STEPS = 60


@dataclass(frozen=True)
class Configuration:
    """Coordinates (N_v, d), bond vectors (N_b, d) and σ (N_b,) as mpmath numbers."""

    coordinates: np.ndarray
    bond_vectors: np.ndarray
    sigma: np.ndarray


# Networks


def incidence(network):
    """g over the free vertices, (N_b, n_free)."""
    g = np.zeros((network.n_edges, network.n_vertices), dtype=int)
    for edge, (tail, head) in enumerate(network.edges):
        g[edge, head] += 1
        g[edge, tail] -= 1
    return numbers(g[:, network.free])


def assembled(network, blocks):
    """Σ_α g_αi g_αj B_α over the free vertices, (n_free m, n_free m), of blocks B (N_b, m, m): P, and H of springs."""
    n, m = len(network.free), blocks.shape[1]
    index = np.full(network.n_vertices, -1)
    index[network.free] = np.arange(n)
    matrix = zeros(n, m, n, m)
    for (tail, head), block in zip(index[network.edges], blocks, strict=True):
        for i, j, sign in ((tail, tail, 1), (head, head, 1), (tail, head, -1), (head, tail, -1)):
            if tail != head and min(i, j) >= 0:
                matrix[i, :, j] += sign * block
    return matrix.reshape(n * m, n * m)


def volume(network):
    """V of a cell in two dimensions."""
    (a, b), (c, d) = numbers(network.cell)
    return abs(a * d - b * c)


def digits_for(sigma):
    """Digits for stresses (N_b,) of this range: those of the largest stress must not hide the smallest one."""
    magnitude = np.abs(np.asarray(sigma, dtype=float))
    return DIGITS + int(np.ceil(np.ptp(np.log10(magnitude[magnitude > 0]))))


def laplacian(network, weights, d=1):
    """gᵀ diag(w) g ⊗ 1_d over the free vertices, (n_free d, n_free d)."""
    return assembled(network, _isotropic(weights, d))


def _isotropic(weights, d):
    """Blocks w 1_d (N_b, d, d)."""
    return weights[:, None, None] * numbers(np.eye(d))


def _rates(network, L):
    """R over the free coordinates, (N_b, n_free d)."""
    return (incidence(network)[:, :, None] * L[:, None, :]).reshape(len(L), -1)


def _strained(L):
    """A L for a dilation and for a pure shear, in two dimensions."""
    return L / 2, L[:, ::-1] / 2


def _placed(network, free, sigma, b):
    x = numbers(network.fixed_positions)
    x[network.free] = free
    return Configuration(x, incidence(network) @ free + b, sigma)


# At the transition


@precise
def configuration(network, sigma):
    """The configuration balanced by σ (N_b,) of any sign: P x = −gᵀ(σ ∘ b) (`FDM1`)."""
    sigma, g, b = numbers(sigma), incidence(network), numbers(network.boundary_vectors)
    return _placed(network, solve(laplacian(network, sigma), -(g.T @ (sigma[:, None] * b))), sigma, b)


@precise
def transition_moduli(network, critical):
    """B_0 and G_0 of a configuration with one self-stress: (Σσḣ)²/(V Σσ²|L|²/k) with ḣ = L·A L."""
    L, sigma, k = critical.bond_vectors, critical.sigma, numbers(network.stiffness)
    cost = volume(network) * (sigma**2 * dot(L, L) / k).sum()
    return np.array([(sigma * dot(L, AL)).sum() ** 2 / cost for AL in _strained(L)], dtype=object)


@precise
def largest_bulk_modulus(network):
    """The largest B_0 over all stresses: Σk|L|²/4V at σ = k."""
    L, k = configuration(network, network.stiffness).bond_vectors, numbers(network.stiffness)
    return (k * dot(L, L)).sum() / (4 * volume(network))


@precise
def stiffening(network, critical):
    """B_0, G_0, C_B, C_G and C_G − B_0/2 of Hookean springs in two dimensions, from one bordered dense system."""
    L, k, V = critical.bond_vectors, numbers(network.stiffness), volume(network)
    sigma = critical.sigma / MP.sqrt((critical.sigma**2).sum())
    square, affine, g, R = dot(L, L), _strained(L), incidence(network), _rates(network, L)
    soft = square / k
    D = (sigma**2 * soft).sum()
    n = R.shape[1]
    matrix = _bordered(laplacian(network, sigma, 2), R, sigma, sigma)
    amplitudes = [(sigma * dot(L, AL)).sum() / D for AL in affine]
    changes = [c * sigma * soft for c in amplitudes]
    right = [
        np.concatenate([-(g.T @ (sigma[:, None] * AL)).ravel(), change - dot(L, AL), zeros(1)])
        for change, AL in zip(changes, affine, strict=True)
    ]
    u = solve(matrix, np.stack(right, axis=1))[:n]
    responses = [AL + g @ u[:, a].reshape(-1, 2) for a, AL in enumerate(affine)]
    # L·b̈ of the boundary for γγ, γε and εε: b̈ maps L to −¼L, ½AL and 0.
    boundary = {(0, 0): -square / 4, (0, 1): dot(L, affine[1]) / 2, (1, 1): 0 * square}

    def third_derivative(a, b, c):
        total = -3 * (k / square**2 * changes[a] * changes[b] * changes[c]).sum()
        for one, (i, j) in ((a, (b, c)), (b, (a, c)), (c, (a, b))):
            curvature = dot(responses[i], responses[j]) + boundary[min(i, j), max(i, j)]
            total += amplitudes[one] * (sigma * curvature).sum()
        return total

    B_0, G_0 = (c**2 * D / V for c in amplitudes)
    C_G = third_derivative(0, 1, 1) / V - G_0
    return np.array([B_0, G_0, B_0 + third_derivative(0, 0, 0) / V, C_G, C_G - B_0 / 2], dtype=object)


def _bordered(P, R, column, row):
    """[[P, Rᵀ, 0], [R, 0, column], [0, row, 0]]."""
    n, n_edges = P.shape[0], R.shape[0]
    matrix = zeros(n + n_edges + 1, n + n_edges + 1)
    matrix[:n, :n], matrix[:n, n:-1], matrix[n:-1, :n] = P, R.T, R
    matrix[n:-1, -1], matrix[-1, n:-1] = column, row
    return matrix


@precise
def critical_from_lengths(network, lengths, sigma, coordinates):
    """The critical configuration with lengths proportional to the given ones (N_b,), by Newton's method.

    Unknowns are x, σ and the ratio t: |L|² = t ℓ², force balance, Σσ = N_b.  With σ > 0 the solution is unique, and
    another one raises `Unknown`.  The start (sigma, coordinates) must be near.
    """
    square, sigma, free = numbers(lengths) ** 2, numbers(sigma), _free(network, coordinates)
    sigma = sigma * len(sigma) / sigma.sum()
    g, b, (n_free, d) = incidence(network), numbers(network.boundary_vectors), free.shape
    L = g @ free + b
    t = dot(L, L).sum() / square.sum()
    for _ in range(_NEWTON_STEPS):
        L, n = g @ free + b, n_free * d
        matrix = _bordered(laplacian(network, sigma, d), _rates(network, L), -square / 2, MP.one)
        force, short = (g.T @ (sigma[:, None] * L)).ravel(), (t * square - dot(L, L)) / 2
        step = solve(matrix, np.concatenate([-force, short, [len(sigma) - sigma.sum()]])[:, None])[:, 0]
        free = free + step[:n].reshape(n_free, d)
        sigma, t = sigma + step[n:-1], t + step[-1]
        if largest(step) < 10.0**-WANTED:
            if min(sigma) <= 0:
                raise Unknown("an edge is slack")
            return _placed(network, free, sigma, b)
    raise Unknown("Newton's method does not converge")


def _free(network, coordinates):
    """Free coordinates relative to the ground vertex of a network without pins."""
    x = numbers(coordinates)
    return x[network.free] - (x[0] if not network.pins else 0)


# Springs


def lengths(L):
    """|L| (N_b,)."""
    return roots(dot(L, L))


def _stress(network, L, rest_lengths):
    """σ = k(|L| − ℓ)/|L| and K = (k − σ)/|L|² of Hookean springs, (N_b,) each."""
    k, length = numbers(network.stiffness), lengths(L)
    sigma = k * (length - rest_lengths) / length
    return sigma, (k - sigma) / length**2


def _hessian(network, L, K, sigma):
    """H = Rᵀ K R + P ⊗ 1 (`GenericHessian`)."""
    blocks = K[:, None, None] * L[:, :, None] * L[:, None, :] + _isotropic(sigma, L.shape[1])
    return assembled(network, blocks)


@precise
def energy(network, rest_lengths, L):
    """Σ ½k(|L| − ℓ)² of springs with bond vectors L (N_b, d)."""
    return (numbers(network.stiffness) * (lengths(L) - numbers(rest_lengths)) ** 2).sum() / 2


@precise
def equilibrium(network, rest_lengths, coordinates, deformation=None):
    """The equilibrium of springs by Newton's method from coordinates (N_v, d).

    deformation  F (d, d) of the boundary, which may have more digits than a cell: b → F b
    """
    rest, free, g = numbers(rest_lengths), _free(network, coordinates), incidence(network)
    b = numbers(network.boundary_vectors)
    b = b if deformation is None else b @ deformation.T
    for _ in range(_NEWTON_STEPS):
        L = g @ free + b
        sigma, K = _stress(network, L, rest)
        force = (g.T @ (sigma[:, None] * L)).reshape(-1, 1)
        step = solve(_hessian(network, L, K, sigma), -force).reshape(free.shape)
        # A longer step could reach another equilibrium than the nearest one.
        free = free + step / max(1.0, 10 * largest(step))
        if largest(step) < 10.0**-WANTED:
            return _placed(network, free, sigma, b)
    raise Unknown("Newton's method does not converge")


@precise
def is_minimum(network, exact, rest_lengths):
    """Whether an equilibrium is a minimum of the energy; Newton's method may also reach saddles."""
    sigma, K = _stress(network, exact.bond_vectors, numbers(rest_lengths))
    hessian = np.array(_hessian(network, exact.bond_vectors, K, sigma), dtype=float)
    return bool(np.linalg.eigvalsh(hessian)[0] > 0)


@precise
def linear_response(network, L, rest_lengths):
    """B, G and G − ½dE/dV of springs in equilibrium, bond vectors L (N_b, 2) and rest lengths (N_b,)."""
    L = numbers(L)
    sigma, K = _stress(network, L, numbers(rest_lengths))
    bulk, shear = _response(network, L, K, sigma)
    return np.array([bulk, shear, shear - (sigma * dot(L, L)).sum() / (4 * volume(network))], dtype=object)


def _response(network, L, K, sigma):
    """(B, G) = (ΣKḣ² + σ(|AL|² + L·b̈) − ΞᵀH⁻¹Ξ)/V in two dimensions."""
    g, H, R = incidence(network), _hessian(network, L, K, sigma), _rates(network, L)
    affine = _strained(L)
    hdot = [dot(L, AL) for AL in affine]
    force = [R.T @ (K * rate) + (g.T @ (sigma[:, None] * AL)).ravel() for rate, AL in zip(hdot, affine, strict=True)]
    relaxed = solve(H, np.stack(force, axis=1))
    boundary = -(sigma * dot(L, L)).sum() / 4, 0
    direct = [(K * rate**2).sum() + (sigma * dot(AL, AL)).sum() for rate, AL in zip(hdot, affine, strict=True)]
    moduli = [(direct[a] + boundary[a] - force[a] @ relaxed[:, a]) / volume(network) for a in range(2)]
    return np.array(moduli, dtype=object)


@precise
def objective(network, name, critical, threshold=None):
    """Value of a named objective; a shear modulus without threshold has no penalty."""
    L, sigma = critical.bond_vectors, critical.sigma
    if name in ("V_L", "V_tau"):
        values = lengths(L) if name == "V_L" else lengths(L) * sigma
        mean = values.sum() / len(values)
        return ((values - mean) ** 2).sum() / len(values) / mean**2
    bulk, shear = transition_moduli(network, critical)
    if name == "B_0":
        return bulk
    if threshold is None:
        return shear
    scaled = sigma * MP.sqrt(len(sigma) / (sigma**2).sum()) / MP.mpf(threshold)
    # In the plane moduli have the unit of stiffness.
    return shear - numbers(network.stiffness).mean() * (scaled**-10).sum() / len(sigma)
