"""Design for targets: the critical configuration nearest to a given one that has requested properties.

    minimise ½|θ − θ_0|² over θ = log σ, to about 1e-3, subject to  O_i(θ) = t_i  or  O_i in an interval,
where θ − θ_0 = Jᵀμ with the gradients J of the targets, which are exact: one solve with P for each.  Shortest steps
restore the targets, and steps along their surface reduce the distance.  There are N_b unknowns and few targets, so
feasible ones have many solutions, and the nearest one changes the stresses least.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import checked
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.critical.objectives import (
    LengthVariance,
    Objective,
    Partials,
    TensionVariance,
    dilation,
    pure_shear,
    transition_modulus,
)
from critflow.design.modulus_bounds import modulus_bound
from critflow.design.optimize import optimize
from critflow.design.tolerances import INDEPENDENT_TARGETS, TARGET_REACHED, TARGET_STATIONARY
from critflow.mechanics.stiffening_objective import StiffeningCoefficient
from critflow.networks.deformation import strain_basis
from critflow.networks.network import Array, Network, edge_values
from critflow.result import InputError, Solution, Stats, Status

_MOST_STEPS = 100
# Longest change of log σ in one step; part of a step below which the search ends.
_LONGEST, _SHORTEST = 1.0, 1e-3
# Steps that may restore the targets after one along their surface.
_RESTORING, _APPROACHES = 6, 30
# Distance from a limit, relative to the size of a target, beyond which a value is inside its interval.
_INSIDE = 1e-9

Interval = float | tuple[float, float]


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


@dataclass(frozen=True, eq=False, kw_only=True)
class Design(Solution[CriticalConfiguration]):
    """A configuration with requested properties.

    achieved     values of the targets by name
    multipliers  cost of each target, by name: the derivative of ½|θ − θ_0|² by its value
    gram         (n, n) cosines between the gradients of the targets: 1 where two cannot be changed independently
    independent  whether all targets can be changed independently here: the least eigenvalue of `gram` is not zero
    distance     root mean square of log σ − log σ_0
    """

    achieved: dict[str, float]
    multipliers: dict[str, float]
    gram: Array = field(repr=False)
    independent: bool
    distance: float


@checked
def design(
    network: Network | CriticalManifold,
    targets: Mapping[str, Interval],
    start: ArrayLike | None = None,
    max_steps: int = _MOST_STEPS,
    throw: bool = True,
) -> Design:
    """The critical configuration with requested properties that changes the stresses of a start least.

    targets  name → value, or (low, high); names are "bulk_modulus", "shear_modulus", "length_variance",
             "tension_variance", "C_B", "C_G" (energy convention), and "S_xx", "S_xy", ... for S/√D
    start    stresses σ_0 (N_b,); 1 on every edge by default, and those of the largest shear modulus where the targets
             cannot be reached from there

    `stats.residual` is the largest error of a target relative to its size.  The optimum is local.
    Error bound (proof): targets beyond `modulus_bound` are refused, `Status.infeasible`, with the bound in the note.
    Otherwise `Status.infeasible` means that the descent found no way to reduce the errors further: the configuration is
    the best compromise found.  Raises `InputError` for unknown or contradictory targets, `SolveError` with `throw`.
    """
    manifold = CriticalManifold.of(network)
    goals = _Goals(manifold, targets)
    m = manifold.network.n_edges
    origin = np.zeros(m) if start is None else np.log(edge_values(start, m, "start"))
    origin = origin - origin.mean()
    excess = goals.excess()
    if excess:
        solution = goals.report(origin, origin, np.zeros(len(goals.names)), 0, Status.infeasible, excess)
    else:
        solution = goals.report(*_nearest(goals, origin, max_steps))
        if start is None and not solution.ok:
            solution = _from_optimum(goals, solution, max_steps)
    return solution.or_raise("no configuration with these properties was found") if throw else solution


def _from_optimum(goals: _Goals, first: Design, max_steps: int) -> Design:
    """The design from the stresses of the largest shear modulus, if it reaches the targets where the first did not."""
    sheared = optimize(goals.manifold, "shear_modulus", throw=False, max_steps=200).value.sigma
    if not (np.isfinite(sheared).all() and (sheared > 0).all()):
        return first
    origin = np.log(sheared) - np.mean(np.log(sheared))
    second = goals.report(*_nearest(goals, origin, max_steps))
    return second if second.ok or second.stats.residual < first.stats.residual else first


def _nearest(goals: _Goals, origin: Array, max_steps: int) -> tuple[Array, Array, Array, int, Status, str]:
    """θ, θ_0, multipliers, steps, status and note: first the targets, then the distance at constant targets."""
    point, steps, reached = _restored(goals, _Point(origin, *goals.at(origin)), max_steps)
    if not reached:
        status = Status.step_limit if steps >= max_steps else Status.infeasible
        note = "the errors of the targets cannot be reduced together from here: relax one, or give another start"
        return point.theta, origin, point.multipliers(origin), steps, status, note if steps < max_steps else ""
    part = 1.0
    for _ in range(_APPROACHES):
        tangent = point.tangential(origin - point.theta)
        if float(np.abs(tangent).max()) < TARGET_STATIONARY or part < _SHORTEST:
            break
        moved = point.theta + min(part, _LONGEST / float(np.abs(tangent).max())) * tangent
        trial, more, reached = _restored(goals, _Point(moved, *goals.at(moved)), _RESTORING)
        steps += more + 1
        if reached and np.linalg.norm(trial.theta - origin) < np.linalg.norm(point.theta - origin):
            point, part = trial, min(1.0, 2 * part)
        else:
            part *= 0.25
    return point.theta, origin, point.multipliers(origin), steps, Status.ok, ""


@dataclass(frozen=True, eq=False)
class _Point:
    """θ, the relative errors of the targets (n,), their gradients J (n, N_b), and those not inside limits (n,)."""

    theta: Array
    error: Array
    J: Array
    active: NDArray[np.bool_]

    def normal(self, damping: float) -> Array:
        """The shortest change of θ that removes the errors to first order."""
        weights = self.J @ self.J.T
        weights[np.diag_indices(len(weights))] += damping * np.trace(weights) + np.finfo(float).tiny
        return np.asarray(-self.J.T @ np.linalg.lstsq(weights, self.error, rcond=1e-13)[0])

    def multipliers(self, origin: Array) -> Array:
        """μ of θ − θ_0 = Jᵀμ in the sense of least squares, (n,)."""
        mu = np.zeros(len(self.J))
        mu[self.active] = np.linalg.lstsq(self.J[self.active].T, self.theta - origin, rcond=None)[0]
        return mu

    def tangential(self, change: Array) -> Array:
        """The part of a change that leaves the targets constant to first order."""
        J = self.J[self.active]
        return np.asarray(change - J.T @ np.linalg.lstsq(J.T, change, rcond=None)[0])


def _restored(goals: _Goals, point: _Point, max_steps: int) -> tuple[_Point, int, bool]:
    """Damped Gauss-Newton steps until all errors are below `TARGET_REACHED`; steps, and whether they are."""
    damping, size = 0.0, float(np.linalg.norm(point.error))
    for step in range(max_steps):
        if np.abs(point.error).max() < TARGET_REACHED:
            return point, step, True
        change = point.normal(damping)
        change *= min(1.0, _LONGEST / max(float(np.abs(change).max()), 1e-300))
        theta = point.theta + change
        trial = _Point(theta, *goals.at(theta))
        there = float(np.linalg.norm(trial.error))
        if there < size:
            point, size, damping = trial, there, 0.1 * damping if damping > 1e-8 else 0.0
        elif size < 100 * TARGET_REACHED and not damping:
            return point, step, True
        elif damping > 1e6:
            return point, step, False
        else:
            damping = max(10 * damping, 1e-6)
    return point, max_steps, bool(np.abs(point.error).max() < TARGET_REACHED)


class _Goals:
    """The targets of one network: objectives, limits and sizes."""

    def __init__(self, manifold: CriticalManifold, targets: Mapping[str, Interval]):
        self.manifold = manifold
        if not targets:
            raise InputError("give at least one target, such as {'bulk_modulus': 0.25}")
        table = _table(manifold)
        unknown = [name for name in targets if name not in table]
        if unknown:
            raise InputError(f"no target is called {unknown[0]!r}: choose from {', '.join(table)}")
        self.names = tuple(targets)
        self.objectives = [table[name]() for name in self.names]
        limits = [_limits(name, value) for name, value in targets.items()]
        self.low, self.high = (np.array(values) for values in zip(*limits, strict=True))
        # Errors are relative to the size of the target, and absolute below a hundredth.
        self.scale = np.maximum(np.maximum(np.abs(self.low), np.abs(self.high)), 1e-2)
        self.scale[~np.isfinite(self.scale)] = 1.0

    def values(self, theta: Array) -> tuple[Array, Array]:
        """Values (n,) and gradients by θ (n, N_b)."""
        balance = self.manifold.balance(np.exp(theta))
        values, rows = [], []
        for objective in self.objectives:
            value, (by_sigma, by_L) = objective.evaluate(balance.sigma, balance.bond_vectors)
            values.append(value)
            rows.append(balance.pull_back(by_sigma, by_L)[0] * balance.sigma)
        return np.array(values), np.array(rows)

    def at(self, theta: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Relative errors (n,), 0 inside an interval, their gradients (n, N_b), and the targets not inside (n,)."""
        values, rows = self.values(theta)
        error = values - np.clip(values, self.low, self.high)
        margin = _INSIDE * self.scale
        active = (values < self.low + margin) | (values > self.high - margin)
        return error / self.scale, rows / self.scale[:, None], active

    def excess(self) -> str:
        """A sentence where closed-form bounds exclude the targets, else an empty string."""
        network = self.manifold.network
        for name, low in zip(self.names, self.low, strict=True):
            strain = {"bulk_modulus": dilation, "shear_modulus": pure_shear}.get(name)
            if strain is not None:
                bound = modulus_bound(self.manifold, strain(network.dimension))
                if low > bound * (1 + 1e-12):
                    return (
                        f"{name} is at most {bound:.8g} for every stress of this network, and {low:.8g} was requested"
                    )
        return self._excess_of_stress()

    def _excess_of_stress(self) -> str:
        """The bound (S:A)² ≤ V D μ_A of a fully prescribed S, for the worst strain A."""
        network, d = self.manifold.network, self.manifold.network.dimension
        names, strains = strain_basis(d)
        wanted = [f"S_{name}" for name in names]
        given = dict(zip(self.names, zip(self.low, self.high, strict=True), strict=True))
        if not all(name in given and given[name][0] == given[name][1] for name in wanted):
            return ""
        m = len(strains)
        S = np.array([given[name][0] for name in wanted])
        # μ_A is a quadratic form of the strain: its matrix follows from sums of two strains.
        form = np.empty((m, m))
        for a in range(m):
            for b in range(a + 1):
                form[a, b] = form[b, a] = modulus_bound(self.manifold, strains[a] + strains[b])
        single = np.diag(form) / 4
        form = 0.5 * (form - single[:, None] - single[None])
        ratio = float(S @ np.linalg.solve(form * network.volume, S))
        if ratio <= 1 + 1e-12:
            return ""
        return f"S/√D exceeds its bound for every stress of this network by a factor of {np.sqrt(ratio):.6g}"

    def report(self, theta: Array, origin: Array, mu: Array, steps: int, status: Status, note: str) -> Design:
        """The design at θ."""
        found = self.manifold.solve(np.exp(theta))
        values, rows = self.values(theta)
        unit = rows / np.maximum(np.linalg.norm(rows, axis=1), np.finfo(float).tiny)[:, None]
        gram = unit @ unit.T
        error = np.abs(values - np.clip(values, self.low, self.high)) / self.scale
        stats = Stats("restoration", steps, float(error.max()), error_bound=found.value.error_bound)
        return Design(
            value=found.value,
            status=status if found.ok else found.status,
            stats=stats,
            note=note,
            achieved=dict(zip(self.names, map(float, values), strict=True)),
            multipliers=dict(zip(self.names, map(float, mu / self.scale), strict=True)),
            gram=gram,
            independent=bool(np.linalg.eigvalsh(gram)[0] > INDEPENDENT_TARGETS),
            distance=float(np.sqrt(np.mean((theta - theta.mean() - origin) ** 2))),
        )


