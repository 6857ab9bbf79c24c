"""The taut backbone of a critical configuration: its stressed edges, as networks without the slack ones.

Where edges are slack, σ = 0, they carry nothing: rigidity, moduli and coefficients are those of the taut part, and the
slack part is floppy.  The taut part may fall into components, each with a self-stress.

A chain of taut edges through free vertices of two edges is one straight cable, a spring of stiffness 1/Σ k⁻¹.  It needs
no special treatment, since its vertices follow from balance: motions along the chain share out its elongation, and
tension resists the transverse ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from critflow.arguments import Mask, of_kind
from critflow.calls import running
from critflow.checks import components as connected
from critflow.manifold import CriticalConfiguration, CriticalManifold, critical_configuration
from critflow.networks import IntArray, Network
from critflow.result import InputError, Record


@dataclass(frozen=True, eq=False, repr=False)
class Backbone(Record):
    """The stressed part of a critical configuration.

    taut        (N_b,) whether σ ≠ 0
    components  configurations of its connected parts, all pins counted as joined
    """

    critical: CriticalConfiguration
    taut: Mask
    components: tuple[CriticalConfiguration, ...]

    @property
    def n_slack(self) -> int:
        """Number of slack edges."""
        return int(np.count_nonzero(~self.taut))

    @property
    def stressed_fraction(self) -> float:
        """Fraction of the edges that are stressed."""
        return float(self.taut.mean())

    @property
    def floppy_vertices(self) -> IntArray:
        """Vertices that no stressed edge meets: nothing determines their coordinates."""
        everywhere = np.arange(self.critical.network.n_vertices)
        return np.setdiff1d(everywhere, self.critical.network.edges[self.taut])

    @property
    def configuration(self) -> CriticalConfiguration:
        """The configuration of the only component; `InputError` for several."""
        if len(self.components) > 1:
            raise InputError(f"the taut part has {len(self.components)} components: use `components`")
        return self.components[0]


@running("backbone")
def backbone(critical: CriticalConfiguration) -> Backbone:
    """The stressed edges, σ ≠ 0, of a critical configuration, as networks of their own.

    Each component has σ scaled to Σσ² = n, and the bond vectors and coordinates of the whole; where the whole has error
    bounds, those in balance under the scaled stress with bounds of their own.  Without pins its first vertex is at the
    origin.  Where no edge is slack the configuration itself is the only component.

    Raises `InputError` for a configuration with NaN or without stress, and as `taut_networks`.

    >>> import critflow as cf
    >>> from critflow.taut_part import backbone
    >>> import numpy as np
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> critical = cf.critical_from_lengths(network, np.linspace(0.5, 1.5, 30), throw=False).value
    >>> found = backbone(critical)
    >>> int(found.taut.sum()), len(found.components)
    (30, 1)
    """
    critical = of_kind(CriticalConfiguration, critical=critical)
    sigma, taut = critical.sigma, critical.sigma != 0
    if not (np.isfinite(sigma).all() and np.isfinite(critical.bond_vectors).all() and taut.any()):
        raise InputError("the stress is zero or not finite: look at the status of its solution")
    if taut.all():
        return Backbone(critical, taut, (critical,))
    components = []
    for part, edges, vertices in taut_networks(critical.network, taut):
        x, stress = critical.coordinates[vertices], sigma[edges]
        component = critical_configuration(part, stress, x if part.pins else x - x[0])
        component = replace(component, bond_vectors=critical.bond_vectors[edges])
        if np.isfinite(critical.bond_errors[edges]).all():
            # Scaling rounds the stress once more, which moves the configuration.
            balance = CriticalManifold(part).solve(stress)
            component = balance.value if balance.ok else component
        components.append(component)
    return Backbone(critical, taut, tuple(components))


def connected_parts(network: Network, kept: Mask) -> list[Mask]:
    """Edges (N_b,) of each connected part of the kept edges, all pins counted as joined."""
    pins = np.fromiter(network.pins, int, len(network.pins))
    joined = np.concatenate([network.edges[kept], np.stack([pins[:-1], pins[1:]], axis=1)])
    part = connected(joined, network.n_vertices)[network.edges[:, 0]]
    return [kept & (part == number) for number in np.unique(part[kept])]


def taut_networks(network: Network, taut: Mask) -> list[tuple[Network, IntArray, IntArray]]:
    """The network of each connected part of the taut edges, with the indices of its edges and vertices in the whole.

    Raises `InputError` where no stress could balance, and for parts without a vertex that can move.
    """
    parts = []
    for kept in connected_parts(network, taut):
        edges = np.flatnonzero(kept)
        degree = np.bincount(network.edges[edges].ravel(), minlength=network.n_vertices)
        degree[list(network.pins)] = 0
        if (degree == 1).any():
            vertex = int(np.flatnonzero(degree == 1)[0])
            raise InputError(f"no stress balances at vertex {vertex} of one taut edge: count it as slack")
        if not degree.any() or np.ptp(network.edges[edges]) == 0:
            raise InputError(f"no vertex of the taut edge {edges[0]} can move: divide it by a vertex")
        part, vertices = network.part(kept)
        parts.append((part, edges, vertices))
    return parts
