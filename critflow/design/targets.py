"""Design for targets: a critical configuration with requested properties, or a stated reason why it does not exist.

    minimise  preference(z)  subject to  l_i ≤ O_i(z) ≤ u_i,
over z = log |σ| of prescribed signs, or z = σ.  There are N_b unknowns and few targets O_i, so feasible ones have many
solutions and the preference selects one.  All gradients are exact: one solve with P for each target.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import checked
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold, require_one_self_stress
from critflow.design.optimize import optimize
from critflow.design.result import Design, of_targets
from critflow.design.target_bounds import excluded, limiting_stress
from critflow.design.target_problem import Preference, TargetProblem, Unknowns
from critflow.networks.network import Array, Network
from critflow.quantities.errors import error_bounds
from critflow.quantities.table import Wanted, edge_limits, wanted
from critflow.result import InputError, Stats, Status
from critflow.solvers.constrained import Minimum, minimise_constrained

UNLIMITED = 1e-6  # gradient of a target by log σ, in units of its size, below which a search cannot start there

_MOST_STEPS = 300
# Steps of one start in which the targets must be reached.
_RESTORING = 60
# Longest change of log σ in one step, spread of random starts, and steps of the ascent that gives the last start.
_LONGEST, _SPREADS, _ASCENT = 0.4, (0.1, 0.5), 30


@checked
def design(
    network: Network | CriticalManifold,
    targets: Mapping[str, Any],
    *,
    prefer: str | CriticalConfiguration | ArrayLike = "least_change",
    within: Mapping[str, Any] | None = None,
    signs: str | ArrayLike = "positive",
    free: str | ArrayLike | None = None,
    start: ArrayLike | None = None,
    max_steps: int = _MOST_STEPS,
    throw: bool = True,
) -> Design[CriticalConfiguration]:
    """The critical configuration with requested properties that a preference selects.

    targets  name → value, (low, high), or "largest" or "smallest" for one of them.  Names are "B_0", "G_0", "V_L",
             "V_tau" (or those of `optimize`), "C_B", "C_G" (energy convention), "S_xx", "S_xy", ... for S/√D with
             C = S⊗S/(V D), and "modulus[uniaxial]" and "stiffening[uniaxial]", ... for the moduli M_0 of deformations
             and their derivatives with strain (`stiffening`)
    prefer   "least_change" of log σ from the start, "length_variance", "tension_variance", or a configuration or
             coordinates (N_v, d) to be near to
    within   limits (low, high) of "lengths", and of "tensions" and "force_densities" in units of their mean; each limit
             is a number, one an edge, or None
    signs    "positive", 1 or −1 for each edge (N_b,), or "any"
    free     edges whose stress may change, indices or a mask; all by default.  Stiffnesses and rest lengths are changed
             by `design_stiffness` and `design_onset`
    start    stresses σ_0 (N_b,), of size 1 by default

    Many parameters: each is a part of the problem.

    The optimum is local.  Error bound (proof): targets beyond a closed-form bound are refused, `Status.infeasible`,
    with the bound in the note.  Otherwise `Status.infeasible` means that no start reached the targets: the
    configuration is the best compromise found.  With `Status.step_limit` or `Status.stalled` the targets are reached,
    unless the note names the one that is missed, and the preference is not at its minimum;
    for "least_change" the status is then `ok`, and the note says so.
    `stats.residual` is the largest error of a target relative to its size.
    Raises `InputError` for unknown or contradictory targets and wrong shapes or signs, `SolveError` with `throw`.
    """
    if max_steps < 0:
        raise InputError(f"max_steps must not be negative, not {max_steps}")
    manifold = CriticalManifold.of(network)
    wants = wanted(manifold, targets)
    if any(target.objective.one_self_stress for target in wants):
        require_one_self_stress(manifold.network, "design its stiffnesses, or prune it to one self-stress")
    unknowns = Unknowns.of(manifold.network, start, free, signs)
    goal = next((target for target in wants if target.goal), None)
    preference = Preference(manifold.network, prefer, goal)
    limits = edge_limits(manifold.network.n_edges, within or {})
    problem = TargetProblem(manifold, unknowns, preference, wants, limits)
    positive = unknowns.signs is not None and bool((unknowns.signs > 0).all())
    note = excluded(manifold, wants, positive)
    if note:
        solution = _report(problem, wants, _at_start(problem), Status.infeasible, note)
    else:
        best = _best(problem, wants, max_steps)
        # The least change only selects: a design that has its targets is complete without it.
        selected = best.reached and preference.name == "change"
        status = Status.ok if selected else best.status
        solution = _report(problem, wants, best, status, _note(problem, best))
    return solution.or_raise("no configuration with these properties was found") if throw else solution


def _at_start(problem: TargetProblem) -> Minimum:
    return minimise_constrained(problem, problem.unknowns.origin, np.inf, _LONGEST, 0)


def _best(problem: TargetProblem, wants: list[Wanted], max_steps: int) -> Minimum:
    """The first search that reaches the targets, or the one with the smallest violation, continued to its end."""
    best: Minimum | None = None
    left = max_steps
    for start in _starts(problem, wants):
        found = minimise_constrained(problem, start, problem.preference.tolerance, _LONGEST, left, restoring=_RESTORING)
        left -= found.steps
        if best is None or found.reached or not found.violation >= best.violation:
            best = found
        if found.reached or left <= 0:
            break
    assert best is not None
    if not best.reached and left > 0:
        found = minimise_constrained(problem, best.point.z, problem.preference.tolerance, _LONGEST, left)
        best = found if found.violation < best.violation else best
    return best


def _starts(problem: TargetProblem, wants: list[Wanted]) -> Iterator[Array]:
    """z of the start, of random ones, and of an ascent of the shear modulus, whose stresses cover two decades.

    Stresses of any sign start from the largest S/√D in the direction of a prescribed one as well.
    Gradients of B_0 and C_B vanish at σ = k, where B_0 is largest and C_B smallest.
    """
    unknowns, manifold = problem.unknowns, problem.manifold
    origin = unknowns.origin
    shaken = np.random.default_rng(0).standard_normal((len(_SPREADS), len(origin)))
    at_origin = problem.at(origin)
    rows = at_origin.rows(np.arange(len(problem.targets)))
    if not len(rows) or np.linalg.norm(rows, axis=1).min() > UNLIMITED:
        yield origin
    yield origin + _SPREADS[0] * shaken[0]
    if unknowns.signs is not None and (unknowns.signs > 0).all():
        sheared = optimize(manifold, "shear_modulus", throw=False, max_steps=_ASCENT).value.sigma
        if np.isfinite(sheared).all() and (sheared > 0).all():
            yield unknowns.of_stress(sheared)
    if unknowns.signs is None:
        limiting = limiting_stress(manifold, wants)
        if limiting is not None:
            yield unknowns.of_stress(limiting)
    yield origin + _SPREADS[1] * shaken[1]


def _note(problem: TargetProblem, best: Minimum) -> str:
    """The error that remains, and the next step."""
    if best.status is Status.ok:
        return ""
    if best.reached:
        return f"the targets are reached, and {problem.preference.name} is not yet at its minimum: raise max_steps"
    c = best.point.constraints
    excess = np.abs(c - np.clip(c, problem.low, problem.high))
    worst = int(np.argmax(excess[: len(problem.targets)])) if len(problem.targets) else 0
    if len(problem.targets) and excess[worst] > 0.1 * excess.max():
        name = problem.targets[worst].name
        return (
            f"no start reached all targets together, {name} misses by {excess[worst] * problem.sizes[worst]:.3g}: "
            + ("raise max_steps, " if best.status is Status.step_limit else "")
            + ("widen the limits of the edges, " if problem.limits else "")
            + "relax one, or give another start"
        )
    return "no start reached the targets inside the limits of the edges: widen the limits, or relax a target"


def _report(
    problem: TargetProblem, wants: list[Wanted], found: Minimum, status: Status, note: str
) -> Design[CriticalConfiguration]:
    """The design at the end of a search."""
    unknowns, z = problem.unknowns, found.point.z
    solved = problem.manifold.solve(unknowns.stress(z))
    balance = problem.manifold.balance(unknowns.stress(z))
    values, by_sigma = problem.values(balance, [target.objective for target in wants])
    rows = unknowns.gradients(by_sigma, balance.sigma)
    names = [target.name for target in wants]
    limited = [target.name for target in problem.targets]
    # dpreference/dlimit = −μ of the constraint in units of its size.
    derivatives = -found.multipliers[: len(limited)] / problem.sizes
    costs = dict.fromkeys(names, 0.0) | {
        name: problem.preference.shown(float(derivative), len(balance.sigma))
        for name, derivative in zip(limited, derivatives, strict=True)
    }
    bounds = error_bounds([target.objective for target in wants], solved.value)
    change = z - unknowns.origin
    if unknowns.signs is not None and len(unknowns.free) == problem.manifold.network.n_edges:
        change = change - change.mean()
    return Design(
        value=solved.value,
        status=status if solved.ok else solved.status,
        stats=Stats("sqp", found.steps, found.violation, error_bound=solved.value.error_bound),
        note=note,
        preference=problem.preference.shown(found.point.value, len(balance.sigma)),
        distance=float(np.sqrt(np.mean(change**2))),
        **of_targets(names, values, bounds, np.array(list(costs.values())), rows),
    )
