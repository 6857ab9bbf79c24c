"""Moduli at the transition and past it: section IV A 1 and the discussion of the paper.

Each function takes a `Sample` and returns a number and whether the statement holds in this network.
"""

import numpy as np

import critflow as cf

from .bending import BentNetwork
from .sample import null_space, rank

DEFORMATIONS = (0.5 * np.eye(2), np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0, 0.0], [0.0, -1.0]]))
BENDING, STRAIN, STEP = 1e-5, 0.01, 1e-4
SPREAD = 0.1  # of stiffnesses about one
SOFT_STRAINS = 1e-4, 1e-5  # at which the soft band is compared with that of P
TAUT, DIPOLE = 1e-2, 1e-4  # volumetric strain at which a dipole acts, and its force over k times a mean edge
LAWS = (cf.Hookean(), cf.PowerLaw(4.0), cf.WormLike(1.0))


def moduli(sample, L, k=1.0):
    """Moduli of springs at rest by a dense matrix, V μ = ḣᵀKḣ − ΞᵀH⁺Ξ, for each of `DEFORMATIONS`."""
    volume = abs(np.linalg.det(sample.network.cell))
    R = sample.response(L) * np.sqrt(k / np.sum(L**2, axis=1))[:, None]
    rates = np.array([np.einsum("am,mn,an->a", L, A, L) for A in DEFORMATIONS]) * np.sqrt(k / np.sum(L**2, axis=1))
    resisted = [rate - R @ np.linalg.lstsq(R, rate, rcond=1e-10)[0] for rate in rates]
    return np.array([rate @ rate for rate in resisted]) / volume


def moduli_jump(sample):
    """Bulk modulus of springs at rest: least at max B_0, where largest at random coordinates is below 1e-10 k."""
    floppy = moduli(sample, sample.bond_vectors(sample.generic()))
    stiff = moduli(sample, sample.stiffest.bond_vectors)
    return stiff[0], floppy.max() < 1e-10 and stiff[0] > 0.1


def modulus_formula(sample):
    """Largest difference of the closed form from linear response, over three deformations, in units of k."""
    one = sample.critical
    volume = abs(np.linalg.det(sample.network.cell))
    work = [np.einsum("a,am,mn,an->", one.sigma, one.bond_vectors, A, one.bond_vectors) for A in DEFORMATIONS]
    formula = np.array(work) ** 2 / (volume * np.sum(one.tensions**2))
    off = np.abs(formula - moduli(sample, one.bond_vectors)).max()
    return off, off < 1e-8


def energy_of_distance(sample):
    """Largest relative difference of E(c)/c² from Σσ²h/k at c = 0.1, 0.01 and 0.001 of the largest c."""
    one, k = sample.critical, 0.5 + sample.rng("stiffness").random(sample.network.n_edges)
    cost = np.sum(one.sigma**2 * one.lengths**2 / (2 * k))
    ratios = []
    for part in (0.1, 0.01, 0.001):
        c = part / np.max(one.sigma / k)
        rest = one.lengths * (1 - c * one.sigma / k)
        ratios.append(0.5 * np.sum(k * (one.lengths - rest) ** 2) / c**2 / cost)
    off = np.abs(np.array(ratios) - 1).max()
    return off, off < 1e-10


def equal_lengths_any_spring(sample):
    """Least tension at a stretch of 1e-4 of springs of equal lengths, over the largest, for three spring laws."""
    one = sample.equal_lengths
    rest = np.full(sample.network.n_edges, one.lengths.mean())
    stretched = sample.network.deformed((1 + 1e-4) * np.eye(2))
    least = np.inf
    for law in LAWS:
        state = cf.spring_state(sample.network, rest, one.coordinates, law)
        if not (state.energy < 1e-20 and np.abs(state.tension).max() < 1e-10):
            return 0.0, False
        taut = cf.equilibrium(cf.spring_state(stretched, rest, (1 + 1e-4) * one.coordinates, law)).value.tension
        least = min(least, taut.min() / taut.max())
    R = sample.response(one.bond_vectors)
    return least, least > 0 and len(R) - rank(R) == 1


