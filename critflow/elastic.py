"""Elasticity of springs at the transition, under stress and at rest: the one route to moduli and tensors.

Conventions.  Strain γ is volumetric, V → V(1 + γ) with b → (1 + γ)^{1/d} b; strain ε is a pure shear, b → (1 + εA) b.
  bulk modulus                    B = V d²E/dV²
  shear modulus (energy)          G = (1/V) d²E/dε²
  shear modulus (stress-corrected)  G − ½ dE/dV
The moduli are relaxed: vertices follow the strain, μ_ab = (E_ab − Ξ_aᵀ H⁻¹ Ξ_b)/V.  Past the transition
B = B_0 + C_B γ and G = G_0 + C_G γ to first order (`ModulusStrainScaling`).

At the transition the only self-stress resists.  With stresses s of springs, their rates ḣ_a under the strains E_a and
their flexibility f,
    V C_ab = (s·ḣ_a)(s·ḣ_b)/D,   D = Σ s² f   (`GenericModulus`),
of edges s = σ, ḣ = L·E_a L, f = |L|²/k.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial, singledispatch
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import of_kind, of_known_kind
from critflow.calls import running
from critflow.deformation import strain_basis
from critflow.extensions import from_extras
from critflow.linear_response import Elasticity, Errors, LinearResponse, linear_response
from critflow.manifold import CriticalConfiguration
from critflow.networks import Array, Network
from critflow.numerics import EPS, dot
from critflow.quantities import dilation, pure_shear, transition_modulus_error
from critflow.result import InputError, Stats, Status
from critflow.self_stress import count_self_stresses
from critflow.springs import HOOKEAN, SpringLaw, SpringState
from critflow.taut_part import backbone

# Force left on a vertex, relative to the largest tension, below which tensions are in balance: those of rounding are
# not, and tensions of 1e-14 near the transition are.
BALANCED = 0.1
# What the error says that needs an extra.
AT_REST = "moduli of springs at rest"


@running("elasticity")
def elasticity(
    springs: Any,
    coordinates: ArrayLike | None = None,
    rest_lengths: ArrayLike | None = None,
    *,
    taut: ArrayLike | None = None,
    law: SpringLaw = HOOKEAN,
    volume: float | None = None,
    tolerance: float = 1e-9,
) -> LinearResponse:
    """Moduli and elasticity tensor of a critical configuration, a state, a network at coordinates, or a tissue.

    coordinates   (N_v, d) of a network
    rest_lengths  ℓ (N_b,) of a network; None: the springs are at rest
    taut          (N_b,) bool, the edges of a network at rest that resist; the others are slack cables.  None: all
    volume        V of a pinned network, whose pins move with the strain: the tensor is a stiffness per unit of V
    tolerance     of forces and stresses in units of the stiffness; smaller stresses out of balance are rounding of
                  springs at rest

    At the transition V C = S ⊗ S/D with S = Σ σ L ⊗ L and D = Σ σ²|L|²/k (`BulkModulus`, `ShearModulus`).  At rest any
    number of self-stresses contributes; without any the network is floppy: zeros and `Status.floppy`.  Slack edges,
    σ = 0, resist nothing, and disconnected taut parts add up.  Under stress vertices follow by linear response
    (`linear_response`).

    Errors (proof) at the transition, errors (estimate) otherwise: `errors` of the value; unknown for a tissue there.
    Raises `InputError` for a pinned network without a volume and where the forces do not balance.

    >>> import critflow as cf
    >>> moduli = cf.elasticity(cf.optimize(cf.lattice("honeycomb", 2, 2), 'B_0')).value
    >>> round(moduli.bulk, 6), bool(moduli.errors.bulk < 1e-15)
    (0.288675, True)
    """
    springs = of_known_kind(elastic_response, CriticalConfiguration, SpringState, Network, springs=springs)
    of_kind(np.ndarray, None, coordinates=coordinates, rest_lengths=rest_lengths, taut=taut)
    of_kind(SpringLaw, law=law)
    of_kind(float, None, volume=volume)
    of_kind(float, tolerance=tolerance)
    V = (springs if isinstance(springs, Network) else springs.network).volume if volume is None else volume
    if not 0 < V < np.inf:
        raise InputError(f"the volume must be positive and finite, not {V}")
    response: LinearResponse = elastic_response(
        springs, V, coordinates=coordinates, rest_lengths=rest_lengths, taut=taut, law=law, tolerance=tolerance
    )
    return response


@singledispatch
def elastic_response(network: Any, volume: float, **options: Any) -> LinearResponse:
    """Elasticity by the kind of the springs, per volume V; of a network at coordinates where nothing is registered.

    options  the other arguments of `elasticity`
    """
    response: LinearResponse = from_extras("response_of_network", AT_REST)(network, volume, **options)
    return response


@elastic_response.register(CriticalConfiguration)
def _at_transition(critical: CriticalConfiguration, volume: float, **_: Any) -> LinearResponse:
    """The sum over the taut parts; at rest where a part has several self-stresses."""
    parts: list[LinearResponse] = []
    for part in backbone(critical).components:
        if count_self_stresses(part) == 1:
            value = elasticity_at_transition(part, volume, roundings=1 if part is critical else 2)
            stats = Stats("transition", residual=part.residual)
            parts.append(LinearResponse(value, Status.ok, stats, n_self_stresses=1))
        else:
            parts.append(from_extras("response_at_rest", AT_REST)(part.network, part.coordinates, volume))
    return total_response(parts)


@elastic_response.register(SpringState)
def _of_state(state: SpringState, volume: float, *, tolerance: float, **_: Any) -> LinearResponse:
    if under_stress(state, tolerance):
        return linear_response(state, volume)
    response: LinearResponse = from_extras("state_at_rest", AT_REST)(state, volume, tolerance)
    return response


def elasticity_at_transition(critical: CriticalConfiguration, volume: float, roundings: int = 1) -> Elasticity:
    """Of a critical configuration with one self-stress and no slack edge; the errors are those of `quantities`.

    roundings  how often σ was scaled
    """
    L, d = critical.bond_vectors, critical.network.dimension
    error = partial(transition_modulus_error, critical=critical, volume=volume, roundings=roundings)
    shear = partial(error, pure_shear(d)) if d > 1 else np.nan
    errors = Errors(partial(_tensor_errors, critical, volume, roundings), partial(error, dilation(d)), shear, shear)
    flexibility = dot(L, L) / critical.network.stiffness
    return tensor_of_self_stress(critical.sigma, strain_rates(L), flexibility, d, volume, errors)


def _tensor_errors(critical: CriticalConfiguration, volume: float, roundings: int) -> Array:
    """Errors (m, m) of the tensor: products of two components are half the differences of squares of their sums."""
    error = partial(transition_modulus_error, critical=critical, volume=volume, roundings=roundings)
    basis = strain_basis(critical.network.dimension)[1]
    errors = np.diag([error(strain) for strain in basis])
    for a, b in zip(*np.tril_indices(len(basis), -1), strict=True):
        errors[a, b] = errors[b, a] = 0.5 * (error(basis[a] + basis[b]) + errors[a, a] + errors[b, b])
    return errors + 8 * EPS * np.abs(elasticity_at_transition(critical, volume).tensor)


def strain_rates(L: Array) -> Array:
    """ḣ = L·A L of the dilation and of all strains of `strain_basis`, (1 + m, N_b)."""
    d = L.shape[1]
    return np.array([dot(L, L @ A) for A in (dilation(d), *strain_basis(d)[1])])


def tensor_of_self_stress(
    stress: Array, rates: Array, flexibility: Array, dimension: int, volume: float, errors: Errors
) -> Elasticity:
    """C_ab by the stresses s (n,), flexibilities f (n,), and rates ḣ (1 + m, n) of the dilation and of all strains."""
    works = np.array([stress @ rate for rate in rates])
    tensor = np.outer(works, works / (stress**2 @ flexibility)) / volume
    affine, nothing = (rates[1:] / flexibility) @ rates[1:].T / volume, np.zeros((dimension, dimension))
    return Elasticity(tensor[1:, 1:], affine, nothing, volume, errors, float(tensor[0, 0]))


def under_stress(state: SpringState, tolerance: float) -> bool:
    """Whether springs in equilibrium are under stress.  Raises `InputError` when the forces do not balance."""
    scale = state.stiffness_scale * state.length_scale
    if not state.max_force <= tolerance * scale:
        raise InputError(
            f"the springs are not in equilibrium, a force of {state.max_force:.2g} is left: call equilibrium() first"
        )
    balanced = state.max_force < BALANCED * float(np.abs(state.sigma * state.lengths).max())
    return balanced or bool((np.abs(state.sigma) > tolerance * state.edge_stiffness).any())


def total_response(parts: Sequence[LinearResponse]) -> LinearResponse:
    """The response of parts that have no vertex in common: tensors add up, and the first failure decides the status."""
    if len(parts) == 1:
        return parts[0]
    values = [part.value for part in parts]
    tensor, affine, stress, bulk = (
        np.sum([getattr(value, name) for value in values], axis=0) for name in ("tensor", "affine", "stress", "bulk")
    )
    names = ("tensor", "bulk", "shear", "shear_stress_corrected")
    errors = Errors(*(partial(_summed_errors, values, name) for name in names))
    failed = [part for part in parts if not (part.ok or part.status is Status.floppy)]
    worst = (failed or [part for part in parts if part.ok] or parts)[0]
    return LinearResponse(
        Elasticity(tensor, affine, stress, values[0].volume, errors, float(bulk)),
        worst.status,
        Stats("sum over the taut parts", len(parts)),
        worst.note,
        n_self_stresses=sum(part.n_self_stresses or 0 for part in parts),
    )


def _summed_errors(values: Sequence[Elasticity], name: str) -> Any:
    return np.sum([getattr(value.errors, name) for value in values], axis=0)
