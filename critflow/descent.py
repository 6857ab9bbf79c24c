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

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NoReturn

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from critflow.calls import tell
from critflow.manifold import COLLAPSED, COLLAPSING, SOUND, CriticalConfiguration, CriticalManifold
from critflow.minimisers import METHODS, Fire, Function, Method, Minimum, Point, minimise
from critflow.networks import Array
from critflow.numerics import dot, quasi_random
from critflow.quantities import Evaluation, Quantity, evaluate, has_exact_hessian
from critflow.result import Solution, Status

# What an optimisation returns.

_NO_EDGES, _NO_VALUES = np.zeros(0, np.intp), np.zeros(0)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Optimum(Solution[CriticalConfiguration]):
    """The best critical configuration by an objective; `stats.residual` is the largest component of dO/dσ.

    Numbers that do not apply are NaN or None, lists are empty.

    objective         value of the objective; where the optimum is not attained, the limit of the value
    error_of          function that computes `objective_error`, where the optimum is known
    uncertainty       |objective − limit| where the optimum is not attained.  Error bound (estimate)
    bound             largest value over all stresses in closed form (moduli without a penalty)
    collapsed_edges   edges whose length is zero at an optimum that is attained, or tends to zero
                      (`Status.edge_collapse`)
    slack_edges       all edges whose tension tends to zero (`Status.slack_edges`)
    saddles           saddle points left on the descent; None where the end was not tested
    start             number of the start that led here
    starts            values of the objective from all starts, (n_starts,)
    crossings         steps after which the number of negative pivots of P differs (stresses of any sign)
    nearest_singular  smallest pivot of P over the largest on the descent (stresses of any sign)
    negative_pivots   number of negative pivots of P at the last step of the descent (stresses of any sign)
    """

    objective: float
    error_of: Callable[[], float] | None = field(default=None, repr=False)
    uncertainty: float = np.nan
    bound: float = np.nan
    collapsed_edges: NDArray[np.intp] = field(default_factory=_NO_EDGES.copy)
    slack_edges: NDArray[np.intp] = field(default_factory=_NO_EDGES.copy)
    saddles: int | None = None
    start: int = 0
    starts: Array = field(default_factory=_NO_VALUES.copy)
    crossings: tuple[int, ...] = ()
    nearest_singular: float = np.nan
    negative_pivots: int | None = None

    def __getattr__(self, name: str) -> NoReturn:
        """Only names that an optimum lacks come here: where they are."""
        raise AttributeError(
            f"{type(self).__name__!r} object has no attribute {name!r}: its value by the objective is .objective, its "
            "configuration .value, and elasticity(...) and properties(...) of it have moduli and other quantities",
            name=name,
            obj=self,
        )

    @cached_property
    def objective_error(self) -> float:
        """|objective − optimum| where the optimum is known, else NaN; computed at its first use.

        Error bound (proof), except for moduli other than B_0, where the rounding of the bound is an estimate.
        """
        return self.error_of() if self.error_of else np.nan

    @property
    def gap(self) -> float:
        """1 − objective/bound where the bound is attained, else NaN."""
        if not self.ok:
            return np.nan
        return 1 - self.objective / self.bound if self.bound else 0.0


# Minimisation past saddle points.
#
# A zero gradient does not distinguish a minimum from a saddle, and a start with a symmetry of the network leads a
# descent to points that are minimal only among the symmetric ones.  Products with the Hessian distinguish them:
# Lanczos' method finds the ends of a spectrum first.

# Negative curvature that is not rounding, relative to the steepest: well above FLAT, as the few Lanczos vectors do not
# resolve the end of the spectrum.
NEGATIVE = 1e-6
# The same in units of the largest component of the gradient: where the gradient does not quite vanish, flat directions
# have an apparent curvature of that size.
NEGATIVE_GRADIENTS = 10.0

# Hessian-vector products of one saddle test, fewer than the evaluations of a descent (60 at 1,000 vertices).
_PRODUCTS = 20
# Largest component of the first step off a saddle, and the number of times that it is divided by three.
_FIRST_STEP, _SHORTER = 0.3, 12
# Upper limit of saddles on one descent; not reached on any tested network.
_MAX_SADDLES = 20

DescentOf = Callable[[Array, int | None], Minimum]
"""A minimisation from x (n,) within a number of steps, or the default number for None."""


