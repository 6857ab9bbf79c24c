"""The local response as a quantity, by the name local[i-j,k-l]: strain of the pair k-l per strain of the pair i-j.

η = (|r_s|/|r_t|) G_ts/G_ss     (`compliance`)

It is that of vanishing stress; local[i-j,k-l,t] is that under the stress tσ, Σσ² = N_b and t in units of k, of springs
with the rest lengths |L|(1 − tσ/k)     (`under_stress`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from critflow.manifold import CriticalConfiguration
from critflow.networks import Array, Network
from critflow.numerics import EPS
from critflow.quantities import Balanced, Partials, Quantity
from critflow.result import InputError
from critflow_extras.local.compliance import Compliances, compliances
from critflow_extras.local.pairs import Pair, Target, Vertex, check_distinct, read_pair, read_target
from critflow_extras.local.under_stress import compliances_under

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


@dataclass(frozen=True, eq=False, repr=False)
class LocalStrain(Quantity):
    """η, the relative change of a target distance per relative change of a source distance.

    stress      t of the stress tσ, Σσ² = N_b, in units of k; zero is the limit of vanishing stress
    n_vertices  of the network that the pairs name: in a part with fewer vertices the value is NaN
    spelled     the pairs as they were written, an image that is not written being the nearest one
    """

    one_self_stress: ClassVar[bool] = True
    elastic: ClassVar[bool] = True
    analytic: ClassVar[bool] = False
    source: Pair
    target: Target
    stress: float
    n_vertices: int
    spelled: str

    @property
    def name(self) -> str:
        return f"local[{self.spelled}]"

    def unit(self, network: Network) -> float:
        return network.spacing if isinstance(self.target, Vertex) else 1.0

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        known = self._compliances(balance)
        if known is None:
            unknown = np.full_like(balance.bond_vectors, np.nan)
            return np.nan, (unknown[:, 0], unknown)
        require_moving(known, self.source)
        by_sigma, by_L = partials(known, self.source, self.target)
        if self.stress:
            sigma = balance.sigma
            square = float(sigma @ sigma)
            along = float(by_sigma @ sigma) / square
            by_sigma = self.stress * np.sqrt(len(sigma) / square) * (by_sigma - along * sigma)
        return strain(known, self.source, self.target), (by_sigma, by_L)

    def _compliances(self, balance: Balanced) -> Compliances | None:
        """The compliances at the stress of the quantity; None in other networks, and where there is no minimum."""
        if balance.manifold.network.n_vertices != self.n_vertices:
            return None
        return compliances_under(balance, self.stress) if self.stress else compliances(balance)

    def error(self, critical: CriticalConfiguration) -> float:
        """Error (estimate): that of the compliances, and |∂η/∂L| times the errors of the bonds."""
        known = self._compliances(critical)
        return np.nan if known is None else strain_error(known, critical, self.source, self.target)

    def by_stiffness(self, balance: Balanced) -> Array:
        """∂η/∂k (N_b,): zero at vanishing stress, where no stiffness enters."""
        known = self._compliances(balance)
        if known is None:
            return np.full(len(balance.sigma), np.nan)
        s, t, own = known.motion(self.source), known.motion(self.target), known.compliance(self.source, self.source)
        mixed, single = (known.by_stiffness(one, self.source) for one in (self.target, self.source))
        return (s.distance / t.distance * mixed - strain(known, self.source, self.target) * single) / own


def local(network: Network, text: str) -> LocalStrain:
    """local[i-j,k-l] with the source i-j and the target k-l, or local[i-j,k-l,t] under the stress tσ.

    i-j:1:0 names the image of j in the next cell.  The target 20x is the motion of vertex 20 along x, a length.
    """
    pairs, stress = text.split(","), 0.0
    if len(pairs) == 3 and _NUMBER.fullmatch(pairs[2].strip()):
        stress = float(pairs.pop())
        if not 0 < stress < np.inf:
            example = "as in local[i-j,k-l,1e-3]; without t it is 0"
            raise InputError(f"local[{text:.40}] needs a positive stress t, {example}")
    if len(pairs) != 2:
        raise InputError(
            f"local[{text:.40}] needs a source and a target: write local[i-j,k-l] with numbers of vertices"
        )
    source, target = read_pair(network, pairs[0]), read_target(network, pairs[1])
    check_distinct(source, target)
    return LocalStrain(source, target, stress, network.n_vertices, text.replace(" ", ""))


def require_moving(found: Compliances, pair: Pair) -> None:
    """`InputError` where edges hold the distance of a source."""
    if found.held(pair):
        raise InputError(f"the edges hold the source {pair}, so that no motion changes its distance: name another pair")


def strain(found: Compliances, source: Pair, target: Target) -> float:
    """η."""
    ratio = found.motion(source).distance / found.motion(target).distance
    return ratio * found.compliance(target, source) / found.compliance(source, source)


def partials(found: Compliances, source: Pair, target: Target) -> Partials:
    """∂η/∂σ (N_b,) and ∂η/∂L (N_b, d)."""
    s, t, own = found.motion(source), found.motion(target), found.compliance(source, source)
    ratio, eta = s.distance / t.distance, strain(found, source, target)
    (mixed_sigma, mixed_L), (own_sigma, own_L) = found.derivatives(target, source), found.own_derivatives(source)
    by_sigma = (ratio * mixed_sigma - eta * own_sigma) / own
    by_L = (ratio * mixed_L - eta * own_L) / own
    by_target = ratio / own * t.turning(s.displacement) - eta / t.distance * t.direction
    by_source = ratio / own * s.turning(t.displacement) - 2 * eta / own * s.turning(s.displacement)
    by_source = by_source + eta / s.distance * s.direction
    for (edges, signs), by_r in ((t.path, by_target), (s.path, by_source)):
        by_L[edges] += signs[:, None] * by_r
    return by_sigma, by_L


def strain_error(found: Compliances, critical: CriticalConfiguration, source: Pair, target: Target) -> float:
    """Error (estimate) of η at a configuration: of the compliances, of the bonds, and of r by a sum along its path."""
    s, t, own = found.motion(source), found.motion(target), found.compliance(source, source)
    eta, ratio = strain(found, source, target), s.distance / t.distance
    of_solves = (ratio * found.error(target, source) + abs(eta) * found.error(source, source)) / abs(own)
    return of_solves + _geometric_error(critical, eta, partials(found, source, target)[1])


def stiffness_error(found: Compliances, critical: CriticalConfiguration, source: Pair) -> float:
    """Error (estimate) of 1/G_ss at a configuration, as `strain_error`."""
    s, own = found.motion(source), found.compliance(source, source)
    by_L, (edges, signs) = found.own_derivatives(source)[1].copy(), s.path
    by_L[edges] += 2 * signs[:, None] * s.turning(s.displacement)
    return (found.error(source, source) + _geometric_error(critical, own, by_L)) / own**2


def _geometric_error(critical: CriticalConfiguration, value: float, by_L: Array) -> float:
    """Error of a value with derivatives by L (N_b, d): of the bonds, and of the sums of bonds along pairs."""
    size = np.linalg.norm(by_L, axis=1)
    rounding = EPS * (4 * abs(value) + float(np.linalg.norm(size * critical.lengths)))
    return float(size @ critical.bond_errors) + rounding
