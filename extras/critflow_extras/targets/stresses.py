"""Stresses as the variables of a design: z = log |σ| for prescribed signs, which every step keeps, or z = σ."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import edge_values
from critflow.manifold import Balance, CriticalConfiguration, CriticalManifold, require_one_stress_by_count
from critflow.networks import Array
from critflow.optima import optimize
from critflow.quantities import Quantity
from critflow.result import InputError
from critflow_extras.sensitivities.gradients import pull_backs
from critflow_extras.targets.constrained import Minimum, Problem, minimise_constrained
from critflow_extras.targets.problem import (
    POWERS,
    DesignOptions,
    DesignResult,
    EdgeLimits,
    Target,
    Variables,
    require_all_valid,
)
from critflow_extras.targets.refusals import limiting_stress, refusal_of

UNLIMITED = 1e-6  # gradient of a target by log σ, in units of its size, below which a search cannot start there

# Steps of one start in which the targets must be reached; spread of random starts, and steps of the ascent that gives
# the last start.
_RESTORING, _SPREADS, _ASCENT = 60, (0.1, 0.5), 30


class Stresses(Variables):
    """The stresses of the free edges, and the configuration that they balance.

    start   σ_0 (N_b,), of mean square one
    free    indices of the edges whose stress may change
    signs   (N_b,) ±1 where z = log |σ|; None for z = σ
    limits  of lengths, tensions and force densities
    """

    limited_quantities = tuple(POWERS)
    longest = 0.4
    # Component of the gradient of the change along the surface of the targets, relative to 1 plus the largest one: the
    # change is then mostly least to 1e-3; it only selects.
    tolerance = 2e-2
    nearest = 1e-3  # the same of the distance to given coordinates, at most

    def __init__(
        self,
        manifold: CriticalManifold,
        start: ArrayLike | None = None,
        free: ArrayLike | None = None,
        signs: str | ArrayLike = "positive",
        limits: Sequence[EdgeLimits] = (),
    ):
        m = manifold.network.n_edges
        self.manifold, self.network, self.limits = manifold, manifold.network, limits
        self.signs = _signs(signs, m)
        sigma = np.ones(m) if start is None else edge_values(start, m, "start", positive=False)
        if start is None and self.signs is not None:
            sigma = self.signs
        if self.signs is not None and not (sigma * self.signs > 0).all():
            edge = int(np.argmin(sigma * self.signs))
            raise InputError(f"start[{edge}] = {sigma[edge]:g} does not have the prescribed sign: change one of them")
        self.start, self.free = sigma / np.sqrt(np.mean(sigma**2)), _free(free, m)
        self.origin = self.of_stress(self.start)
        self.low = np.concatenate([np.zeros(0), *(limit.low for limit in limits)])
        self.high = np.concatenate([np.zeros(0), *(limit.high for limit in limits)])
        self._targets: list[Target] = []

    @classmethod
    def of(cls, start: Any, options: DesignOptions) -> Self:
        manifold = start if isinstance(start, CriticalManifold) else CriticalManifold(options.network)
        of_start = start.sigma if isinstance(start, CriticalConfiguration) else None
        sigma = of_start if options.initial is None else options.initial
        signs = "positive" if options.signs is None else options.signs
        return cls(manifold, sigma, options.free, signs, options.limits(cls))

    @property
    def positive(self) -> bool:
        """Whether every stress is positive."""
        return self.signs is not None and bool((self.signs > 0).all())

    @property
    def _has_moduli(self) -> bool:
        """Whether moduli have their formula: a volume, several dimensions, and one self-stress by the counts."""
        network = self.network
        return network.has_volume and network.dimension > 1 and network.least_self_stresses <= 1

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

    def at(self, z: Array) -> Balance:
        return self.manifold.balance(self.stress(z))

    def values(self, state: Balance, quantities: Sequence[Quantity]) -> tuple[Array, Array]:
        values, partials = np.empty(len(quantities)), []
        for n, quantity in enumerate(quantities):
            values[n], own = quantity.evaluate(state)
            partials.append(own)
        return values, self.gradients(pull_backs(state, partials), state.sigma)

    def limited(self, state: Balance) -> Array:
        return np.concatenate([np.zeros(0), *(limit.values(state) for limit in self.limits)])

    def limited_rows(self, state: Balance, indices: NDArray[np.intp]) -> Array:
        m = len(state.sigma)
        parts = [
            self.gradients(limit.rows(state, indices[(indices >= first) & (indices < first + m)] - first), state.sigma)
            for first, limit in zip(range(0, m * len(self.limits), m), self.limits, strict=True)
        ]
        return np.concatenate([np.zeros((0, len(self.origin))), *parts])

    def refusal(self, targets: Sequence[Target]) -> str:
        if any(target.quantity.one_self_stress for target in targets):
            require_one_stress_by_count(self.manifold.network)
        require_all_valid(self, targets)
        self._targets = list(targets)
        return refusal_of(self.manifold, targets, self.positive)

    def search(self, problem: Problem, tolerance: float, max_steps: int) -> Minimum:
        """The first search that reaches the targets, or the one with the smallest violation, continued to its end."""
        best: Minimum | None = None
        left = max_steps
        for start in self._starts(problem):
            end = minimise_constrained(problem, start, tolerance, self.longest, left, restoring=_RESTORING)
            left -= end.steps
            if best is None or end.reached or not end.violation >= best.violation:
                best = end
            if end.reached or left <= 0:
                break
        assert best is not None
        if not best.reached and left > 0:
            end = minimise_constrained(problem, best.point.z, tolerance, self.longest, left)
            best = end if end.violation < best.violation else best
        return best

    def _starts(self, problem: Problem) -> Iterator[Array]:
        """z of the start, of random ones, and of an ascent of the shear modulus, whose stresses cover two decades.

        Stresses of any sign start from the largest S/√D in the direction of a prescribed one as well.
        Gradients of B_0 and C_B vanish at σ = k, where B_0 is largest and C_B smallest.
        """
        origin, n_limits = self.origin, len(self.low)
        shaken = np.random.default_rng(0).standard_normal((len(_SPREADS), len(origin)))
        rows = problem.at(origin).rows(np.arange(len(problem.low) - n_limits))
        if not len(rows) or np.linalg.norm(rows, axis=1).min() > UNLIMITED:
            yield origin
        yield origin + _SPREADS[0] * shaken[0]
        if self.positive and self._has_moduli:
            sheared = optimize(self.manifold, "G_0", throw=False, max_steps=_ASCENT).value.sigma
            if np.isfinite(sheared).all() and (sheared > 0).all():
                yield self.of_stress(sheared)
        if self.signs is None:
            limiting = limiting_stress(self.manifold, self._targets)
            if limiting is not None:
                yield self.of_stress(limiting)
        yield origin + _SPREADS[1] * shaken[1]

    def designed(self, z: Array, quantities: Sequence[Quantity]) -> DesignResult:
        return self.at_configuration(self.manifold.solve(self.stress(z)), z, quantities)

    def distance(self, z: Array) -> float:
        change = z - self.origin
        if self.signs is not None and len(self.free) == self.manifold.network.n_edges:
            change = change - change.mean()
        return float(np.sqrt(np.mean(change**2)))


def _signs(signs: str | ArrayLike, m: int) -> Array | None:
    if isinstance(signs, str):
        if signs not in ("positive", "any"):
            raise InputError(f"signs must be 'positive', 'any' or one of 1 and -1 an edge, not {signs!r:.40}")
        return np.ones(m) if signs == "positive" else None
    pattern = edge_values(signs, m, "signs", positive=False)
    if not (np.abs(pattern) == 1).all():
        raise InputError("signs must be 1 for tension or -1 for compression on every edge, or 'positive' or 'any'")
    return pattern


def _free(free: ArrayLike | None, m: int) -> NDArray[np.intp]:
    if free is None:
        return np.arange(m)
    array = np.asarray(free)
    if array.dtype == bool and array.shape == (m,):
        array = np.flatnonzero(array)
    if array.ndim != 1 or array.dtype.kind not in "iu" or not len(array):
        raise InputError(f"free must name at least one edge whose stress may change, by indices or a mask of {m}")
    if array.min() < 0 or array.max() >= m:
        raise InputError(f"free names edge {array.min() if array.min() < 0 else array.max()}: edges are 0 to {m - 1}")
    return np.unique(array).astype(np.intp)
