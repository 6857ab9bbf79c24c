"""All stresses of one configuration: the kernel of the map σ → configuration.

Every σ' that balances on the same bond vectors, gᵀ(σ' ∘ L) = 0, has the same configuration, since P(σ') x = −gᵀ(σ' ∘ b)
has one solution wherever P(σ') is regular.  So the stresses of a configuration are its N_s-dimensional space of
self-stresses, less those with a singular P.  With N_s = 1, as generic underconstrained networks have it, the map is
one-to-one up to the scale of σ; overconstrained networks have N_s > 1 (`SelfStressParamaterization_bondvecs`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import checked
from critflow.critical.manifold import CriticalConfiguration
from critflow.networks.checks import edge_values
from critflow.networks.network import Array
from critflow.result import InputError, Record, Solution, Stats
from critflow.rigidity.counts import Rigidity, rigidity


@dataclass(frozen=True, eq=False)
class StressSpace(Record):
    """The stresses that share a configuration.

    basis  orthonormal geometric stresses, (N_s, N_b); the first is that of the configuration itself, scaled to |σ| = 1
    gap    largest singular value of the rigidity matrix that counts as zero, and the next one
    """

    critical: CriticalConfiguration
    basis: Array
    gap: tuple[float, float]

    @property
    def dimension(self) -> int:
        """N_s: independent stresses that give this configuration; one where σ → configuration is one-to-one."""
        return len(self.basis)

    def distance(self, sigma: ArrayLike) -> float:
        """Sine of the angle between a stress (N_b,) and the space: 0 if it gives this configuration."""
        stress = edge_values(sigma, self.basis.shape[1], "sigma", positive=False)
        size = float(np.linalg.norm(stress))
        if size == 0:
            raise InputError("sigma is zero on every edge: give a stress with a non-zero entry")
        return float(np.linalg.norm(stress - (self.basis @ stress) @ self.basis)) / size


@checked
def self_stresses(critical: CriticalConfiguration, tolerance: float | None = None) -> Solution[StressSpace]:
    """The space of all stresses that give the same configuration as a critical one.

    `stats.residual` is the distance of the configuration's σ from the space.  `Status.singular` where an edge has no
    length or the count cannot be trusted, and `Status.floppy` where the coordinates admit no self-stress, so that σ
    cannot balance.

    >>> import critflow as cf
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> cf.self_stresses(cf.optimize(network, 'bulk_modulus')).ok
    True
    """
    counts = rigidity(critical.network, critical.coordinates, tolerance)
    found = counts.value
    space = StressSpace(critical, _aligned_basis(critical.sigma, found), (found.largest_zero, found.smallest_nonzero))
    distance = space.distance(critical.sigma) if counts.ok else np.nan
    return Solution(space, counts.status, Stats("counts", 1, residual=distance), counts.note)


def _aligned_basis(sigma: Array, found: Rigidity) -> Array:
    """An orthonormal basis of the self-stresses whose first member is the projection of σ."""
    basis = found.self_stresses
    if len(basis) == 0:
        return basis
    # Gram–Schmidt from σ's components rotates the first member onto σ.
    rotation = np.linalg.qr(np.column_stack([basis @ sigma, np.eye(len(basis))]))[0]
    aligned = rotation.T @ basis
    return aligned * np.sign(aligned[0] @ sigma or 1.0)
