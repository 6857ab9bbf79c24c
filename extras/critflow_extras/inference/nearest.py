"""The critical configuration nearest to observed positions: the stresses that a picture of a network shows.

    minimise  D = (1/s²) Σ_i |x_i(σ) + c − x̂_i|²   over σ > 0 and, for periodic networks, the translation c.

The map x(σ) is that of force densities, so its derivative by θ = log σ is the solution u of P u = −gᵀ(θ̇ σ ∘ L), one
sparse system for displacement, multipliers and stresses together (Gauss-Newton, damped by Levenberg and Marquardt).

With pressures the map is x(σ, p), and the steps are those of `curved_sides`.  Where three edges meet at each vertex
every picture balances under exactly one (σ, p), and no residual is left to test it by; sides that are traced with
vertices of their own, of two edges, leave one degree of freedom for each.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor
from scipy.linalg.blas import dsymv
from scipy.linalg.lapack import dpotri
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh, splu
from scipy.stats import chi2

from critflow.arguments import edge_values, of_kind
from critflow.calls import running
from critflow.manifold import Balance, CriticalManifold
from critflow.networks import Array, IntArray, Network, validated_coordinates
from critflow.numerics import LARGEST_DENSE
from critflow.result import InputError, Solution, Stats, Status
from critflow.sparse import FixedPattern, end_pairs, free_ends, spread_columns
from critflow_extras.inference.curved_sides import PositionFit, arc_tensions, sides_of, standard_errors
from critflow_extras.tissue.pressures import PressureManifold

NEAREST_CONVERGED = 1e-9  # change of log σ in a step of Gauss and Newton below which it has converged
NEAREST_ROUGH = 1e-3  # the same with a regularisation that is then left out
NEAREST_BALANCED = 1e-6  # distance of the start, in units of the lengths, from which no regularisation is needed
NEAREST_EXACT = 1e-12  # the same from which no step is needed: rounding leaves 1e-14
NEAREST_DAMPING = 1e-9  # first damping of these steps, in units of the mean square of the coordinates
# Regularises the multipliers of balance, relative to the mean stress: pivots of both signs stay apart.
NEAREST_REGULARISATION = 1e-12
# Smallest stress that a descent starts from, relative to the mean: stresses in balance at noisy positions may be
# negative.
SMALLEST_START = 0.05
WEAKEST_START = 1e-9  # the same where none is negative: that rounding leaves
# First regularisation of log σ, relative to the mean square length: an infimum that is not attained then has a
# minimiser.
NEAREST_RIDGE = 1e-8
NEAREST_STALLED = 1e-7  # relative gradient that shows a stalled descent to have reached its infimum
# Relative distance from the observed positions beyond which the balance of the tensions and pressures found from them
# has lost its digits.
REPRODUCED = 1e-6
WIDEST_STRESS = 9.2  # |log σ| relative to the mean beyond which an edge counts as collapsed or slack
# Distance, in units of the lengths and of the most extreme factor of a stress, below which even that one is resolved.
NEAREST_RESOLVED = 0.01

_MOST_STEPS = 200
_GROWTH, _DECAY, _LARGEST = 10.0, 0.2, 1e12
# Longest change of log σ in one step.
_LONGEST = 3.0
# Expected relative gain of a step with pressures that ends the descent: far within the standard errors.
_NO_GAIN = 1e-7
_SHORTEST = 1e-3  # shortest part of such a step


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Nearest(Solution[Any]):
    """The critical configuration nearest to observed positions, with pressures a `PressurisedConfiguration`.

    distance      root mean square of |x_i + c − x̂_i|, in units of length; rounding where freedom is zero
    displacement  x + c − x̂, (N_v, d): from the observed to the critical configuration
    translation   c (d,), zero with pins
    stress_error  (N_b,) standard error for independent errors s of all coordinates, of log σ, or of σ with pressures;
                  NaN for large networks
    undetermined  (N_b,) the relative change of σ that the positions determine least, of unit norm; NaN for large
                  networks, and with pressures
    error         s, given or estimated from the distance and the degrees of freedom; NaN where these are none
    chi_squared   D for a given error: above its 99 % interval the model misfits, which the note says; else NaN
    freedom       degrees of freedom of D: coordinates less stresses and pressures that they determine

    With pressures also

    pressure_error  (N_f,) standard error of p at fixed Σσ
    sides           (N_b,) the side of each edge, numbered from 0: edges joined by vertices of two edges are one side
    side_tensions   (N_sides,) T = √(τ² + (q|L|/2)²), the tension along the arc of a side, in the scale of `value`
    side_errors     (N_sides,) standard error of T at fixed ΣT
    amplification   root mean square relative error of T, over that of coordinates, s over the mean length of sides
    """

    distance: float
    displacement: Array = field(repr=False)
    translation: Array
    stress_error: Array = field(repr=False)
    undetermined: Array = field(repr=False)
    error: float
    chi_squared: float
    freedom: int
    pressure_error: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    sides: IntArray = field(default_factory=lambda: np.zeros(0, np.int64), repr=False)
    side_tensions: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    side_errors: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    amplification: float = np.nan

    @property
    def configuration(self) -> Any:
        """The critical configuration, the same as `value`."""
        return self.value


class _Iterate(NamedTuple):
    """θ, its balance, the displacements r (n_free, d) and of fixed vertices, and D s²."""

    theta: Array
    balance: Balance
    residual: Array
    shift: Array
    cost: float


@running("nearest_critical")
def nearest_critical(
    network: Network | CriticalManifold,
    coordinates: ArrayLike,
    error: float | None = None,
    start: ArrayLike | None = None,
    max_steps: int = _MOST_STEPS,
    throw: bool = True,
    *,
    pressures: bool = False,
    sides: ArrayLike | None = None,
) -> Nearest:
    """The configuration in balance under positive stresses that is nearest to observed coordinates (N_v, d).

    error  standard error s of the observed coordinates, from which those of the stresses follow; None: estimated
    start  stresses (N_b,) to begin with; by default those that balance best at the observed positions
    pressures  infer a pressure in each face too, for stresses of any sign.  Where three edges meet at each vertex all
           positions balance, and their errors are amplified; trace sides with vertices of two edges against both
    sides  with pressures the number of the side of each edge (N_b,); by default found at vertices of two edges

    The minimum is local: D is not convex in σ.  `stats.residual` is the largest component of dD/dθ over Σ|x̂|².
    Where the infimum is approached as edges shrink to zero length or lose their stress, the configuration is close to
    it, mostly by a weak regularisation of θ: `Status.edge_collapse` or `Status.slack_edges`.
    Raises `InputError` for coordinates or stresses of a wrong shape and for an error that is not positive,
    `SolveError` where the descent stalls and `throw` is set.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> found = ce.nearest_critical(network, network.positions)
    >>> found.distance < 1e-6  # a Voronoi tessellation is critical
    True
    """
    network = of_kind(Network, CriticalManifold, network=network)
    of_kind(np.ndarray, coordinates=coordinates)
    of_kind(float, None, error=error)
    of_kind(np.ndarray, None, start=start, sides=sides)
    max_steps = of_kind(int, max_steps=max_steps)
    of_kind(bool, throw=throw, pressures=pressures)
    manifold = CriticalManifold.of(network)
    x = validated_coordinates(manifold.network, coordinates)
    if error is not None and not error > 0:
        raise InputError(f"the error of the coordinates must be positive, not {error}")
    if max_steps < 0:
        raise InputError(f"max_steps must not be negative, not {max_steps}")
    if pressures and start is not None:
        raise InputError("pressures=True starts from a linear system and needs no start: omit it")
    if sides is not None and not pressures:
        raise InputError("sides= belongs to pressures=True, which bend the sides of cells: give both")
    if pressures:
        nearest, failure = infer_pressures(manifold.network, x, error, sides), "no tensions and pressures balance here"
    else:
        nearest = _nearest(manifold, x, error, start, max_steps)
        failure = "no nearest critical configuration was found"
    return nearest.or_raise(failure) if throw else nearest


def _nearest(
    manifold: CriticalManifold, x: Array, error: float | None, start: ArrayLike | None, max_steps: int
) -> Nearest:
    """The end of the descent under stresses alone, with its standard errors."""
    sigma = _best_balance(manifold, x) if start is None else edge_values(start, manifold.network.n_edges, "start")
    fit = _Fit(manifold, x)
    here, steps, status = fit.descend(np.log(sigma), max_steps)
    found = manifold.solve(np.exp(here.theta))
    dimensions = x.size - (0 if manifold.network.pins else x.shape[1])
    freedom = dimensions - (manifold.network.n_edges - 1)
    displacement = found.value.coordinates + here.shift - x
    s, chi_squared = _scatter(here.cost, freedom, error)
    stress_error, undetermined = fit.uncertainty(here, s)
    return Nearest(
        value=found.value,
        status=status if found.ok else found.status,
        note=_note(here, steps, status) or _misfit(chi_squared, freedom),
        stats=Stats("gauss-newton", steps, residual=fit.gradient(here), error_bound=found.value.error_bound),
        distance=float(np.sqrt(here.cost / manifold.network.n_vertices)),
        displacement=displacement,
        translation=here.shift,
        stress_error=stress_error,
        undetermined=undetermined,
        error=s,
        chi_squared=chi_squared,
        freedom=freedom,
    )


def _note(here: _Iterate, steps: int, status: Status) -> str:
    """A sentence on a descent that reached no minimum."""
    if status is Status.step_limit:
        return f"the descent did not end in {steps} steps: raise max_steps, or start from other stresses"
    if status not in (Status.edge_collapse, Status.slack_edges):
        return ""
    edges = np.flatnonzero(_extreme(here))
    tend = "1 edge tends" if len(edges) == 1 else f"{len(edges)} edges tend"
    return f"{tend} to zero length or zero stress, edge {edges[0]} first: the distance is a limit"


def _extreme(here: _Iterate) -> NDArray[np.bool_]:
    """Edges (N_b,) that count as collapsed or slack."""
    return np.asarray(np.abs(here.theta) > WIDEST_STRESS)


class _Fit:
    """The least-squares problem of one network and its observed coordinates."""

    def __init__(self, manifold: CriticalManifold, observed: Array):
        self.manifold, self.network = manifold, manifold.network
        self._observed = observed
        self._free = self.network.free
        self._moves = not self.network.pins
        self._pattern = _step_pattern(self.network)
        self._size = float(np.mean(observed**2)) or 1.0
        self._ridge = NEAREST_RIDGE * float(np.mean(np.sum(self.network.bond_vectors(observed) ** 2, axis=1)))

    def at(self, theta: Array) -> _Iterate:
        """The balance of σ = e^θ and its distances, with the best translation."""
        balance = self.manifold.balance(np.exp(theta))
        apart = self.network.all_coordinates(balance.coordinates) - self._observed
        shift = -apart.mean(axis=0) if self._moves else np.zeros(apart.shape[1])
        # Pins do not move to observed positions.
        residual = (apart + shift)[self._free] if not self._moves else apart + shift
        return _Iterate(theta, balance, residual, shift, float(np.sum(residual**2)))

    def descend(self, theta: Array, max_steps: int) -> tuple[_Iterate, int, Status]:
        """Damped Gauss-Newton steps on D s² + ridge Σθ², and without the ridge where no stress tends to a limit."""
        start = self.at(theta - theta.mean())
        size = self._ridge / NEAREST_RIDGE * len(start.residual)
        if start.cost < NEAREST_EXACT**2 * size:
            return start, 0, Status.ok
        if start.cost < NEAREST_BALANCED**2 * size:
            here, steps, status = self._descend(start, max_steps, 0.0)
            widest = float(np.abs(here.theta).max())
            resolved = here.cost < (NEAREST_RESOLVED * np.exp(-widest)) ** 2 * size
            if status is Status.ok and (widest <= WIDEST_STRESS or resolved):
                return here, steps, status
        # The end without the ridge needs only a rough one with it.
        here, steps, status = self._descend(start, max_steps, self._ridge, NEAREST_ROUGH)
        if (status is not Status.ok or _extreme(here).any()) and not self._at_limit(here):
            here, more, status = self._descend(here, max_steps - steps, self._ridge)
            steps += more
        ended = status is Status.ok and bool(_extreme(here).any())
        if status is Status.ok and not ended:
            here, more, status = self._descend(here, max_steps - steps, 0.0)
            steps += more
        if ended or (status is Status.stalled and self._at_limit(here)):
            status = Status.edge_collapse if here.theta.max() > WIDEST_STRESS else Status.slack_edges
        return here, steps, status

    def _descend(
        self, here: _Iterate, max_steps: int, ridge: float, tolerance: float = NEAREST_CONVERGED
    ) -> tuple[_Iterate, int, Status]:
        """Steps until one changes no log σ by more than the tolerance."""
        damping, growth = NEAREST_DAMPING, _GROWTH
        for step in range(max_steps):
            change = self._step(here, damping * self._size, ridge)
            longest = float(np.abs(change).max())
            if not np.isfinite(longest):
                return here, step, Status.singular
            there = self.at(here.theta + np.clip(change, -_LONGEST, _LONGEST))
            gained = here.cost + ridge * here.theta @ here.theta - there.cost - ridge * there.theta @ there.theta
            if gained >= 0:
                theta = there.theta - there.theta.mean() if ridge == 0 else there.theta
                converged = longest < tolerance or gained <= 1e-15 * here.cost
                here, damping = there._replace(theta=theta), max(_DECAY * damping, 1e-3 * NEAREST_DAMPING)
                growth = _GROWTH
                if converged:
                    return here, step + 1, Status.ok
            elif longest < NEAREST_CONVERGED:
                return here, step, Status.ok
            else:
                damping, growth = damping * growth, 2 * growth
                if damping > _LARGEST * NEAREST_DAMPING:
                    return here, step, Status.stalled
        return here, max_steps, Status.step_limit

    def _at_limit(self, here: _Iterate) -> bool:
        """Whether an infimum is reached: stresses over many decades leave rounding in the last steps."""
        return bool(_extreme(here).any()) and self.gradient(here) < NEAREST_STALLED

    def gradient(self, here: _Iterate) -> float:
        """Largest component of dD/dθ over Σ|x̂|²/s²."""
        r = here.residual if not self._moves else here.residual[self._free]
        y = here.balance.factor.solve(r)
        pull = np.einsum("ad,ad->a", here.balance.bond_vectors, self.network.free_incidence @ y)
        return float(np.abs(2 * here.balance.sigma * pull).max()) / float(np.sum(self._observed**2) or 1.0)

    def _step(self, here: _Iterate, damping: float, ridge: float) -> Array:
        """The change θ̇ that minimises |r + u + c|² + ridge |θ + θ̇|² + damping |θ̇|² subject to P u + gᵀ(θ̇ σ ∘ L) = 0."""
        n, d, m = len(self._free), self.network.dimension, self.network.n_edges
        sigma, L = here.balance.sigma, here.balance.bond_vectors
        bottom = np.full(n * d, -NEAREST_REGULARISATION * float(sigma.mean()))
        shift = np.concatenate([np.ones(n * d), np.full(m, damping + ridge), bottom])
        factor = self._pattern.factorize(np.concatenate([sigma, (sigma[:, None] * L).T.ravel()]), shift)
        r = here.residual[self._free] if self._moves else here.residual
        solution = factor.solve(np.concatenate([-r.ravel(), -ridge * here.theta, np.zeros(n * d)]))
        if self._moves:
            # The translation c moves each free vertex, and the grounded one: a border of d columns.
            border = np.zeros((len(solution), d))
            border[: n * d] = np.tile(np.eye(d), (n, 1))
            columns = factor.solve(border)
            schur = (n + 1) * np.eye(d) - border.T @ columns
            c = np.linalg.solve(schur, -here.residual.sum(axis=0) - border.T @ solution)
            solution = solution - columns @ c
        return np.asarray(solution[n * d : n * d + m])

    def uncertainty(self, here: _Iterate, error: float) -> tuple[Array, Array]:
        """Standard errors of log σ at a fixed mean, and its least determined direction; NaN for large networks."""
        m, n, d = self.network.n_edges, len(self._free), self.network.dimension
        if m * n * d > LARGEST_DENSE // 4 or not np.isfinite(error):
            return np.full(m, np.nan), np.full(m, np.nan)
        # ∂x/∂θ_α = −P⁻¹ g_αᵀ (σL)_α, so that JᵀJ is an entrywise product.
        forces = here.balance.sigma[:, None] * here.balance.bond_vectors
        spread = here.balance.factor.solve(self.network.free_incidence.T.toarray())
        gram = spread.T @ spread
        if self._moves:
            total = spread.sum(axis=0)
            gram -= np.outer(total, total) / (n + 1)
        gram *= forces @ forces.T
        variances, weakest = _inverse_without_scale(gram)
        return error * np.sqrt(variances), weakest


def _inverse_without_scale(gram: Array) -> tuple[Array, Array]:
    """Diagonal of the inverse of JᵀJ (m, m) across its null vector, equal changes of log σ, and its weakest vector."""
    m, mean = len(gram), float(np.trace(gram)) / len(gram)
    start = np.random.default_rng(0).standard_normal(m)
    try:
        # The null vector gets the mean eigenvalue, which is subtracted from the inverse.
        inverse = dpotri(cho_factor(gram + mean / m, lower=True)[0], lower=1)[0]
        # Products with the inverse read half of it once, solves with the factor twice.
        across = LinearOperator(gram.shape, lambda v: dsymv(1.0, inverse, v - v.mean(), lower=1))
        weakest = eigsh(across, k=1, which="LA", v0=start - start.mean())[1]
        variances = np.diag(inverse) - 1 / (m * mean)
        if (variances > 0).all():
            return variances, weakest[:, 0]
    except (np.linalg.LinAlgError, ArpackNoConvergence):
        pass
    # The zero eigenvalue is that of the scale of σ.
    values, columns = np.linalg.eigh(gram)
    values, columns = values[1:], columns[:, 1:]
    return np.sum(columns**2 / np.maximum(values, np.finfo(float).tiny), axis=1), columns[:, 0]


def _step_pattern(network: Network) -> FixedPattern:
    """The pattern of [[·, 0, P], [0, ·, Rᵀ], [P, R, ·]] for (u, θ̇, λ), from σ (N_b,) and σL by axes (d·N_b,)."""
    n, d, m = len(network.free), network.dimension, network.n_edges
    stresses, multipliers = n * d, n * d + m
    entries = []
    for axis in range(d):
        for i, j, edge, sign in end_pairs(network):
            entries.append((d * i + axis, multipliers + d * j + axis, edge, sign))
        for end, sign in zip(free_ends(network).T, (-1.0, 1.0), strict=True):
            edge = np.flatnonzero(end >= 0)
            entries.append((stresses + edge, multipliers + d * end[edge] + axis, m * (1 + axis) + edge, sign))
    return FixedPattern(2 * n * d + m, m * (1 + d), entries, in_space=d > 2)


def _best_balance(manifold: CriticalManifold, x: Array) -> Array:
    """Positive stresses that balance best at coordinates: the least singular vector of the forces, made positive."""
    network = manifold.network
    L = network.bond_vectors(x)
    force = sp.csr_array(spread_columns(network, L).T)
    normal = sp.csc_array(force.T @ force)
    shift = 1e-10 * float(normal.diagonal().mean())
    factor = splu(sp.csc_array(normal + shift * sp.eye_array(network.n_edges)))
    sigma = np.ones(network.n_edges)
    for _ in range(20):
        sigma = factor.solve(sigma)
        sigma = sigma / np.abs(sigma).max()
    sigma = sigma * np.sign(sigma.sum() or 1.0)
    # Stresses that are all positive are those of a configuration near by, however weak some are.
    least = WEAKEST_START if (sigma > 0).all() else SMALLEST_START
    return np.maximum(sigma, least * float(np.mean(np.abs(sigma))))


def infer_pressures(network: Network, x: Array, error: float | None, sides: ArrayLike | None = None) -> Nearest:
    """σ and p whose configuration is nearest to coordinates x (N_v, 2), with their standard errors for an error s.

    Raises `InputError` for networks without faces, where coordinates do not determine (σ, p), and for sides that no
    balance allows.
    """
    manifold = PressureManifold(network)
    fit, numbers = PositionFit(network, manifold.jumps), sides_of(network, sides)
    u, cost, steps, status = _least_distance(manifold, fit, x)
    m = network.n_edges
    found = manifold.solve(u[:m], u[m:])
    scale = float(found.value.sigma @ u[:m] / (u[:m] @ u[:m]))
    displacement, shift = _displacement(network, found.value.coordinates, x)
    distance = float(np.sqrt(np.mean(np.sum(displacement**2, axis=1))))
    length = np.linalg.norm(network.bond_vectors(x), axis=1)
    # Without degrees of freedom the positions are those of (σ, p), unless these have lost their digits.
    if not found.ok or (fit.freedom == 0 and not distance < REPRODUCED * float(length.mean())):
        status = Status.ill_conditioned
    s, chi_squared = _scatter(cost, fit.freedom, error)
    L = found.value.bond_vectors
    tensions = scale * arc_tensions(fit, u, L, numbers)
    spread, relative = np.full(len(u), np.nan), np.full(len(tensions), np.nan)
    if status is Status.ok and (2 * network.n_vertices) ** 2 <= LARGEST_DENSE:
        spread, relative = standard_errors(fit, u, L, numbers)
    note = _remark(found.value.sigma, chi_squared, fit.freedom) if status is Status.ok else ""
    # More coordinates than unknowns may still leave one open, as on straight lines through vertices of four edges.
    if fit.freedom and (lost := float(np.median(s * relative))) > 1:
        status = Status.ill_conditioned
        note = f"the median standard error of a tension is {lost:.2g} times the tension: trace sides that are curved"
    return Nearest(
        value=found.value,
        status=status,
        note=note,
        stats=Stats("gauss-newton" if fit.freedom else "linear", steps, found.value.residual, found.stats.condition),
        displacement=displacement,
        translation=shift,
        stress_error=s * scale * spread[:m],
        undetermined=np.full(m, np.nan),
        pressure_error=s * scale * spread[m:],
        amplification=float(np.sqrt(np.mean(relative**2)) * length.sum() / len(tensions)),
        error=s,
        distance=distance,
        chi_squared=chi_squared,
        freedom=fit.freedom,
        sides=numbers,
        side_tensions=tensions,
        side_errors=s * np.abs(tensions) * relative,
    )


def _least_distance(manifold: PressureManifold, fit: PositionFit, x: Array) -> tuple[Array, float, int, Status]:
    """(σ, p) of the nearest configuration, with D s², by Gauss-Newton steps, halved until they come nearer."""
    network, m = manifold.network, manifold.network.n_edges
    L = network.bond_vectors(x)
    u = fit.least_forces(L)
    if fit.freedom == 0:
        return u, 0.0, 1, Status.ok

    def at(u: Array) -> tuple[float, Array, Array]:
        """The squared distance, x + c − x̂ of vertices that are not fixed, and bond vectors, at (σ, p)."""
        balance = manifold.balance(u[:m], u[m:])
        apart = _displacement(network, network.all_coordinates(balance.coordinates), x)[0]
        apart = apart[network.free] if network.pins else apart
        return float(np.sum(apart**2)), apart, balance.bond_vectors

    cost = np.nan
    try:
        # The same forces, weighted by the errors that those of the positions give them.
        starts = u, fit.step(L, u, 0 * at(u)[1])[0]
        (cost, apart, L), u = min(((at(start), start) for start in starts), key=lambda start: start[0][0])
        for step in range(2, _MOST_STEPS):
            there, gain = fit.step(L, u, apart)
            change, part, nearer = there - u, 1.0, at(there)
            ended = gain < _NO_GAIN * cost or cost < (NEAREST_EXACT * np.linalg.norm(L)) ** 2
            while not nearer[0] < cost and not ended and part > _SHORTEST:
                part /= 2
                nearer = at(u + part * change)
            if not nearer[0] < cost:
                return u, cost, step, Status.ok if ended else Status.stalled
            (cost, apart, L), u = nearer, u + part * change
            if ended:
                return u, cost, step, Status.ok
    except RuntimeError:  # an exact zero pivot
        return u, cost, 1, Status.singular
    return u, cost, _MOST_STEPS, Status.step_limit


def _displacement(network: Network, coordinates: Array, x: Array) -> tuple[Array, Array]:
    """x + c − x̂ (N_v, d) with the best translation c (d,), zero with pins."""
    apart = coordinates - x
    shift = np.zeros(x.shape[1]) if network.pins else -apart.mean(axis=0)
    return apart + shift, shift


def _scatter(cost: float, freedom: int, error: float | None) -> tuple[float, float]:
    """The error s of coordinates, given or of D s², and χ² = D, which is NaN without a given error."""
    if error is not None:
        return error, cost / error**2 if freedom > 0 else np.nan
    return (float(np.sqrt(cost / freedom)) if freedom > 0 else np.nan), np.nan


def _remark(sigma: Array, chi_squared: float, freedom: int) -> str:
    """Sentences on compressed edges and on χ²."""
    n_pushed = int(np.sum(sigma < 0))
    pushed = f"{n_pushed} of {len(sigma)} edges carry compression" if n_pushed else ""
    return "; ".join(filter(None, (pushed, _misfit(chi_squared, freedom))))


def _misfit(chi_squared: float, freedom: int) -> str:
    """A sentence on χ² outside of its 99 % interval."""
    if not freedom > 0 or np.isnan(chi_squared):
        return ""
    low, high = chi2.ppf([0.005, 0.995], freedom)
    test = f"χ² = {chi_squared:.4g} for {freedom} degrees of freedom, of which 99 % have {low:.4g} to {high:.4g}"
    if chi_squared > high:
        return f"{test}: balance does not explain the positions within their error, nor do the stated errors hold"
    return f"{test}: the positions are more exact than the given error" if chi_squared < low else ""
