"""Tasks of the optima over stress, all methods from the same start and with θ = log σ as unknowns.

The start is σ = 1 on every edge; that is the optimum of B_0 already, which starts from a random stress therefore.
The error of each is measured without a subtraction of nearly equal numbers, so it keeps falling where differences of
the value would be rounding:
    V_L         √V_L, the relative spread of the lengths, whose least is zero
    B_0         the sine of the angle between the forces σL and those of the closed form, √(1 − B_0/max B_0)
    V_τ, G_0    the largest d log O/d log σ of an edge over that of the start.  G_0 with its penalty has several local
                optima, in which methods may end.  The network of 10,000 vertices does not attain its infimum of V_τ,
                where an edge has no length, and so has no such error: that size is left out
Methods of critflow test whether the end is a saddle, at the default tolerance of 1e-12 and less; other packages do not,
which is part of the times.

jax_fdm knows no periodic cells: it is compared on the part of the network that does not cross the cell, hung on the
vertices whose edges were removed, where these are when all edges are equally long: V_L = 0 is attained.  The model of
jax_fdm gives value and gradient of the same function, compiled in its preparation, to SciPy's L-BFGS-B, as in the
optimisers of jax_fdm.  SciPy takes both from critflow.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.optimize import minimize

from critflow import CriticalManifold, Network, Status, optimize, voronoi_network
from critflow.cones import fit_lengths
from critflow.descent import Descent
from critflow.engine import stable_rng
from critflow.minimisers import Point
from critflow.optima import objective_of
from critflow.quantities import evaluate

from ...shared.populations import LABELS, OPTIMA
from ..timing import Answer, Method, Run, Task, peer

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


def _by_scipy(network: Network, word: str, start: np.ndarray, method: str) -> Run:
    """Value, gradient and products with the Hessian at the last θ are those of critflow."""
    manifold, latest = CriticalManifold(replace(network)), list[Point]()
    objective = Descent(manifold, objective_of(manifold.network, word))

    def function(theta: np.ndarray) -> tuple[float, np.ndarray]:
        latest[:] = [objective.at(theta.copy())]
        return latest[0].value, latest[0].gradient

    def curvature(theta: np.ndarray, direction: np.ndarray) -> np.ndarray:
        if not np.array_equal(theta, latest[0].x):
            function(theta)
        return objective.hessian_product(latest[0], direction)

    return _minimiser(function, start, method, curvature if method == "trust-krylov" else None)


def _minimiser(function: Gradient, start: np.ndarray, method: str, curvature: Callable | None = None) -> Run:
    """Levels are the largest component of the gradient; L-BFGS-B is not to stop by the value."""
    max_steps = SCIPY_STEPS[method]
    own = {"ftol": 0.0, "maxcor": 15, "maxfun": 2 * max_steps} if method == "L-BFGS-B" else {}

    def run(level: float) -> Answer:
        options = {"gtol": level, "maxiter": max_steps, **own}
        with np.errstate(all="ignore"):
            end = minimize(function, np.log(start), jac=True, hessp=curvature, method=method, options=options)
        status = Status.ok if end.success else Status.step_limit if end.nit >= max_steps else Status.stalled
        return Answer(np.exp(end.x - end.x.max()), status)

    return run


def _by_critflow(network: Network, word: str, method: str, start: np.ndarray | None) -> Run:
    manifold = CriticalManifold(replace(network))

    def run(level: float) -> Answer:
        # Levels of FIRE are step limits: to any tolerance it would take minutes.
        limits = {"tolerance": 1e-15, "max_steps": int(level)} if method == "fire" else {"tolerance": level}
        solution = optimize(manifold, word, method, start=start, throw=False, **limits)
        return Answer(solution.value.sigma, solution.status)

    return run


def _by_cone(network: Network) -> Run:
    """Clarabel's tensions as they are; levels are its tolerances."""
    network = replace(network)

    def run(level: float) -> Answer:
        cone = fit_lengths(network.free_incidence, network.boundary_vectors, np.ones(network.n_edges), level)
        return Answer(cone.sigma, Status.ok if cone.solved else Status.stalled)

    return run


