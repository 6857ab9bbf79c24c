"""Tasks of the optima over stress, all methods from the same start and with θ = log σ as unknowns.

The start is σ = 1 on every edge; that is the optimum of B_0 already, which starts from a random stress therefore.
The error of each is measured without a subtraction of nearly equal numbers, so it keeps falling where differences of
the value would be rounding:
    V_L         the value itself, whose least is zero
    B_0         1 − B_0/max B_0, the sin² of the angle between the forces σL and those of the closed form
    V_τ, G_0    the largest d log O/d log σ of an edge.  G_0 with its penalty has several local optima, in
                which methods may end.  The network of 10,000 vertices does not attain its infimum of V_τ, where an
                edge has no length, and so has no such error: that size is left out
Methods of critflow test whether the end is a saddle, at the default tolerance of 1e-12 and less; other packages do not,
which is part of the times.

jax_fdm knows no periodic cells: it is compared on the part of the network that does not cross the cell, hung on the
vertices whose edges were removed, where these are when all edges are equally long: V_L = 0 is attained.  Few such
networks attain the infimum of V_τ, all of them small: the first that does is taken.  The model of jax_fdm gives value
and gradient of the same function, compiled before any time is taken, to SciPy's L-BFGS-B, as in the
optimisers of jax_fdm.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.optimize import minimize

from critflow import CriticalManifold, Network, Status, optimize, voronoi_network
from critflow.critical.quantity import evaluate
from critflow.lengths.cone import fit_lengths
from critflow.optimisation.descent import StressObjective
from critflow.optimisation.minimize import Point
from critflow.optimisation.optimize import objective_of
from critflow.workflow import stable_rng

from ..timing import Answer, Method, Task, installed, peer

SIZES = (100, 1_000, 10_000)
# Decades of the tolerances: close ones end where runs become long.
CLOSE, FINEST = 8, 14
SHORT = 1_000  # size from which methods with curvatures have one tolerance a decade
CONE = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
STEPS = (30.0, 100.0, 300.0, 1_000.0, 3_000.0, 10_000.0)
# Step limits of SciPy's methods, which also stop by other measures.
SCIPY_STEPS = {"L-BFGS-B": 3_000, "trust-krylov": 100}


def tolerances(n_vertices: int, a_decade: int = 4) -> tuple[float, ...]:
    """Tolerances of the largest component of the gradient, from rough to fine, one a decade where runs are long.

    Components are of order 1/N_b, so the roughest tolerance is 1e-2 at 100 vertices and falls as 1/N_v.  Methods that
    take the same steps are compared to a step or two: a few tolerances a decade skip most of the steps.
    """
    first = max(2.0, float(np.log10(n_vertices)))
    close = first + np.arange(int(a_decade * (CLOSE - first))) / a_decade
    return tuple((10.0 ** -np.concatenate([close, np.arange(CLOSE, FINEST + 1)])).tolist())


Gradient = Callable[[np.ndarray], tuple[float, np.ndarray]]
Run = Callable[[float], Answer]


def _for_scipy(objective: StressObjective) -> tuple[Gradient, Callable]:
    """Value with gradient over θ = log σ, and the product of the Hessian at the last θ with a direction."""
    latest: list[Point] = []

    def function(theta: np.ndarray) -> tuple[float, np.ndarray]:
        latest[:] = [objective.at(theta.copy())]
        return latest[0].value, latest[0].gradient

    def curvature(theta: np.ndarray, direction: np.ndarray) -> np.ndarray:
        if not np.array_equal(theta, latest[0].x):
            function(theta)
        return objective.hessian_product(latest[0], direction)

    return function, curvature


def _by_scipy(
    objective: StressObjective, function: Gradient, start: np.ndarray, method: str, curvature: Callable | None = None
) -> Run:
    """Levels are the largest component of the gradient; L-BFGS-B is not to stop by the value."""
    max_steps = SCIPY_STEPS[method]
    own = {"ftol": 0.0, "maxcor": 15, "maxfun": 2 * max_steps} if method == "L-BFGS-B" else {}

    def run(level: float) -> Answer:
        options = {"gtol": level, "maxiter": max_steps, **own}
        with np.errstate(all="ignore"):
            end = minimize(function, np.log(start), jac=True, hessp=curvature, method=method, options=options)
        steps = int(end.nit)
        status = Status.ok if end.success else Status.step_limit if steps >= max_steps else Status.stalled
        return Answer(objective.sigma(end.x), status, steps)

    return run


def _by_critflow(manifold: CriticalManifold, word: str, method: str, start: np.ndarray | None, level: float) -> Answer:
    # Levels of FIRE are step limits: to any tolerance it would take minutes.
    limits = {"tolerance": 1e-15, "max_steps": int(level)} if method == "fire" else {"tolerance": level}
    solution = optimize(manifold, word, method, start=start, throw=False, **limits)
    return Answer(solution.value.sigma, solution.status, solution.stats.steps)


def _by_cone(manifold: CriticalManifold, level: float) -> Answer:
    """Clarabel's tensions as they are; levels are its tolerances."""
    network = manifold.network
    cone = fit_lengths(network.free_incidence, network.boundary_vectors, np.ones(network.n_edges), level)
    return Answer(cone.sigma, Status.ok if cone.solved else Status.stalled, cone.steps)


