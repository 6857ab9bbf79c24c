"""The largest possible values of quantities over all stresses of a network, in closed form."""

from __future__ import annotations

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.critical.manifold import CriticalManifold
from critflow.critical.quantity import Quantity, only_positive
from critflow.critical.vocabulary import quantity
from critflow.networks.network import Network


@running("upper_bound")
def upper_bound(network: Network | CriticalManifold, name: str | Quantity, signs: str = "positive") -> float:
    """The largest possible value of a quantity over all stresses of a network in closed form; infinite without one.

    Error bound (proof, up to rounding).  B_0 ≤ (1/d²V) Σ k|L*|² with L* the configuration at σ = k; every other modulus
    at the transition likewise.  `quantity(network, name).extreme` has the smallest possible value too.

    signs  "positive", or "any" for stresses of both signs

    >>> import critflow as cf
    >>> round(cf.upper_bound(cf.lattice("honeycomb", 2, 2), 'B_0'), 6)
    0.288675
    """
    network = of_kind(Network, CriticalManifold, network=network)
    name = of_kind(str, Quantity, name=name)
    of_kind(str, signs=signs)
    manifold = CriticalManifold.of(network)
    return quantity(manifold.network, name).extreme(manifold, only_positive(signs))[1]