def _error(manifold: CriticalManifold, word: str, start: np.ndarray) -> Callable[[np.ndarray], float]:
    """The error of a stress, as defined above."""
    best = manifold.configuration(manifold.network.stiffness).bond_vectors.ravel()
    best = best / np.linalg.norm(best)
    goal = objective_of(manifold.network, word)

    def slope(sigma: np.ndarray) -> float:
        evaluation = evaluate(manifold.balance(sigma), goal)
        return float(np.abs(sigma * evaluation.gradient / evaluation.value).max())

    unit = slope(start)

    def error(sigma: np.ndarray) -> float:
        if not (np.isfinite(sigma).all() and (sigma > 0).all()):
            return np.nan
        evaluation = evaluate(manifold.balance(sigma), goal)
        if word == "V_L":
            return float(np.sqrt(evaluation.value))
        if word == "B_0":
            forces = (sigma[:, None] * evaluation.balance.bond_vectors).ravel()
            return float(np.linalg.norm(forces - (forces @ best) * best) / np.linalg.norm(forces))
        return slope(sigma) / unit

    return error


def _methods(n_vertices: int, seed: int, word: str, pinned: bool = False) -> list[Method]:
    network = voronoi_network(n_vertices, seed)
    network = hung(network) if pinned else network
    start = np.ones(network.n_edges)
    if word == "B_0":
        start = np.exp(0.5 * stable_rng(seed, "contest", "start").standard_normal(len(start)))
    error = _error(CriticalManifold(network), word, start)
    fine, curved = tolerances(n_vertices), tolerances(n_vertices, 4 if n_vertices < SHORT else 1)
    # A closed form has one accuracy.
    levels = {"auto": (1e-12,) if word == "B_0" else fine, "newton": curved, "lbfgs": fine, "fire": STEPS}
    methods = [
        Method(name, partial(_by_critflow, network, word, name, None if name == "auto" else start), error, values)
        for name, values in levels.items()
    ]
    if word == "V_L":
        methods.append(Method("cone", partial(_by_cone, network), error, CONE))
    for name, values in (("L-BFGS-B", fine), ("trust-krylov", curved)):
        methods.append(Method(f"SciPy {name}", partial(_by_scipy, network, word, start, name), error, values, "scipy"))
    if pinned:
        methods.append(Method("jax_fdm", partial(_by_jax, network, start), error, fine, "jax-fdm"))
    return methods


def hung(network: Network) -> Network:
    """The part of a periodic network that does not cross the cell, on pins where an edge was cut."""
    x = optimize(network, "V_L").value.coordinates
    inside = (network.offsets == 0).all(axis=1)
    cut = np.zeros(network.n_vertices, bool)
    cut[network.edges[~inside]] = True
    # The stress of an edge between two pins is not determined.
    inside &= ~cut[network.edges].all(axis=1)
    vertices, edges = np.unique(network.edges[inside], return_inverse=True)
    pins = {place: x[vertex] for place, vertex in enumerate(vertices) if cut[vertex]}
    return Network(edges.reshape(-1, 2), pins=pins, n_vertices=len(vertices), positions=x[vertices])


def _by_jax(network: Network, start: np.ndarray) -> Run:
    """Value and gradient of V_L by jax_fdm's sparse model in double precision."""
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
        lengths = model.edges_lengths(model.edges_vectors(x, structure.connectivity)).ravel()
        return jnp.mean((lengths / jnp.mean(lengths) - 1) ** 2)

    compiled = jax.jit(jax.value_and_grad(variance))
    compiled(jnp.zeros(network.n_edges))

    def function(theta):
        value, gradient = compiled(theta)
        return float(value), np.asarray(gradient)

    return _minimiser(function, start, "L-BFGS-B")


_NAMES = ("auto", "newton", "lbfgs", "fire", "SciPy L-BFGS-B", "SciPy trust-krylov")
_SLOPE = "largest d log O/d log σ of an edge over that of the start"
_ERRORS = {
    "min_V_L": "relative spread of the lengths, $\\sqrt{V_L}$",
    "min_V_tau": _SLOPE,
    "max_B_0": "$\\sqrt{1 - B_0/\\max B_0}$",
    "max_G_0": _SLOPE,
}


def _task(word: str, sizes: tuple[int, ...]) -> Task:
    names = (*_NAMES, "cone") if word == "min_V_L" else _NAMES
    title = LABELS[word] + (" with its penalty" if word == "max_G_0" else "")
    return Task(word, title, _ERRORS[word], sizes, names, "auto", partial(_methods, word=OPTIMA[word]))


_MIN_V_L = _task("min_V_L", SIZES)
TASKS = (
    _MIN_V_L,
    _task("min_V_tau", SIZES[:2]),
    _task("max_B_0", SIZES),
    _task("max_G_0", SIZES),
    replace(
        _MIN_V_L,
        word="min_V_L_pinned",
        title=f"{_MIN_V_L.title}, pinned",
        sizes=SIZES[:2],
        names=(*_MIN_V_L.names, "jax_fdm"),
        methods=partial(_methods, word="V_L", pinned=True),
    ),
)