def minimise_past_saddles(
    function: Function, descend: DescentOf, x0: Array, max_steps: int | None, tested: Callable[[Minimum], bool]
) -> tuple[Minimum, int | None]:
    """A descent from x0 (n,), continued from every saddle at which it ends; and the number of saddles.

    tested  whether an end is to be tested, which costs as much as half of a descent; where it is not, the number of
            saddles is None if no other was met

    `Status.stalled` where no step off a saddle decreases the value.
    """
    end = descend(x0, max_steps)
    steps, saddles = end.steps, 0
    while end.status is Status.ok and tested(end):
        direction = negative_curvature_direction(function, end.point)
        if direction is None:
            return Minimum(end.point, end.status, steps), saddles
        saddles += 1
        lower = step_off_saddle(function, end.point, direction)
        left = None if max_steps is None else max_steps - steps
        if lower is None or left == 0 or saddles > _MAX_SADDLES:
            end = replace(end, status=Status.stalled if lower is None else Status.step_limit)
            break
        end = descend(lower.x, left)
        steps += end.steps
    return Minimum(end.point, end.status, steps), saddles or None


def negative_curvature_direction(function: Function, point: Point, products: int = _PRODUCTS) -> Array | None:
    """A direction (n,) of negative curvature at a stationary point, or None.

    By Lanczos' method with full orthogonalisation on S H S, whose curvatures have the signs of those of H.  S scales
    out the known diagonal, which would hide all other curvatures.  The first vector has no symmetry.
    """
    n = len(point.x)
    first = quasi_random(n) - 0.5
    diagonal = function.preconditioner(point)
    scale = np.ones(n)
    if np.any(diagonal):
        rest = function.hessian_product(point, first) - diagonal * first
        scale = 1 / np.sqrt(1 + diagonal * np.linalg.norm(first) / np.linalg.norm(rest))
    products = min(products, n)
    basis = np.empty((products + 1, n))
    basis[0] = first / np.linalg.norm(first)
    main, off = np.zeros(products), np.zeros(products)
    for k in range(products):
        curved = scale * function.hessian_product(point, scale * basis[k])
        main[k] = curved @ basis[k]
        for _ in range(2):
            curved -= basis[: k + 1].T @ (basis[: k + 1] @ curved)
        off[k] = np.linalg.norm(curved)
        if k + 1 == products or off[k] <= NEGATIVE * np.abs(main).max():
            break
        basis[k + 1] = curved / off[k]
    values, vectors = scipy.linalg.eigh_tridiagonal(main[: k + 1], off[:k])
    direction = scale * (vectors[:, 0] @ basis[: k + 1])
    # The curvature of H itself in this direction, per unit length.
    curvature = values[0] / (direction @ direction)
    noise = max(NEGATIVE * float(np.abs(values).max()), NEGATIVE_GRADIENTS * float(np.abs(point.gradient).max()))
    return direction if curvature < -noise else None


def step_off_saddle(function: Function, point: Point, direction: Array) -> Point | None:
    """The lower of two points at ± a step in a direction of negative curvature; None if neither decreases the value."""
    step = _FIRST_STEP / float(np.abs(direction).max()) * direction
    for _ in range(_SHORTER):
        best = min((function.at(point.x + step), function.at(point.x - step)), key=lambda trial: trial.value)
        if best.value < point.value:
            return best
        step = step / 3
    return None


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


# Descent of a quantity over all stresses of a network, in θ = log σ or, where compression is allowed, in σ itself.
#
# With u the natural unit of O, and the sign − for quantities that are to be largest,
#
#     minimise f(θ) = ±O(σ(θ))/u,   σ = c exp θ,   Σσ² = N_b.
#
# 1. Evaluate O at θ: solve P(σ) x = −gᵀ(σ ∘ b) for the bond vectors, and P(σ) y = gᵀ ∂O/∂L for the gradient,
#        dO/dσ = ∂O/∂σ − L·(g y),   ∂f/∂θ = ±σ dO/dσ/u   (`TotalDeriv`).
# 2. Step by L-BFGS, FIRE or Newton's method (`critflow.minimisers`) until max |dO/dσ|/u is below the
#    tolerance; "auto" continues with Newton's method where L-BFGS does not reach it.
# 3. After each step look whether an edge vanishes or falls slack, which ends the descent
#    (`critflow.descent`).
# 4. A descent that fails is repeated from its end with σ clipped to [median/3, 3 median].
# 5. A stationary end may be a saddle: leave it in a direction of negative curvature, and go on from 2
#    (`critflow.descent`).
# 6. Return the optimum that belongs to the end (table in `critflow.descent`).
#
# The scale of σ changes no quantity, so that derivatives by the unknowns are those of σ without its scaling.

