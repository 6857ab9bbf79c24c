"""The local response as a quantity, by the name local[i-j,k-l]: strain of the pair k-l per strain of the pair i-j.

η = (|r_s|/|r_t|) G_ts/G_ss     (`compliance`)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.quantity import Balanced, Partials, Quantity
from critflow.extras.local.compliance import Compliances, compliances
from critflow.extras.local.pairs import Pair, check_distinct, read_pair
from critflow.networks.network import Array, Network
from critflow.result import InputError


@dataclass(frozen=True, eq=False, repr=False)
class LocalStrain(Quantity):
    """η, the relative change of a target distance per relative change of a source distance, at vanishing stress.

    n_vertices  of the network that the pairs name: in a part with fewer vertices the value is NaN
    spelled     the pairs as they were written, an image that is not written being the nearest one
    """

    one_self_stress: ClassVar[bool] = True
    elastic: ClassVar[bool] = True
    analytic: ClassVar[bool] = False
    source: Pair
    target: Pair
    n_vertices: int
    spelled: str

    @property
    def name(self) -> str:
        return f"local[{self.spelled}]"

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        if balance.manifold.network.n_vertices != self.n_vertices:
            nothing = np.full_like(balance.bond_vectors, np.nan)
            return np.nan, (nothing[:, 0], nothing)
        found = compliances(balance)
        require_moving(found, self.source)
        return strain(found, self.source, self.target), partials(found, self.source, self.target)

    def error(self, critical: CriticalConfiguration) -> float:
        """Error (estimate): that of the compliances, and |∂η/∂L| times the errors of the bonds."""
        found = compliances(critical)
        return strain_error(found, critical, self.source, self.target)

    def by_stiffness(self, balance: Balanced) -> Array:
        """No stiffness enters: zeros (N_b,)."""
        return np.zeros(len(balance.sigma))


def local(network: Network, text: str) -> LocalStrain:
    """local[i-j,k-l] with the source i-j and the target k-l; i-j:1:0 names the image of j in the next cell."""
    parts = text.split(",")
    if len(parts) != 2:
        raise InputError(
            f"local[{text:.40}] needs a source and a target: write local[i-j,k-l] with numbers of vertices"
        )
    source, target = (read_pair(network, part) for part in parts)
    check_distinct(source, target)
    return LocalStrain(source, target, network.n_vertices, text.replace(" ", ""))


def require_moving(found: Compliances, pair: Pair) -> None:
    """`InputError` where edges hold the distance of a source."""
    if found.held(pair):
        raise InputError(f"the edges hold the source {pair}, so that no motion changes its distance: name another pair")


def strain(found: Compliances, source: Pair, target: Pair) -> float:
    """η."""
    ratio = found.motion(source).distance / found.motion(target).distance
    return ratio * found.compliance(target, source) / found.compliance(source, source)


def partials(found: Compliances, source: Pair, target: Pair) -> Partials:
    """∂η/∂σ (N_b,) and ∂η/∂L (N_b, d)."""
    s, t, own = found.motion(source), found.motion(target), found.compliance(source, source)
    ratio, eta = s.distance / t.distance, strain(found, source, target)
    (mixed_sigma, mixed_L), (own_sigma, own_L) = (found.derivatives(one, source) for one in (target, source))
    by_sigma = (ratio * mixed_sigma - eta * own_sigma) / own
    by_L = (ratio * mixed_L - eta * own_L) / own
    by_target = ratio / own * t.turning(s.displacement) - eta / t.distance * t.direction
    by_source = ratio / own * s.turning(t.displacement) - 2 * eta / own * s.turning(s.displacement)
    by_source = by_source + eta / s.distance * s.direction
    for (edges, signs), by_r in ((t.path, by_target), (s.path, by_source)):
        by_L[edges] += signs[:, None] * by_r
    return by_sigma, by_L


def strain_error(found: Compliances, critical: CriticalConfiguration, source: Pair, target: Pair) -> float:
    """Error (estimate) of η at a configuration: of the compliances, of the bonds, and of r by a sum along its path."""
    s, t, own = found.motion(source), found.motion(target), found.compliance(source, source)
    eta, ratio = strain(found, source, target), s.distance / t.distance
    of_solves = (ratio * found.error(target, source) + abs(eta) * found.error(source, source)) / own
    _, by_L = partials(found, source, target)
    size = np.linalg.norm(by_L, axis=1)
    rounding = np.finfo(float).eps * (4 * abs(eta) + float(np.linalg.norm(size * critical.lengths)))
    return float(size @ critical.bond_errors) + of_solves + rounding
