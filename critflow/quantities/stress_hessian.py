"""How flat a quantity is over the stresses: its exact Hessian, and the directions in which it does not change.

At the largest bulk modulus the Hessian ∂²B_0/∂σ∂σ is negative semidefinite.  Its null space is σ itself, because the
configuration does not depend on the scale of σ, and σ̇ = −σ e/|L| for every isogonal mode e, which keeps the tensions:
N_v/2 directions for a periodic network of three edges a vertex, of which the paper counts N_v/2 − 1, those that
change the configuration (`BulkModulusHessian`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import LinearOperator

from critflow.arguments import checked
from critflow.critical.derivatives import evaluate
from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.quantity import Quantity
from critflow.networks.network import Array
from critflow.quantities.vocabulary import quantity
from critflow.result import InputError, Record

FLAT = 1e-9  # eigenvalues of a stress Hessian below this part of the largest are zero; rounding leaves about 1e-13
DENSE_EDGES = 2000  # most edges for all eigenvalues of a stress Hessian: 32 MB and some seconds


@dataclass(frozen=True, eq=False)
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


@checked
def stress_hessian(critical: CriticalConfiguration, name: str | Quantity = "B_0") -> LinearOperator:
    """∂²O/∂σ∂σ at Σσ² = N_b, configuration following σ, as an operator (N_b, N_b) (`BulkModulusHessian`).

    A product costs two solves on the factor of P; the matrix itself is never formed.
    """
    manifold, goal = critical.manifold, quantity(critical.network, name)
    evaluation = evaluate(manifold, goal, manifold.configuration(critical.sigma).sigma)

    def apply(direction: Array) -> Array:
        return evaluation.hessian_product(np.ravel(direction))

    n = critical.network.n_edges
    return LinearOperator((n, n), matvec=apply, rmatvec=apply, dtype=float)


@checked
def flat_directions(
    critical: CriticalConfiguration, name: str | Quantity = "B_0", tolerance: float = FLAT
) -> FlatDirections:
    """Null space of the Hessian of a quantity over stress, by all its eigenvalues.

    tolerance  eigenvalues of at most this part of the largest are zero

    Meant for an optimum: elsewhere ∂²O/∂σ∂σ σ = −dO/dσ, so that not even the scaling of σ is flat.  Raises
    `InputError` for networks of more than 2,000 edges.

    >>> import critflow as cf
    >>> from critflow.quantities.stress_hessian import flat_directions
    >>> flat_directions(cf.optimize(cf.lattice("honeycomb", 2, 2), 'B_0')).n_flat
    4
    """
    n = critical.network.n_edges
    if n > DENSE_EDGES:
        raise InputError(
            f"all eigenvalues are found up to {DENSE_EDGES} edges, not for {n}: use the products of stress_hessian()"
        )
    operator = stress_hessian(critical, name)
    columns = operator @ np.eye(n)
    eigenvalues, vectors = np.linalg.eigh(0.5 * (columns + columns.T))
    size = np.abs(eigenvalues) / np.abs(eigenvalues).max()
    zero = size <= tolerance
    gap = (float(size[zero].max(initial=0.0)), float(size[~zero].min(initial=np.inf)))
    return FlatDirections(vectors[:, zero].T, eigenvalues, gap)
