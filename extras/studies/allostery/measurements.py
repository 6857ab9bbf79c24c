"""What is measured of one network: untrained responses, capacities, and what trained responses cost."""

import numpy as np
from critflow.studies.shared.populations import PAPER_POPULATIONS, configuration
from critflow.studies.shared.tables import stacked

import critflow as cf
import critflow_extras as ce
from critflow.engine import stable_rng
from critflow_extras.local.diagonals import face_diagonals, response_name

from ..shared.parts import NARROW

KINDS = ("signs", "amplitudes")  # of the goals: ±1, and uniform between −1 and 1
N_SOURCES = 3  # of the conditions of a capacity
BINS = np.arange(0.5, 6.0, 1.0)  # distances of the centres of source and target, in units of √(V/N_v)
UNTRAINED = 6  # sources of the untrained responses
# Stresses t in tσ, in units of k, and relative errors of the rest lengths at t = 1e-3.
STRESSES, NOISES, NOISY_STRESS = np.array([1e-6, 1e-5, 1e-4, 1e-3, 1e-2]), np.array([1e-5, 1e-4, 1e-3]), 1e-3
LIMITED = 0.2  # least force density of the designs that hold farther, in units of the mean
# Designs in the limit of no stress, the same with limited force densities, and designs for the stress t = 1e-3.
STYLES = ("free", "limited", "stressed")
REACHED = 1e-6  # error of a design that has its goals


def case(parameters, *, seed):
    """One network: untrained responses, trained ones and what they cost; networks of all sizes for the capacity."""
    manifold = cf.CriticalManifold(cf.voronoi_network(parameters["n_vertices"], seed))
    pairs = face_diagonals(manifold.network)
    return {
        "status": cf.Status.ok,
        **untrained(manifold, pairs, seed),
        **trained(manifold, pairs, parameters, seed),
        **picture(manifold, pairs, seed),
        **capacity(parameters, seed),
    }


def untrained(manifold, pairs, seed):
    """Median and largest |η| by distance in each population, and the largest product η_ts η_st."""
    places = bins(manifold.network, pairs)
    rows = []
    for population in PAPER_POPULATIONS:
        solution = configuration(manifold, NARROW, seed, population)
        row = {"typical": np.full(len(BINS) - 1, np.nan), "largest": np.nan, "reciprocity": np.nan}
        if solution.ok and (solution.value.sigma > 0).all():
            eta = responses(solution.value, pairs[:UNTRAINED], pairs)
            size = np.abs(eta)
            row["typical"] = np.array([median(size[places == n]) for n in range(len(BINS) - 1)])
            row["largest"] = size[places >= 2].max(initial=0.0)
            between = eta[:, :UNTRAINED] * eta[:, :UNTRAINED].T
            row["reciprocity"] = between[~np.eye(len(between), dtype=bool)].max()
        rows.append(row)
    return stacked(rows)


def responses(critical, sources, targets):
    """η of every target to every source, (n_sources, n_targets), 1 for a source itself."""
    rows = np.ones((len(sources), len(targets)))
    for n, source in enumerate(sources):
        others = [m for m, target in enumerate(targets) if target != source]
        solution = ce.local_response(critical, source, [targets[m] for m in others], throw=False)
        rows[n, others] = solution.value.strains
    return rows


def bins(network, pairs):
    """The bin of the distance of each pair from each source, (n_sources, n_pairs); −1 outside of all."""
    x = network.positions
    centres = np.array([x[i] + 0.5 * (x[j] + image @ network.cell - x[i]) for i, j, image in pairs])
    apart = in_cell(centres - centres[:UNTRAINED, None], network.cell)
    place = np.digitize(np.linalg.norm(apart, axis=2) / network.spacing, BINS) - 1
    return np.where(place < len(BINS) - 1, place, -1)


def median(values):
    return np.median(values) if len(values) else np.nan


