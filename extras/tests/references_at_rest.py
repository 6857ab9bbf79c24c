"""Moduli of springs at rest in many digits."""

import numpy as np

from workflows.benchmarks import reference
from workflows.benchmarks.high_precision import DIGITS, MP, dot, numbers, precise, solve


@precise
def moduli_at_rest(network, coordinates):
    """B and G of unstressed springs whose edges constrain every motion; any number of self-stresses."""
    L = numbers(network.bond_vectors(np.asarray(coordinates, dtype=float)))
    return reference._response(network, L, numbers(network.stiffness) / dot(L, L), numbers(0 * network.stiffness))


def digits_for_contrast(stiffness):
    """Digits for stiffnesses (N_b,) of this range: those of the stiffest spring must not hide the softest one."""
    k = np.log10(np.asarray(stiffness, dtype=float))
    return DIGITS + 4 * int(np.ceil(np.ptp(k)))


@precise
def elasticity_at_rest(network, coordinates):
    """V C_ab of unstressed springs in the basis xx, yy, xy of the plane, (3, 3); floppy motions contribute nothing.

    A shift of the Hessian, far below the softest spring, resists floppy motions, on which no force acts.
    """
    L = numbers(network.bond_vectors(np.asarray(coordinates, dtype=float)))
    K, R = numbers(network.stiffness) / dot(L, L), reference._rates(network, L)
    hdot = np.stack([L[:, 0] ** 2, L[:, 1] ** 2, L[:, 0] * L[:, 1]], axis=1)
    H = reference._hessian(network, L, K, 0 * K)
    H[np.diag_indices(len(H))] += MP.mpf(10) ** (-MP.dps // 2)
    load = R.T @ (K[:, None] * hdot)
    return hdot.T @ (K[:, None] * hdot) - load.T @ solve(H, load)
