"""The constrained problem of a design: unknowns z of the stresses, a preference, and the targets as constraints.

z = log |σ| for prescribed signs, where every step keeps them, and z = σ for stresses of any sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.critical.manifold import Balance, CriticalConfiguration, CriticalManifold
from critflow.critical.quantity import LengthVariance, Objective, Partials, TensionVariance
from critflow.networks.checks import edge_values
from critflow.networks.network import Array, Network, validated_coordinates
from critflow.quantities.stiffening import Growth, StiffeningCoefficient
from critflow.quantities.table import EdgeLimits, Wanted
from critflow.result import InputError
from critflow.solvers.constrained import Point

# Component of the gradient of a preference along the surface of the targets, relative to 1 plus the largest component
# of the gradient, below which it is least.
TARGET_OPTIMAL = 1e-3
TARGET_NEAREST = 2e-2  # TARGET_OPTIMAL of the least change, least to 1e-3 then: it only selects

PREFERENCES = {"length_variance": LengthVariance, "tension_variance": TensionVariance}
"""Preferences that are objectives, by name."""


@dataclass(frozen=True, eq=False)
class Unknowns:
    """z (n,) of the free edges, and the stresses of all (N_b,).

    start  σ_0 (N_b,), of mean square one
    free   indices of the edges whose stress may change
    signs  (N_b,) ±1 where z = log |σ|; None for z = σ
    """

    start: Array
    free: NDArray[np.intp]
    signs: Array | None

    @classmethod
    def of(
        cls, network: Network, start: ArrayLike | None, free: str | ArrayLike | None, signs: str | ArrayLike
    ) -> Unknowns:
        """Unknowns from the arguments of `design`; raises `InputError` for wrong shapes and signs."""
        m = network.n_edges
        pattern = _signs(signs, m)
        sigma = np.ones(m) if start is None else edge_values(start, m, "start", positive=False)
        if start is None and pattern is not None:
            sigma = pattern
        if pattern is not None and not (sigma * pattern > 0).all():
            edge = int(np.argmin(sigma * pattern))
            raise InputError(f"start[{edge}] = {sigma[edge]:g} does not have the prescribed sign: change one of them")
        return cls(sigma / np.sqrt(np.mean(sigma**2)), _free(free, m), pattern)

    @property
    def origin(self) -> Array:
        """z of the start, (n,)."""
        return self.of_stress(self.start)

    def of_stress(self, sigma: Array) -> Array:
        """z (n,) of stresses (N_b,)."""
        chosen = sigma[self.free]
        return np.asarray(chosen if self.signs is None else np.log(np.abs(chosen)))

    def stress(self, z: Array) -> Array:
        """σ (N_b,)."""
        sigma = self.start.copy()
        sigma[self.free] = z if self.signs is None else self.signs[self.free] * np.exp(z)
        return sigma

    def gradients(self, by_sigma: Array, sigma: Array) -> Array:
        """Derivatives by z, (..., n), from those by σ, (..., N_b)."""
        rows = by_sigma[..., self.free]
        return np.asarray(rows if self.signs is None else rows * sigma[self.free])


def _signs(signs: str | ArrayLike, m: int) -> Array | None:
    if isinstance(signs, str):
        if signs not in ("positive", "any"):
            raise InputError(f"signs must be 'positive', 'any' or one of 1 and -1 an edge, not {signs!r:.40}")
        return np.ones(m) if signs == "positive" else None
    pattern = edge_values(signs, m, "signs", positive=False)
    if not (np.abs(pattern) == 1).all():
        raise InputError("signs must be 1 for tension or -1 for compression on every edge, or 'positive' or 'any'")
    return pattern


def _free(free: str | ArrayLike | None, m: int) -> NDArray[np.intp]:
    if free is None:
        return np.arange(m)
    if isinstance(free, str):
        raise InputError(
            f"free names edges whose stress may change, not {free!r:.40}: for stiffnesses call design_stiffness, for "
            "rest lengths design_onset"
        )
    array = np.asarray(free)
    if array.dtype == bool and array.shape == (m,):
        array = np.flatnonzero(array)
    if array.ndim != 1 or array.dtype.kind not in "iu" or not len(array):
        raise InputError(f"free must be indices of edges, or a mask of {m}, and name at least one edge")
    if array.min() < 0 or array.max() >= m:
        raise InputError(f"free names edge {array.min() if array.min() < 0 else array.max()}: edges are 0 to {m - 1}")
    return np.unique(array).astype(np.intp)


class Preference:
    """What selects among the configurations with the targets, as a function of z to be minimised.

    change     ½|z − z_0|²
    objective  V_L, V_τ, or a target that is to be largest or smallest, times its sign and N_b
    positions  ½Σ|x + c − x̂|² over the number of vertices, with the translation c of periodic networks
    """

    def __init__(self, network: Network, prefer: str | CriticalConfiguration | ArrayLike, goal: Wanted | None):
        self.objective: Objective | None = None
        self.sign, self.name, self.positions = 1.0, "change", None
        if goal is not None:
            if not (isinstance(prefer, str) and prefer == "least_change"):
                raise InputError(f"{goal.name} is to be {_GOAL[goal.goal]}, which leaves no choice: omit prefer")
            self.objective, self.sign, self.name = goal.objective, float(goal.goal), goal.name
        elif isinstance(prefer, str):
            if prefer in PREFERENCES:
                self.objective, self.name = PREFERENCES[prefer](), prefer
            elif prefer != "least_change":
                names = ", ".join(("least_change", *PREFERENCES))
                raise InputError(f"no preference is called {prefer!r:.40}: choose from {names}, or give coordinates")
        else:
            x = prefer.coordinates if isinstance(prefer, CriticalConfiguration) else prefer
            self.positions, self.name = validated_coordinates(network, x), "distance"

    @property
    def tolerance(self) -> float:
        """Relative gradient at which it is least."""
        return TARGET_NEAREST if self.name == "change" else TARGET_OPTIMAL

    def at(self, balance: Balance, unknowns: Unknowns, z: Array) -> tuple[float, Array]:
        """The value and its gradient by z, (n,)."""
        if self.objective is not None:
            value, partials = self.objective.evaluate(balance.sigma, balance.bond_vectors)
            gradient = unknowns.gradients(balance.pull_back(*partials)[0], balance.sigma)
            # Times the number of edges, so that components of the gradient are of order one.
            size = self.sign * len(balance.sigma)
            return size * value, size * gradient
        if self.positions is None:
            change = z - unknowns.origin
            return 0.5 * float(change @ change), change
        network = balance.network
        apart = network.all_coordinates(balance.coordinates) - self.positions
        if not network.pins:
            apart -= apart.mean(axis=0)
        y = balance.factor.solve(apart[network.free])
        by_sigma = -np.einsum("ad,ad->a", balance.bond_vectors, network.free_incidence @ y) / len(apart)
        return 0.5 * float(np.sum(apart**2)) / len(apart), unknowns.gradients(by_sigma, balance.sigma)

    def shown(self, value: float, n_edges: int) -> float:
        """A value of the function, or its derivative, in the units of the objective."""
        return value if self.objective is None else self.sign * value / n_edges


_GOAL = {1: "smallest", -1: "largest"}


class TargetProblem:
    """A preference and targets of one network as a `critflow.solvers.constrained.Problem`, in units of their sizes.

    The first constraints are the targets with limits, the others the limits of edges.
    """

    def __init__(
        self,
        manifold: CriticalManifold,
        unknowns: Unknowns,
        preference: Preference,
        targets: Sequence[Wanted],
        limits: Sequence[EdgeLimits],
    ):
        self.manifold, self.unknowns, self.preference = manifold, unknowns, preference
        self.targets = [target for target in targets if not target.goal]
        self.limits = limits
        self.sizes = np.array([target.size for target in self.targets])
        own_low, own_high = (np.array([getattr(t, end) for t in self.targets]) for end in ("low", "high"))
        self.low = np.concatenate([own_low / self.sizes, *(limit.low for limit in limits)])
        self.high = np.concatenate([own_high / self.sizes, *(limit.high for limit in limits)])

    def at(self, z: Array) -> Point:
        sigma = self.unknowns.stress(z)
        balance = self.manifold.balance(sigma)
        n = len(self.targets)
        with np.errstate(all="ignore"):
            value, gradient = self.preference.at(balance, self.unknowns, z)
            values, rows = self.values(balance, [target.objective for target in self.targets])
            edges = [limit.values(balance) for limit in self.limits]
        rows = self.unknowns.gradients(rows, sigma) / self.sizes[:, None]

        def of(indices: NDArray[np.intp]) -> Array:
            parts = [rows[indices[indices < n]]]
            first = n
            for limit in self.limits:
                own = indices[(indices >= first) & (indices < first + len(sigma))] - first
                parts.append(self.unknowns.gradients(limit.rows(balance, own), sigma))
                first += len(sigma)
            return np.concatenate(parts)

        return Point(z, value, gradient, np.concatenate([values / self.sizes, *edges]), of)

    def values(self, balance: Balance, objectives: Sequence[Objective]) -> tuple[Array, Array]:
        """Values (n,) of objectives and their gradients by σ (n, N_b)."""
        values, partials = np.empty(len(objectives)), list[Partials]()
        growth: Growth | None = None
        for n, objective in enumerate(objectives):
            if isinstance(objective, StiffeningCoefficient):
                growth = growth or Growth(self.manifold, balance.sigma, balance.bond_vectors)
                values[n], own = objective.of(growth)
            else:
                values[n], own = objective.evaluate(balance.sigma, balance.bond_vectors)
            partials.append(own)
        return values, balance.pull_backs(partials)
