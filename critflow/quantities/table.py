"""What a design may prescribe: functions of σ and L by name, and limits of edges."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from critflow.critical.manifold import Balance, CriticalManifold
from critflow.critical.quantity import (
    LengthVariance,
    Objective,
    Partials,
    TensionVariance,
    TransitionModulus,
    dilation,
    pure_shear,
    transition_modulus,
)
from critflow.networks.checks import edge_values
from critflow.networks.deformation import DEFORMATIONS, deformation_of, strain_basis
from critflow.networks.network import Array
from critflow.quantities.stiffening import PathStiffeningCoefficient, StiffeningCoefficient
from critflow.result import InputError

ALIASES = {
    "bulk_modulus": "B_0",
    "shear_modulus": "G_0",
    "length_variance": "V_L",
    "tension_variance": "V_tau",
}
"""Names of objectives that are also targets, and their symbols."""

GOALS = ("largest", "smallest")
LIMITED = ("lengths", "tensions", "force_densities")


@dataclass(frozen=True)
class StressComponent(Objective):
    """Component of S/√D, S = Σσ L⊗L, D = Σσ²|L|²/k: all that linear elasticity is at the transition, C = S⊗S/(V D)."""

    strain: Array
    stiffness: Array

    one_self_stress: ClassVar[bool] = True

    def evaluate(self, sigma: Array, L: Array) -> tuple[float, Partials]:
        EL = L @ self.strain
        product = np.einsum("ad,ad->a", L, EL)
        flexibility = np.einsum("ad,ad->a", L, L) / self.stiffness
        work, root = float(sigma @ product), float(np.sqrt(sigma**2 @ flexibility))
        by_sigma = product / root - work / root**3 * sigma * flexibility
        by_L = (2 / root) * sigma[:, None] * EL - (work / root**3) * (sigma**2 / self.stiffness)[:, None] * L
        return work / root, (by_sigma, by_L)

    def differential(self, sigma: Array, L: Array, dsigma: Array, dL: Array) -> Partials:
        EL, EdL = L @ self.strain, dL @ self.strain
        product, dproduct = np.einsum("ad,ad->a", L, EL), 2 * np.einsum("ad,ad->a", dL, EL)
        flexibility = np.einsum("ad,ad->a", L, L) / self.stiffness
        dflexibility = 2 * np.einsum("ad,ad->a", L, dL) / self.stiffness
        work, square = sigma @ product, sigma**2 @ flexibility
        dwork = dsigma @ product + sigma @ dproduct
        dsquare = 2 * (sigma * dsigma) @ flexibility + sigma**2 @ dflexibility
        root = np.sqrt(square)
        inverse, dinverse = 1 / root, -0.5 * dsquare / root**3
        ratio = work / root**3
        dratio = dwork / root**3 - 1.5 * work * dsquare / root**5
        ddO_dsigma = dinverse * product + inverse * dproduct - dratio * sigma * flexibility
        ddO_dsigma -= ratio * (dsigma * flexibility + sigma * dflexibility)
        ddO_dL = 2 * (dinverse * sigma + inverse * dsigma)[:, None] * EL + (2 * inverse * sigma)[:, None] * EdL
        ddO_dL -= ((dratio * sigma**2 + 2 * ratio * sigma * dsigma) / self.stiffness)[:, None] * L
        ddO_dL -= (ratio * sigma**2 / self.stiffness)[:, None] * dL
        return ddO_dsigma, ddO_dL


class Wanted(NamedTuple):
    """One target: its name as given, the function, its limits, and 1 or −1 where the smallest or largest is wanted."""

    name: str
    objective: Objective
    low: float
    high: float
    goal: int

    @property
    def size(self) -> float:
        """Errors are relative to the size of a target, and absolute below a hundredth."""
        finite = [abs(limit) for limit in (self.low, self.high) if np.isfinite(limit)]
        return max([*finite, 1e-2]) if finite else 1.0


def wanted(manifold: CriticalManifold, targets: Mapping[str, object]) -> list[Wanted]:
    """The targets in their order; raises `InputError` for unknown names, and for values that are no targets."""
    if not targets:
        raise InputError("give at least one target, such as {'B_0': 0.25}")
    symbols, found = dict[str, str](), list[Wanted]()
    for name, value in targets.items():
        objective, symbol = named_target(manifold, name), ALIASES.get(name, name)
        if symbol in symbols:
            raise InputError(f"the targets {symbols[symbol]} and {name} are the same: give one of them")
        symbols[symbol] = name
        if isinstance(value, str):
            if value not in GOALS:
                raise InputError(
                    f"the target {name} must be a number, a pair of limits, 'largest' or 'smallest', not {value!r:.40}"
                )
            found.append(Wanted(name, objective, -np.inf, np.inf, 1 if value == "smallest" else -1))
        else:
            found.append(Wanted(name, objective, *limits_of(name, value), 0))
    _require_different(found)
    goals = [target.name for target in found if target.goal]
    if len(goals) > 1:
        raise InputError(
            f"only one target can be largest or smallest, not {' and '.join(goals)}: give the others limits"
        )
    return found


def _require_different(targets: list[Wanted]) -> None:
    """Refuse one modulus by two names: B_0 is that of dilation."""
    moduli = [target for target in targets if isinstance(target.objective, TransitionModulus)]
    for n, one in enumerate(moduli):
        for other in moduli[:n]:
            if np.allclose(one.objective.symmetric, other.objective.symmetric, rtol=0, atol=1e-14):  # type: ignore[attr-defined]
                raise InputError(f"the targets {other.name} and {one.name} are the same modulus: give one of them")


def named_target(manifold: CriticalManifold, name: str) -> Objective:
    """The function of a target; raises `InputError` for unknown names."""
    table = _table(manifold)
    symbol = ALIASES.get(name, name) if isinstance(name, str) else None
    if symbol not in table:
        raise InputError(f"no target is called {name!r:.40}: choose from {', '.join(table)}")
    return table[symbol]()


def _table(manifold: CriticalManifold) -> dict[str, Callable[[], Objective]]:
    """The targets by symbol."""
    network = manifold.network
    d, k = network.dimension, network.stiffness
    table: dict[str, Callable[[], Objective]] = {
        "B_0": lambda: transition_modulus(network, dilation(d)),
        "G_0": lambda: transition_modulus(network, pure_shear(d)),
        "V_L": LengthVariance,
        "V_tau": TensionVariance,
        "C_B": lambda: StiffeningCoefficient(manifold),
        "C_G": lambda: StiffeningCoefficient(manifold, of_shear=True),
    }
    for name, strain in zip(*strain_basis(d), strict=True):
        table[f"S_{name}"] = partial(StressComponent, strain, k)
    for name in (name for name in DEFORMATIONS if not deformation_of(name, d).free):
        table[f"modulus[{name}]"] = partial(transition_modulus, network, name)
        table[f"stiffening[{name}]"] = partial(_path_stiffening, manifold, name)
    return table


def _path_stiffening(manifold: CriticalManifold, name: str) -> Objective:
    return PathStiffeningCoefficient(manifold, deformation_of(name, manifold.network.dimension))


@dataclass(frozen=True, eq=False)
class EdgeLimits:
    """Limits (N_b,) of one quantity q of every edge: its length, or its tension or σ in units of their mean."""

    name: str
    low: Array
    high: Array

    @classmethod
    def of(cls, name: str, value: object, n_edges: int) -> EdgeLimits:
        """Limits from a pair of numbers or of arrays; None is no limit."""
        if name not in LIMITED:
            raise InputError(f"no quantity of the edges is called {name!r:.40}: choose from {', '.join(LIMITED)}")
        if not (isinstance(value, tuple | list) and len(value) == 2):
            raise InputError(f"the limits of {name} must be a pair (low, high), each a number, one an edge, or None")
        low, high = (
            np.full(n_edges, sign * np.inf)
            if limit is None
            else edge_values(
                np.full(n_edges, limit) if np.ndim(limit) == 0 else limit, n_edges, f"limit of {name}", positive=False
            )
            for sign, limit in zip((-1, 1), value, strict=True)
        )
        if (low > high).any():
            raise InputError(f"the lower limit of {name} is above the upper one at edge {int(np.argmax(low > high))}")
        if name == "lengths" and (high <= 0).any():
            raise InputError("the upper limit of the lengths must be positive")
        if name != "lengths" and ((low > 1).all() or (high < 1).all()):
            raise InputError(f"the limits of {name} are in units of their mean: they must enclose 1")
        return cls(name, low, high)

    def values(self, balance: Balance) -> Array:
        """q, (N_b,)."""
        q = self._quantities(balance)
        return q if self.name == "lengths" else q / q.mean()

    def rows(self, balance: Balance, edges: NDArray[np.intp]) -> Array:
        """dq/dσ of chosen edges, (m, N_b): one solve with P each."""
        network, sigma, L = balance.network, balance.sigma, balance.bond_vectors
        m, length = len(edges), np.linalg.norm(balance.bond_vectors, axis=1)
        unit = L / length[:, None]
        weight = {"lengths": np.ones_like(sigma), "tensions": sigma, "force_densities": np.zeros_like(sigma)}[self.name]
        direct = {"lengths": np.zeros_like(sigma), "tensions": length, "force_densities": np.ones_like(sigma)}[
            self.name
        ]
        g = network.free_incidence
        spread = g @ balance.factor.solve(g[edges].T.toarray()) if weight.any() else np.zeros((len(sigma), m))
        # ∂|L_β|/∂σ_α = −(g P⁻¹ gᵀ)_αβ L_α·L_β/|L_β|
        rows = -(weight[edges] * spread * (L @ unit[edges].T)).T
        rows[np.arange(m), edges] += direct[edges]
        if self.name == "lengths":
            return np.asarray(rows)
        q = self._quantities(balance)
        mean = q.mean()
        of_mean = balance.pull_back(direct / len(q), (weight / len(q))[:, None] * unit)[0]
        return np.asarray((rows - (q[edges] / mean)[:, None] * of_mean) / mean)

    def _quantities(self, balance: Balance) -> Array:
        if self.name == "force_densities":
            return balance.sigma
        length = np.linalg.norm(balance.bond_vectors, axis=1)
        return length if self.name == "lengths" else balance.sigma * length


def edge_limits(n_edges: int, within: Mapping[str, object]) -> list[EdgeLimits]:
    """The limits of edges, those without any left out."""
    found = [EdgeLimits.of(name, value, n_edges) for name, value in within.items()]
    return [limits for limits in found if np.isfinite(limits.low).any() or np.isfinite(limits.high).any()]


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
