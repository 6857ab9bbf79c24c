"""Descent of a quantity over all stresses of a network, from one start to an optimum.

    minimise f(θ) = ±O(σ(θ))/u,   σ = c exp θ,   Σσ² = N_b,

with the natural unit u of O and the sign − for quantities that are to be largest; where compression is allowed, the
unknowns are σ itself.  Solve P(σ) x = −gᵀ(σ ∘ b) for the bond vectors, and P(σ) y = gᵀ ∂O/∂L for the gradient,

    dO/dσ = ∂O/∂σ − L·(g y),   ∂f/∂θ = ±σ dO/dσ/u   (`TotalDeriv`).

The scale of σ changes no quantity, so that derivatives by the unknowns are those of σ without its scaling.  In units in
which Σσ² = N_b, the mean length ⟨|L|⟩ is 1 and O has its natural unit, a descent ends as

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

and as slack_edges or edge_collapse only where the gradient of all other edges is small, Σ |∂f/∂θ| < CONVERGED_REST |f|;
else it goes on.  A configuration is sound with |L| > SOUND and σ > SOUND².  Over positive stresses a descent that ends
stalled, slack_edges, edge_collapse or singular is first repeated from moderate stresses.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, ClassVar, NoReturn

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from critflow.calls import tell
from critflow.manifold import COLLAPSED, COLLAPSING, SOUND, CriticalConfiguration, CriticalManifold
from critflow.minimisers import METHODS, Function, Minimum, Point, minimise
from critflow.networks import Array
from critflow.numerics import dot, quasi_random
from critflow.quantities import Quantity, evaluate, has_exact_hessian
from critflow.result import Solution, Status

# Minimisers of each method in turn: "auto" continues with Newton's method where gradients alone do not converge.
DESCENTS = {"fire": ("fire",), "lbfgs": ("lbfgs",), "newton": ("newton",), "auto": ("lbfgs", "newton")}
# Step limits: several times the steps that standard networks of 1,000 vertices need.
MAX_STEPS = {"fire": 200_000, "lbfgs": 3_000, "newton": 200}

# Limits of positive stresses.
FADED = 1e-12  # σ that tends to zero: far below the stresses of any optimum (1e-3)
FALLING = 1e6 * FADED  # σ of the edges that fall slack together with one that has faded
UNRESOLVED_STRESS = 1e-20  # least σ at which a descent ends without an optimum: far below FADED
TENSE = 0.01  # tension of an edge that does not fall slack, in units of the mean
GAINING = 0.1  # gain of an edge that collapses, relative to the largest gain: isogonal modes shorten others without
# Gradient of the edges that do not tend to their limits at an infimum, relative to the value; standard networks reach
# 4e-4, and false infima have more than 1e-2.
CONVERGED_REST = 1e-3
NOT_ATTAINED = (Status.edge_collapse, Status.slack_edges)
FAILED = (*NOT_ATTAINED, Status.stalled, Status.singular)

# Limits of stresses of any sign.
# Smallest pivot over the largest of a nearly singular prestress matrix: lengths are then known to 1e-7.
NEARLY_SINGULAR = 1e-9
TRAPPED = 20  # number of successive steps at nearly singular matrices that show a limit at a singular one

# Repeats.  A failed descent is repeated with σ clipped to [median/MODERATE, MODERATE · median]: stresses that a bad
# start or a long step drove apart hardly change along the gradient.  With 10 or 100 a few starts of small networks
# return to limits that are no infima.
MODERATE, REPEATS = 3.0, 2
# Change of log σ from a start at which an edge has no length, as one between vertices with the same neighbours has at
# equal stresses: no gradient leads away from it, nor from a symmetric infimum.
PERTURBATION = 0.3

# Saddles.  With a residual below STATIONARY the end is always tested, above STOPPED never, and between them if the
# start is symmetric: a rough tolerance stops a descent early on purpose, mostly far from saddles.
STOPPED, STATIONARY = 1e-8, 1e-12
SYMMETRIC = 1e-9  # distance of two components of a gradient, relative to all, of edges that are images of each other
MAX_SADDLES = 20  # on one descent; not reached on any tested network
# Negative curvature that is not rounding, relative to the steepest: well above `minimisers.FLAT`, as the few Lanczos
# vectors do not resolve the end of the spectrum.
NEGATIVE = 1e-6
# The same in units of the largest component of the gradient: where the gradient does not quite vanish, flat directions
# have an apparent curvature of that size.
NEGATIVE_GRADIENTS = 10.0
PRODUCTS = 20  # with the Hessian in one test, fewer than the evaluations of a descent (60 at 1,000 vertices)
FIRST_STEP, SHORTER = 0.3, 12  # largest component of the first step off a saddle; how often it is divided by three

LOCAL = "the value is local, and other starts may have a better one: give starts and rng"

Observer = Callable[[int, float, Array, Array], Any]
"""Called with step, value of the objective, σ (N_b,) and L (N_b, d); a true result ends the descent."""

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


class Descent(Function):
    """f = ±O(σ)/u as a function of θ = log σ (N_b,), and what one descent of it meets.

    The state of a point is the `Evaluation` at its stress.

    unit            ±u, a value of O over that of f
    step            number of points that were met
    first_gradient  ∂f/∂θ at the first of them (N_b,)
    last_sound      σ (N_b,) of the last one without short edges or weak stresses; 1 without one
    stopped         whether the observer has ended the descent
    """

    repeats: ClassVar[int] = REPEATS  # from moderate stresses
    unsound: ClassVar[float] = 1.0
    nearest_singular: float = np.nan
    crossings: tuple[int, ...] = ()
    negative_pivots: int | None = None
    trapped: int = 0

    def __init__(self, manifold: CriticalManifold, quantity: Quantity, observe: Observer | None = None):
        self.manifold, self.quantity, self.observe = manifold, quantity, observe
        self.unit = (-1.0 if quantity.maximise else 1.0) * quantity.unit(manifold.network)
        self.step, self.stopped = 0, False
        self.last_sound = np.full(manifold.network.n_edges, self.unsound)
        self.first_gradient = np.zeros_like(self.last_sound)

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

    def at(self, x: Array) -> Point:
        """Value and gradient at x (N_b,), by one factorisation."""
        # Trial points far from the optimum may overflow; a value that is not finite marks them.
        with np.errstate(all="ignore"):
            sigma = self.sigma(x)
            evaluation = evaluate(self.manifold.balance(sigma), self.quantity)
        residual = float(np.maximum.reduce(np.abs(evaluation.gradient))) / abs(self.unit)
        gradient = self.rate(x, sigma)[0] * evaluation.gradient / self.unit
        return Point(x, evaluation.value / self.unit, gradient, residual if residual < np.inf else np.inf, evaluation)

    def preconditioner(self, point: Point) -> Array | float:
        return self.quantity.preconditioner(point.state.balance) / abs(self.unit)

    def hessian_product(self, point: Point, direction: Array) -> Array:
        """The Hessian at a point times a direction (N_b,), by two solves; of some quantities by differences."""
        evaluation = point.state
        product = evaluation.hessian_product if self.exact else evaluation.hessian_difference
        rate, second = self.rate(point.x, evaluation.balance.sigma)
        curved = rate * product(rate * direction)
        return (second * direction * evaluation.gradient + curved) / self.unit

    def monitor(self, point: Point) -> Status | None:
        """The status with which the descent ends at a point; None where it goes on."""
        if not self.step:
            self.first_gradient = point.gradient
        status, balance, value = self.ended(point), point.state.balance, self.unit * point.value
        enough = self.observe is not None and self.observe(self.step, value, balance.sigma, balance.bond_vectors)
        self.step += 1
        tell(f"step {self.step}")
        self.stopped = bool(enough) and status is None
        return Status.step_limit if self.stopped else status

    def ended(self, point: Point) -> Status | None:
        """The status where edges collapse or fall slack, or are about to without being resolved."""
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
                rest = np.delete(gradient, leaving(limit, sigma, length, gradient))
                if float(np.abs(rest).sum()) < CONVERGED_REST * abs(point.value):
                    return limit
        unresolved = sigma.min() < UNRESOLVED_STRESS or length.min() < COLLAPSED * length.mean()
        return Status.stalled if unresolved else None


class SignedDescent(Descent):
    """f as a function of σ (N_b,) itself, whose signs may change, and with them the inertia of P(σ).

    It ends where P becomes singular, and lengths grow without end.

    last_sound  σ (N_b,) of the last configuration with a regular P; NaN without one
    trapped     number of successive points at nearly singular P
    """

    repeats: ClassVar[int] = 0
    unsound: ClassVar[float] = np.nan
    nearest_singular: float = np.inf

    def unknowns(self, sigma: Array) -> Array:
        return sigma.copy()

    def sigma(self, x: Array) -> Array:
        return x * np.sqrt(len(x) / (x @ x))

    def rate(self, x: Array, sigma: Array) -> tuple[Array | float, Array | float]:
        return np.sqrt(len(x) / (x @ x)), 0.0

    def ended(self, point: Point) -> Status | None:
        factor = point.state.balance.factor
        pivots = np.abs(factor.pivots)
        self.nearest_singular = min(self.nearest_singular, float(pivots.min() / pivots.max()))
        if self.negative_pivots not in (None, factor.n_negative):
            self.crossings += (self.step,)
        self.negative_pivots = factor.n_negative
        self.trapped = self.trapped + 1 if pivots.min() < NEARLY_SINGULAR * pivots.max() else 0
        if not self.trapped:
            self.last_sound = point.state.balance.sigma
        return Status.singular if factor.singular or self.trapped > TRAPPED else None


def descend(descent: Descent, start: Array, method: str, tolerance: float, max_steps: int | None = None) -> Optimum:
    """The optimum of a descent from a start σ (N_b,), by one of `DESCENTS`."""
    x, steps, saddles = descent.unknowns(start), 0, None
    best: Minimum | None = None
    repeats = 0
    while True:
        # 1. Minimise f by the minimisers of the method in turn.
        before = steps
        for name in DESCENTS[method]:
            # The time step of FIRE: curvatures per edge are of order 1/N_b.
            minimiser = partial(METHODS["fire"], time_step=0.3 * np.sqrt(len(x))) if name == "fire" else METHODS[name]
            left = MAX_STEPS[name] if max_steps is None else max_steps - steps
            end = minimise(descent, minimiser, x, tolerance, left, descent.monitor, STATIONARY)
            point, status, taken = end
            x, steps = point.x, steps + taken
            if status not in (Status.step_limit, Status.stalled) or descent.stopped or steps == max_steps:
                break
        # Symmetric starts lead to points that are minimal, or infima, among the symmetric ones only.
        gradient = descent.first_gradient
        symmetric = np.diff(np.sort(gradient)).min(initial=np.inf) < SYMMETRIC * np.ptp(gradient)
        # 2. Repeat a descent that fails from its end with moderate stresses, as long as that improves it.
        if best is None or improves(end, best):
            best = end
            if status in FAILED and repeats < descent.repeats:
                x = np.clip(x, np.median(x) - np.log(MODERATE), np.median(x) + np.log(MODERATE))
                if steps == before or symmetric:
                    x = x + PERTURBATION * np.random.default_rng(0).standard_normal(len(x))
                if not np.array_equal(x, point.x):
                    repeats += 1
                    continue
        # 3. A stationary end may be a saddle: leave it in a direction of negative curvature, and descend again.
        point, status, _ = best
        if status is not Status.ok or point.residual > STOPPED:
            break
        if point.residual > STATIONARY and not symmetric:
            break
        direction = negative_curvature_direction(descent, point)
        saddles = (saddles or 0) + (direction is not None)
        if direction is None:
            break
        lower = step_off_saddle(descent, point, direction)
        if lower is None or steps == max_steps or saddles > MAX_SADDLES:
            status = Status.stalled if lower is None else Status.step_limit
            break
        x, best, repeats = lower.x, None, 0
    return optimum_at(descent, (point, status, steps), saddles, method)


def improves(again: Minimum, end: Minimum) -> bool:
    """Whether a repeated descent replaces the end of the first one."""
    (here, status, _), (before, status_before, _), margin = again, end, 0.0
    ended, ended_before = (one in (Status.ok, *NOT_ATTAINED) for one in (status, status_before))
    if ended != ended_before:
        return ended
    if status_before in NOT_ATTAINED:
        # Two approaches to one infimum differ by their distances from it.
        margin = float(np.abs(before.gradient).sum()) * (-1.0 if status in NOT_ATTAINED else 1.0)
    return bool(here.value < before.value + margin) or not np.isfinite(before.value)


def leaving(limit: Status, sigma: Array, length: Array, gradient: Array) -> NDArray[np.intp]:
    """The edges that shrink to zero length or lose their tension, by a gradient in log σ that is to be descended."""
    if limit is Status.slack_edges:
        return np.flatnonzero((sigma < 1e3 * FADED) & (gradient > 0))
    # Short edges with a gain: an isogonal mode may shorten others without one.
    gain = np.where(length < 0.5 * SOUND * length.mean(), -gradient / length, 0.0)
    return np.flatnonzero(gain > GAINING * gain.max())


def optimum_at(descent: Descent, end: Minimum, saddles: int | None, method: str) -> Optimum:
    """What is returned at the end of a descent: the table of this module.

    saddles  that the descent has left; None where the end was not tested
    """
    (point, status, steps), unit = end, descent.unit
    limit: dict[str, Any] = {}
    last = descent.manifold.solve(point.state.balance.sigma, balance=point.state.balance)
    value, objective, note = last.value, unit * point.value, ""
    regular, stalled = bool(np.isfinite(descent.last_sound).all()), status is Status.stalled
    unresolved, sound = f"to resolve as the value falls to {objective:.6g}: try another start", False
    if status in NOT_ATTAINED:
        # A vanishing length is ∝ 1/σ and its gain ∝ 1/σ, that of a vanishing stress ∝ σ: the gain that remains is the
        # gradient in log σ.  Edges that fall slack together, such as all of a vertex, have gradients of either sign.
        edges, collapse = leaving(status, value.sigma, value.lengths, point.gradient), status is Status.edge_collapse
        reached = edges if collapse else np.flatnonzero(value.sigma < FALLING)
        gain = float(np.abs(point.gradient[edges]).sum())
        objective, sound, saddles = unit * (point.value - gain), True, None
        # Error bound (estimate) of the limit: the gain that remains and all other components of the gradient.
        error = abs(unit) * (gain + float(np.abs(np.delete(point.gradient, edges)).sum()))
        limit = {"uncertainty": error, "collapsed_edges" if collapse else "slack_edges": reached}
        change = "shrink to zero length" if collapse else "lose their tension"
        listed = ", ".join(map(str, reached))
        note = f"edges {listed} {change} towards the infimum {objective:.8g}, which is not attained: {LOCAL}"
    elif descent.trapped and status in (Status.singular, Status.stalled) and regular:
        status, sound = Status.singular, True
        note = f"the value tends to {objective:.8g} as the prestress matrix becomes singular and lengths grow"
        note += " without end"
    elif not last.ok and stalled and steps and regular:
        note, sound = f"stresses become too different {unresolved}", True
    elif not last.ok:
        status, objective = last.status, np.nan
    elif stalled and value.lengths.min() < SOUND**2 * value.lengths.mean():
        note, sound = f"edges become too short {unresolved}", True
    elif stalled and value.sigma.min() < FADED:
        first = value.sigma.argmin()
        note = f"stresses fade, that of edge {first} first, before the others have converged: {LOCAL}"
    elif status in (Status.step_limit, Status.stalled) and method != "auto":
        note = f"{status.message}, or choose method='auto'"
    stats = replace(last.stats, method=method, steps=steps, residual=point.residual)
    if sound:
        value = descent.manifold.configuration(descent.last_sound)
        stats = replace(stats, error_bound=value.error_bound)
    return Optimum(
        *(value, status, stats, note),
        objective=objective,
        saddles=saddles,
        crossings=descent.crossings,
        nearest_singular=descent.nearest_singular,
        negative_pivots=descent.negative_pivots,
        **limit,
    )


# A zero gradient does not distinguish a minimum from a saddle, and a start with a symmetry of the network leads a
# descent to points that are minimal only among the symmetric ones.  Products with the Hessian distinguish them:
# Lanczos' method finds the ends of a spectrum first.


def negative_curvature_direction(function: Function, point: Point) -> Array | None:
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
    products = min(PRODUCTS, n)
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
    step = FIRST_STEP / float(np.abs(direction).max()) * direction
    for _ in range(SHORTER):
        best = min((function.at(point.x + step), function.at(point.x - step)), key=lambda trial: trial.value)
        if best.value < point.value:
            return best
        step = step / 3
    return None
