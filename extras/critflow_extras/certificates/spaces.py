"""The spaces of zero modes and of self-stresses, by orthonormal bases; `counts` has their dimensions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import edge_values, of_kind
from critflow.calls import running
from critflow.manifold import CriticalConfiguration
from critflow.networks import Array, Network, validated_coordinates
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.self_stress import Spectrum, edge_without_length
from critflow_extras.certificates.counts import check_size, rigidity


@dataclass(frozen=True, eq=False, repr=False)
class ZeroModes(Record):
    """Displacements that change no length to first order, all orthonormal, zero at pins (`FirstOrder`).

    modes                           (N_0 − n_trivial, N_v, d), orthogonal to the translations of a periodic network
    largest_zero, smallest_nonzero  singular values of R on both sides of the tolerance
    """

    modes: Array
    largest_zero: float
    smallest_nonzero: float


@running("zero_modes")
def zero_modes(network: Network, coordinates: ArrayLike, tolerance: float | None = None) -> Solution[ZeroModes]:
    """All zero modes of a configuration (N_v, d), separate from the translations of a periodic network.

    `Status.singular` as for `rigidity`.  Raises `InputError` for modes that would not fit in memory.

    >>> import critflow as cf
    >>> from critflow_extras.certificates.spaces import zero_modes
    >>> network = cf.lattice("honeycomb", 2, 2)
    >>> zero_modes(network, network.positions).value.modes.shape
    (3, 8, 2)
    """
    network = of_kind(Network, network=network)
    of_kind(np.ndarray, coordinates=coordinates)
    of_kind(float, None, tolerance=tolerance)
    x = validated_coordinates(network, coordinates)
    d, n_vertices = network.dimension, network.n_vertices
    if note := edge_without_length(np.linalg.norm(network.bond_vectors(x), axis=1)):
        nothing = ZeroModes(np.zeros((0, n_vertices, d)), np.nan, np.nan)
        return Solution(nothing, Status.singular, Stats("zero modes"), note)
    spectrum = Spectrum(network, x, tolerance)
    check_size(spectrum.n_motions, spectrum.n_coordinates, "zero modes", "rigidity() counts them")
    motions, gap = spectrum.null_space(spectrum.n_motions, of_stresses=False)
    modes = np.zeros((len(motions), n_vertices, d))
    modes[:, network.free] = motions.reshape(len(motions), len(network.free), d)
    if not network.pins:
        # The grounded vertex is arbitrary: without their mean the modes are orthogonal to the translations.
        modes -= modes.mean(axis=1, keepdims=True)
        modes = np.linalg.qr(modes.reshape(len(modes), n_vertices * d).T)[0].T.reshape(modes.shape)
    doubt = spectrum.doubt(*gap)
    status, stats = Status.singular if doubt else Status.ok, Stats("zero modes", 1, residual=gap[0])
    return Solution(ZeroModes(modes, *gap), status, stats, doubt)


@dataclass(frozen=True, eq=False, repr=False)
class StressSpace(Record):
    """The stresses that share a configuration: the kernel of the map σ → configuration.

    Every σ' that balances on the same bond vectors, gᵀ(σ' ∘ L) = 0, has the same configuration, since P(σ') x = −gᵀ(σ'
    ∘ b) has one solution wherever P(σ') is regular.  With N_s = 1, as generic underconstrained networks have it, the
    map is one-to-one up to the scale of σ (`SelfStressParamaterization_bondvecs`).

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


@running("self_stresses")
def self_stresses(critical: CriticalConfiguration, tolerance: float | None = None) -> Solution[StressSpace]:
    """The space of all stresses that give the same configuration as a critical one.

    `stats.residual` is the distance of the configuration's σ from the space.  `Status.singular` where an edge has no
    length or the count cannot be trusted, and `Status.floppy` where the coordinates admit no self-stress, so that σ
    cannot balance.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> ce.self_stresses(cf.optimize(network, 'B_0')).ok
    True
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    of_kind(float, None, tolerance=tolerance)
    counts = rigidity(critical.network, critical.coordinates, tolerance)
    basis = counts.value.self_stresses
    if len(basis):
        # Gram–Schmidt from σ's components rotates the first member onto σ.
        aligned = np.linalg.qr(np.column_stack([basis @ critical.sigma, np.eye(len(basis))]))[0].T @ basis
        basis = aligned * np.sign(aligned[0] @ critical.sigma or 1.0)
    space = StressSpace(critical, basis, (counts.value.largest_zero, counts.value.smallest_nonzero))
    distance = space.distance(critical.sigma) if counts.ok else np.nan
    return Solution(space, counts.status, Stats("counts", 1, residual=distance), counts.note)
