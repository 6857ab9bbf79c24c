"""A strain of a critical configuration with weak forces: its work, its elastic response, rates of the weak energy.

Along F(ε) the vertices follow x = F(ε) x_c + ε u, where u lets every edge gain tension in proportion to the self-stress
and is least in the energy of turning edges (`third_order`): R u = (c/D) K⁻¹σ − ḣ with c = Σ σ ḣ, D = Σ σ²|L|²/k.  The
weak energy U and its forces change along that motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from critflow.critical.manifold import CriticalConfiguration
from critflow.networks.deformation import Deformation
from critflow.networks.network import Array
from critflow.response.weak_system import WeakSystem
from critflow.springs.weak_energies import WeakFunction

# Step of differences of fourth order along a strain: their errors are 1e-12 and, of second derivatives, 1e-9.
_STEP = 1e-3
_PLACES = (-2, -1, 1, 2)


@dataclass(frozen=True, eq=False)
class WeakStrain:
    """A strain A = F'(0) of a configuration.

    work       c = Σ σ L·A L
    motion     u (d·n_free,)
    rate       L̇ = A L + g u, (N_b, d)
    weak_rate, weak_curvature  dU/dε and d²U/dε² along the motion
    weak_load  d(∂U/∂x)/dε along the motion, (d·n_free,)
    """

    deformation: Deformation
    work: float
    motion: Array
    rate: Array
    weak_rate: float
    weak_curvature: float
    weak_load: Array

    @property
    def strain(self) -> Array:
        """A = F'(0), (d, d)."""
        return self.deformation.rate(0.0)


def weak_strain(
    critical: CriticalConfiguration, system: WeakSystem, energy: WeakFunction, deformation: Deformation
) -> WeakStrain:
    """The elastic response to a strain and the rates of the weak energy along it."""
    network, sigma, L = critical.network, critical.sigma, critical.bond_vectors
    A, compliance = deformation.rate(0.0), sigma * critical.lengths**2 / network.stiffness
    affine = L @ A.T
    hdot = np.einsum("ad,ad->a", L, affine)
    c, D = float(sigma @ hdot), float(sigma @ compliance)
    pull = -np.asarray(network.divergence @ (sigma[:, None] * affine)).ravel()
    motion, _ = system.factorize(1.0, weak=0.0).solve(pull, c / D * compliance - hdot)
    rate = affine + network.free_incidence @ motion.reshape(-1, network.dimension)

    def along(strain: float) -> tuple[float, Array]:
        value, gradient, _ = energy(*moved(critical, deformation, strain, strain * motion))
        return value, gradient[network.free].ravel()

    here = along(0.0)[0]
    values, gradients = zip(*(along(n * _STEP) for n in _PLACES), strict=True)
    slope, curve = np.array([1, -8, 8, -1]) / (12 * _STEP), np.array([-1, 16, 16, -1]) / (12 * _STEP**2)
    return WeakStrain(
        deformation,
        c,
        motion,
        rate,
        float(slope @ values),
        float(curve @ (np.array(values) - here)),
        np.asarray(slope @ np.array(gradients)),
    )


def moved(
    critical: CriticalConfiguration, deformation: Deformation, strain: float, motion: Array
) -> tuple[Array, Array]:
    """Coordinates F x_c + u (N_v, d) after a strain and a motion u (d·n_free,), and F (d, d)."""
    F = deformation.gradient(strain)
    x = critical.coordinates @ F.T
    x[critical.network.free] += motion.reshape(-1, critical.network.dimension)
    return x, F


def turning(first: WeakStrain, second: WeakStrain, critical: CriticalConfiguration, curvature: Array) -> float:
    """Σ σ (L̇_a·L̇_b + L·M L) of two strains, with M = ∂²F/∂a∂b (d, d): geometric stiffness per tension."""
    sigma, L = critical.sigma, critical.bond_vectors
    turned = np.einsum("ad,ad->a", first.rate, second.rate) + np.einsum("ad,ad->a", L, L @ curvature.T)
    return float(sigma @ turned)


Remainder = Callable[[Array], float]


def remainder(critical: CriticalConfiguration, energy: WeakFunction, force: Array, system: WeakSystem) -> Remainder:
    """v (d·n_free,) → U(x + v) − U + f·v − ½ vᵀH v."""
    d = critical.network.dimension
    here, unit = energy(critical.coordinates, np.eye(d))[0], np.eye(d)

    def beyond(v: Array) -> float:
        x = critical.coordinates.copy()
        x[critical.network.free] += v.reshape(-1, d)
        return float(energy(x, unit)[0] - here + force @ v - 0.5 * v @ (system.hessian @ v))

    return beyond
