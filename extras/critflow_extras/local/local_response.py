"""The response of pairs of vertices to a change of distance of another pair: allostery at the transition and past it.

Impose a small change of the distance of a source pair.  At vanishing stress all edges keep their lengths and the stress
alone resists, so that the response is a function of the stress and the geometry; no stiffness enters:

    min ½ uᵀ(P ⊗ 1)u   subject to   R u = 0,  a_sᵀ u = 1,          η = (a_tᵀu/|r_t|)/(1/|r_s|)

with a = n (e_head − e_tail) along a pair r.  Its solution is the motion by a force along the source (`compliance`),
    η = (|r_s|/|r_t|) G_ts/G_ss,   stiffness of the source 1/G_ss.
Under finite stress the Hessian RᵀKR + P takes the place of P, and edges yield.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import singledispatch
from typing import Any

import numpy as np

from critflow.arguments import is_number, of_kind, of_known_kind, shown
from critflow.calls import running
from critflow.elastic import under_stress
from critflow.linear_response import accumulated_rounding
from critflow.manifold import CriticalConfiguration
from critflow.networks import Array, Network
from critflow.numerics import EPS
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.saddles import REGULARISATION, Saddle
from critflow.self_stress import require_one_stress_by_rank
from critflow.springs import SpringState
from critflow_extras.local.compliance import Compliances, HessianCompliances, HessianFactor, compliances
from critflow_extras.local.local_quantity import partials, stiffness_error, strain, strain_error
from critflow_extras.local.pairs import Pair, Target, Vertex, check_distinct, next_neighbours, pair_of, target_of

# Part by which a response may deviate at the stress `limit`; error beyond which responses are not trusted, as a part of
# the largest of them or of the strain of the source.
DEVIATION, TRUSTED = 0.01, 0.01
_MOST_TARGETS = 3000  # of "all": each keeps its motion of all vertices
_MARGIN = 30.0  # errors of growths in units of the changes that two sets of roundings cause
_TOLERANCE = 1e-9  # forces of a state in units of its stiffness that count as balanced


@dataclass(frozen=True, eq=False, repr=False)
class LocalResponse(Record):
    """The response of target pairs, and of single vertices, to a source pair.

    source, targets  the pairs, with the image of the head of each, or vertices with a direction
    strains          η (n,): relative change of each target distance per relative change of the source distance; of a
                     vertex its motion along the direction, a length, in a network without pins relative to the mean
    errors           of them (estimate), (n,)
    stiffness        force along the source per change of its distance: of a configuration per unit of stress, since it
                     is t times this for the stress tσ, Σσ² = N_b; of a state in units of k
    stiffness_error  of it (estimate)
    growth           dη/dt of each target for the stress tσ, (n,); NaN for a state
    growth_errors    of them (estimate), (n,), also relative to `growth` those of `limit`
    displacements    u (N_v, d) per relative change of the source distance; of periodic networks with mean zero
    """

    source: Pair
    targets: tuple[Target, ...]
    strains: Array
    errors: Array
    stiffness: float
    stiffness_error: float
    growth: Array = field(repr=False)
    growth_errors: Array = field(repr=False)
    displacements: Array = field(repr=False)

    @property
    def limit(self) -> Array:
        """Stress t (n,), in units of k, at which each response deviates by 1 %, by its next order; NaN for a state."""
        with np.errstate(divide="ignore"):
            return DEVIATION * np.abs(self.strains) / np.abs(self.growth)

    def strongest(self, number: int = 5) -> LocalResponse:
        """The same response of the targets of the largest |η|, that many or all of them, the largest first.

        Raises `InputError` for a number below one.
        """
        if of_kind(int, number=number) < 1:
            raise InputError(f"number must be one or more, not {number}")
        kept = np.argsort(-np.abs(self.strains), kind="stable")[:number]
        arrays = {name: getattr(self, name)[kept] for name in ("strains", "errors", "growth", "growth_errors")}
        return replace(self, targets=tuple(self.targets[n] for n in kept), **arrays)


@running("local_response")
def local_response(springs: Any, source: Any, targets: Any, throw: bool = True) -> Solution[LocalResponse]:
    """How far target pairs of vertices are stretched by a stretched source pair.

    springs  a critical configuration: the limit of vanishing stress; or a state under stress, of `strain_path`, or with
             weak forces, of `weak_equilibrium`
    source   two vertices (i, j) that no edge joins, or (i, j, image) with the cell of j relative to that of i.  Without
             an image it is the nearest one at equal stresses, which `source` of the value states
    targets  a pair, or a list of pairs; (i, (n_x, n_y)) is the motion of vertex i along a direction; "all": every pair
             that two edges in a row join, up to 3000, of which `strongest` of the value picks the largest responses

    Errors (estimate): `errors` of the value, against the configuration in exact balance under the floating-point σ; of
    a state, at its coordinates as given.

    `Status.rigid` and NaN where edges hold the source; `Status.ill_conditioned` and NaN where an error exceeds a
    hundredth, or is not known since the solve has not converged or rounding hides the growth;
    `Status.unstable` and NaN for a state that is no minimum.
    Raises `InputError` for pairs that are edges, equal vertices, a target equal to the source, several self-stresses,
    stresses that are not positive, and states at rest or out of balance.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> best = cf.optimize(cf.voronoi_network(n_vertices=20, seed=1), "B_0")
    >>> found = ce.local_response(best, source=(0, 9), targets=[(4, 15)]).value
    >>> round(float(found.strains[0]), 6)  # 4-15 shrinks while 0-9 grows
    -0.734505
    """
    springs = of_known_kind(response_of_pairs, CriticalConfiguration, SpringState, springs=springs)
    of_kind(bool, throw=throw)
    network = springs.network
    one = pair_of(network, source, "source")
    if isinstance(targets, str) and targets == "all":
        others = _all_pairs(network, one)
    else:
        others = [target_of(network, target, f"targets[{n}]") for n, target in enumerate(_pairs(targets))]
    for other in others:
        check_distinct(one, other)
    solution: Solution[LocalResponse] = response_of_pairs(springs, one, tuple(others))
    return solution.or_raise("no local response") if throw else solution


def _all_pairs(network: Network, source: Pair) -> list[Target]:
    """The targets of "all", without the source."""
    others: list[Target] = [pair for pair in next_neighbours(network) if pair not in (source, source.reversed)]
    if not 0 < len(others) <= _MOST_TARGETS:
        raise InputError(
            f"targets='all' are {len(others):,} pairs here, not 1 to {_MOST_TARGETS:,}: give a list of pairs"
        )
    return others


def _pairs(targets: Any) -> list[Any]:
    """The pairs of a list, or the only one."""
    if not isinstance(targets, Sequence | np.ndarray) or isinstance(targets, str) or not len(targets):
        raise InputError(
            f"targets must be a list of pairs of vertices, such as [(3, 20)], or 'all', not {shown(targets)}"
        )
    return [targets] if is_number(targets[0]) else list(targets)


@singledispatch
def response_of_pairs(springs: Any, source: Pair, targets: tuple[Target, ...]) -> Solution[LocalResponse]:
    """The response by the kind of the springs."""
    raise InputError(f"local responses are those of springs on edges, not of {shown(springs)}")


@response_of_pairs.register(CriticalConfiguration)
def _at_transition(
    critical: CriticalConfiguration, source: Pair, targets: tuple[Target, ...]
) -> Solution[LocalResponse]:
    if not np.isfinite(critical.bond_vectors).all():
        raise InputError("the configuration is not known, its coordinates are NaN: look at the status of its solution")
    found = compliances(critical)
    require_one_stress_by_rank(critical, "follow strain_path() and give one of its states")
    if found.held(source):
        note = f"the edges hold the source {source}, so that no motion changes its distance: name another pair"
        return _failed(critical, source, targets, Status.rigid, note)
    errors = np.array([strain_error(found, critical, source, target) for target in targets])
    own_error, growth = stiffness_error(found, critical, source), _growths(found, source, targets)
    own = found.compliance(source, source)
    # Those of η and 1/G_ss, by which it is made of the growths of compliances, and those of the latter.
    growth_errors = np.full_like(growth, np.nan)
    if np.isfinite(errors).all():
        own_growth = abs(found.growth(source, source) / own)
        growth_errors = errors * own_growth + np.abs(growth) * own_error * own
        growth_errors += _MARGIN * EPS * np.abs(growth)
        for other in _disturbed(critical):
            growth_errors += _MARGIN * np.abs(_growths(other, source, targets) - growth)
        # Errors are of first order in motions that are not known themselves where their growths are not.
        strains = np.array([strain(found, source, target) for target in targets])
        errors = np.where(growth_errors < own_growth * np.maximum(1.0, np.abs(strains)), errors, np.inf)
    return _answer(critical, found, source, targets, errors, np.array([growth, growth_errors]), own_error)


def _disturbed(critical: CriticalConfiguration) -> Iterator[Compliances]:
    """Compliances by two sets of errors of the bonds and two regularisations, of which refinement may leave a part."""
    L, sigma = critical.bond_vectors, critical.sigma
    # By their roundings at least: half of one moves no number.
    moved = np.maximum(critical.bond_errors[:, None], EPS * np.abs(L))
    for seed, part in enumerate((0.1, 0.01)):
        there = L + moved * np.random.default_rng(seed).choice([-1.0, 1.0], L.shape)
        factor = critical.manifold.saddle.factorize(sigma, there, part * REGULARISATION)
        yield Compliances(critical.network, sigma, there, factor, tolerance=0.0)


def _growths(found: Compliances, source: Pair, targets: tuple[Target, ...]) -> Array:
    """dη/dt of each target, (n,)."""
    ratio = found.motion(source).distance / np.array([found.motion(target).distance for target in targets])
    mixed, own = np.array([found.growth(target, source) for target in targets]), found.growth(source, source)
    eta = np.array([strain(found, source, target) for target in targets])
    return np.asarray((ratio * mixed - eta * own) / found.compliance(source, source))


@response_of_pairs.register(SpringState)
def _under_stress(state: SpringState, source: Pair, targets: tuple[Target, ...]) -> Solution[LocalResponse]:
    if not under_stress(state, _TOLERANCE):
        raise InputError("springs without stress do not resist: give the critical configuration, or a strained state")
    found = _of_state(state)
    if found is None:
        return _failed(state, source, targets, Status.unstable, "")
    own = found.compliance(source, source)
    errors = []
    for target in targets:
        ratio, eta = found.motion(source).distance / found.motion(target).distance, strain(found, source, target)
        solves = (ratio * found.error(target, source) + abs(eta) * found.error(source, source)) / own
        of_stress = np.abs(partials(found, source, target)[0]) * state.stress_rounding
        errors.append(solves + float(accumulated_rounding(of_stress)) + 4 * EPS * abs(eta))
    of_stress = np.abs(found.own_derivatives(source)[0]) * state.stress_rounding
    own_error = (found.error(source, source) + float(accumulated_rounding(of_stress))) / own**2
    return _answer(state, found, source, targets, np.array(errors), np.full((2, len(targets)), np.nan), own_error)


def _of_state(state: SpringState) -> Compliances | None:
    """The compliances of a state under stress; None for a saddle of the energy."""
    network, sigma, L, K = state.network, state.sigma, state.bond_vectors, state.modified_stiffness
    if type(state) is SpringState and isinstance(K, np.ndarray):
        # With yielding edges, which keep their digits however small the stress is.
        saddle = Saddle(network).factorize(sigma, L, compliance=1 / K)
        stable = saddle.factor.n_negative == int(np.count_nonzero(K > 0))
        return Compliances(network, sigma, L, saddle, 1 / K) if stable else None
    # Other kinds couple edges, or have energies besides those of edges.
    factor = state.factorize()
    if factor.indefinite:
        return None
    return HessianCompliances(network, sigma, L, HessianFactor(factor), resisting=np.abs(state.edge_stiffness))


def _answer(
    springs: CriticalConfiguration | SpringState,
    found: Compliances,
    source: Pair,
    targets: tuple[Target, ...],
    errors: Array,
    growth: Array,
    own_error: float,
) -> Solution[LocalResponse]:
    """The solution, refused where an error exceeds a hundredth of the largest strain, that of the source included.

    growth  dη/dt and its errors, (2, n)
    """
    strains, own = np.array([strain(found, source, target) for target in targets]), found.compliance(source, source)
    motion = found.motion(source)
    # The motion of a vertex is a length: that of the source is its distance.
    unit = np.array([motion.distance if isinstance(target, Vertex) else 1.0 for target in targets])
    moved = motion.displacement * motion.distance / own
    if not springs.network.pins:
        moved = moved - moved.mean(axis=0)
    force, slip = motion.residual
    residual = max(float(np.abs(part).max(initial=0.0)) for part in (force, slip))
    # Errors are NaN, not known, where those of the bond vectors are.
    if not np.isfinite(strains).all() or (errors > TRUSTED * np.maximum(unit, np.abs(strains))).any():
        note = "rounding errors exceed a hundredth of the response: choose stresses of more similar magnitude"
        return _failed(springs, source, targets, Status.ill_conditioned, note)
    value = LocalResponse(
        source, targets, strains, errors, 1 / own, own_error + 2 * EPS / own, growth[0], growth[1], moved
    )
    return Solution(value, Status.ok, Stats("saddle", len(targets) + 1, residual, error_bound=float(errors.max())))


def _failed(
    springs: CriticalConfiguration | SpringState, source: Pair, targets: tuple[Target, ...], status: Status, note: str
) -> Solution[LocalResponse]:
    """No response, for a reason."""
    nothing, unknown = np.full(len(targets), np.nan), np.full_like(springs.coordinates, np.nan)
    value = LocalResponse(source, targets, nothing, nothing, np.nan, np.nan, nothing, nothing, unknown)
    return Solution(value, status, Stats("saddle", 1), note)
