"""Properties at the transition with their exact gradients by stress and by stiffness.

The configuration x(σ) does not depend on k, so that dO/dk = ∂O/∂k at constant σ and L.  Through D = Σσ²|L|²/k
    ∂D/∂k = −σ²|L|²/k²,   dμ_A/dk = (μ_A/D) σ²|L|²/k²,   d(S/√D)/dk = ½ (S/D^{3/2}) σ²|L|²/k²;
coefficients of stiffening are stationary in their responses (`PathStiffeningCoefficient`).  Gradients by σ take one
solve with P.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import checked
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold, require_one_self_stress
from critflow.critical.quantity import Objective, TransitionModulus
from critflow.networks.checks import edge_values
from critflow.networks.network import Array, Network
from critflow.quantities.errors import error_bounds
from critflow.quantities.stiffening import PathStiffeningCoefficient, StiffeningCoefficient
from critflow.quantities.table import StressComponent, named_target
from critflow.result import InputError, Solution


@dataclass(frozen=True, eq=False, kw_only=True)
class TransitionProperties(Solution[CriticalConfiguration]):
    """A critical configuration, its properties by name, and their gradients (N_b,) by name.

    achieved      values
    error_bounds  of the values (estimate)
    by_stress     dO/dσ at constant k; orthogonal to σ, whose scale changes nothing
    by_stiffness  dO/dk at constant σ

    All are empty where the stress has no configuration.
    """

    achieved: dict[str, float]
    error_bounds: dict[str, float] = field(repr=False)
    by_stress: dict[str, Array] = field(repr=False)
    by_stiffness: dict[str, Array] = field(repr=False)


@checked
def transition_properties(
    network: Network | CriticalManifold, stress: ArrayLike, names: Sequence[str], *, throw: bool = True
) -> TransitionProperties:
    """Properties of the critical configuration of a stress (N_b,) with exact gradients by σ and by k.

    names  those of the targets of `design`, such as "B_0", "C_B", "S_xy" or "stiffening[uniaxial]"

    Raises `InputError` for unknown names and for networks with several self-stresses, `SolveError` where the stress has
    no configuration and `throw` is set.

    >>> import critflow as cf
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> found = cf.transition_properties(network, network.stiffness, ['B_0'])
    >>> bool(abs(found.by_stress['B_0']).max() < 1e-12)  # σ = k has the largest B_0
    True
    """
    manifold = CriticalManifold.of(network)
    if isinstance(names, str) or not len(names):
        raise InputError("names must be a list of at least one property, such as ['B_0']")
    sigma = edge_values(stress, manifold.network.n_edges, "stress", positive=False)
    objectives = [named_target(manifold, name) for name in names]
    if any(objective.one_self_stress for objective in objectives):
        require_one_self_stress(manifold.network, "design its stiffnesses, or prune it to one self-stress")
    solved = manifold.solve(sigma)
    if not solved.ok:
        nothing = TransitionProperties(
            solved.value, solved.status, solved.stats, solved.note,
            achieved={}, error_bounds={}, by_stress={}, by_stiffness={},
        )  # fmt: skip
        return nothing.or_raise("the stress has no configuration") if throw else nothing
    balance, L = manifold.balance(sigma), solved.value.bond_vectors
    values, partials = zip(*(objective.evaluate(sigma, L) for objective in objectives), strict=True)
    return TransitionProperties(
        solved.value,
        solved.status,
        solved.stats,
        solved.note,
        achieved=dict(zip(names, map(float, values), strict=True)),
        error_bounds=dict(zip(names, map(float, error_bounds(objectives, solved.value)), strict=True)),
        by_stress=dict(zip(names, balance.pull_backs(partials), strict=True)),
        by_stiffness={name: _by_stiffness(one, sigma, L) for name, one in zip(names, objectives, strict=True)},
    )


def _by_stiffness(objective: Objective, sigma: Array, L: Array) -> Array:
    """∂O/∂k (N_b,) at constant σ and L."""
    if isinstance(objective, StiffeningCoefficient | PathStiffeningCoefficient):
        return objective.by_stiffness(sigma, L)
    if not isinstance(objective, TransitionModulus | StressComponent):
        return np.zeros_like(sigma)
    k = objective.stiffness
    cost = sigma**2 * np.einsum("ad,ad->a", L, L) / k
    # Moduli are of degree −1 in D, components of S/√D of degree −½.
    degree = 1.0 if isinstance(objective, TransitionModulus) else 0.5
    return np.asarray(degree * objective.evaluate(sigma, L)[0] / cost.sum() * cost / k)
