"""Values of quantities at a critical configuration, with their errors and exact gradients by stress and stiffness.

The configuration x(σ) does not depend on k, so that dO/dk = ∂O/∂k at constant σ and L.  Gradients by σ take one solve
with P.

At the largest bulk modulus the Hessian ∂²B_0/∂σ∂σ is negative semidefinite.  Its null space is σ itself, because the
configuration does not depend on the scale of σ, and σ̇ = −σ e/|L| for every isogonal mode e, which keeps the tensions:
N_v/2 directions for a periodic network of three edges a vertex, of which the paper counts N_v/2 − 1, those that
change the configuration (`BulkModulusHessian`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse.linalg import LinearOperator

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.critical.manifold import CriticalConfiguration, require_one_self_stress
from critflow.critical.quantity import Quantity, evaluate, has_exact_hessian, require_valid
from critflow.critical.vocabulary import quantity
from critflow.networks.network import Array
from critflow.result import InputError, Record

FLAT = 1e-9  # eigenvalues of a stress Hessian below this part of the largest are zero; rounding leaves about 1e-13
DENSE_EDGES = 2000  # most edges for all eigenvalues of a stress Hessian: 32 MB and some seconds


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
    >>> best = cf.optimize(cf.voronoi_network(n_vertices=20, seed=1), 'B_0')
    >>> bool(abs(cf.properties(best, ['B_0']).by_stress['B_0']).max() < 1e-12)
    True
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    given = [quantities] if isinstance(quantities, str | Quantity) else quantities
    if not isinstance(given, list | tuple) or not given or not all(isinstance(one, str | Quantity) for one in given):
        raise InputError("give a list of at least one quantity, such as ['B_0']")
    parsed = {key if isinstance(key, str) else key.name: quantity(critical.network, key) for key in given}
    if any(one.one_self_stress for one in parsed.values()):
        require_one_self_stress(critical.network)
    for one in parsed.values():
        require_valid(one, critical)
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


@dataclass(frozen=True, eq=False, repr=False)
class FlatDirections(Record):
    """The directions in stress along which a quantity does not change to second order.

    directions   orthonormal σ̇ of zero curvature, (n_flat, N_b); σ/|σ| lies in their span
    eigenvalues  of the Hessian at Σσ² = N_b, ascending, (N_b,)
    gap          largest |eigenvalue| counted as zero and the next one, relative to the largest of all
    """

    directions: Array
    eigenvalues: Array
    gap: tuple[float, float]

    @property
    def n_flat(self) -> int:
        """The nullity, scaling of σ included."""
        return len(self.directions)


@running("stress_hessian")
def stress_hessian(critical: CriticalConfiguration, name: str | Quantity = "B_0") -> LinearOperator:
    """∂²O/∂σ∂σ at Σσ² = N_b, configuration following σ, as an operator (N_b, N_b) (`BulkModulusHessian`).

    A product costs two solves on the factor of P; the matrix itself is never formed.  Where `evaluate` of the quantity
    does not take complex σ and L, as for C_B and C_G, it is a difference of gradients with nine digits.
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    name = of_kind(str, Quantity, name=name)
    manifold, goal = critical.manifold, quantity(critical.network, name)
    require_valid(goal, critical)
    evaluation = evaluate(manifold, goal, manifold.configuration(critical.sigma).sigma)
    product = evaluation.hessian_product if has_exact_hessian(manifold, goal) else evaluation.hessian_difference

    def apply(direction: Array) -> Array:
        return product(np.ravel(direction))

    n = critical.network.n_edges
    return LinearOperator((n, n), matvec=apply, rmatvec=apply, dtype=float)


@running("flat_directions")
def flat_directions(
    critical: CriticalConfiguration, name: str | Quantity = "B_0", tolerance: float = FLAT
) -> FlatDirections:
    """Null space of the Hessian of a quantity over stress, by all its eigenvalues.

    tolerance  eigenvalues of at most this part of the largest are zero

    Meant for an optimum: elsewhere ∂²O/∂σ∂σ σ = −dO/dσ, so that not even the scaling of σ is flat.  Raises
    `InputError` for networks of more than 2,000 edges.

    >>> import critflow as cf
    >>> from critflow.critical.properties import flat_directions
    >>> flat_directions(cf.optimize(cf.lattice("honeycomb", 2, 2), 'B_0')).n_flat
    4
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    name = of_kind(str, Quantity, name=name)
    of_kind(float, tolerance=tolerance)
    n = critical.network.n_edges
    if n > DENSE_EDGES:
        raise InputError(f"{n} edges are more than {DENSE_EDGES}: use the products of stress_hessian()")
    operator = stress_hessian(critical, name)
    columns = operator @ np.eye(n)
    eigenvalues, vectors = np.linalg.eigh(0.5 * (columns + columns.T))
    size = np.abs(eigenvalues) / np.abs(eigenvalues).max()
    zero = size <= tolerance
    gap = (float(size[zero].max(initial=0.0)), float(size[~zero].min(initial=np.inf)))
    return FlatDirections(vectors[:, zero].T, eigenvalues, gap)