def _error(manifold: CriticalManifold, word: str) -> Callable[[np.ndarray], float]:
    """The error of a stress, as defined above."""
    goal = objective_of(manifold.network, word)
    best = manifold.configuration(manifold.network.stiffness).bond_vectors.ravel()
    best = best / np.linalg.norm(best)

    def error(sigma: np.ndarray) -> float:
        if not (np.isfinite(sigma).all() and (sigma > 0).all()):
            return np.nan
        evaluation = evaluate(manifold, goal, sigma)
        if word == "length_variance":
            return float(evaluation.value)
        if word == "bulk_modulus":
            forces = (sigma[:, None] * evaluation.balance.bond_vectors).ravel()
            across = forces - (forces @ best) * best
            return float((across @ across) / (forces @ forces))
        return float(np.abs(sigma * evaluation.gradient / evaluation.value).max())

    return error


def _methods(n_vertices: int, seed: int, word: str, pinned: bool = False) -> list[Method]:
    manifold = _hanging(n_vertices, seed, word) if pinned else CriticalManifold(voronoi_network(n_vertices, seed))
    start = np.ones(manifold.network.n_edges)
    if word == "bulk_modulus":
        start = np.exp(0.5 * stable_rng(seed, "contest", "start").standard_normal(len(start)))
    objective = StressObjective(manifold, objective_of(manifold.network, word))
    error, (function, curvature) = _error(manifold, word), _for_scipy(objective)
    fine, curved = tolerances(n_vertices), tolerances(n_vertices, 4 if n_vertices < SHORT else 1)
    # A closed form has one accuracy.
    levels = {"auto": (1e-12,) if word == "bulk_modulus" else fine, "newton": curved, "lbfgs": fine, "fire": STEPS}
    methods = [
        Method(name, partial(_by_critflow, manifold, word, name, None if name == "auto" else start), error, values)
        for name, values in levels.items()
    ]
    if word == "length_variance":
        methods.append(Method("cone", partial(_by_cone, manifold), error, CONE))
    lbfgs = _by_scipy(objective, function, start, "L-BFGS-B")
    krylov = _by_scipy(objective, function, start, "trust-krylov", curvature)
    methods += [
        Method("SciPy L-BFGS-B", lbfgs, error, fine, "scipy"),
        Method("SciPy trust-krylov", krylov, error, curved, "scipy"),
    ]
    if pinned:
        run = _by_jax(objective, word, start) if installed("jax-fdm") else lbfgs
        methods.append(Method("jax_fdm", run, error, fine, "jax-fdm"))
    return methods


