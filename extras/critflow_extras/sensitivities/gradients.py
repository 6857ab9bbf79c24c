"""Values of quantities at a critical configuration, with their errors and exact gradients by stress and stiffness.

The configuration x(σ) does not depend on k, so that dO/dk = ∂O/∂k at constant σ and L.  Gradients by σ take one solve
with P.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import singledispatch

import numpy as np

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.manifold import (
    Balance,
    CriticalConfiguration,
    CriticalManifold,
    StressedBonds,
    require_one_stress_by_count,
)
from critflow.networks import Array
from critflow.numerics import dot
from critflow.quantities import (
    DIFFERENCE,
    Balanced,
    LengthVariance,
    PenalisedModulus,
    Quantity,
    TensionVariance,
    TransitionModulus,
    quantity,
    require_valid,
)
from critflow.result import InputError, Record


@dataclass(frozen=True, eq=False, repr=False)
class Properties(Record):
    """Quantities of a critical configuration and their gradients (N_b,), by name.

    values
    errors        of the values (estimate)
    by_stress     dO/dσ at constant k; orthogonal to σ, whose scale changes nothing.  NaN where edges are slack: a small
                  stress on them would move vertices that nothing holds
    by_stiffness  dO/dk at constant σ
    """

    values: dict[str, float]
    errors: dict[str, float] = field(repr=False)
    by_stress: dict[str, Array] = field(repr=False)
    by_stiffness: dict[str, Array] = field(repr=False)


@running("properties")
def properties(critical: CriticalConfiguration, quantities: Sequence[str | Quantity] | str | Quantity) -> Properties:
    """Quantities of a critical configuration with their errors and exact gradients by σ and by k.

    quantities  names such as "B_0", "C_B", "S_xy" or "stiffening[uniaxial]", or `Quantity` objects

    Raises `InputError` for unknown names, and for networks with several self-stresses where a quantity needs one.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> best = cf.optimize(cf.voronoi_network(n_vertices=20, seed=1), 'B_0')
    >>> bool(abs(ce.properties(best, ['B_0']).by_stress['B_0']).max() < 1e-12)
    True
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    given = [quantities] if isinstance(quantities, str | Quantity) else quantities
    if not isinstance(given, list | tuple) or not given or not all(isinstance(one, str | Quantity) for one in given):
        raise InputError("give a list of at least one quantity, such as ['B_0']")
    parsed = {key if isinstance(key, str) else key.name: quantity(critical.network, key) for key in given}
    if any(one.one_self_stress for one in parsed.values()):
        require_one_stress_by_count(critical.network)
    for one in parsed.values():
        require_valid(one, critical)
    balance = critical.manifold.balance(critical.sigma)
    evaluated = {name: one.evaluate(critical) for name, one in parsed.items()}
    rows = pull_backs(balance, [partials for _, partials in evaluated.values()])
    if not critical.sigma.all():
        rows = np.full_like(rows, np.nan)
    return Properties(
        {name: float(value) for name, (value, _) in evaluated.items()},
        {name: one.error(critical) for name, one in parsed.items()},
        dict(zip(parsed, rows, strict=True)),
        {name: by_stiffness(one, critical) for name, one in parsed.items()},
    )


def pull_backs(balance: Balance, partials: Sequence[tuple[Array, Array]]) -> Array:
    """Total derivatives (n, N_b) of several functions from (∂O/∂σ, ∂O/∂L) of each, as `Balance.pull_back` of one."""
    if not partials:
        return np.zeros((0, len(balance.sigma)))
    n, d = len(partials), balance.bond_vectors.shape[1]
    gy = balance.edge_response(np.concatenate([by_L for _, by_L in partials], axis=1)).reshape(-1, n, d)
    rows = np.array([by_sigma for by_sigma, _ in partials])
    return np.asarray(rows - np.einsum("ad,and->na", balance.bond_vectors, gy))


def by_stiffness(quantity: Quantity, balance: Balanced) -> Array:
    """∂O/∂k (N_b,) at constant σ and L, by the method `by_stiffness` of its class where it has one.

    Else by the formulas below, or by central differences.
    """
    method = getattr(quantity, "by_stiffness", None)
    return np.asarray(method(balance) if method else _by_stiffness(quantity, balance))


@singledispatch
def _by_stiffness(quantity: Quantity, balance: Balanced) -> Array:
    """By central differences."""
    network, rows = balance.network, np.empty(balance.network.n_edges)
    for edge, k in enumerate(network.stiffness):
        ends = []
        for sign in (1, -1):
            stiffness = network.stiffness.copy()
            stiffness[edge] = k * (1 + sign * DIFFERENCE)
            changed = network.with_stiffness(stiffness)
            there = StressedBonds(CriticalManifold.of(changed), balance.sigma, balance.bond_vectors)
            ends.append(quantity.evaluate(there)[0])
        rows[edge] = (ends[0] - ends[1]) / (2 * DIFFERENCE * k)
    return rows


@_by_stiffness.register
def _(variance: LengthVariance | TensionVariance, balance: Balanced) -> Array:
    return np.zeros_like(balance.sigma)


@_by_stiffness.register
def _(modulus: TransitionModulus, balance: Balanced) -> Array:
    # Of μ = W²/(V D) with ∂D/∂k = −σ²|L|²/k².
    sigma, L, k = balance.sigma, balance.bond_vectors, balance.network.stiffness
    square, flexibility = sigma * sigma, dot(L, L) / k
    ratio = (sigma @ dot(L, L @ modulus.symmetric)).item() / (square @ flexibility).item()
    return np.asarray(square * flexibility / k * (ratio * ratio) / balance.network.volume)


@_by_stiffness.register
def _(penalised: PenalisedModulus, balance: Balanced) -> Array:
    # The unit is proportional to the mean stiffness.
    return (
        by_stiffness(penalised.modulus, balance) - penalised.powers(balance)[0].mean() / balance.network.stiffness.sum()
    )
