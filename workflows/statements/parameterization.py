"""The map from stresses to configurations and the geometry of the manifold: section III of the paper.

Each function takes a `Sample` and returns a number and whether the statement holds in this network.
"""

import numpy as np

import critflow as cf
from critflow.self_stress import Spectrum

from .sample import ZERO, differences, floppy_motions, rank

EXACT = 1e-12
STEP = 1e-6  # of differences
N_LINKAGES = 10


def tensions_do_not_fix(sample):
    """Spread of the tensions of three bars, at random lengths and at random stresses, over their mean.

    Bars of all lengths carry equal tensions, so these do not fix the lengths; bars of any stress carry no others.
    """
    rng, network = sample.rng("bars"), cf.three_bar_linkage()
    manifold, span = cf.CriticalManifold(network), 3.0
    worst = 0.0
    for _ in range(N_LINKAGES):
        lengths = rng.random(3) + 0.1
        lengths *= span / lengths.sum()
        off = np.abs(manifold.configuration(1 / lengths).lengths - lengths).max()
        tensions = manifold.configuration(rng.random(3) + 0.1).tensions
        worst = max(worst, off, np.ptp(tensions) / tensions.mean())
    return worst, worst < EXACT


def prestress_matrix(sample):
    """Second smallest eigenvalue of P over the mean stress: P is a function of σ and g by its definition."""
    sigma = sample.critical.sigma
    values = np.linalg.eigvalsh(sample.g.T @ (sigma[:, None] * sample.g)) / sigma.mean()
    return values[1], abs(values[0]) < EXACT and values[1] > ZERO


def unique_configuration(sample):
    """Largest force over the mean tension, and largest change of a length from σ to 3σ."""
    one = sample.critical
    force = np.abs(sample.g.T @ (one.sigma[:, None] * one.bond_vectors)).max() / one.tensions.mean()
    change = np.abs(sample.manifold.configuration(3 * one.sigma).lengths - one.lengths).max()
    return max(force, change), max(force, change) < EXACT


def overconstrained(sample):
    """Largest change of a length between the configurations of two self-stresses of a triangulation."""
    network = cf.delaunay_network(sample.n_vertices, sample.seed)
    spectrum = Spectrum(network, network.positions)
    tensions, _ = spectrum.null_space(spectrum.n_self_stresses, of_stresses=True)
    stresses = np.linalg.qr((tensions / spectrum.lengths).T)[0].T
    mixed = sample.rng("mixed").standard_normal((2, len(stresses))) @ stresses
    manifold, L = cf.CriticalManifold(network), network.bond_vectors(network.positions)
    lengths = np.linalg.norm(L, axis=1)
    off = max(np.abs(manifold.configuration(sigma).lengths - lengths).max() for sigma in mixed)
    return off, len(stresses) > 1 and off < 1e-10 * lengths.mean() * sample.n_vertices


def stiffness_rule(sample):
    """Largest force with ℓ = L(1 − cσ/k), over the mean tension, for random stiffnesses; none at c = 0."""
    one = sample.critical
    k = 0.5 + sample.rng("stiffness").random(len(one.sigma))
    worst = 0.0
    for c in (0.1 / np.max(one.sigma / k), 0.0):
        rest = one.lengths * (1 - c * one.sigma / k)
        tension = k * (one.lengths - rest)
        force = np.abs(sample.g.T @ ((tension / one.lengths)[:, None] * one.bond_vectors))
        worst = max(worst, force.max() / (k * one.lengths).mean())
    return worst, worst < EXACT and np.all(tension == 0)


def hessian_split(sample):
    """Largest difference of RᵀKR + P from differences of forces, over the largest entry, under stress."""
    x = sample.generic()
    L = sample.bond_vectors(x)
    rest = 0.9 * np.linalg.norm(L, axis=1)
    sigma = 1 - rest / np.linalg.norm(L, axis=1)
    R = sample.response(L)
    H = R.T @ (((1 - sigma) / np.sum(L**2, axis=1))[:, None] * R) + sample.laplacian(sigma)
    by_differences = differences(lambda at: _gradient(sample, at, rest), x, np.full(x.size, STEP))
    off = np.abs(by_differences - H).max() / np.abs(H).max()
    return off, off < 1e-6


