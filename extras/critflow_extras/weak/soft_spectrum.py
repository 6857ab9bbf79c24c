"""Vibrations of a critical network under a small tension τ: the soft band τ·eig(P on floppy motions), exactly.

The Hessian is R̃ᵀ k R̃ + τP, up to second order.  Its longitudinal band, of order k, consists of motions that stretch
edges; floppy motions Z, R Z = 0, form the transverse band, whose eigenvalues are τ times those of ZᵀPZ.  With motions W
that stretch edges, second-order perturbation lowers the eigenvalue of a soft mode z by
    τ² zᵀP W (Wᵀ R̃ᵀ k R̃ W)⁻¹ WᵀP z,
the coupling between the bands.  The soft states enter free energies by ½ ln det ZᵀPZ, whose change with R is that of
its null space, dZ = −R⁺ dR Z: with A = Z(ZᵀPZ)⁻¹Zᵀ,
    d ln det ZᵀPZ = tr A dP − 2 tr A P R⁺ dR,
and the derivative by σ follows by one solve (`Balance.pull_back`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigsh

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.manifold import CriticalConfiguration
from critflow.networks import Array
from critflow.numerics import LARGEST_DENSE, quasi_random
from critflow.result import InputError, Record
from critflow.self_stress import require_one_stress_by_rank
from critflow.sparse import spread_columns
from critflow_extras.weak.weak_system import WeakSystem


@dataclass(frozen=True, eq=False, repr=False)
class SoftSpectrum(Record):
    """The two bands of a critical configuration, for σ with Σσ² = N_b and unit masses.

    soft      eigenvalues of P on the N_f floppy motions, ascending; frequencies are √(τ·soft)
    stiff     eigenvalues of R̃ᵀ k R̃ on the motions that stretch edges, ascending
    coupling  (N_f,) decrease of each soft eigenvalue τ·soft by the other band, per τ²
    gradient  (N_b,) derivative of `log_determinant` by σ, which moves the configuration
    """

    soft: Array
    stiff: Array
    coupling: Array
    gradient: Array

    @property
    def least_frequency(self) -> float:
        """Least frequency of the soft band, per √τ."""
        return float(np.sqrt(self.soft[0]))

    @property
    def log_determinant(self) -> float:
        """½ ln det P on the floppy motions."""
        return 0.5 * float(np.sum(np.log(self.soft)))


@running("soft_spectrum")
def soft_spectrum(critical: CriticalConfiguration) -> SoftSpectrum:
    """Both bands, their coupling and ½ ln det with its gradient, from dense matrices.

    Raises `InputError` for several self-stresses, without floppy motions, where P is not positive on them, and beyond
    about 2,000 vertices of the plane: `soft_eigenvalues` has no such limit.

    >>> import critflow as cf
    >>> from critflow_extras.weak.soft_spectrum import soft_spectrum
    >>> critical = cf.optimize(cf.voronoi_network(n_vertices=20, seed=1), 'B_0').value
    >>> found = soft_spectrum(critical)
    >>> len(found.soft), len(found.stiff)
    (9, 29)
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    network, sigma, L, d = critical.network, critical.sigma, critical.bond_vectors, critical.network.dimension
    require_floppy_motions(critical, "remove edges until one is left")
    size = d * len(network.free)
    if size * size > LARGEST_DENSE:
        raise InputError(f"the spectrum of {size} coordinates is too large for dense matrices: use soft_eigenvalues")
    lengths, g = critical.lengths, network.free_incidence
    R = spread_columns(network, L / lengths[:, None]).toarray()
    U, values, V = np.linalg.svd(R, full_matrices=True)
    rank = network.n_edges - 1
    Z, W = V[rank:].T, V[:rank].T
    P = sp.csr_array(sp.kron(g.T @ sp.diags_array(sigma) @ g, sp.eye_array(d)))
    soft, modes = np.linalg.eigh(Z.T @ (P @ Z))
    if not soft[0] > 0:
        raise InputError("the stress does not stabilise all floppy motions, so soft modes have no frequency")
    Z = Z @ modes
    stiffness = (U[:, :rank] * values[:rank]).T @ (network.stiffness[:, None] * (U[:, :rank] * values[:rank]))
    coupled = W.T @ (P @ Z)
    coupling = np.einsum("in,in->n", coupled, scipy.linalg.solve(stiffness, coupled, assume_a="pos"))
    gradient = _gradient(critical, P, Z, soft, (W / values[:rank]) @ U[:, :rank].T)
    return SoftSpectrum(soft, np.linalg.eigvalsh(stiffness), coupling, gradient)


def require_floppy_motions(critical: CriticalConfiguration, instead: str) -> None:
    """Raise `InputError` for unknown configurations, slack edges, several self-stresses, or without floppy motions.

    instead  advice where there are several self-stresses
    """
    network = critical.network
    if not (np.isfinite(critical.sigma).all() and np.isfinite(critical.bond_vectors).all()):
        raise InputError("the configuration is unknown, it has NaN: look at the status of the solution it comes from")
    if slack := int(np.count_nonzero(critical.sigma == 0)):
        raise InputError(
            f"{slack} of {network.n_edges} edges are slack, and forces on their vertices are not small there: take the "
            "taut part, backbone(critical).configuration, or relax the whole network with weak_equilibrium()"
        )
    require_one_stress_by_rank(critical, instead)
    if network.dimension * len(network.free) < network.n_edges:
        raise InputError("the network has no floppy motions, so it has no soft band: use strain_path()")


def _gradient(critical: CriticalConfiguration, P: sp.csr_array, Z: Array, soft: Array, inverse: Array) -> Array:
    """d(½ ln det ZᵀPZ)/dσ, (N_b,), with modes Z of eigenvalues `soft` and R̃⁺ (d·n_free, N_b)."""
    network, d = critical.network, critical.network.dimension
    g = network.free_incidence
    # tr A dP: the motions of each edge in all modes
    by_sigma = np.zeros(network.n_edges)
    for axis in range(d):
        by_sigma += np.sum((g @ Z[axis::d]) ** 2 / soft, axis=1)
    # R̃ = L·g/|L|, and changes of |L| only scale its rows, whose null space stays.
    X = ((Z / soft) @ (Z.T @ (P @ inverse))).reshape(-1, d, network.n_edges)
    by_L = np.stack([-2 * np.asarray((g.multiply(X[:, axis].T)).sum(axis=1)) for axis in range(d)], axis=1)
    by_L = by_L / critical.lengths[:, None]
    balance = critical.manifold.balance(critical.sigma)
    return np.asarray(0.5 * balance.pull_back(by_sigma, by_L)[0])


def soft_eigenvalues(system: WeakSystem, n: int) -> Array:
    """The n least eigenvalues of P on the floppy motions, ascending, by Lanczos iteration on bordered systems."""
    network = system.network
    size = network.dimension * len(network.free)
    floppy = size - network.n_edges + 1
    if not 0 < n <= floppy:
        raise InputError(f"there are {floppy} floppy motions: choose a number of eigenvalues from 1 to {floppy}")
    factor = system.factorize(1.0, weak=0.0)
    inverse = LinearOperator((size, size), matvec=lambda f: factor.solve(np.ravel(f))[0])
    if 3 * n > floppy:
        values = np.linalg.eigvalsh(inverse @ np.eye(size))[::-1]
    else:
        values = eigsh(inverse, n, which="LA", v0=inverse @ (quasi_random(size) - 0.5), return_eigenvectors=False)[::-1]
    return np.asarray(1 / np.sort(values)[::-1][:n])