def _table(manifold: CriticalManifold) -> dict[str, Callable[[], Objective]]:
    """The targets by name."""
    network = manifold.network
    d, k = network.dimension, network.stiffness
    table: dict[str, Callable[[], Objective]] = {
        "bulk_modulus": lambda: transition_modulus(network, dilation(d)),
        "shear_modulus": lambda: transition_modulus(network, pure_shear(d)),
        "length_variance": LengthVariance,
        "tension_variance": TensionVariance,
        "C_B": lambda: StiffeningCoefficient(manifold),
        "C_G": lambda: StiffeningCoefficient(manifold, of_shear=True),
    }
    for name, strain in zip(*strain_basis(d), strict=True):
        table[f"S_{name}"] = partial(StressComponent, strain, k)
    return table


def _limits(name: str, value: Interval) -> tuple[float, float]:
    """Low and high limit of a target."""
    low, high = value if isinstance(value, tuple | list) and len(value) == 2 else (value, value)
    try:
        limits = float(low), float(high)
    except (TypeError, ValueError):
        raise InputError(f"the target {name} must be a number or a pair of limits, not {value!r:.40}") from None
    if np.isnan(limits).any() or limits[0] > limits[1] or np.isinf(limits).all():
        raise InputError(f"the target {name} must be a number or a pair (low, high), not {value!r:.40}")
    return limits