def _gradient(sample, x, rest):
    """∂E/∂x of Hookean springs of unit stiffness, (2 N_v,)."""
    L = sample.bond_vectors(x)
    sigma = 1 - rest / np.linalg.norm(L, axis=1)
    return (sample.g.T @ (sigma[:, None] * L)).ravel()


def vertex_model_coupling(sample):
    """Number of pairs of edges whose coupling in E = ½Σ(p − p0)² contradicts whether they share a face.

    K = ∂²E/∂h∂h with p = Σ√(2h) over the sides of a face, by differences.
    """
    faces = sample.network.faces
    sides = np.zeros((faces.n_faces, sample.network.n_edges))
    np.add.at(sides, (np.repeat(np.arange(faces.n_faces), faces.sizes), faces.edges), 1.0)
    h = 0.5 * sample.critical.lengths**2
    p0 = 0.9 * sides @ sample.critical.lengths
    K = differences(lambda at: (sides.T @ (sides @ np.sqrt(2 * at) - p0)) / np.sqrt(2 * at), h, 1e-5 * h)
    share = (sides.T @ sides) > 0
    coupled = np.abs(K) * np.sqrt(np.outer(h, h)) > 1e-8
    wrong = (coupled != share) & ~np.eye(len(h), dtype=bool)
    return int(wrong.sum() // 2), not wrong.any()


def same_zero_modes(sample):
    """Largest difference of the two prestress matrices on the zero modes, and of the responses there."""
    one = sample.critical
    R = sample.response(one.bond_vectors)
    unit = R / one.lengths[:, None]
    Z = floppy_motions(sample, one.bond_vectors)
    P = sample.laplacian(one.sigma)
    of_lengths = P - unit.T @ (one.sigma[:, None] * unit)
    off = max(np.abs(Z.T @ (P - of_lengths) @ Z).max() / np.abs(P).max(), np.abs(unit @ Z).max())
    return off, off < 1e-10 and rank(np.vstack([R, unit])) == rank(R)


def boundary_term(sample):
    """Largest difference of the configuration in a deformed cell from the deformed configuration."""
    F = np.array([[1.1, 0.3], [0.0, 0.9]])
    network = sample.network.deformed(F)
    one = cf.CriticalManifold(network).configuration(sample.critical.sigma)
    off = np.abs(one.bond_vectors - sample.critical.bond_vectors @ F.T).max()
    return off, off < EXACT


def stress_is_normal(sample):
    """Largest entry of σᵀ ∂h/∂σ over those of ∂h/∂σ."""
    sigma = sample.critical.sigma
    B = sample.manifold.response(sample.critical) @ np.eye(len(sigma))
    off = np.abs(sigma @ B).max() / (np.abs(B).max() * np.linalg.norm(sigma))
    return off, off < EXACT


def derivative(sample):
    """Largest difference of −R P⁻¹ Rᵀ from differences of h, over the largest entry."""
    sigma = sample.critical.sigma
    R = sample.response(sample.critical.bond_vectors)
    B = -R @ np.linalg.pinv(sample.laplacian(sigma)) @ R.T
    by_differences = differences(lambda at: _half_squares(sample, at), sigma, 100 * STEP * sigma)
    off = np.abs(by_differences - B).max() / np.abs(B).max()
    return off, off < 1e-6 and np.abs(B - B.T).max() < EXACT * np.abs(B).max() * len(B)


def _half_squares(sample, sigma):
    """h(σ), (N_b,), by a pseudo-inverse."""
    P = sample.g.T @ (sigma[:, None] * sample.g)
    b = sample.network.boundary_vectors
    x = -np.linalg.pinv(P) @ (sample.g.T @ (sigma[:, None] * b))
    return 0.5 * np.sum((sample.g @ x + b) ** 2, axis=1)
