"""Descents of an objective over stress: methods, monitors of a descent, and optima that are not attained."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from critflow.critical.manifold import CriticalConfiguration
from critflow.linalg.vectors import dot
from critflow.networks.network import Array
from critflow.optimisation.largest_modulus import Optimum
from critflow.optimisation.minimize import METHODS, Fire, Method, Minimum, Point, minimise
from critflow.optimisation.saddles import Descent, minimise_past_saddles
from critflow.optimisation.stress_objective import SignedStressObjective, StressObjective
from critflow.progress import tell
from critflow.result import Status

FADED = 1e-12  # σ that tends to zero, where Σσ² = N_b: far below the stresses of any optimum (1e-3)
# Ratio of a stress to the median, at most, from which a failed descent is repeated: from 10 or 100 a few starts of
# small networks return to limits that are no infima.
MODERATE = 3.0
# Change of log σ from a start at which an edge has no length, as one between vertices with the same neighbours has at
# equal stresses: no gradient leads away from it.
PERTURBATION = 0.3
UNRESOLVED_STRESS = 1e-20  # least σ, where Σσ² = N_b, at which a descent ends without an optimum: far below FADED
COLLAPSING = 1e-4  # length of an edge under tension that tends to zero, in units of the mean
TENSE = 0.01  # tension of an edge that does not fall slack, in units of the mean
GAINING = 0.1  # gain of an edge that collapses, relative to the largest gain: isogonal modes shorten others without
# Shortest length, in units of the mean, and square root of the least stress of a configuration returned for an optimum
# that is not attained: shorter edges lose digits in the rounding of the coordinates.
SOUND = 1e-2
# Length of the shortest edge, in units of the mean, at which a descent ends without an optimum: half of the digits of
# its direction are lost.
UNRESOLVED_LENGTH = 1e-8
# Gain that remains at an infimum in the edges that do not tend to their limits, relative to the value; standard
# networks reach 4e-4, and false infima have more than 1e-2.
CONVERGED_REST = 1e-3
# Gradients above which a descent was stopped early on purpose, by a rough tolerance, and up to which it was not, as by
# default.  Between them only a start with a symmetry leads to a saddle, but for accidents.
STOPPED, STATIONARY = 1e-8, 1e-12
SYMMETRIC = 1e-9  # distance of two components of a gradient, relative to all, of edges that are images of each other
# Smallest pivot over the largest of a nearly singular prestress matrix: lengths are then known to 1e-7.
NEARLY_SINGULAR = 1e-9
TRAPPED = 20  # number of successive steps at nearly singular matrices that show a limit at a singular one

# Minimisers of each method in turn: "auto" continues with Newton's method where gradients alone do not converge.
DESCENTS = {"fire": ("fire",), "lbfgs": ("lbfgs",), "newton": ("newton",), "auto": ("lbfgs", "newton")}

_LOCAL = "the value is local, and other starts may have a better one: give starts and rng"
# Step limits: several times the steps that standard networks of 1,000 vertices need.
_MAX_STEPS = {"fire": 200_000, "lbfgs": 3_000, "newton": 200}
# Descents repeated from moderate stresses.
_REPEATS = 2
_NOT_ATTAINED = (Status.edge_collapse, Status.slack_edges)

Observer = Callable[[int, float, Array, Array], Any]
"""Called with step, value of the objective, σ (N_b,) and L (N_b, d); a true result ends the descent."""


def descend(
    objective: StressObjective,
    method: str,
    start: Array,
    tolerance: float,
    max_steps: int | None = None,
    observe: Observer | None = None,
) -> Optimum:
    """The optimum of an objective from a start σ (N_b,), by one of `DESCENTS`.

    A descent that ends at vanishing lengths or stresses, or stalls, is repeated from its end with stresses of moderate
    ratios: stresses that a bad start or a long step drove apart hardly change along the gradient.  One that cannot
    begin is repeated from stresses near its start.

    `Status.edge_collapse`, `Status.slack_edges` or `Status.singular` where the optimum is not attained: the limit of
    the value, with the last configuration of the descent that is accurate.  `Status.stalled` has that configuration too
    where edges became too short to resolve.
    """
    manifold = objective.manifold
    signed = isinstance(objective, SignedStressObjective)
    monitor = (SignedDescentMonitor if signed else DescentMonitor)(objective, observe)
    repeated = partial(_repeated, objective, partial(_minimise, objective, method, tolerance, monitor), monitor)
    end, saddles = minimise_past_saddles(
        objective, repeated, objective.unknowns(start), max_steps, partial(_saddle_is_possible, monitor)
    )
    balance = end.point.state.balance
    reached = manifold.solve(balance.sigma, balance=balance)
    optimum = Optimum(
        value=reached.value,
        status=end.status,
        stats=replace(reached.stats, method=method, steps=end.steps, residual=end.point.residual),
        objective=objective.unit * end.point.value,
        saddles=saddles,
        crossings=tuple(monitor.crossings),
        nearest_singular=monitor.nearest_singular,
        negative_pivots=monitor.negative_pivots,
    )
    if end.status in _NOT_ATTAINED:
        return _infimum(optimum, end, objective, monitor)
    if monitor.diverges(end):
        limit = f"the value tends to {optimum.objective:.8g} as the prestress matrix becomes singular and lengths grow"
        return _at(objective, monitor.last_sound, replace(optimum, status=Status.singular, note=f"{limit} without end"))
    if not reached.ok:
        return replace(optimum, status=reached.status, objective=np.nan)
    if end.status is Status.stalled and reached.value.lengths.min() < SOUND**2 * reached.value.lengths.mean():
        note = f"edges become too short to resolve as the value falls to {optimum.objective:.6g}: try another start"
        return _at(objective, monitor.last_sound, replace(optimum, note=note))
    if end.status is Status.stalled and reached.value.sigma.min() < FADED:
        edge = int(reached.value.sigma.argmin())
        note = f"stresses fade, that of edge {edge} first, before the others have converged: {_LOCAL}"
        return replace(optimum, note=note)
    return optimum


def _repeated(
    objective: StressObjective, run: Descent, monitor: DescentMonitor, x: Array, max_steps: int | None
) -> Minimum:
    """The descent from x (N_b,), repeated from moderate stresses where it does not end at an optimum."""
    end = run(x, max_steps)
    steps = end.steps
    for _ in range(_REPEATS):
        left = None if max_steps is None else max_steps - steps
        repeatable = end.status in (*_NOT_ATTAINED, Status.stalled, Status.singular) and left != 0
        moderate = objective.moderate(end.point.x, MODERATE) if repeatable and not monitor.ended else None
        if moderate is not None and not end.steps:
            moderate = moderate + PERTURBATION * np.random.default_rng(0).standard_normal(len(moderate))
        if moderate is None or np.array_equal(moderate, end.point.x):
            break
        again = run(moderate, left)
        steps += again.steps
        if not _improves(again, end):
            break
        end = again
    return replace(end, steps=steps)


def _saddle_is_possible(monitor: DescentMonitor, end: Minimum) -> bool:
    """Whether the end of a descent is tested: always where it is as stationary as by default."""
    residual, start = end.point.residual, monitor.start
    if not STATIONARY < residual <= STOPPED:
        return residual <= STATIONARY
    return bool(np.diff(np.sort(start)).min(initial=np.inf) < SYMMETRIC * np.ptp(start))


def _improves(again: Minimum, end: Minimum) -> bool:
    """Whether a repeated descent replaces the end of the first one."""
    ended = [one.status in (Status.ok, *_NOT_ATTAINED) for one in (again, end)]
    if ended[0] != ended[1]:
        return ended[0]
    margin = 0.0
    if end.status in _NOT_ATTAINED:
        # Two approaches to one infimum differ by their distances from it.
        margin = float(np.abs(end.point.gradient).sum()) * (-1.0 if again.status in _NOT_ATTAINED else 1.0)
    return bool(again.point.value < end.point.value + margin) or not np.isfinite(end.point.value)


def _minimise(
    objective: StressObjective, method: str, tolerance: float, monitor: DescentMonitor, x: Array, max_steps: int | None
) -> Minimum:
    """One descent from x (N_b,), without a test for saddles."""
    steps = 0
    for name in DESCENTS[method]:
        minimiser: Method[Any] = Fire(objective.time_step) if name == "fire" else METHODS[name]()
        left = _MAX_STEPS[name] if max_steps is None else max_steps - steps
        end = minimise(objective, minimiser, x, tolerance, left, monitor, STATIONARY)
        steps += end.steps
        if end.status not in (Status.step_limit, Status.stalled) or monitor.ended or steps == max_steps:
            break
        x = end.point.x
    return replace(end, steps=steps)


class DescentMonitor:
    """Observes the points of a descent and ends it where edges collapse or fall slack.

    last_sound  unknowns of the last configuration without edges shorter, or stresses weaker, than `SOUND` allows;
                σ = 1 without one
    start       gradient at the first point, (N_b,)
    ended       whether the observer ended the descent
    """

    def __init__(self, objective: StressObjective, observe: Observer | None = None):
        self.objective, self._observe, self._step = objective, observe, 0
        self.last_sound = np.zeros(objective.manifold.network.n_edges)
        self.start = np.zeros_like(self.last_sound)
        self.crossings: list[int] = []
        self.nearest_singular = np.nan
        self.negative_pivots: int | None = None
        self.ended, self._trapped = False, 0

    def __call__(self, point: Point) -> Status | None:
        if not self._step:
            self.start = point.gradient
        status, balance = self._status(point), point.state.balance
        value = self.objective.unit * point.value
        enough = self._observe is not None and self._observe(self._step, value, balance.sigma, balance.bond_vectors)
        self._step += 1
        tell(f"step {self._step}")
        self.ended = bool(enough) and status is None
        return Status.step_limit if self.ended else status

    def _status(self, point: Point) -> Status | None:
        sigma, L = point.state.balance.sigma, point.state.balance.bond_vectors
        length = np.sqrt(dot(L, L))
        if length.min() * len(length) > SOUND * length.sum() and sigma.min() > SOUND**2:
            # Far from all limits below.
            self.last_sound = point.x
            return None
        tension = sigma * length
        # An edge tends to its limit if the value decreases in that direction; a bad start may lie there without reason.
        gradient = point.gradient
        fading = (sigma < FADED) & (gradient > 0)
        vanishing = (length < COLLAPSING * length.mean()) & (tension > TENSE * tension.mean()) & (gradient < 0)
        for limit, found in ((Status.slack_edges, fading), (Status.edge_collapse, vanishing)):
            if found.any():
                edges = _leaving(limit, sigma, length, gradient)
                rest = float(np.abs(np.delete(gradient, edges)).sum())
                if rest < CONVERGED_REST * abs(point.value):
                    return limit
        unresolved = sigma.min() < UNRESOLVED_STRESS or length.min() < UNRESOLVED_LENGTH * length.mean()
        return Status.stalled if unresolved else None

    def diverges(self, end: Minimum) -> bool:
        """Whether the descent ended because lengths grow without end, which positive stresses exclude."""
        ended = end.status in (Status.singular, Status.stalled) and self._trapped > 0
        return ended and bool(np.isfinite(self.last_sound).all())


class SignedDescentMonitor(DescentMonitor):
    """Observes the inertia of P(σ), and ends a descent towards a singular P, where lengths grow without end.

    last_sound  unknowns of the last configuration with a regular P; NaN without one
    """

    def __init__(self, objective: StressObjective, observe: Observer | None = None):
        super().__init__(objective, observe)
        self.last_sound = np.full_like(self.last_sound, np.nan)
        self.nearest_singular = np.inf

    def _status(self, point: Point) -> Status | None:
        factor = point.state.balance.factor
        pivots = np.abs(factor.pivots)
        self.nearest_singular = min(self.nearest_singular, float(pivots.min() / pivots.max()))
        if self.negative_pivots is not None and factor.n_negative != self.negative_pivots:
            self.crossings.append(self._step)
        self.negative_pivots = factor.n_negative
        self._trapped = self._trapped + 1 if pivots.min() < NEARLY_SINGULAR * pivots.max() else 0
        if not self._trapped:
            self.last_sound = point.x
        return Status.singular if factor.singular or self._trapped > TRAPPED else None


def _infimum(optimum: Optimum, end: Minimum, objective: StressObjective, monitor: DescentMonitor) -> Optimum:
    """The infimum that a descent approaches without attaining it: its value, and the edges that vanish or fall slack.

    A vanishing length is ∝ 1/σ and its gain ∝ 1/σ, that of a vanishing stress ∝ σ: the gain that remains is the
    gradient in log σ.  Error bound (estimate) of the limit: this gain and all other components of the gradient.
    """
    gradient, collapse = end.point.gradient, end.status is Status.edge_collapse
    edges = _leaving(end.status, optimum.value.sigma, optimum.value.lengths, gradient)
    change = "shrink to zero length" if collapse else "lose their tension"
    left = float(np.abs(gradient[edges]).sum())
    limit = objective.unit * (end.point.value - left)
    listed = ", ".join(map(str, edges))
    optimum = replace(
        optimum,
        note=f"edges {listed} {change} towards the infimum {limit:.8g}, which is not attained: {_LOCAL}",
        objective=limit,
        uncertainty=abs(objective.unit) * (left + float(np.abs(np.delete(gradient, edges)).sum())),
        collapsed_edges=edges if collapse else edges[:0],
        slack_edges=edges[:0] if collapse else edges,
        saddles=None,
    )
    return _at(objective, monitor.last_sound, optimum)


def _leaving(limit: Status, sigma: Array, length: Array, gradient: Array) -> NDArray[np.intp]:
    """The edges that shrink to zero length or lose their tension, by a gradient in log σ that is to be descended."""
    if limit is Status.slack_edges:
        return np.flatnonzero((sigma < 1e3 * FADED) & (gradient > 0))
    # Short edges with a gain: an isogonal mode may shorten others without one.
    gain = np.where(length < 0.5 * SOUND * length.mean(), -gradient / length, 0.0)
    return np.flatnonzero(gain > GAINING * gain.max())


def _at(objective: StressObjective, x: Array, optimum: Optimum) -> Optimum:
    """The same optimum with the configuration at other unknowns x (N_b,)."""
    value: CriticalConfiguration = objective.manifold.configuration(objective.sigma(x))
    return replace(optimum, value=value, stats=replace(optimum.stats, error_bound=value.error_bound))
