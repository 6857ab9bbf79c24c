"""Elasticity of springs at rest, at the transition and under stress: the one route to moduli and tensors.

Conventions.  Strain γ is volumetric, V → V(1 + γ) with b → (1 + γ)^{1/d} b; strain ε is a pure shear, b → (1 + εA) b.
  bulk modulus                    B = V d²E/dV²
  shear modulus (energy)          G = (1/V) d²E/dε²
  shear modulus (stress-corrected)  G − ½ dE/dV
The moduli are relaxed: vertices follow the strain, μ_ab = (E_ab − Ξ_aᵀ H⁻¹ Ξ_b)/V.  Past the transition
B = B_0 + C_B γ and G = G_0 + C_G γ to first order (`ModulusStrainScaling`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import checked
from critflow.certificates.uniqueness import count_self_stresses
from critflow.critical.backbone import backbone, taut_edges, taut_networks
from critflow.critical.manifold import CriticalConfiguration
from critflow.extras.rest.at_rest import ResponseAtRest, response_at_rest
from critflow.extras.tissue.face_springs import FaceSprings
from critflow.extras.tissue.state import TissueState
from critflow.extras.tissue.tissue import CriticalTissue
from critflow.networks.network import Network, validated_coordinates
from critflow.response.at_transition import elasticity_at_transition, tissue_at_transition
from critflow.response.linear_response import linear_response
from critflow.response.tensor import Elasticity, Errors
from critflow.result import InputError, Solution, Stats, Status
from critflow.springs.laws import HOOKEAN, SpringLaw
from critflow.springs.state import SpringState, edge_directions, spring_state

SLACK_FACE = 1e-9  # tension of a face without any, relative to the largest
# Force left on a vertex, relative to the largest tension, below which tensions are in balance: those of rounding are
# not, and tensions of 1e-14 near the transition are.
BALANCED = 0.1
# Change of a tensor by a stress that counts as rounding, relative to the affine tensor and to the largest σ over the
# largest k: 0.6 was found in random networks just past the transition.
NEGLECTED = 5.0


@checked
def elasticity(
    springs: CriticalConfiguration | SpringState | CriticalTissue | Network,
    coordinates: ArrayLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    taut: ArrayLike | None = None,
    law: SpringLaw = HOOKEAN,
    volume: float | None = None,
    tolerance: float = 1e-9,
) -> Solution[Elasticity]:
    """Moduli and elasticity tensor of a critical configuration, a state, a tissue, or a network at coordinates.

    coordinates   (N_v, d) of a network
    rest_lengths  ℓ (N_b,) of a network; None: the springs are at rest
    taut          (N_b,) bool, the edges of a network at rest that resist; the others are slack cables.  None: all
    volume        V of a pinned network, whose pins move with the strain: the tensor is a stiffness per unit of V
    tolerance     of forces and stresses in units of the stiffness; smaller stresses out of balance are rounding of
                  springs at rest

    At the transition V C = S ⊗ S/D with S = Σ σ L ⊗ L and D = Σ σ²|L|²/k (`BulkModulus`, `ShearModulus`).  At rest any
    number of self-stresses contributes (`response_at_rest`); without any the network is floppy: zeros and
    `Status.floppy`.  Slack edges, σ = 0, resist nothing, and disconnected taut parts add up.  Under stress vertices
    follow by linear response (`linear_response`).

    Errors (proof) at the transition, errors (estimate) otherwise: `errors` of the value; unknown for a tissue there.
    Raises `InputError` for a pinned network without a volume and where the forces do not balance.

    >>> import critflow as cf
    >>> moduli = cf.elasticity(cf.optimize(cf.lattice("honeycomb", 2, 2), 'bulk_modulus')).value
    >>> round(moduli.bulk, 6), bool(moduli.errors.bulk < 1e-15)
    (0.288675, True)
    >>> network = cf.lattice("triangular", 3, 3)
    >>> tensor = cf.elasticity(network, network.positions).value
    >>> round(tensor.bulk, 6), round(tensor.shear, 6), round(tensor.poisson(0.0), 6)
    (0.866025, 0.433013, 0.333333)
    """
    V = (springs if isinstance(springs, Network) else springs.network).volume if volume is None else volume
    if not 0 < V < np.inf:
        raise InputError(f"the volume must be positive and finite, not {V}")
    if isinstance(springs, CriticalConfiguration):
        parts = backbone(springs).components
        return _total([_at_transition(part, V, 1 if part is springs else 2) for part in parts])
    if isinstance(springs, CriticalTissue):
        return _of_tissue(springs, V)
    if isinstance(springs, Network):
        if coordinates is None:
            raise InputError("the elasticity of a network depends on its configuration: give coordinates")
        if taut is not None and not taut_edges(springs, taut).all():
            if rest_lengths is not None:
                raise InputError("taut edges are those of springs at rest: for rest lengths choose law=Cable()")
            return _of_taut(springs, coordinates, taut, V)
        if rest_lengths is None:
            rest_lengths = np.linalg.norm(edge_directions(springs, coordinates)[1], axis=1)
        springs = spring_state(springs, rest_lengths, coordinates, law)
    if _stressed(springs, tolerance):
        return linear_response(springs, V)
    return _at_rest(springs, V)


def _at_rest(springs: SpringState, volume: float) -> ResponseAtRest:
    """The response of springs whose stress is rounding; its effect is part of the errors."""
    found = response_at_rest(
        springs.network, springs.coordinates, volume, springs.faces if isinstance(springs, TissueState) else None
    )
    value, stress = found.value, float(np.abs(springs.sigma).max() / np.abs(springs.edge_stiffness).max())
    if not stress:
        return found
    errors = value.errors.tensor + NEGLECTED * stress * np.abs(value.affine).max()
    return replace(found, value=replace(value, errors=Errors.of_tensor(errors, springs.network.dimension)))


def _stressed(state: SpringState, tolerance: float) -> bool:
    """Whether springs in equilibrium are under stress.  Raises `InputError` when the forces do not balance."""
    scale = state.stiffness_scale * state.length_scale
    if state.max_force > tolerance * scale:
        raise InputError(
            f"the springs are not in equilibrium, a force of {state.max_force:.2g} is left: call equilibrium() first"
        )
    balanced = state.max_force < BALANCED * float(np.abs(state.sigma * state.lengths).max())
    return balanced or bool((np.abs(state.sigma) > tolerance * state.edge_stiffness).any())


def _at_transition(critical: CriticalConfiguration, volume: float, roundings: int) -> ResponseAtRest:
    """The response of a configuration without slack edges, at rest where it has several self-stresses."""
    if count_self_stresses(critical) == 1:
        return _of_one_self_stress(elasticity_at_transition(critical, volume, roundings), critical.residual)
    return response_at_rest(critical.network, critical.coordinates, volume)


def _of_tissue(tissue: CriticalTissue, volume: float) -> ResponseAtRest:
    """The response of the perimeters in tension, at rest where these have several self-stresses."""
    critical, tense = tissue.configuration, tissue.face_tensions > SLACK_FACE * tissue.face_tensions.max()
    faces = FaceSprings(tissue.faces.sides[tense], tissue.faces.stiffness[tense])
    if faces.several_self_stresses(critical.network, critical.bond_vectors):
        return response_at_rest(critical.network, critical.coordinates, volume, faces)
    return _of_one_self_stress(tissue_at_transition(tissue, volume), critical.residual)


def _of_one_self_stress(value: Elasticity, residual: float) -> ResponseAtRest:
    return ResponseAtRest(value, Status.ok, Stats("transition", residual=residual), n_self_stresses=1)


def _of_taut(network: Network, coordinates: ArrayLike, taut: ArrayLike, volume: float) -> ResponseAtRest:
    """The response of all connected parts of the taut edges at rest."""
    x, mask = validated_coordinates(network, coordinates), taut_edges(network, taut)
    parts = taut_networks(network, mask)
    found = _total([response_at_rest(part, x[vertices], volume) for part, _, vertices in parts])
    slack = f"{np.count_nonzero(~mask)} of {network.n_edges} edges are slack: the moduli are those of the taut part"
    return replace(found, note=f"{found.note}; {slack}" if found.note else slack)


def _total(parts: Sequence[ResponseAtRest]) -> ResponseAtRest:
    """The response of parts that have no vertex in common: tensors add up, and the first failure decides the status."""
    if len(parts) == 1:
        return parts[0]
    values = [part.value for part in parts]
    tensor, affine, stress = (
        np.sum([getattr(value, name) for value in values], axis=0) for name in ("tensor", "affine", "stress")
    )
    errors, bulk = Errors.total([value.errors for value in values]), sum(value.bulk for value in values)
    failed = [part for part in parts if not (part.ok or part.status is Status.floppy)]
    worst = (failed or [part for part in parts if part.ok] or parts)[0]
    return ResponseAtRest(
        Elasticity(tensor, affine, stress, values[0].volume, errors, bulk),
        worst.status,
        Stats("sum over the taut parts", len(parts)),
        worst.note,
        n_self_stresses=sum(part.n_self_stresses for part in parts),
    )