def _hanging(n_vertices: int, seed: int, word: str) -> CriticalManifold:
    """The first hung network whose infimum is attained."""
    for other in range(seed, seed + 100):
        manifold = CriticalManifold(hung(voronoi_network(n_vertices, other)))
        if optimize(manifold, word, throw=False).ok:
            return manifold
    raise ValueError(f"no hung network of {n_vertices} vertices attains its least {word}")


def hung(network: Network) -> Network:
    """The part of a periodic network that does not cross the cell, on pins where an edge was cut."""
    x = optimize(network, "length_variance").value.coordinates
    inside = (network.offsets == 0).all(axis=1)
    cut = np.zeros(network.n_vertices, bool)
    cut[network.edges[~inside]] = True
    # The stress of an edge between two pins is not determined.
    inside &= ~cut[network.edges].all(axis=1)
    vertices, edges = np.unique(network.edges[inside], return_inverse=True)
    pins = {place: x[vertex] for place, vertex in enumerate(vertices) if cut[vertex]}
    return Network(edges.reshape(-1, 2), pins=pins, n_vertices=len(vertices), positions=x[vertices])


def _by_jax(objective: StressObjective, word: str, start: np.ndarray) -> Run:
    """Value and gradient by jax_fdm's sparse model in double precision."""
    network = objective.manifold.network
    fdm, jax, jnp = peer("jax_fdm.equilibrium"), peer("jax"), peer("jax.numpy")
    n, fixed = network.n_vertices, np.array(sorted(network.pins))
    supports = np.zeros(n, int)
    supports[fixed] = 1
    structure = fdm.EquilibriumStructureSparse(np.arange(n), network.edges, supports)
    model = fdm.EquilibriumModelSparse(tmax=1)
    places = np.zeros((len(fixed), 3))
    places[:, :2] = [network.pins[vertex] for vertex in fixed]
    loads = jnp.zeros((n, 3))

    def variance(theta):
        q = jnp.exp(theta - jnp.max(theta))
        free = model.nodes_free_positions(q, jnp.asarray(places), loads, structure)
        x = model.nodes_positions(free, jnp.asarray(places), structure)
        values = model.edges_lengths(model.edges_vectors(x, structure.connectivity)).ravel()
        values = values if word == "length_variance" else q * values
        return jnp.mean((values / jnp.mean(values) - 1) ** 2)

    compiled = jax.jit(jax.value_and_grad(variance))
    compiled(jnp.zeros(network.n_edges))

    def function(theta):
        value, gradient = compiled(theta)
        return float(value), np.asarray(gradient)

    return _by_scipy(objective, function, start, "L-BFGS-B")


_NAMES = ("auto", "newton", "lbfgs", "fire", "SciPy L-BFGS-B", "SciPy trust-krylov")
_SLOPE = "largest d log O/d log σ of an edge"


def _task(word: str, title: str, error: str, sizes: tuple[int, ...], pinned: bool = False) -> Task:
    names = (*_NAMES, *(["cone"] if word == "length_variance" else []), *(["jax_fdm"] if pinned else []))
    key, suffix = (f"{word}_pinned", ", pinned") if pinned else (word, "")
    return Task(key, title + suffix, error, sizes, names, "auto", partial(_methods, word=word, pinned=pinned))


TASKS = (
    _task("length_variance", "least $V_L$", "$V_L$", SIZES),
    _task("tension_variance", "least $V_\\tau$", _SLOPE, SIZES[:2]),
    _task("bulk_modulus", "largest $B_0$", "$1 - B_0/\\max B_0$", SIZES),
    _task("shear_modulus", "largest $G_0$ with penalty", _SLOPE, SIZES),
    _task("length_variance", "least $V_L$", "$V_L$", SIZES[:2], pinned=True),
    _task("tension_variance", "least $V_\\tau$", _SLOPE, SIZES[:1], pinned=True),
)
