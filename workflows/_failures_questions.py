"""The questions that are asked of every problem: what the library says, and how far that is from the reference."""

from __future__ import annotations

import numpy as np

from critflow import (
    Status,
    critical_from_lengths,
    elastic_moduli,
    equilibrium,
    linear_response,
    optimize,
    rigidity,
    stiffening,
    transition_moduli,
)
from critflow.objectives import pure_shear, transition_modulus

from . import _failures_reference as reference
from ._failures_judge import Answer, Carried, Judgement, judged
from ._failures_problems import METHODS, OBJECTIVES
from ._failures_reference import Unknown

# Beyond this FIRE has failed; the default limit would take a minute a network.
_FIRE_STEPS = 20_000


def asked(quantity: str, problem) -> Judgement:
    """The judgement of one quantity of a problem."""
    ask, compare = QUESTIONS[quantity]
    return judged(lambda: ask(problem), lambda answer: compare(problem, answer))


def _coordinates(solution):
    return Answer(solution.status, solution.value.coordinates, solution.stats.error_bound)


def _off(answer, exact):
    """Largest coordinate error, relative to the largest coordinate."""
    return reference.distance(answer.values, exact.coordinates), reference.largest(exact.coordinates)


def _each(answer, truth, scale=None):
    """Error of each number, relative to the largest of them or to a scale."""
    errors = [reference.distance([value], np.array([t], dtype=object)) for value, t in zip(answer.values, truth, strict=True)]
    return errors, scale or reference.largest(truth)


# At the transition


def _configuration(problem):
    return _coordinates(problem.solution)


def _configuration_error(problem, answer):
    return _off(answer, problem.exact)


def _transition_moduli(problem):
    value = transition_moduli(problem.critical)
    return Answer(Status.ok, (value.bulk, value.shear))


def _transition_error(problem, answer):
    truth = problem.moduli or reference.transition_moduli(problem.network, problem.exact, digits=problem.digits)
    if problem.moduli:
        truth = reference.decimals(problem.moduli)
    return _each(answer, truth)


def _stiffening(problem):
    solution = stiffening(problem.network, problem.critical, problem.manifold.saddle, throw=False)
    return Answer(solution.status, _plain(solution.value), _plain(solution.stats.error_bound))


def _stiffening_error(problem, answer):
    if problem.moduli:
        raise Unknown("the reference holds for one self-stress")
    return _each(answer, reference.stiffening(problem.network, problem.exact, digits=problem.digits))


def _plain(numbers):
    """The fields of Moduli or of Stiffening, or one number as it is."""
    return numbers if isinstance(numbers, float) else tuple(vars(numbers).values())


def _rigidity(problem):
    coordinates = np.asarray(problem.critical.coordinates, dtype=problem.dtype)
    solution = rigidity(problem.network, coordinates)
    return Answer(solution.status, (solution.value.n_self_stresses, solution.value.n_zero_modes), 0.0)


def _rigidity_error(problem, answer):
    network, n_stresses = problem.network, problem.n_stresses(problem.network)
    truth = (n_stresses, 2 * network.n_vertices - network.n_edges + n_stresses)
    return np.abs(np.subtract(answer.values, truth)), 1.0


def _elastic_moduli(problem):
    solution = elastic_moduli(problem.network, problem.network.positions)
    # A network without more edges than motions has no self-stress where it was drawn.
    floppy = problem.network.n_edges <= 2 * (problem.network.n_vertices - 1)
    proper = (Status.floppy,) if floppy else (Status.ok, Status.singular)
    return Answer(solution.status, _plain(solution.value), _plain(solution.stats.error_bound), proper)


def _elastic_error(problem, answer):
    if answer.status is Status.floppy:
        return np.abs(answer.values), 1.0
    bulk, shear = reference.moduli_at_rest(problem.network, problem.network.positions)
    return _each(answer, (bulk, shear, shear))


# Past the transition


def _equilibrium(method, limit):
    def ask(problem):
        return _coordinates(equilibrium(problem.strained, method, max_steps=limit, throw=False))

    return ask


def _equilibrium_error(problem, answer):
    state = problem.strained
    return _off(answer, reference.equilibrium(state.network, state.rest_lengths, _nearest(problem, answer)))


def _nearest(problem, answer):
    """Where the reference starts: at the end of many small steps, so that another equilibrium than that is an error."""
    if problem.strain <= 1e-2:
        return answer.values
    x, state, n = None, problem.strained, int(np.ceil(problem.strain / 5e-3))
    for step in range(1, n + 1):
        size = np.sqrt(1 + problem.strain * step / n)
        network = problem.network.deformed(size * np.eye(2))
        before = np.sqrt(1 + problem.strain * (step - 1) / n)
        x = size / before * reference.floats(x) if step > 1 else size * problem.critical.coordinates
        x = reference.equilibrium(network, state.rest_lengths, x).coordinates
    return reference.floats(x)


