"""How a descent ends: its status, the condition, and what is returned.

In units in which Σσ² = N_b, the mean length ⟨|L|⟩ is 1 and the quantity O has its natural unit; f is what is minimised,
±O, and ∂f/∂θ its gradient by θ = log σ.

    status         condition                                                    value; objective
    -------------  -----------------------------------------------------------  --------------------------------
    ok             max |dO/dσ| < tolerance; no negative curvature, if tested    the last configuration; O
    step_limit     the steps are used up, or an observer has ended it           the last configuration; O
    stalled        rounding hides every decrease, also of a step off a saddle,  the last configuration; O
                   or σ < UNRESOLVED_STRESS, or |L| < COLLAPSED
    stalled        one of these where |L| < SOUND², or σ leaves no digit of L   the last sound one; the last O
    stalled        one of these where σ < FADED                                 the last configuration; O
    slack_edges    σ < FADED with ∂f/∂θ > 0: edges of σ < FALLING fall slack    the last sound one; limit of O
    edge_collapse  |L| < COLLAPSING under tension with ∂f/∂θ < 0: they vanish   the last sound one; limit of O
    singular       P singular, or nearly so for TRAPPED steps (stresses of      the last regular one; the last O
                   any sign)
    any other      the last stress has no configuration, as a singular start    NaN; NaN

A descent ends as slack_edges or edge_collapse only where the gradient of all other edges is small,
Σ |∂f/∂θ| < CONVERGED_REST |f|; else it goes on.  A configuration is sound with |L| > SOUND and σ > SOUND².  Over
positive stresses a descent that ends stalled, slack_edges, edge_collapse or singular is first repeated (`descent`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from critflow.calls import tell
from critflow.critical.edge_lengths import COLLAPSED, COLLAPSING, SOUND
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.linalg.vectors import dot
from critflow.minimisers import Minimum, Point
from critflow.networks.network import Array
from critflow.optimisation.optimum import Optimum
from critflow.result import Status

FADED = 1e-12  # σ that tends to zero: far below the stresses of any optimum (1e-3)
FALLING = 1e6 * FADED  # σ of the edges that fall slack together with one that has faded
UNRESOLVED_STRESS = 1e-20  # least σ at which a descent ends without an optimum: far below FADED
TENSE = 0.01  # tension of an edge that does not fall slack, in units of the mean
GAINING = 0.1  # gain of an edge that collapses, relative to the largest gain: isogonal modes shorten others without
# Gradient of the edges that do not tend to their limits at an infimum, relative to the value; standard networks reach
# 4e-4, and false infima have more than 1e-2.
CONVERGED_REST = 1e-3
# Smallest pivot over the largest of a nearly singular prestress matrix: lengths are then known to 1e-7.
NEARLY_SINGULAR = 1e-9
TRAPPED = 20  # number of successive steps at nearly singular matrices that show a limit at a singular one

NOT_ATTAINED = (Status.edge_collapse, Status.slack_edges)
_LOCAL = "the value is local, and other starts may have a better one: give starts and rng"

Observer = Callable[[int, float, Array, Array], Any]
"""Called with step, value of the objective, σ (N_b,) and L (N_b, d); a true result ends the descent."""


class DescentMonitor:
    """Observes the points of a descent over positive stresses, and ends it where edges collapse or fall slack.

    unit            of the objective, with the sign of what is minimised
    last_sound      σ (N_b,) of the last configuration without short edges or weak stresses; 1 without one
    first_gradient  by the unknowns, at the first point (N_b,)
    ended           whether the observer has ended the descent
    """

    def __init__(self, manifold: CriticalManifold, unit: float, observe: Observer | None = None):
        self.manifold, self.unit, self._observe, self._step = manifold, unit, observe, 0
        self.last_sound = np.ones(manifold.network.n_edges)
        self.first_gradient = np.zeros_like(self.last_sound)
        self.crossings: list[int] = []
        self.nearest_singular = np.nan
        self.negative_pivots: int | None = None
        self.ended = False

    def __call__(self, point: Point) -> Status | None:
        """The status with which the descent ends at a point; None where it goes on."""
        if not self._step:
            self.first_gradient = point.gradient
        status, balance = self._status(point), point.state.balance
        value = self.unit * point.value
        enough = self._observe is not None and self._observe(self._step, value, balance.sigma, balance.bond_vectors)
        self._step += 1
        tell(f"step {self._step}")
        self.ended = bool(enough) and status is None
        return Status.step_limit if self.ended else status

    def _status(self, point: Point) -> Status | None:
        sigma, L, gradient = point.state.balance.sigma, point.state.balance.bond_vectors, point.gradient
        length = np.sqrt(dot(L, L))
        if length.min() * len(length) > SOUND * length.sum() and sigma.min() > SOUND**2:
            # Far from all limits below.
            self.last_sound = sigma
            return None
        tension = sigma * length
        # An edge tends to its limit if the value decreases in that direction; a bad start may lie there without reason.
        fading = (sigma < FADED) & (gradient > 0)
        vanishing = (length < COLLAPSING * length.mean()) & (tension > TENSE * tension.mean()) & (gradient < 0)
        for limit, some in ((Status.slack_edges, fading), (Status.edge_collapse, vanishing)):
            if some.any():
                edges = _leaving(limit, sigma, length, gradient)
                rest = float(np.abs(np.delete(gradient, edges)).sum())
                if rest < CONVERGED_REST * abs(point.value):
                    return limit
        unresolved = sigma.min() < UNRESOLVED_STRESS or length.min() < COLLAPSED * length.mean()
        return Status.stalled if unresolved else None

    def diverges(self, end: Minimum) -> bool:
        """Whether the descent has ended because lengths grow without end, which positive stresses exclude."""
        return False


class SignedDescentMonitor(DescentMonitor):
    """Observes the inertia of P(σ), and ends a descent towards a singular P, where lengths grow without end.

    last_sound  σ (N_b,) of the last configuration with a regular P; NaN without one
    """

    def __init__(self, manifold: CriticalManifold, unit: float, observe: Observer | None = None):
        super().__init__(manifold, unit, observe)
        self.last_sound = np.full_like(self.last_sound, np.nan)
        self.nearest_singular = np.inf
        self._trapped = 0

    def _status(self, point: Point) -> Status | None:
        balance = point.state.balance
        pivots = np.abs(balance.factor.pivots)
        self.nearest_singular = min(self.nearest_singular, float(pivots.min() / pivots.max()))
        if self.negative_pivots is not None and balance.factor.n_negative != self.negative_pivots:
            self.crossings.append(self._step)
        self.negative_pivots = balance.factor.n_negative
        self._trapped = self._trapped + 1 if pivots.min() < NEARLY_SINGULAR * pivots.max() else 0
        if not self._trapped:
            self.last_sound = balance.sigma
        return Status.singular if balance.factor.singular or self._trapped > TRAPPED else None

    def diverges(self, end: Minimum) -> bool:
        ended = end.status in (Status.singular, Status.stalled) and self._trapped > 0
        return ended and bool(np.isfinite(self.last_sound).all())


def optimum_at(end: Minimum, saddles: int | None, monitor: DescentMonitor, method: str) -> Optimum:
    """What is returned at the end of a descent: the table of this module.

    saddles  that the descent has left; None where the end was not tested
    """
    balance = end.point.state.balance
    last = monitor.manifold.solve(balance.sigma, balance=balance)
    optimum = Optimum(
        value=last.value,
        status=end.status,
        stats=replace(last.stats, method=method, steps=end.steps, residual=end.point.residual),
        objective=monitor.unit * end.point.value,
        saddles=saddles,
        crossings=tuple(monitor.crossings),
        nearest_singular=monitor.nearest_singular,
        negative_pivots=monitor.negative_pivots,
    )
    if end.status in NOT_ATTAINED:
        return _infimum(optimum, end, monitor)
    if monitor.diverges(end):
        limit = f"the value tends to {optimum.objective:.8g} as the prestress matrix becomes singular and lengths grow"
        return _at_last_sound(monitor, replace(optimum, status=Status.singular, note=f"{limit} without end"))
    stalled = end.status is Status.stalled
    if not last.ok:
        if stalled and end.steps and np.isfinite(monitor.last_sound).all():
            return _unresolved(monitor, optimum, "stresses become too different")
        return replace(optimum, status=last.status, objective=np.nan)
    if stalled and last.value.lengths.min() < SOUND**2 * last.value.lengths.mean():
        return _unresolved(monitor, optimum, "edges become too short")
    if stalled and (sigma := last.value.sigma).min() < FADED:
        note = f"stresses fade, that of edge {sigma.argmin()} first, before the others have converged: {_LOCAL}"
        return replace(optimum, note=note)
    return optimum


def _unresolved(monitor: DescentMonitor, optimum: Optimum, change: str) -> Optimum:
    """The last sound configuration, where rounding hides the descent."""
    note = f"{change} to resolve as the value falls to {optimum.objective:.6g}: try another start"
    return _at_last_sound(monitor, replace(optimum, note=note))


def _infimum(optimum: Optimum, end: Minimum, monitor: DescentMonitor) -> Optimum:
    """The infimum that a descent approaches without attaining it: its value, and the edges that vanish or fall slack.

    A vanishing length is ∝ 1/σ and its gain ∝ 1/σ, that of a vanishing stress ∝ σ: the gain that remains is the
    gradient in log σ.  Error bound (estimate) of the limit: this gain and all other components of the gradient.
    """
    gradient, collapse = end.point.gradient, end.status is Status.edge_collapse
    edges = _leaving(end.status, optimum.value.sigma, optimum.value.lengths, gradient)
    change = "shrink to zero length" if collapse else "lose their tension"
    left = float(np.abs(gradient[edges]).sum())
    limit = monitor.unit * (end.point.value - left)
    # Edges that fall slack together, such as all those of a vertex, have gradients of either sign.
    reached = edges if collapse else np.flatnonzero(optimum.value.sigma < FALLING)
    listed = ", ".join(map(str, reached))
    optimum = replace(
        optimum,
        note=f"edges {listed} {change} towards the infimum {limit:.8g}, which is not attained: {_LOCAL}",
        objective=limit,
        uncertainty=abs(monitor.unit) * (left + float(np.abs(np.delete(gradient, edges)).sum())),
        collapsed_edges=edges if collapse else edges[:0],
        slack_edges=edges[:0] if collapse else reached,
        saddles=None,
    )
    return _at_last_sound(monitor, optimum)


def _leaving(limit: Status, sigma: Array, length: Array, gradient: Array) -> NDArray[np.intp]:
    """The edges that shrink to zero length or lose their tension, by a gradient in log σ that is to be descended."""
    if limit is Status.slack_edges:
        return np.flatnonzero((sigma < 1e3 * FADED) & (gradient > 0))
    # Short edges with a gain: an isogonal mode may shorten others without one.
    gain = np.where(length < 0.5 * SOUND * length.mean(), -gradient / length, 0.0)
    return np.flatnonzero(gain > GAINING * gain.max())


def _at_last_sound(monitor: DescentMonitor, optimum: Optimum) -> Optimum:
    """The same optimum with the last sound configuration as its value."""
    value: CriticalConfiguration = monitor.manifold.configuration(monitor.last_sound)
    return replace(optimum, value=value, stats=replace(optimum.stats, error_bound=value.error_bound))
