"""The quantities of every problem: the answer of the library and its error against the reference."""

from functools import partial
from itertools import pairwise

import numpy as np

import critflow as cf
from critflow.linear_response import linear_response
from critflow.networks import validated_coordinates
from critflow.optima import objective_of
from critflow.quantities import evaluate, pure_shear, stress_hessian, transition_modulus
from critflow.self_stress import Spectrum, count_self_stresses, edge_without_length
from critflow.taut_part import backbone

from ...shared.populations import OPTIMA
from ...shared.strain_protocol import critical_by_strain
from .. import reference
from ..reference import Unknown
from .outcomes import Answer, Finding, Unavailable, assessed
from .peers import PEERS, peer_finding
from .problems import METHODS

# Beyond this FIRE has failed; the default limit would take a minute a network.
_FIRE_STEPS = 20_000


def finding(quantity: str, problem) -> Finding:
    """The finding on one quantity of a problem, or on one peer."""
    if quantity in PEERS:
        return peer_finding(quantity, problem, _equilibrium_near)
    compute, compare = QUANTITIES[quantity]
    return assessed(lambda: compute(problem), lambda answer: compare(problem, answer))


def _coordinates(solution):
    return Answer(solution.status, solution.value.coordinates, solution.stats.error_bound)


def _off(problem, answer, exact):
    """Largest coordinate error, relative to the largest coordinate."""
    # A network without pins may have been carried away as a whole.
    error = reference.largest_error(answer.values, exact.coordinates, moved=not problem.network.pins)
    return error, reference.largest(exact.coordinates)


def _each(answer, truth):
    """Error of each number, relative to the largest of them."""
    errors = [
        reference.largest_error([value], np.array([t], dtype=object))
        for value, t in zip(answer.values, truth, strict=True)
    ]
    return errors, reference.largest(truth)


# At the transition


def _transition_moduli(problem):
    counts = [count_self_stresses(part) for part in backbone(problem.critical).components]
    if None in counts:  # rounding hides them
        raise Unavailable(cf.Status.singular)
    if counts != [1] * len(counts):
        raise cf.InputError("the reference requires one self-stress")
    solution = cf.elasticity(problem.critical)
    value = solution.value
    return Answer(solution.status, (value.bulk, value.shear), (value.errors.bulk, value.errors.shear))


def _transition_error(problem, answer):
    truth = problem.moduli or reference.transition_moduli(problem.stressed, problem.exact, digits=problem.digits)
    if problem.moduli:
        truth = reference.numbers(problem.moduli)
    return _each(answer, truth)


def _stiffening(problem):
    solution = cf.stiffening(problem.critical, throw=False, manifold=problem.manifold)
    return Answer(solution.status, _plain(solution.value), _plain(solution.stats.error_bound))


def _stiffening_error(problem, answer):
    if problem.moduli:
        raise Unknown("the reference requires one self-stress")
    return _each(answer, reference.stiffening(problem.stressed, problem.exact, digits=problem.digits))


def _plain(numbers):
    """The fields of Stiffening that the reference has, or one number as it is."""
    return numbers if isinstance(numbers, float) else tuple(vars(numbers).values())[:5]


def _moduli(numbers):
    return numbers.bulk, numbers.shear, numbers.shear_stress_corrected


def _rigidity(problem):
    network = problem.network
    x = validated_coordinates(network, np.asarray(problem.critical.coordinates, dtype=problem.dtype))
    if edge_without_length(np.linalg.norm(network.bond_vectors(x), axis=1)):
        return Answer(cf.Status.singular, np.nan)
    spectrum = Spectrum(network, x)
    # Translations are no motions of the spectrum.
    counts = spectrum.n_self_stresses, spectrum.n_motions + network.dimension
    status = cf.Status.ok if spectrum.n_self_stresses else cf.Status.floppy
    return Answer(cf.Status.singular if spectrum.doubt(*spectrum.gap) else status, counts, 0.0)


def _rigidity_error(problem, answer):
    network, n_stresses = problem.network, problem.n_stresses(problem.network)
    truth = (n_stresses, 2 * network.n_vertices - network.n_edges + n_stresses)
    return np.abs(np.subtract(answer.values, truth)), 1.0


# Past the transition


def _equilibrium(problem, method, limit):
    return _coordinates(cf.equilibrium(problem.strained, method, max_steps=limit, throw=False))


def _equilibrium_error(problem, answer):
    return _off(problem, answer, _equilibrium_near(problem, problem.strained, answer.values))


def _equilibrium_near(problem, state, coordinates):
    """The equilibrium of a strained state: without compression the only one; else that at the end of small steps."""
    exact = reference.equilibrium(state.network, state.rest_lengths, coordinates)
    if min(exact.sigma) > 0:
        # The energy without compression is convex, and least here.
        return exact
    few = int(np.ceil(problem.strain / 5e-3))
    for n in (few, 16 * few):
        x, sizes = problem.critical.coordinates, np.sqrt(1 + problem.strain * np.arange(n + 1) / n)
        for before, size in pairwise(sizes):
            network = problem.network.deformed(size * np.eye(2))
            exact = reference.equilibrium(network, state.rest_lengths, size / before * x)
            x = exact.coordinates.astype(float)
        if reference.is_minimum(network, exact, state.rest_lengths):
            return exact
    raise reference.Unknown("small steps from the transition lead to a saddle")