def _linear_response(problem):
    reached = equilibrium(problem.strained, throw=False)
    if not reached.ok:
        raise Carried(reached.status)
    problem.reached = reached.value
    solution = linear_response(reached.value)[0]
    return Answer(solution.status, _plain(solution.value), _plain(solution.stats.error_bound))


def _linear_error(problem, answer):
    """Against the response of the exact equilibrium next to the state."""
    state = problem.reached
    exact = reference.equilibrium(state.network, state.rest_lengths, state.coordinates)
    return _each(answer, reference.linear_response(state.network, exact.bond_vectors, state.rest_lengths))


# From rest lengths


def _lengths(method):
    def ask(problem):
        solution = critical_from_lengths(problem.manifold, problem.rest_lengths, method, throw=False)
        problem.found = solution
        return _coordinates(solution)

    return ask


def _conic_error(problem, answer):
    found = problem.found.value
    exact = reference.critical_from_lengths(problem.network, problem.rest_lengths, found.sigma, found.coordinates)
    return _off(answer, exact)


def _strain_error(problem, answer):
    """Against the equilibrium of the rest lengths that the protocol came to, a little past the transition."""
    return _off(
        answer,
        reference.equilibrium(problem.network, problem.found.stats.details["rest_lengths"], answer.values),
    )


# Optima


def _optimum(objective, method):
    def ask(problem):
        solution = _optimised(problem, objective, method)
        problem.found = solution
        return Answer(solution.status, (solution.stats.details["objective"],))

    return ask


def _optimised(problem, name, method, start=None, tolerance=1e-12):
    objective = name
    if name == "shear_modulus" and problem.threshold is None:
        objective = transition_modulus(problem.network, pure_shear(2))
    limit = _FIRE_STEPS if method == "fire" else None
    threshold = problem.threshold or 0.1
    return optimize(
        problem.manifold, objective, method, start=start, threshold=threshold, tolerance=tolerance, max_steps=limit,
        throw=False,
    )  # fmt: skip


def _optimum_error(name):
    def compare(problem, answer):
        """Against the exact value of the σ returned, and of the best σ known to lie uphill of it."""
        sigma = problem.found.value.sigma
        exact = reference.configuration(problem.network, sigma, digits=reference.digits_for(sigma))
        there = float(reference.objective(problem.network, name, exact, problem.threshold))
        best = _best(problem, name, sigma)
        scale = 1.0 if name.endswith("variance") else float(max(abs(there), abs(best)))
        return max(abs(answer.values[0] - there), abs(there - best)), scale

    return compare


def _best(problem, name, sigma):
    """The best value known: in closed form, of equal lengths, of several starts, or at the top of the same hill."""
    if name == "bulk_modulus":
        exact = reference.configuration(problem.network, problem.network.stiffness)
        L, k = exact.bond_vectors, reference.decimals(problem.network.stiffness)
        return float((k * (L * L).sum(axis=1)).sum() / (4 * reference.volume(problem.network)))
    if name == "shear_modulus":
        # It has many local optima, of which a descent promises one.
        return _polished(problem, name, sigma)
    if not hasattr(problem, "known"):
        problem.known = {}
    if name not in problem.known:
        starts = [None, *(0.5 + problem.rng.random((2, problem.network.n_edges)))]
        values = [_optimised(problem, name, "newton", start).stats.details["objective"] for start in starts]
        values.append(_optimised(problem, name, "auto").stats.details["objective"])
        problem.known[name] = float(np.nanmin(values))
    return problem.known[name]


def _polished(problem, name, sigma):
    solution = _optimised(problem, name, "newton", start=sigma, tolerance=1e-14)
    exact = reference.configuration(
        problem.network, solution.value.sigma, digits=reference.digits_for(solution.value.sigma)
    )
    return float(reference.objective(problem.network, name, exact, problem.threshold))


QUESTIONS = {
    "configuration": (_configuration, _configuration_error),
    "transition_moduli": (_transition_moduli, _transition_error),
    "stiffening": (_stiffening, _stiffening_error),
    "rigidity": (_rigidity, _rigidity_error),
    "elastic_moduli": (_elastic_moduli, _elastic_error),
    "equilibrium_newton": (_equilibrium("newton", None), _equilibrium_error),
    "equilibrium_fire": (_equilibrium("fire", _FIRE_STEPS), _equilibrium_error),
    "linear_response": (_linear_response, _linear_error),
    "lengths_conic": (_lengths("conic"), _conic_error),
    "lengths_strain": (_lengths("strain"), _strain_error),
    **{f"{name}_{method}": (_optimum(name, method), _optimum_error(name)) for name in OBJECTIVES for method in METHODS},
}