def stiffened(sample):
    """Modulus along dilation at a strain of +0.01 over that at −0.01, equal lengths with bending of 1e-5 k, relaxed."""
    strains = np.array([STRAIN + STEP, STRAIN - STEP, -STRAIN + STEP, -STRAIN - STEP])
    above, _, below = np.diff(BentNetwork(sample, sample.equal_lengths, BENDING).pressures(strains)) / np.diff(strains)
    return above / below, above > 100 * below > 0


def robust(sample):
    """Relative change of the bulk modulus at the transition by stiffnesses that differ by 10 %."""
    one = sample.equal_lengths
    k = 1 + SPREAD * sample.rng("stiffness").standard_normal(sample.network.n_edges)
    moduli_of_k = [moduli(sample, one.bond_vectors, values)[0] for values in (np.ones_like(k), k)]
    change = abs(moduli_of_k[1] / moduli_of_k[0] - 1)
    return change, change < 0.1


def two_groups(sample):
    """The softest longitudinal eigenvalue over the stiffest transverse one at a volumetric strain of 1e-5."""
    values = _vibrations(sample, cf.strain_path(sample.stiffest, [1e-5]).value.states[-1])
    n_soft = sample.n_vertices // 2 - 1
    gap = values[n_soft] / values[n_soft - 1]
    return gap, gap > 10


def soft_modes(sample):
    """Deviation of the soft eigenvalues from τ eig P at a volumetric strain of 1e-4 over that at 1e-5, at max B_0."""
    one, held = sample.stiffest, _held(sample)
    Z = null_space(sample.response(one.bond_vectors)[:, held])
    soft = np.linalg.eigvalsh(Z.T @ sample.laplacian(one.sigma)[np.ix_(held, held)] @ Z)
    deviations = []
    for strain in SOFT_STRAINS:
        state = cf.strain_path(one, [strain]).value.states[-1]
        tau = one.tensions @ (state.lengths - one.lengths) / np.sum(one.tensions**2)
        deviations.append(np.abs(_vibrations(sample, state)[: len(soft)] / (tau * soft) - 1).max())
    ratio = deviations[0] / deviations[1]
    return ratio, abs(ratio / (SOFT_STRAINS[0] / SOFT_STRAINS[1]) - 1) <= 0.1


def _held(sample):
    """The coordinates that remain where one vertex is held, so that no translation is left."""
    return np.add.outer(2 * sample.network.free, [0, 1]).ravel()


def _vibrations(sample, state):
    """Eigenvalues of H, ascending."""
    return np.linalg.eigvalsh(_hessian(sample, state))


def _hessian(sample, state):
    """H = RᵀKR + P ⊗ 1 of springs without the translations."""
    held, R = _held(sample), sample.response(state.bond_vectors)
    H = R.T @ (state.modified_stiffness[:, None] * R) + sample.laplacian(state.sigma)
    return H[np.ix_(held, held)]


def bond_operator(sample):
    """Largest difference of Ξ = R H⁻¹ Rᵀ from the changes of length by a dipole, over the largest change.

    A rest length that grows by δ exerts the forces ±kδ on the ends of its edge, to first order.
    """
    state, held = cf.strain_path(sample.stiffest, [TAUT]).value.states[-1], _held(sample)
    R = sample.response(state.bond_vectors / state.lengths[:, None])[:, held]
    edge = int(sample.rng("dipole").integers(len(R)))
    expected = R @ np.linalg.solve(_hessian(sample, state), R[edge])
    change = DIPOLE * sample.stiffest.lengths.mean() * np.eye(len(R))[edge]
    lengths = [
        cf.equilibrium(cf.spring_state(state.network, state.rest_lengths + delta, state.coordinates)).value.lengths
        for delta in (change, -change)
    ]
    measured = (lengths[0] - lengths[1]) / (2 * change[edge])
    off = np.abs(measured - expected).max() / np.abs(expected).max()
    return off, off < 1e-6