# A failed descent is repeated with σ clipped to [median/MODERATE, MODERATE · median]: stresses that a bad start or a
# long step drove apart hardly change along the gradient.  With 10 or 100 a few starts of small networks return to
# limits that are no infima.
MODERATE = 3.0
# Change of log σ from a start at which an edge has no length, as one between vertices with the same neighbours has at
# equal stresses: no gradient leads away from it.
PERTURBATION = 0.3
REPEATS = 2  # descents repeated from moderate stresses
# With a residual below STATIONARY the end is always tested for a saddle, above STOPPED never, and between them if the
# start is symmetric: a rough tolerance stops a descent early on purpose, mostly far from saddles.
STOPPED, STATIONARY = 1e-8, 1e-12
SYMMETRIC = 1e-9  # distance of two components of a gradient, relative to all, of edges that are images of each other

# Minimisers of each method in turn: "auto" continues with Newton's method where gradients alone do not converge.
DESCENTS = {"fire": ("fire",), "lbfgs": ("lbfgs",), "newton": ("newton",), "auto": ("lbfgs", "newton")}
# Step limits: several times the steps that standard networks of 1,000 vertices need.
MAX_STEPS = {"fire": 200_000, "lbfgs": 3_000, "newton": 200}


class StressObjective(Function):
    """f = ±O(σ)/u as a function of θ = log σ (N_b,).  The state of a point is the `Evaluation` at its stress.

    unit  ±u, a value of O over that of f
    """

    monitor: type[DescentMonitor] = DescentMonitor

    def __init__(self, manifold: CriticalManifold, quantity: Quantity):
        self.manifold, self.quantity = manifold, quantity
        self.unit = (-1.0 if quantity.maximise else 1.0) * quantity.unit(manifold.network)

    @cached_property
    def exact(self) -> bool:
        """Whether products with the Hessian are exact."""
        return has_exact_hessian(self.manifold, self.quantity)

    def unknowns(self, sigma: Array) -> Array:
        """θ of a stress σ (N_b,)."""
        return np.log(sigma)

    def sigma(self, x: Array) -> Array:
        """σ of log-stresses θ, scaled to Σσ² = N_b."""
        sigma = np.exp(x - np.maximum.reduce(x))
        return sigma * math.sqrt(len(x) / (sigma @ sigma))

    def rate(self, x: Array, sigma: Array) -> tuple[Array | float, Array | float]:
        """First and second derivatives of each σ by its own unknown."""
        return sigma, sigma

    def moderate(self, x: Array) -> Array | None:
        """x with stresses clipped around their median; None where signs may change."""
        middle, width = np.median(x), np.log(MODERATE)
        return np.clip(x, middle - width, middle + width)

    @property
    def time_step(self) -> float:
        """A time step of FIRE: curvatures per edge are of order 1/N_b."""
        return 0.3 * np.sqrt(self.manifold.network.n_edges)

    def at(self, x: Array) -> Point:
        """Value and gradient at x (N_b,), by one factorisation."""
        # Trial points far from the optimum may overflow; a value that is not finite marks them.
        with np.errstate(all="ignore"):
            sigma = self.sigma(x)
            evaluation = evaluate(self.manifold, self.quantity, sigma)
        residual = float(np.maximum.reduce(np.abs(evaluation.gradient))) / abs(self.unit)
        gradient = self.rate(x, sigma)[0] * evaluation.gradient / self.unit
        return Point(x, evaluation.value / self.unit, gradient, residual if residual < np.inf else np.inf, evaluation)

    def preconditioner(self, point: Point) -> Array | float:
        return self.quantity.preconditioner(point.state.balance) / abs(self.unit)

    def hessian_product(self, point: Point, direction: Array) -> Array:
        """The Hessian at a point times a direction (N_b,), by two solves; of some quantities by differences."""
        evaluation: Evaluation = point.state
        product = evaluation.hessian_product if self.exact else evaluation.hessian_difference
        rate, second = self.rate(point.x, evaluation.balance.sigma)
        curved = rate * product(rate * direction)
        return (second * direction * evaluation.gradient + curved) / self.unit


