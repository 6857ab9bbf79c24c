"""Zero modes, self-stresses and orders of rigidity: section II of the paper.

Each function takes a `Sample` and returns a number and whether the statement holds in this network.
"""

import numpy as np

import critflow as cf

from .sample import ZERO, floppy_motions, null_space, rank

KEPT = 1e-10  # change of length that counts as none, in units of a mean edge
STEPS = 20  # along a floppy motion
N_LINKAGES = 1000


def codimension_one(sample):
    """Rank of ∂h/∂σ, which is that of the tangents."""
    n = sample.network.n_edges
    dh = sample.manifold.response(sample.critical) @ np.eye(n)
    return n - rank(dh), rank(dh) == n - 1


def counting(sample):
    """N_0 − N_s − d N_v + N_b at random and at critical coordinates, from the two null spaces by themselves."""
    left = []
    for x in (sample.generic(), sample.critical.coordinates):
        R = sample.response(sample.bond_vectors(x))
        n_zero, n_stresses = (int(np.sum(_eigenvalues(M) < ZERO)) for M in (R.T @ R, R @ R.T))
        left.append(n_zero - n_stresses - R.shape[1] + R.shape[0])
    return max(map(abs, left)), not any(left)


def _eigenvalues(symmetric):
    values = np.linalg.eigvalsh(symmetric)
    return values / values[-1]


def generic_no_self_stress(sample):
    """Number of self-stresses at random coordinates."""
    R = sample.response(sample.bond_vectors(sample.generic()))
    return len(R) - rank(R), rank(R) == len(R)


def generic_floppy(sample):
    """Largest change of a length along a motion of at least a tenth of an edge that follows zero modes."""
    x = start = sample.generic()
    lengths = np.linalg.norm(sample.bond_vectors(x), axis=1)
    u = sample.rng("motion").standard_normal(x.size)
    for _ in range(STEPS):
        Z = floppy_motions(sample, sample.bond_vectors(x))
        u = Z @ (Z.T @ u)
        x = _with_lengths(sample, x + 0.2 * (u / np.linalg.norm(u)).reshape(x.shape), lengths)
    off = np.abs(np.linalg.norm(sample.bond_vectors(x), axis=1) - lengths).max()
    moved = np.linalg.norm(x - start, axis=1).max()
    return off, off < KEPT and moved > 0.1 * lengths.mean()


def _with_lengths(sample, x, lengths):
    """Coordinates with these lengths nearest to x, by Newton's method."""
    for _ in range(8):
        L = sample.bond_vectors(x)
        off = 0.5 * (lengths**2 - np.sum(L**2, axis=1))
        x = x + np.linalg.lstsq(sample.response(L), off, rcond=None)[0].reshape(x.shape)
    return x


def second_order_rigid(sample):
    """Least stiffness of P on the zero modes over the mean of P."""
    Z = floppy_motions(sample, sample.critical.bond_vectors)
    P = sample.laplacian(sample.critical.sigma)
    least = np.linalg.eigvalsh(Z.T @ P @ Z)[0] / (np.trace(P) / len(P))
    return least, Z.shape[1] == sample.n_vertices // 2 - 1 and least > 0


def prestress_stability(sample):
    """Number of stresses, one positive and five of both signs, that are rigid to second order, each with its proof.

    Where P is definite on the zero modes no motion extends to second order.  Where it is not, a motion u with
    uᵀPu = 0 does: R ẍ = −Σ|g u|² has a solution, to rounding.
    """
    signs = np.ones((6, sample.network.n_edges))
    signs[1:] -= 2 * (sample.rng("signs").random(signs[1:].shape) < 0.3)
    definite = [_agrees(sample, sample.manifold.configuration(sign * sample.critical.sigma)) for sign in signs]
    return sum(stable for stable, _ in definite), all(agrees for _, agrees in definite)


def _agrees(sample, critical):
    """Whether P is definite on the zero modes, and whether second-order rigidity says the same."""
    Z, L = floppy_motions(sample, critical.bond_vectors), critical.bond_vectors
    values, vectors = np.linalg.eigh(Z.T @ sample.laplacian(critical.sigma) @ Z)
    if values[0] * values[-1] > 0:
        motions = Z @ sample.rng("escape").standard_normal((Z.shape[1], 20))
        return True, min(_obstruction(sample, L, u) for u in motions.T) > 1e-6
    u = Z @ (vectors[:, 0] / np.sqrt(-values[0]) + vectors[:, -1] / np.sqrt(values[-1]))
    return False, _obstruction(sample, L, u) < 1e-8


def _obstruction(sample, L, u):
    """The part of the second-order change of lengths by a motion u that no further motion takes back."""
    change = np.sum((sample.g @ u.reshape(-1, 2)) ** 2, axis=1)
    R = sample.response(L)
    left = null_space(R.T)
    return np.linalg.norm(left.T @ change) / np.linalg.norm(change)


def driven_to_critical(sample):
    """Number of self-stresses of the relaxed network with random rest lengths that are a tenth too short."""
    lengths = 1 + 0.1 * sample.rng("rest lengths").standard_normal(sample.network.n_edges)
    critical = cf.critical_from_lengths(sample.manifold, lengths, throw=False).value
    state = cf.spring_state(sample.network, lengths / lengths.mean() * 0.9 * critical.lengths.mean(), sample.generic())
    R = sample.response(cf.equilibrium(state).value.bond_vectors)
    return len(R) - rank(R), len(R) - rank(R) == 1


def three_bar_floppy(sample):
    """Least over largest singular value of R, least of random configurations of three bars: zero at a self-stress.

    The text names panel A as an example, which is rigid, as its caption says.
    """
    network, rng = cf.three_bar_linkage(), sample.rng("bars")
    g, (first, last), ratios = network.incidence.toarray(), network.positions[[0, 3]], []
    for _ in range(N_LINKAGES):
        L = network.bond_vectors(np.array([first, *(3 * rng.standard_normal((2, 2))), last]))
        unit = L / np.linalg.norm(L, axis=1)[:, None]
        values = np.linalg.svd((g[:, 1:3, None] * unit[:, None, :]).reshape(3, 4), compute_uv=False)
        ratios.append(values[-1] / values[0])
    return min(ratios), min(ratios) > ZERO


def one_self_stress(sample):
    """Number of self-stresses at a critical configuration of a network with three edges at every vertex."""
    R = sample.response(sample.critical.bond_vectors)
    three = bool((np.abs(sample.g).sum(axis=0) == 3).all())
    return len(R) - rank(R), three and len(R) - rank(R) == 1
