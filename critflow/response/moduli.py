"""Elastic moduli by linear response at any strain, at the transition.

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
from critflow.critical.transition import dilation, pure_shear, transition_modulus
from critflow.networks.checks import edge_values
from critflow.networks.network import Array, Network, validated_coordinates
from critflow.response.at_rest import joined_responses, response_at_rest, transition_elasticity
from critflow.response.elasticity import Elasticity, Moduli
from critflow.response.response import linear_response
from critflow.result import InputError, Solution, Stats, Status
from critflow.rigidity.counts import rigidity
from critflow.rigidity.uniqueness import only_self_stress, require_only_self_stress
from critflow.springs.laws import HOOKEAN, SpringLaw
from critflow.springs.state import ElasticState, SpringState, edge_directions, spring_state


@dataclass(frozen=True, kw_only=True)
class SelfStressModuli(Solution[Moduli]):
    """Moduli of a state at rest.

    n_self_stresses  independent self-stresses that resist the strain
    """

    n_self_stresses: int


@checked
def transition_moduli(critical: CriticalConfiguration) -> Moduli:
    """B_0 and G_0 of a critical configuration, in the limit of zero stress (`BulkModulus`, `ShearModulus`).

    Slack edges, σ = 0, resist nothing; disconnected taut parts add up, each with its self-stress.
    Raises `InputError` for configurations with several self-stresses, all of which contribute to the moduli, and where
    rounding hides their number.

    >>> import critflow as cf
    >>> moduli = cf.transition_moduli(cf.optimize(cf.honeycomb_network(2, 2), 'bulk_modulus'))
    >>> round(moduli.bulk, 6)
    0.288675
    """
    parts = taut_configurations(critical)
    mask = "" if critical.sigma.all() else ", taut=critical.sigma != 0"
    for part in parts:
        require_only_self_stress(part, f"use elastic_moduli(network, coordinates{mask}), which takes all of them")
    d = critical.network.dimension
    bulk, shear = (
        sum(transition_modulus(part.network, A).evaluate(part)[0] for part in parts)
        for A in (dilation(d), pure_shear(d))
    )
    return Moduli(bulk, shear, shear)


@checked
def elastic_moduli(
    network: Network,
    coordinates: ArrayLike,
    rest_lengths: ArrayLike | None = None,
    tolerance: float = 1e-9,
    *,
    law: SpringLaw = HOOKEAN,
    taut: ArrayLike | None = None,
    volume: float | None = None,
) -> Solution[Moduli]:
    """Relaxed B and G of springs at coordinates (N_v, d) in equilibrium, on either side of the transition.

    rest_lengths  ℓ (N_b,); None: the springs are at rest
    taut          (N_b,) bool, the edges that resist; the others are slack cables.  None: all
    tolerance     of forces and stresses in units of the stiffness; smaller ones are rounding of springs at rest
    volume        V of a pinned network

    Stressed springs respond linearly (`LinearResponse`).  Springs at rest resist through their self-stresses, for any
    stiffnesses (`SelfStressModuli`, `response_at_rest`); without any the network is floppy: moduli exactly 0 and
    `Status.floppy`.  Raises `InputError` when the forces do not balance.

    >>> import critflow as cf
    >>> network = cf.triangular_network(3, 3)
    >>> moduli = cf.elastic_moduli(network, network.positions).value
    >>> round(moduli.bulk, 6), round(moduli.shear, 6)
    (0.866025, 0.433013)
    """
    mask = np.ones(network.n_edges, bool) if taut is None else taut_edges(network, taut)
    if not mask.all():
        return _moduli_of_taut(network, coordinates, rest_lengths, tolerance, law, mask, volume)
    state = spring_state(network, _rest_lengths(network, coordinates, rest_lengths), coordinates, law)
    V = _volume(network, volume)
    if _stressed(state, tolerance):
        return linear_response(state, volume=V)
    found = response_at_rest(network, state.coordinates, V)
    return SelfStressModuli(
        found.value.moduli,
        found.status,
        replace(found.stats, error_bound=_moduli_bounds(found.value)),
        found.note,
        n_self_stresses=found.n_self_stresses,
    )


@checked
def elasticity(
    springs: CriticalConfiguration | ElasticState | Network,
    coordinates: ArrayLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    law: SpringLaw = HOOKEAN,
    volume: float | None = None,
    tolerance: float = 1e-9,
) -> Solution[Elasticity]:
    """The elasticity tensor of a critical configuration, of a state, or of a network at coordinates (N_v, d).

    rest_lengths  ℓ (N_b,) of a network; None: the springs are at rest
    volume        V of a pinned network, whose pins move with the strain: the tensor is a stiffness per unit of V
    tolerance     of forces and stresses, as for `elastic_moduli`

    At the transition V C = S ⊗ S/D with S = Σ σ L ⊗ L and D = Σ σ²|L|²/k; `factors` is S/√D.  At rest any number of
    self-stresses contributes (`response_at_rest`); slack edges, σ = 0, resist nothing.  Under stress vertices follow by
    linear response.
    Error bound (proof) at the transition, error bound (estimate) otherwise: `bounds` of the tensor.
    Raises `InputError` for a pinned network without a volume and where the forces do not balance.

    >>> import critflow as cf
    >>> network = cf.triangular_network(3, 3)
    >>> tensor = cf.elasticity(network, network.positions).value
    >>> round(tensor.poissons_ratio([1, 0], [0, 1]), 6)
    0.333333
    """
    if isinstance(springs, CriticalConfiguration):
        V, parts = _volume(springs.network, volume), taut_configurations(springs)
        found = [
            transition_elasticity(part, V, roundings=1 if part is springs else 2)
            if _one_self_stress(part)
            else response_at_rest(part.network, part.coordinates, V)
            for part in parts
        ]
        return found[0] if len(found) == 1 else joined_responses(found)
    if isinstance(springs, Network):
        if coordinates is None:
            raise InputError("the elasticity of a network depends on its configuration: give coordinates")
        rest = _rest_lengths(springs, coordinates, rest_lengths)
        springs = spring_state(springs, rest, coordinates, law)
    V = _volume(springs.network, volume)
    if not _stressed(springs, tolerance):
        if not isinstance(springs, SpringState):
            raise InputError("cells at rest have moduli by perimeter_moduli(): strain them for a tensor")
        return response_at_rest(springs.network, springs.coordinates, V)
    response = linear_response(springs, volume=V)
    return Solution(response.elasticity, response.status, response.stats, response.note)


def _one_self_stress(critical: CriticalConfiguration) -> bool:
    if only_self_stress(critical):
        return True
    network = critical.network
    if network.n_edges - network.dimension * len(network.free) > 1:
        return False
    counts = rigidity(network, critical.coordinates, vectors=False)
    return counts.ok and counts.value.n_self_stresses == 1


def _rest_lengths(network: Network, coordinates: ArrayLike, rest_lengths: ArrayLike | None) -> ArrayLike:
    """The rest lengths, or the lengths at the coordinates where they are None."""
    return np.linalg.norm(edge_directions(network, coordinates)[1], axis=1) if rest_lengths is None else rest_lengths


def _volume(network: Network, volume: float | None) -> float:
    if volume is None:
        if not network.has_volume:
            raise InputError(
                "a pinned network has no volume: name the one that its stiffness refers to, such as volume=1.0"
            )
        return network.volume
    if not 0 < volume < np.inf:
        raise InputError(f"the volume must be positive and finite, not {volume}")
    return float(volume)


def _stressed(state: ElasticState, tolerance: float) -> bool:
    """Whether springs in equilibrium are under stress.  Raises `InputError` when the forces do not balance."""
    scale = state.stiffness_scale * state.length_scale
    if state.max_force > tolerance * scale:
        raise InputError(
            f"the springs are not in equilibrium, a force of {state.max_force:.2g} is left: call equilibrium() first"
        )
    return bool((np.abs(state.sigma) > tolerance * state.edge_stiffness).any())


def _moduli_bounds(tensors: Elasticity) -> Moduli:
    d = tensors.dimension
    shear = float(tensors.bounds[-1, -1])
    return Moduli(float(tensors.bounds[:d, :d].sum()) / d**2, shear, shear)


def _moduli_of_taut(
    network: Network,
    coordinates: ArrayLike,
    rest_lengths: ArrayLike | None,
    tolerance: float,
    law: SpringLaw,
    mask: Mask,
    volume: float | None,
) -> Solution[Moduli]:
    """The moduli of all connected parts of the taut edges, which add up; the first failure decides the status."""
    x = validated_coordinates(network, coordinates)
    rest = None if rest_lengths is None else edge_values(rest_lengths, network.n_edges, "rest_lengths")
    found = [
        elastic_moduli(part, x[vertices], None if rest is None else rest[edges], tolerance, law=law, volume=volume)
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
