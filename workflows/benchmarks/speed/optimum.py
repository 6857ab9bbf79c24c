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

from critflow import CriticalManifold, Network, Status, optimize, voronoi_network
from critflow.cones import fit_lengths
from critflow.descent import Descent
from critflow.engine import stable_rng
from critflow.optima import objective_of
from critflow.quantities import evaluate

from ...shared.populations import LABELS, OPTIMA
from ..scipy_methods import Solved, by_scipy, minimiser
from ..timing import TALLY, Answer, Method, Run, Task, peer

SIZES = (100, 1_000, 10_000)
CONE = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
# Step limits of SciPy's methods, which also stop by other measures, and steps of FIRE times the root of the vertices.
SCIPY_STEPS = {"L-BFGS-B": 3_000, "trust-krylov": 100}
FIRE_STEPS = 30_000


def tolerances(n_vertices: int) -> tuple[float, ...]:
    """Tolerances of the largest component of the gradient, from rough to fine.

    Components are of order 1/N_b, so the roughest tolerance is 1e-2 at 100 vertices and falls as 1/N_v.
    """
    return tuple((10.0 ** -np.arange(max(2.0, float(np.log10(n_vertices))), 15, 2)).tolist())


def _by_scipy(network: Network, word: str, start: np.ndarray, method: str) -> Run:
    manifold = CriticalManifold(replace(network))
    objective = Descent(manifold, objective_of(manifold.network, word))
    return _stresses(by_scipy(objective, method, np.log(start), SCIPY_STEPS[method]))


def _stresses(solved: Solved) -> Run:
    """The run of a minimiser whose unknowns are θ = log σ."""

    def run(level: float) -> Answer:
        theta, status = solved(level)
        return Answer(np.exp(theta - theta.max()), status)

    return run


def _by_critflow(network: Network, word: str, method: str, start: np.ndarray | None) -> Run:
    manifold = CriticalManifold(replace(network))

    def run(level: float) -> Answer:
        limit = int(FIRE_STEPS / np.sqrt(network.n_vertices)) if method == "fire" else None
        solution = optimize(manifold, word, method, start=start, tolerance=level, max_steps=limit, throw=False)
        return Answer(solution.value.sigma, solution.status)

    return run


def _by_cone(network: Network) -> Run:
    """Clarabel's tensions as they are; levels are its tolerances."""
    network = replace(network)

    def run(level: float) -> Answer:
        cone = fit_lengths(network.free_incidence, network.boundary_vectors, np.ones(network.n_edges), level)
        TALLY["factorisations"] += cone.steps
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


def _methods(n_vertices: int, seed: int, gamma: float, word: str, pinned: bool = False) -> list[Method]:
    network = voronoi_network(n_vertices, seed)
    network = hung(network) if pinned else network
    start = np.ones(network.n_edges)
    if word == "B_0":
        start = np.exp(0.5 * stable_rng(seed, "contest", "start").standard_normal(len(start)))
    error = _error(CriticalManifold(network), word, start)
    fine = tolerances(n_vertices)
    # A closed form has one accuracy.
    levels = {"auto": fine[-1:] if word == "B_0" else fine, "newton": fine, "lbfgs": fine, "fire": fine}
    methods = [
        Method(name, partial(_by_critflow, network, word, name, None if name == "auto" else start), error, values)
        for name, values in levels.items()
    ]
    if word == "V_L":
        methods.append(Method("cone", partial(_by_cone, network), error, CONE))
    for name in SCIPY_STEPS:
        methods.append(Method(f"SciPy {name}", partial(_by_scipy, network, word, start, name), error, fine, "scipy"))
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
        # A factorisation, and a solve in each direction.
        TALLY.update(factorisations=1, solves=2)
        value, gradient = compiled(theta)
        return float(value), np.asarray(gradient)

    return _stresses(minimiser(function, np.log(start), "L-BFGS-B", SCIPY_STEPS["L-BFGS-B"]))


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
    _task("max_B_0", SIZES[:2]),
    _task("max_G_0", SIZES[:2]),
    replace(
        _MIN_V_L,
        word="min_V_L_pinned",
        title=f"{_MIN_V_L.title}, pinned",
        sizes=SIZES[:1],
        names=(*_MIN_V_L.names, "jax_fdm"),
        methods=partial(_methods, word="V_L", pinned=True),
    ),
)