def _strain_path(problem):
    path = cf.strain_path(problem.critical, [problem.strain], throw=False)
    if not path.ok:
        return Answer(path.status, np.nan)
    return Answer(path.status, path.value.states[-1].coordinates, path.value.coordinate_error[-1])


def _linear_response(problem):
    reached = cf.equilibrium(problem.strained, throw=False)
    if not reached.ok:
        raise Unavailable(reached.status)
    problem.reached = reached.value
    solution = linear_response(reached.value, reached.value.network.volume)
    return Answer(solution.status, _moduli(solution.value), _moduli(solution.value.errors))


def _linear_error(problem, answer):
    """Against the response of the exact equilibrium next to the state."""
    state = problem.reached
    exact = _equilibrium_near(problem, state, state.coordinates)
    return _each(answer, reference.linear_response(state.network, exact.bond_vectors, state.rest_lengths))


# From rest lengths


def _lengths(problem, method):
    problem.found = method(problem.manifold, problem.rest_lengths)
    return _coordinates(problem.found)


def _conic_error(problem, answer):
    found = problem.found.value
    exact = reference.critical_from_lengths(problem.network, problem.rest_lengths, found.sigma, found.coordinates)
    return _off(problem, answer, exact)


def _strain_error(problem, answer):
    """Against the equilibrium of the rest lengths that the protocol came to, a little past the transition."""
    rest_lengths = problem.found.rest_lengths
    return _off(problem, answer, reference.equilibrium(problem.network, rest_lengths, answer.values))


# Optima


def _optimum(problem, name, method):
    limit = _FIRE_STEPS if method == "fire" else None
    solution = cf.optimize(problem.manifold, _goal(problem, name), method, max_steps=limit, throw=False)
    problem.found = solution
    return Answer(solution.status, solution.objective, solution.objective_error)


def _goal(problem, name):
    if name == "G_0" and problem.threshold is None:
        return transition_modulus(problem.network, pure_shear(2))
    return objective_of(problem.network, name, problem.threshold or 0.1)


def _optimum_error(problem, answer, name):
    """Against the best value where it is known, else against the gain left by Newton's method."""
    sigma = problem.found.value.sigma
    exact = reference.configuration(problem.network, sigma, digits=reference.digits_for(sigma))
    there = reference.objective(problem.network, name, exact, problem.threshold)
    scale = 1.0 if name.startswith("V_") else abs(float(there))
    best = None
    if name == "B_0":
        best = reference.largest_bulk_modulus(problem.network)
    elif name == "V_L" and _equal_lengths(problem):
        best = reference.numbers(0.0)
    if best is not None and np.isfinite(answer.bounds):
        return reference.largest_error(answer.values, best), scale
    short = _remaining_gain(problem, name) if best is None else reference.largest_error(float(there), best)
    return max(reference.largest_error(answer.values, there), short), scale


def _equal_lengths(problem):
    """Whether the network has a critical configuration with all lengths equal, and so no length variance at all."""
    if not hasattr(problem, "equal"):
        found = cf.critical_from_lengths(problem.manifold, np.ones(problem.network.n_edges), throw=False)
        problem.equal = found.ok
    return problem.equal


def _remaining_gain(problem, name):
    """The gain in the objective left by Newton's method at the σ that was found; infinite at a saddle."""
    value = problem.found.value
    goal = _goal(problem, name)
    sigma = problem.manifold.solve(value.sigma).value.sigma
    slope = evaluate(problem.manifold.balance(sigma), goal).gradient
    # The objective does not depend on the scale of σ, but the product of the Hessian with σ is −dO/dσ.
    across = np.eye(len(sigma)) - np.outer(sigma, sigma) / (sigma @ sigma)
    hessian = across @ (stress_hessian(value, goal) @ across)
    curvatures, modes = np.linalg.eigh(hessian + hessian.T)
    curvatures = (-0.5 if goal.maximise else 0.5) * curvatures
    steep = np.abs(curvatures) > 1e-9 * np.abs(curvatures).max()
    if (curvatures < -1e-7 * np.abs(curvatures).max()).any():
        return np.inf
    return float(np.sum((slope @ modes[:, steep]) ** 2 / curvatures[steep]) / 2)


QUANTITIES = {
    "configuration": (
        lambda problem: _coordinates(problem.solution),
        lambda problem, answer: _off(problem, answer, problem.exact),
    ),
    "transition_moduli": (_transition_moduli, _transition_error),
    "stiffening": (_stiffening, _stiffening_error),
    "rigidity": (_rigidity, _rigidity_error),
    "equilibrium_newton": (partial(_equilibrium, method="newton", limit=None), _equilibrium_error),
    "equilibrium_fire": (partial(_equilibrium, method="fire", limit=_FIRE_STEPS), _equilibrium_error),
    "strain_path": (_strain_path, _equilibrium_error),
    "linear_response": (_linear_response, _linear_error),
    "lengths_conic": (partial(_lengths, method=partial(cf.critical_from_lengths, throw=False)), _conic_error),
    "lengths_strain": (partial(_lengths, method=critical_by_strain), _strain_error),
    **{
        f"{optimum}_{method}": (partial(_optimum, name=name, method=method), partial(_optimum_error, name=name))
        for optimum, name in OPTIMA.items()
        for method in METHODS
    },
}
