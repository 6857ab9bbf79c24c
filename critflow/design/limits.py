"""Targets of a design and limits of its edges, from what a user asks for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from critflow.critical.manifold import Balance
from critflow.critical.quantity import Quantity
from critflow.networks.checks import edge_values
from critflow.networks.network import Array, Network
from critflow.quantities.vocabulary import quantity, same
from critflow.result import InputError

GOALS = ("largest", "smallest")
# Powers of σ and |L| in the quantities of an edge that a stress sets.
POWERS = {"lengths": (0, 1), "tensions": (1, 1), "force_densities": (1, 0)}
LIMITED = {"stress": tuple(POWERS), "faces": ("lengths",), "stiffness": ("stiffnesses",)}
ABSOLUTE = ("lengths", "stiffnesses")  # the others are in units of their mean


class Target(NamedTuple):
    """One target: its name as given, the quantity, its limits, and 1 or −1 where the smallest or largest is sought."""

    name: str
    quantity: Quantity
    low: float
    high: float
    goal: int


def parse_targets(network: Network, targets: Mapping[Any, object]) -> list[Target]:
    """The targets in their order; raises `InputError` for unknown names, and for values that are no targets."""
    if not targets:
        raise InputError("give at least one target, such as {'B_0': 0.25}")
    parsed = list[Target]()
    for key, value in targets.items():
        function = quantity(network, key)
        name = key if isinstance(key, str) else function.name
        for other in parsed:
            if same(function, other.quantity):
                raise InputError(f"the targets {other.name} and {name} are the same: give one of them")
        if isinstance(value, str):
            if value not in GOALS:
                raise InputError(
                    f"the target {name} must be a number, a pair of limits, 'largest' or 'smallest', not {value!r:.40}"
                )
            parsed.append(Target(name, function, -np.inf, np.inf, 1 if value == "smallest" else -1))
        else:
            parsed.append(Target(name, function, *limits_of(name, value), 0))
    goals = [target.name for target in parsed if target.goal]
    if len(goals) > 1:
        raise InputError(
            f"only one target can be largest or smallest, not {' and '.join(goals)}: give the others limits"
        )
    return parsed


def limit_sizes(targets: Sequence[Target]) -> Array:
    """The largest finite limit of each target, by its magnitude (n,)."""
    limits = np.abs([(target.low, target.high) for target in targets]).reshape(-1, 2)
    return np.where(np.isfinite(limits), limits, 0.0).max(axis=1)


def limits_of(name: str, value: object) -> tuple[float, float]:
    """Low and high limit of a target."""
    low, high = value if isinstance(value, tuple | list) and len(value) == 2 else (value, value)
    try:
        limits = float(low), float(high)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise InputError(f"the target {name} must be a number or a pair of limits, not {value!r:.40}") from None
    if np.isnan(limits).any() or limits[0] > limits[1] or np.isinf(limits).all():
        raise InputError(f"the target {name} must be a number or a pair (low, high), not {value!r:.40}")
    return limits


@dataclass(frozen=True, eq=False)
class EdgeLimits:
    """Limits (N_b,) of one quantity q of every edge: its length, or its tension or σ in units of their mean."""

    name: str
    low: Array
    high: Array

    @classmethod
    def of(cls, name: str, value: object, n_edges: int) -> EdgeLimits:
        """Limits from a pair of numbers or of arrays; None is no limit."""
        if not (isinstance(value, tuple | list) and len(value) == 2):
            raise InputError(f"the limits of {name} must be a pair (low, high), each a number, one an edge, or None")
        low, high = np.full(n_edges, -np.inf), np.full(n_edges, np.inf)
        for end, limit in zip((low, high), value, strict=True):
            if limit is not None:
                each = np.full(n_edges, limit) if np.ndim(limit) == 0 else limit
                end[:] = edge_values(each, n_edges, f"limit of {name}", positive=False)
        if (low > high).any():
            raise InputError(f"the lower limit of {name} is above the upper one at edge {int(np.argmax(low > high))}")
        if name in ABSOLUTE and (high <= 0).any():
            raise InputError(f"the upper limit of the {name} must be positive")
        if name not in ABSOLUTE and ((low > 1).all() or (high < 1).all()):
            raise InputError(f"the limits of {name} are in units of their mean: they must enclose 1")
        return cls(name, low, high)

    def values(self, balance: Balance) -> Array:
        """q, (N_b,)."""
        q, mean, _, _ = self._quantities(balance)
        return q / mean

    def rows(self, balance: Balance, edges: NDArray[np.intp]) -> Array:
        """dq/dσ of chosen edges, (m, N_b): one solve with P each."""
        L, g, m = balance.bond_vectors, balance.network.free_incidence, len(edges)
        q, mean, by_sigma, by_L = self._quantities(balance)
        rows = np.zeros((m, len(q)))
        if by_L.any():
            # ∂|L_β|/∂σ_α = −(g P⁻¹ gᵀ)_αβ L_α·L_β/|L_β|
            rows -= ((g @ balance.factor.solve(g[edges].T.toarray())) * (L @ by_L[edges].T)).T
        rows[np.arange(m), edges] += by_sigma[edges]
        if self.name in ABSOLUTE:
            return rows
        of_mean = balance.pull_back(by_sigma / len(q), by_L / len(q))[0]
        return np.asarray((rows - (q[edges] / mean)[:, None] * of_mean) / mean)

    def _quantities(self, balance: Balance) -> tuple[Array, float, Array, Array]:
        """q before its division by the mean of all, or by 1; that number; and ∂q/∂σ (N_b,) and ∂q/∂L (N_b, d)."""
        a, b = POWERS[self.name]
        sigma, L = balance.sigma, balance.bond_vectors
        length = np.linalg.norm(L, axis=1)
        q = sigma**a * length**b
        by_L = (b * sigma**a / length)[:, None] * L
        return q, 1.0 if self.name in ABSOLUTE else float(q.mean()), a * length**b, by_L


def edge_limits(n_edges: int, within: Mapping[str, object], change: str = "stress") -> list[EdgeLimits]:
    """The limits of edges, those without any left out."""
    limited = LIMITED.get(change, ())
    for name in within:
        if name not in limited:
            raise InputError(
                f"no quantity of the edges is called {name!r:.40}: choose from {', '.join(limited) or 'none'}"
            )
    every = [EdgeLimits.of(name, value, n_edges) for name, value in within.items()]
    return [limits for limits in every if np.isfinite(limits.low).any() or np.isfinite(limits.high).any()]