class SignedStressObjective(StressObjective):
    """±O/u as a function of σ (N_b,) itself, whose signs may change, and with them the inertia of P(σ)."""

    monitor = SignedDescentMonitor

    def unknowns(self, sigma: Array) -> Array:
        return sigma.copy()

    def sigma(self, x: Array) -> Array:
        return x * np.sqrt(len(x) / (x @ x))

    def rate(self, x: Array, sigma: Array) -> tuple[Array | float, Array | float]:
        return np.sqrt(len(x) / (x @ x)), 0.0

    def moderate(self, x: Array) -> Array | None:
        return None


@dataclass(frozen=True, eq=False)
class Descent:
    """Descents of one objective by one of `DESCENTS`, which share a monitor."""

    objective: StressObjective
    method: str
    tolerance: float
    monitor: DescentMonitor

    def past_failures(self, x: Array, max_steps: int | None) -> Minimum:
        """The descent from x (N_b,), repeated from moderate stresses where it does not end at an optimum (4)."""
        end = self.once(x, max_steps)
        steps = end.steps
        for _ in range(REPEATS):
            left = None if max_steps is None else max_steps - steps
            failed = end.status in (*NOT_ATTAINED, Status.stalled, Status.singular)
            moderate = self.objective.moderate(end.point.x) if failed and left != 0 and not self.monitor.ended else None
            if moderate is not None and not end.steps:
                moderate = moderate + PERTURBATION * np.random.default_rng(0).standard_normal(len(moderate))
            if moderate is None or np.array_equal(moderate, end.point.x):
                break
            again = self.once(moderate, left)
            steps += again.steps
            if not _improves(again, end):
                break
            end = again
        return replace(end, steps=steps)

    def once(self, x: Array, max_steps: int | None) -> Minimum:
        """One descent from x (N_b,) by the minimisers of the method in turn (1 to 3)."""
        steps = 0
        for name in DESCENTS[self.method]:
            minimiser: Method[Any] = Fire(self.objective.time_step) if name == "fire" else METHODS[name]()
            left = MAX_STEPS[name] if max_steps is None else max_steps - steps
            end = minimise(self.objective, minimiser, x, self.tolerance, left, self.monitor, STATIONARY)
            steps += end.steps
            if end.status not in (Status.step_limit, Status.stalled) or self.monitor.ended or steps == max_steps:
                break
            x = end.point.x
        return replace(end, steps=steps)

    def may_be_saddle(self, end: Minimum) -> bool:
        """Whether an end is tested for a saddle (5)."""
        residual, gradient = end.point.residual, self.monitor.first_gradient
        if not STATIONARY < residual <= STOPPED:
            return residual <= STATIONARY
        return bool(np.diff(np.sort(gradient)).min(initial=np.inf) < SYMMETRIC * np.ptp(gradient))


def descend(
    objective: StressObjective,
    method: str,
    start: Array,
    tolerance: float,
    max_steps: int | None = None,
    observe: Observer | None = None,
) -> Optimum:
    """The optimum of an objective from a start σ (N_b,), by one of `DESCENTS`, with a status of `descent_end`."""
    monitor = objective.monitor(objective.manifold, objective.unit, observe)
    descent = Descent(objective, method, tolerance, monitor)
    end, saddles = minimise_past_saddles(
        objective, descent.past_failures, objective.unknowns(start), max_steps, descent.may_be_saddle
    )
    return optimum_at(end, saddles, monitor, method)


def _improves(again: Minimum, end: Minimum) -> bool:
    """Whether a repeated descent replaces the end of the first one."""
    ended = [one.status in (Status.ok, *NOT_ATTAINED) for one in (again, end)]
    if ended[0] != ended[1]:
        return ended[0]
    margin = 0.0
    if end.status in NOT_ATTAINED:
        # Two approaches to one infimum differ by their distances from it.
        margin = float(np.abs(end.point.gradient).sum()) * (-1.0 if again.status in NOT_ATTAINED else 1.0)
    return bool(again.point.value < end.point.value + margin) or not np.isfinite(end.point.value)
