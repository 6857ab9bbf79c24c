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
from critflow.design.modulus_bounds import modulus_bound, stiffening_bound
from critflow.design.optimize import optimize
from critflow.design.restoration import Interval, limits_of, nearest_solution
from critflow.design.tolerances import INDEPENDENT_TARGETS
from critflow.mechanics.stiffening_objective import StiffeningCoefficient
from critflow.networks.deformation import strain_basis
from critflow.networks.network import Array, Network, edge_values
from critflow.result import InputError, Solution, Stats, Status

_MOST_STEPS = 100
# Distance from a limit, relative to the size of a target, beyond which a value is inside its interval.
_INSIDE = 1e-9


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
        solution = goals.report(*nearest_solution(goals, origin, max_steps))
        if start is None and not solution.ok:
            solution = _from_optimum(goals, solution, max_steps)
    return solution.or_raise("no configuration with these properties was found") if throw else solution


def _from_optimum(goals: _Goals, first: Design, max_steps: int) -> Design:
    """The design from the stresses of the largest shear modulus, if it reaches the targets where the first did not."""
    sheared = optimize(goals.manifold, "shear_modulus", throw=False, max_steps=200).value.sigma
    if not (np.isfinite(sheared).all() and (sheared > 0).all()):
        return first
    origin = np.log(sheared) - np.mean(np.log(sheared))
    second = goals.report(*nearest_solution(goals, origin, max_steps))
    return second if second.ok or second.stats.residual < first.stats.residual else first


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
        limits = [limits_of(name, value) for name, value in targets.items()]
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
        if "C_B" in self.names:
            bound, high = stiffening_bound(self.manifold), self.high[self.names.index("C_B")]
            if high < bound - 1e-12 * abs(bound):
                return f"C_B is at least {bound:.8g} for every positive stress of this network, not {high:.8g}"
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