def goals(rng, sources, targets, n, kind, stress=0.0):
    """Targets of `design`: n random responses under a stress, shared between the sources."""
    orders = [rng.permutation(len(targets)) for _ in sources]
    wanted = {}
    for m in range(n):
        # In turn from each source, without repetition.
        turn, number = m % len(sources), m // len(sources)
        goal = rng.choice([-1.0, 1.0]) if kind == "signs" else rng.uniform(-1, 1)
        wanted[response_name(sources[turn], targets[orders[turn][number]], stress)] = float(goal)
    return wanted


def made(manifold, wanted, starts, steps, rng, **options):
    """The first design from several starts that has its goals, or the best one, and its largest error."""
    best, error = None, np.inf
    for n in range(starts):
        initial = None if n == 0 else np.exp(0.3 * rng.standard_normal(manifold.network.n_edges))
        found = ce.design(manifold, wanted, initial=initial, max_steps=steps, throw=False, **options)
        values = np.array([found.targets[name].value - goal for name, goal in wanted.items()])
        worst = np.nan_to_num(np.abs(values).max(), nan=np.inf)
        if best is None or worst < error:
            best, error = found, worst
        if error < REACHED:
            break
    return best, error


def capacity(parameters, seed):
    """Whether designs have n random conditions of three sources, (size, fraction, kind)."""
    rows = []
    for size in parameters["sizes"]:
        manifold = cf.CriticalManifold(cf.voronoi_network(size, seed))
        pairs = face_diagonals(manifold.network)
        sources, targets = pairs[:N_SOURCES], pairs[N_SOURCES:]
        for fraction in parameters["fractions"]:
            n = min(round(fraction * (manifold.network.n_edges - 1)), N_SOURCES * len(targets))
            for kind in KINDS:
                rng = stable_rng(seed, f"{size} {fraction} {kind}")
                wanted = goals(rng, sources, targets, n, kind)
                found, error = made(manifold, wanted, parameters["starts"], parameters["steps"], rng)
                rows.append({"n_conditions": n, "error": error, "capacity_status": found.status})
    shape = len(parameters["sizes"]), len(parameters["fractions"]), len(KINDS)
    return {name: values.reshape(shape) for name, values in stacked(rows).items()}


def trained(manifold, pairs, parameters, seed):
    """Designs of one source and some or all targets, in three styles, (style, load)."""
    source, targets = pairs[0], pairs[1:]
    rows = []
    for style in STYLES:
        within = {"force_densities": (LIMITED, None)} if style == "limited" else None
        stress = NOISY_STRESS if style == "stressed" else 0.0
        for load in parameters["loads"]:
            rng = stable_rng(seed, f"load {load}")
            n = max(1, round(load * len(targets)))
            wanted = goals(rng, [source], targets, n, "signs", stress)
            found, error = made(manifold, wanted, parameters["starts"], parameters["steps"], rng, within=within)
            chosen = [pair for pair in targets if response_name(source, pair, stress) in wanted]
            signs = np.array([wanted[response_name(source, pair, stress)] for pair in chosen])
            rows.append({"trained_error": error, **measured(found.value, source, chosen, signs, rng)})
    shape = len(STYLES), len(parameters["loads"])
    return {name: values.reshape(*shape, *values.shape[1:]) for name, values in stacked(rows).items()}


