"""Elastic moduli by linear response at any strain, at the transition, and fits of their growth past it.

Conventions.  Strain γ is volumetric, V → V(1 + γ) with b → (1 + γ)^{1/d} b; strain ε is a pure shear, b → (1 + εA) b.
  bulk modulus                    B = V d²E/dV²
  shear modulus (energy)          G = (1/V) d²E/dε²
  shear modulus (stress-corrected)  G − ½ dE/dV
The moduli are relaxed: vertices follow the strain, μ_ab = (E_ab − Ξ_aᵀ H⁻¹ Ξ_b)/V.  Past the transition
B = B_0 + C_B γ and G = G_0 + C_G γ to first order (`ModulusStrainScaling`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import astuple, dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import checked
from critflow.critical.backbone import Mask, taut_configurations, taut_edges, taut_networks
from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.objectives import dilation, pure_shear, transition_modulus
from critflow.mechanics.elasticity import FLOPPY, NO_MODULI, Moduli
from critflow.mechanics.laws import HOOKEAN, SpringLaw
from critflow.mechanics.response import linear_response
from critflow.mechanics.springs import spring_state
from critflow.networks.network import Array, Network, edge_values, validated_coordinates
from critflow.result import InputError, Solution, Stats, Status
from critflow.rigidity.counts import rigidity
from critflow.rigidity.uniqueness import require_only_self_stress


@dataclass(frozen=True, kw_only=True)
class SelfStressModuli(Solution[Moduli]):
    """Moduli of a state at rest.

    n_self_stresses  independent self-stresses that resist the strain
    """

    n_self_stresses: int


@dataclass(frozen=True)
class Fit:
    """A least-squares polynomial in strain: value and slope at the transition with their standard errors."""

    value: float
    slope: float
    value_error: float
    slope_error: float


@checked
def transition_moduli(critical: CriticalConfiguration) -> Moduli:
    """B_0 and G_0 of a critical configuration, in the limit of zero stress (`BulkModulus`, `ShearModulus`).

    Slack edges, σ = 0, resist nothing; disconnected taut parts add up, each with its self-stress.
    Raises `InputError` for configurations with several self-stresses, all of which contribute to the moduli, and where
    rounding hides their number.
    """
    parts = taut_configurations(critical)
    mask = "" if critical.sigma.all() else ", taut=critical.sigma != 0"
    for part in parts:
        require_only_self_stress(part, f"use elastic_moduli(network, coordinates{mask}), which takes all of them")
    d = critical.network.dimension
    bulk, shear = (
        sum(transition_modulus(part.network, A).evaluate(part.sigma, part.bond_vectors)[0] for part in parts)
        for A in (dilation(d), pure_shear(d))
    )
    return Moduli(bulk, shear, shear)


@checked
def fit_stiffening(strains: ArrayLike, moduli: ArrayLike, window: float = np.inf, degree: int = 1) -> Fit:
    """Least-squares polynomial of a modulus over 0 ≤ γ ≤ window; its slope at γ = 0 is C with a standard error.

    A straight line over a window w has a bias of order w, a parabola of order w².  Raises `InputError` where fewer
    points than degree + 2 lie in the window: their standard error would be undefined.
    """
    gamma, values = np.asarray(strains, dtype=float), np.asarray(moduli, dtype=float)
    if gamma.ndim != 1 or gamma.shape != values.shape:
        raise InputError(
            f"strains and moduli must be lists of one length, not of shapes {gamma.shape} and {values.shape}"
        )
    inside = (gamma >= 0) & (gamma <= window * (1 + 1e-12))
    gamma, values = gamma[inside], values[inside]
    if degree < 1:
        raise InputError(f"a fit needs a degree of at least 1 to have a slope, not {degree}")
    count = len(np.unique(gamma))
    if count < degree + 2:
        raise InputError(f"a fit of degree {degree} needs {degree + 2} strains in its window, not {count}: widen it")
    if not np.isfinite(values).all():
        return Fit(np.nan, np.nan, np.nan, np.nan)
    # Scaled strains keep the normal equations well conditioned.
    scale = float(gamma.max())
    design = np.vander(gamma / scale, degree + 1, increasing=True)
    coefficients, *_ = np.linalg.lstsq(design, values, rcond=None)
    residual = values - design @ coefficients
    variance = float(residual @ residual) / (len(gamma) - degree - 1)
    error = np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))
    return Fit(float(coefficients[0]), float(coefficients[1]) / scale, float(error[0]), float(error[1]) / scale)


@checked
def elastic_moduli(
    network: Network,
    coordinates: ArrayLike,
    rest_lengths: ArrayLike | None = None,
    tolerance: float = 1e-9,
    *,
    law: SpringLaw = HOOKEAN,
    taut: ArrayLike | None = None,
) -> Solution[Moduli]:
    """Relaxed B and G of springs at coordinates (N_v, d) in equilibrium, on either side of the transition.

    rest_lengths  ℓ (N_b,); None: the springs are at rest
    taut          (N_b,) bool, the edges that resist; the others are slack cables.  None: all

    Stressed springs respond linearly (`LinearResponse`).  Springs at rest resist through their self-stresses S,
    μ_a = ḣ_aᵀ S (Sᵀ K⁻¹ S)⁻¹ Sᵀ ḣ_a/V (`SelfStressModuli`); without any the network is floppy: moduli exactly 0 and
    `Status.floppy`.  Raises `InputError` when the forces do not balance.
    """
    mask = np.ones(network.n_edges, bool) if taut is None else taut_edges(network, taut)
    if not mask.all():
        return _moduli_of_taut(network, coordinates, rest_lengths, tolerance, law, mask)
    x = validated_coordinates(network, coordinates)
    at_rest = np.linalg.norm(network.bond_vectors(x), axis=1)
    state = spring_state(network, at_rest if rest_lengths is None else rest_lengths, x, law)
    stress = float(np.max(np.abs(state.sigma) / network.stiffness))
    if state.max_force > tolerance * float(np.mean(network.stiffness) * np.mean(state.lengths)):
        raise InputError(
            f"the springs are not in equilibrium, a force of {state.max_force:.2g} is left: call equilibrium() first"
        )
    if stress > tolerance:
        return linear_response(state)
    counts = rigidity(network, x)
    n_stresses = counts.value.n_self_stresses
    if not counts.ok:
        value = FLOPPY if counts.status is Status.floppy else NO_MODULI
        return SelfStressModuli(value, counts.status, counts.stats, counts.note, n_self_stresses=n_stresses)
    L, S, d = state.bond_vectors, counts.value.self_stresses, network.dimension
    rates = (np.einsum("ad,ad->a", L, L @ A) for A in (dilation(d), pure_shear(d)))
    value = self_stress_moduli(S, np.sum(L**2, axis=1) / network.stiffness, rates, network.volume)
    stats = Stats("self-stress", 1, residual=counts.stats.residual)
    return SelfStressModuli(value, Status.ok, stats, n_self_stresses=n_stresses)


def _moduli_of_taut(
    network: Network,
    coordinates: ArrayLike,
    rest_lengths: ArrayLike | None,
    tolerance: float,
    law: SpringLaw,
    mask: Mask,
) -> Solution[Moduli]:
    """The moduli of all connected parts of the taut edges, which add up; the first failure decides the status."""
    x = validated_coordinates(network, coordinates)
    rest = None if rest_lengths is None else edge_values(rest_lengths, network.n_edges, "rest_lengths")
    found = [
        elastic_moduli(part, x[vertices], None if rest is None else rest[edges], tolerance, law=law)
        for part, edges, vertices in taut_networks(network, mask)
    ]
    slack = f"{np.count_nonzero(~mask)} of {network.n_edges} edges are slack: the moduli are those of the taut part"
    worst = next((solution for solution in found if not (solution.ok or solution.status is Status.floppy)), None)
    if len(found) == 1 or worst is not None:
        solution = worst or found[0]
        return replace(solution, note=f"{solution.note}; {slack}" if solution.note else slack)
    value = Moduli(*(float(total) for total in np.sum([astuple(solution.value) for solution in found], axis=0)))
    status = Status.ok if any(solution.ok for solution in found) else Status.floppy
    return Solution(value, status, Stats("sum over the taut parts", len(found)), slack)


def self_stress_moduli(stresses: Array, flexibility: Array, rates: Iterable[Array], volume: float) -> Moduli:
    """Moduli at rest through self-stresses S (N_s, n), K⁻¹ (n,) and the rates (n,) of dilation and of shear."""
    compliance = (stresses * flexibility) @ stresses.T
    works = [stresses @ rate for rate in rates]
    bulk, shear = (float(work @ np.linalg.solve(compliance, work)) / volume for work in works)
    return Moduli(bulk, shear, shear)
