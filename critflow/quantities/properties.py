"""Values of quantities at a critical configuration, with their errors and exact gradients by stress and stiffness.

The configuration x(σ) does not depend on k, so that dO/dk = ∂O/∂k at constant σ and L.  Gradients by σ take one solve
with P.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from critflow.arguments import checked
from critflow.critical.manifold import CriticalConfiguration, require_one_self_stress
from critflow.critical.quantity import Quantity
from critflow.networks.network import Array
from critflow.quantities.vocabulary import quantity
from critflow.result import InputError, Record


@dataclass(frozen=True, eq=False)
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


@checked
def properties(critical: CriticalConfiguration, quantities: Sequence[str | Quantity] | str | Quantity) -> Properties:
    """Quantities of a critical configuration with their errors and exact gradients by σ and by k.

    quantities  names such as "B_0", "C_B", "S_xy" or "stiffening[uniaxial]", or `Quantity` objects

    Raises `InputError` for unknown names, and for networks with several self-stresses where a quantity needs one.

    >>> import critflow as cf
    >>> best = cf.optimize(cf.voronoi_network(n_vertices=20, seed=1), 'B_0')
    >>> bool(abs(cf.properties(best, ['B_0']).by_stress['B_0']).max() < 1e-12)
    True
    """
    given = [quantities] if isinstance(quantities, str | Quantity) else quantities
    if not isinstance(given, list | tuple) or not given or not all(isinstance(one, str | Quantity) for one in given):
        raise InputError("give a list of at least one quantity, such as ['B_0']")
    parsed = {key if isinstance(key, str) else key.name: quantity(critical.network, key) for key in given}
    if any(one.one_self_stress for one in parsed.values()):
        require_one_self_stress(critical.network)
    balance = critical.manifold.balance(critical.sigma)
    evaluated = {name: one.evaluate(critical) for name, one in parsed.items()}
    rows = balance.pull_backs([partials for _, partials in evaluated.values()])
    if not critical.sigma.all():
        rows = np.full_like(rows, np.nan)
    return Properties(
        {name: float(value) for name, (value, _) in evaluated.items()},
        {name: one.error(critical) for name, one in parsed.items()},
        dict(zip(parsed, rows, strict=True)),
        {name: one.by_stiffness(critical) for name, one in parsed.items()},
    )