def measured(critical, source, targets, signs, rng):
    """What a trained network pays: range of stress, V_L, the stress at which its responses are lost, noise."""
    limit = ce.local_response(critical, source, targets, throw=False).value
    past = []
    for t in STRESSES:
        state = stressed(critical, t)
        past.append(ce.local_response(state, source, targets, throw=False).value.strains - signs)
    state, noisy = stressed(critical, NOISY_STRESS), []
    noise = rng.standard_normal(critical.network.n_edges)
    for size in NOISES:
        rest = state.rest_lengths * (1 + size * noise)
        relaxed = cf.equilibrium(cf.spring_state(critical.network, rest, critical.coordinates), throw=False)
        answer = np.full(len(targets), np.nan)
        if relaxed.ok:
            answer = ce.local_response(relaxed.value, source, targets, throw=False).value.strains
        noisy.append(answer - signs)
    return {
        "least_stress": critical.sigma.min(),
        "largest_stress": critical.sigma.max(),
        "V_L": ce.properties(critical, "V_L").values["V_L"],
        **along_paths(critical, source, targets),
        "limit": limit.limit.min(),
        "past_error": np.abs(past).max(axis=1),
        "past_slope": np.abs(np.abs(past[0]).max() / (STRESSES[0] * np.abs(limit.growth).max()) - 1),
        "noise_error": np.abs(noisy).max(axis=1),
    }


def along_paths(critical, source, targets):
    """Stress within one spacing of the lines from the source to its targets: ⟨ln σ⟩ there less elsewhere, alignment.

    The alignment is Σ τ cos 2θ/Σ τ over the edges near a line, with θ between edge and line: 1 along, −1 across it.
    """
    network, x, L = critical.network, critical.coordinates, critical.bond_vectors
    middle = {(i, j, image): 0.5 * (x[i] + x[j] + image @ network.cell) for i, j, image in (source, *targets)}
    edges = x[network.edges[:, 0]] + 0.5 * L - middle[source]
    nearest, angle = np.full(network.n_edges, np.inf), np.zeros(network.n_edges)
    for target in targets:
        line = in_cell(middle[target] - middle[source], network.cell)
        length = np.linalg.norm(line)
        # About the middle of the line, so that no edge is taken at the other side of the cell.
        off = in_cell(edges - 0.5 * line, network.cell)
        along = np.clip(off @ line / length, -0.5 * length, 0.5 * length)
        distance = np.linalg.norm(off - along[:, None] * line / length, axis=1)
        cosine = (L @ line / (critical.lengths * length)) ** 2
        angle = np.where(distance < nearest, 2 * cosine - 1, angle)
        nearest = np.minimum(nearest, distance)
    near, stress = nearest < network.spacing, np.log(critical.sigma)
    weights = critical.tensions[near]
    return {
        "path_stress": stress[near].mean() - stress[~near].mean() if near.any() and not near.all() else np.nan,
        "path_alignment": (weights * angle[near]).sum() / weights.sum() if near.any() else np.nan,
    }


def in_cell(vectors, cell):
    """The nearest images of vectors in a nearly square cell."""
    shares = vectors @ np.linalg.inv(cell)
    return (shares - np.round(shares)) @ cell


def stressed(critical, t):
    """Springs with the stress tσ at the coordinates of a configuration."""
    lengths = critical.lengths * (1 - t * critical.sigma / critical.network.stiffness)
    return cf.spring_state(critical.network, lengths, critical.coordinates)


def picture(manifold, pairs, seed):
    """Coordinates, stress and displacements (2, ...) of one network before and after training of eight targets."""
    source, targets = pairs[0], pairs[1:]
    rng, network = stable_rng(seed, "picture"), manifold.network
    wanted = goals(rng, [source], targets, min(8, len(targets)), "signs")
    before = manifold.configuration(network.stiffness)
    after, _ = made(manifold, wanted, 1, 300, rng)
    chosen = [pair for pair in targets if response_name(source, pair) in wanted]
    found = [ce.local_response(one, source, chosen, throw=False).value for one in (before, after.value)]
    shown = np.zeros((9, 4))
    for n, (i, j, image) in enumerate([source, *chosen]):
        shown[n] = i, j, *image
    shown[len(chosen) + 1 :] = -1
    return {
        "bonds": np.array([one.bond_vectors for one in (before, after.value)]),
        "stress": np.array([one.sigma for one in (before, after.value)]),
        "places": np.array([one.coordinates for one in (before, after.value)]),
        "moves": np.array([one.displacements for one in found]),
        "shown": shown,
        "edges": network.edges,
        "cell": network.cell,
    }
