"""The shear modulus G_0 at the transition: unconstrained ascents, and its dependence on size, threshold and starts.

From σ = 1 and without constraints on the signs of the stress (`ShearModulusSteepestDescent`) every network climbs
towards the closed-form bound.  Edges along the shear grow to the size of the box, others come under compression, and
the prestress matrix becomes indefinite.  Compressed edges of all sizes are compared at the same part of the bound: the
same number of steps of FIRE, the method of the paper, reaches a larger part in small networks.

With positive stresses (`ShearModulusScaling`) the shear modulus of populations that are not optimised for it falls as
1/N_v; that of max G_0 is independent of size, with aligned edges that align further at a lower threshold r.  The
constrained objective has many local optima.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from critflow import CriticalManifold, Solution, optimize, upper_bound, voronoi_network
from critflow.elastic import elasticity
from critflow.engine import Axis, Coordinate, Study, Variable, stable_rng
from critflow.optima import largest_modulus
from critflow.points import STANDARD_HARD_CORE, check_voronoi
from critflow.quantities import pure_shear, transition_modulus
from critflow.result import Status, StudyError

from ..paper.verdicts import committed_run
from ..shared.checks import check_known, check_network
from ..shared.populations import MEANING, POPULATIONS, SETTINGS, configuration, prepared
from ..shared.reports import PAPER
from ..shared.tables import NETWORK, PLANE, networks, numbers, of_network, outcomes
from .compression import least_compressed_length
from .figures import animation, ascent_figure, compression_figure, scaling_figure
from .report import claims, verify

METHODS = ("lbfgs", "fire", "newton")
# Every step at first, then about eight a factor of ten.
STEPS = tuple(int(step) for step in np.unique(np.round(np.concatenate([[0, 1], 10 ** np.arange(0.3, 3.71, 0.1)]))))


MEASURES = {
    "G_0_ascent": "shear modulus at the transition, in units of k",
    "longest_edge": "length of the longest edge over the side of the box",
    "least_tension": "least tension over the largest magnitude of a tension",
    "compressed_edges": "number of edges under compression",
    "compressed_length": "total length of the edges under compression",
}
OF_PART = ("compressed_edges", "compressed_length")  # stored where an ascent first reaches a part of the bound


def measures(network, value, sigma, L):
    """The numbers of `MEASURES`, in their order."""
    length = np.linalg.norm(L, axis=1)
    tension, compressed = sigma * length, sigma < 0
    longest, least = length.max() / np.sqrt(network.volume), tension.min() / np.abs(tension).max()
    return value, longest, least, np.count_nonzero(compressed), length[compressed].sum()


@dataclass(frozen=True)
class Ascent:
    """An ascent from σ = 1: its solution, the bound, and the five measures of `MEASURES`.

    recorded  (5, n_steps) at the recorded steps, NaN beyond the end
    sigmas    (n_steps, N_b), stresses at the recorded steps up to the end
    reached   (5, n_fractions) at the first step beyond each part of the bound
    end       (5,) at the last step
    """

    solution: Solution
    bound: float
    recorded: np.ndarray
    sigmas: np.ndarray
    reached: np.ndarray
    end: np.ndarray


def ascend(manifold, method, steps, fractions, stop_at_last=False):
    """Climb from σ = 1 through `steps[-1]` steps, or with `stop_at_last` to the largest part of the bound."""
    network = manifold.network
    bound = upper_bound(manifold, transition_modulus(manifold.network, pure_shear(2)))
    place = {step: n for n, step in enumerate(steps)}
    recorded, reached = np.full((5, len(steps)), np.nan), np.full((5, len(fractions)), np.nan)
    ahead, end, sigmas = np.full(len(fractions), True), np.full(5, np.nan), []

    def observe(step, value, sigma, L):
        end[:] = measures(network, value, sigma, L)
        newly = ahead & (value >= np.array(fractions) * bound)
        reached[:, newly], ahead[newly] = end[:, None], False
        if step in place:
            recorded[:, place[step]] = end
            sigmas.append(sigma.copy())
        return step >= steps[-1] or (stop_at_last and not ahead.any())

    solution = optimize(manifold, "G_0", method, signs="any", max_steps=max(steps) + 1, observe=observe, throw=False)
    return Ascent(solution, bound, recorded, np.array(sigmas), reached, end)


def case(parameters, *, seed, n_vertices):
    """The recorded ascent, which does not depend on the size of the case, and everything at this size.

    Thresholds, starts and ascents of all sizes cost more, and are those of the first networks only.
    """
    manifold = prepared(voronoi_network, n_vertices, seed, parameters["hard_core"])
    detailed = seed < parameters["detailed_seeds"]
    return {
        "status": Status.ok,
        "bound": upper_bound(manifold, transition_modulus(manifold.network, pure_shear(2))),
        "least_compressed_length": least_compressed_length(manifold, pure_shear(2)) if detailed else np.nan,
        **_recorded(*(parameters[name] for name in ("ascent_vertices", "hard_core", "method", "steps")), seed),
        **_compression(manifold, parameters, detailed),
        **_populations(manifold, parameters, seed),
        **_constrained(manifold, parameters, seed, n_vertices, detailed),
    }


@lru_cache(maxsize=1)
def _recorded(n_vertices, hard_core, method, steps, seed):
    """One ascent: measures and configurations at the recorded steps, and the bound with its closed form."""
    network = voronoi_network(n_vertices, seed, hard_core)
    manifold = CriticalManifold(network)
    ascent = ascend(manifold, method, steps, ())
    solution = ascent.solution
    # Coordinates whose bond vectors are those of the record, to single precision, which is enough to draw.
    stored = len(ascent.sigmas)
    sigma = np.full((len(steps), network.n_edges), np.nan)
    sigma[:stored] = ascent.sigmas
    coordinates = np.full((len(steps), *network.positions.shape), np.nan)
    coordinates[:stored] = [network.all_coordinates(manifold.balance(s).coordinates) for s in ascent.sigmas]
    return {
        **of_network(network),
        **dict(zip(MEASURES, ascent.recorded, strict=True)),
        "sigma": sigma,
        "position": coordinates,
        "ascent_status": solution.status,
        "ascent_bound": ascent.bound,
        "G_0_end": solution.objective,
        "closed_form_gap": largest_modulus(manifold, pure_shear(2)).gap,
        "needed_length": least_compressed_length(manifold, pure_shear(2)),
        "crossings": len(solution.crossings),
        "negative_pivots": solution.negative_pivots,
        "residual": solution.value.residual,
    }


def _compression(manifold, parameters, detailed):
    """Ascents by each algorithm: compression where they first reach each part of the bound, their last modulus."""
    algorithms, fractions = parameters["algorithms"], parameters["fractions"]
    reached, ends = np.full((5, len(algorithms), len(fractions)), np.nan), np.full(len(algorithms), np.nan)
    status = np.full(len(algorithms), int(Status.missing))
    for n, algorithm in enumerate(algorithms if detailed else ()):
        ascent = ascend(manifold, algorithm, (0, parameters["n_steps"]), fractions, stop_at_last=algorithm != "fire")
        reached[:, n], ends[n] = ascent.reached, ascent.end[0]
        # A stop at the largest part of the bound is the requested end.
        status[n] = Status.ok if np.isfinite(ascent.reached[0]).all() else ascent.solution.status
    parts = {f"{name}_of_part": values for name, values in zip(MEASURES, reached, strict=True) if name in OF_PART}
    return parts | {"G_0_ascent_of_end": ends, "algorithm_status": status}


def _populations(manifold, parameters, seed):
    """G_0 of every population, and the bound on its rounding."""
    moduli, statuses = np.full((2, len(parameters["populations"])), np.nan), []
    for n, population in enumerate(parameters["populations"]):
        solution = configuration(manifold, parameters, seed, population)
        statuses.append(solution.status)
        if np.isfinite(solution.value.coordinates).all():
            moduli[:, n] = _shear_modulus(solution.value)
    return {"G_0": moduli[0], "G_0_error_bound": moduli[1], "population_status": statuses}


def _shear_modulus(critical):
    """G_0 and the bound on its rounding."""
    found = elasticity(critical).value
    return found.shear, found.errors.shear


def alignment(critical):
    """Order of the edges about a diagonal, weighted by tensions, |Σ τ 2 L_x L_y/L²|/Σ τ: 1 if all lie along it."""
    L, tension = critical.bond_vectors, critical.tensions
    return abs(tension @ (2 * L[:, 0] * L[:, 1] / critical.lengths**2)) / tension.sum()


def _constrained(manifold, parameters, seed, n_vertices, detailed):
    """Max G_0 at each threshold and from several starts."""
    thresholds, starts = parameters["thresholds"], np.full(parameters["n_starts"], np.nan)
    moduli, aligned = np.full((2, len(thresholds)), np.nan), np.full(len(thresholds), np.nan)
    statuses = np.full(len(thresholds), int(Status.missing))
    if detailed:
        for n, r in enumerate(thresholds):
            solution = optimize(manifold, "G_0", threshold=r, throw=False)
            moduli[:, n], statuses[n] = _shear_modulus(solution.value), solution.status
            aligned[n] = alignment(solution.value)
        rng, r = stable_rng(seed, "starts", str(n_vertices)), parameters["threshold"]
        several = optimize(manifold, "G_0", threshold=r, starts=len(starts), rng=rng, throw=False)
        starts[:] = several.starts
    return {
        "G_0_of_threshold": moduli[0],
        "G_0_of_threshold_error_bound": moduli[1],
        "alignment_of_threshold": aligned,
        "threshold_status": statuses,
        "objective_of_start": starts,
    }


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    for method in (parameters["method"], *parameters["algorithms"]):
        if method not in METHODS:
            raise StudyError(f"method={method} must be lbfgs, fire (the paper's) or newton")
    if not all(0 < part < 1 for part in parameters["fractions"]):
        raise StudyError("fractions are parts of the bound: numbers between 0 and 1")
    if list(parameters["steps"]) != sorted(set(parameters["steps"])) or parameters["steps"][0] < 0:
        raise StudyError("steps must be increasing whole numbers from 0 on, such as 0,1,10,100")
    check_known("population", parameters["populations"], POPULATIONS)
    if not all(r > 0 for r in (*parameters["thresholds"], parameters["threshold"])):
        raise StudyError("thresholds must be positive, such as 0.1")
    for name in ("n_starts", "n_steps", "detailed_seeds"):
        if parameters[name] < 1:
            raise StudyError(f"{name}={parameters[name]} must be at least 1")
    for n_vertices in (*axes["n_vertices"], parameters["ascent_vertices"]):
        check_network(check_voronoi, n_vertices, parameters["hard_core"])


# Numbers of the end of a recorded ascent and of the configuration that attains the bound.
AT_END = {
    "ascent_bound": "largest shear modulus of any stress, in closed form",
    "G_0_end": "shear modulus at the last step, or its limit, in units of k",
    "closed_form_gap": "relative distance of the shear modulus of the closed form's configuration from the bound",
    "needed_length": "least compressed length of any configuration at the bound",
    "residual": "largest unbalanced force over the mean tension at the end",
}
EACH, EACH_SEED, RECORD = ("seed", "n_vertices"), ("seed",), ("seed", "step")
ALGORITHM, PART = (*EACH, "algorithm"), (*EACH, "algorithm", "fraction")


VARIABLES = (
    *NETWORK,
    *numbers(RECORD, **MEASURES),
    *numbers(PART, **{f"{name}_of_part": f"{MEASURES[name]}, where an ascent reaches this part" for name in OF_PART}),
    *numbers(ALGORITHM, G_0_ascent_of_end=f"{MEASURES['G_0_ascent']}, at the end of an ascent"),
    *outcomes(ALGORITHM, algorithm_status="outcome of an ascent"),
    *numbers((*RECORD, "edge"), "f4", sigma="geometric stress, sum of squares N_b"),
    *numbers((*RECORD, "vertex", "axis"), "f4", position="coordinates of the vertices"),
    *numbers(EACH_SEED, **AT_END),
    Variable("crossings", EACH_SEED, "i4", long_name="steps across a singular prestress matrix", fill=-1),
    *numbers(EACH_SEED, "i4", negative_pivots="negative eigenvalues of the last prestress matrix"),
    *outcomes(EACH_SEED, ascent_status="outcome of the ascent"),
    *numbers(
        EACH,
        least_compressed_length="least compressed length of configurations at the bound",
        bound="largest shear modulus of any stress, in closed form [k]",
    ),
    *numbers(
        (*EACH, "population"),
        G_0="shear modulus at the transition [k]",
        G_0_error_bound="bound on the rounding error of G_0",
    ),
    *outcomes((*EACH, "population"), population_status="outcome by population"),
    *numbers(
        (*EACH, "threshold"),
        G_0_of_threshold="G_0 of max G_0, from σ = 1 [k]",
        G_0_of_threshold_error_bound="bound on the rounding error of G_0_of_threshold",
        alignment_of_threshold="order of its edges about a diagonal, |Σ τ 2 L_x L_y/L²|/Σ τ with the tensions τ",
    ),
    *outcomes((*EACH, "threshold"), threshold_status="outcome by threshold"),
    *numbers((*EACH, "start"), objective_of_start="penalised G_0 of each start, σ = 1 first"),
    *outcomes(EACH, status="whether the case was computed"),
)


study = Study(
    name="shear",
    title="The shear modulus at the transition: unconstrained ascents, size, threshold and starts",
    references=f"{PAPER}, figures ShearModulusSteepestDescent, ShearModulusScaling and Movie 1",
    committed=committed_run("shear"),
    axes=(
        networks(100),
        Axis("n_vertices", (50, 100, 200, 500, 1000), "number of vertices", key="n_vertices"),
    ),
    parameters={
        "hard_core": STANDARD_HARD_CORE,
        "ascent_vertices": 1000,
        "method": "lbfgs",
        "steps": STEPS,
        "algorithms": ("fire", "lbfgs"),
        "n_steps": 10000,
        "fractions": (0.4, 0.5, 0.8, 0.95),
        "populations": tuple(POPULATIONS),
        "thresholds": (0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7),
        "n_starts": 12,
        "detailed_seeds": 12,
        **SETTINGS,
    },
    coordinates=(
        Coordinate("step", "steps", "step of the recorded ascent"),
        Coordinate("algorithm", "algorithms", "algorithm of the ascents at all sizes"),
        Coordinate("fraction", "fractions", "part of the closed-form bound that is reached"),
        Coordinate("population", "populations", MEANING),
        Coordinate("threshold", "thresholds", "least stress r that the penalty allows, where the mean square is one"),
        *PLANE,
    ),
    case=case,
    check=check,
    variables=VARIABLES,
    verify=verify,
    figures={"ascent": ascent_figure, "compression": compression_figure, "scaling": scaling_figure},
    animations={"ascent": animation},
    claims=claims,
)
