"""Local responses on the critical manifold: how far they reach untrained, and how many one network can be given.

Sources and targets are diagonals of faces.  The response η is the relative change of a target per relative change of a
source at vanishing stress; designs change the stress from σ = k.  A design that is not reached is no proof that there
is none, with one exception: η_ts η_st = G_ts²/(G_ss G_tt) lies between 0 and 1, so that conditions never name a source
as the target of another.

In overconstrained networks of springs, trained by cutting, Rocks et al. find that the number of targets that one source
can command has a sharp limit which grows more slowly than the number of vertices.

Random rest lengths (`random_lengths`) have s = 0.1, not the 0.3 of the paper, so that every edge carries tension.
"""

import numpy as np
from matplotlib.collections import LineCollection

import critflow as cf
from critflow.extras.local.diagonals import face_diagonals, response_name
from critflow.extras.local.drawing import add_response, response_legend
from critflow.figures.plot import periodic_segments
from critflow.result import StudyError
from critflow.workflow import Claim, Coordinate, Study, stable_rng
from critflow.workflow.study import plural

from .shared.checks import check_network, check_voronoi, voronoi_check
from .shared.figures import counted, legend_below, lettered, panels
from .shared.populations import LABELS, NAMES, PAPER_POPULATIONS, configuration
from .shared.reports import PAPER, finite, parameters, series
from .shared.tables import networks, numbers, outcomes, stacked

SOURCES = (
    f"{PAPER}; Rocks et al., Limits of multifunctionality in tunable networks (PNAS 116, 2506, 2019); Rocks et al., "
    "Designing allostery-inspired response in mechanical networks (PNAS 114, 2520, 2017); Yan et al., Architecture and "
    "coevolution of allosteric materials (PNAS 114, 2526, 2017)"
)
NETWORK = {"threshold": 0.1, "spread": 0.1}
KINDS = ("signs", "amplitudes")  # of the goals: ±1, and uniform between −1 and 1
N_SOURCES = 3  # of the conditions of a capacity
BINS = np.arange(0.5, 6.0, 1.0)  # distances of the centres of source and target, in units of √(V/N_v)
FAR = 3  # the bin around four spacings, which every network has
UNTRAINED = 6  # sources of the untrained responses
# Stresses t in tσ, in units of k, and relative errors of the rest lengths at t = 1e-3.
STRESSES, NOISES, NOISY_STRESS = np.array([1e-6, 1e-5, 1e-4, 1e-3, 1e-2]), np.array([1e-5, 1e-4, 1e-3]), 1e-3
LIMITED = 0.2  # least force density of the designs that hold farther, in units of the mean
# Designs in the limit of no stress, the same with limited force densities, and designs for the stress t = 1e-3.
STYLES = ("free", "limited", "stressed")
FRAMES, SWING = 16, 0.25  # of the movie, and the largest strain of its source
REACHED, LOST = 1e-6, 0.1  # errors of a design that has its goals, and of a response that is lost


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
        solution = configuration(manifold, NETWORK, seed, population)
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
        solution = cf.local_response(critical, source, [targets[m] for m in others], throw=False)
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
        found = cf.design(manifold, wanted, initial=initial, max_steps=steps, throw=False, **options)
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
    limit = cf.local_response(critical, source, targets, throw=False).value
    past = []
    for t in STRESSES:
        state = stressed(critical, t)
        past.append(cf.local_response(state, source, targets, throw=False).value.strains - signs)
    state, noisy = stressed(critical, NOISY_STRESS), []
    noise = rng.standard_normal(critical.network.n_edges)
    for size in NOISES:
        rest = state.rest_lengths * (1 + size * noise)
        relaxed = cf.equilibrium(cf.spring_state(critical.network, rest, critical.coordinates), throw=False)
        answer = np.full(len(targets), np.nan)
        if relaxed.ok:
            answer = cf.local_response(relaxed.value, source, targets, throw=False).value.strains
        noisy.append(answer - signs)
    return {
        "least_stress": critical.sigma.min(),
        "largest_stress": critical.sigma.max(),
        "V_L": cf.properties(critical, "V_L").values["V_L"],
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
    found = [cf.local_response(one, source, chosen, throw=False).value for one in (before, after.value)]
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


# Figures


def success(ds):
    """Part of the networks whose designs have all goals, (size, fraction, kind)."""
    return (ds.error < REACHED).mean("seed").values


def thresholds(ds):
    """Conditions over N_b − 1 at which half of the networks have their goals, (size, kind); NaN beyond the range."""
    part, fractions = success(ds), np.array(parameters(ds)["fractions"])
    found = np.full((part.shape[0], len(KINDS)), np.nan)
    for s, k in np.ndindex(*found.shape):
        curve = np.minimum.accumulate(part[s, :, k])
        if curve[0] >= 0.5 > curve[-1]:
            n = int(np.argmax(curve < 0.5))
            share = (curve[n - 1] - 0.5) / (curve[n - 1] - curve[n])
            found[s, k] = fractions[n - 1] + share * (fractions[n] - fractions[n - 1])
    return found


def capacity_figure(ds):
    """Success against the number of conditions, and the threshold against size."""
    figure, (left, right) = panels(
        2,
        f"Conditions of {N_SOURCES} sources that designs meet: responses ±1 (signs), or of any size between\n"
        f"({counted(ds)} a size)",
        height=4.2,
    )
    fractions, sizes = np.array(parameters(ds)["fractions"]), np.array(parameters(ds)["sizes"])
    part, threshold = success(ds), thresholds(ds)
    for s, size in enumerate(sizes):
        for k, kind in enumerate(KINDS):
            style = {**series(s), "ls": ("-", ":")[k], "label": f"$N_v$ = {size}, {kind}"}
            left.plot(fractions, part[s, :, k], ms=4, **style)
    left.set(xlabel="conditions over $N_b - 1$", ylabel="networks with all goals [part]", ylim=(-0.03, 1.05))
    for k, kind in enumerate(KINDS):
        right.plot(sizes, threshold[:, k] * (1.5 * sizes - 1), ms=5, **series(k), label=f"half succeed, {kind}")
    right.plot(sizes, 1.5 * sizes - 1, "k--", lw=0.8)
    right.text(sizes[-1], 1.5 * sizes[-1], "$N_b - 1$", ha="right", va="bottom", fontsize=9)
    right.plot(sizes, 0.5 * sizes - 1, "k:", lw=0.8)
    right.text(sizes[-1], 0.25 * sizes[-1], "all faces, one source", ha="right", va="top", fontsize=9)
    right.set(xlabel="$N_v$", ylabel="number of conditions", xlim=(0, None), ylim=(0, None))
    right.legend(frameon=False, fontsize=9)
    legend_below(figure, left, ncols=3)
    lettered(left, right)
    return figure


def response_figure(ds):
    """Untrained responses by distance; deviations of trained ones by stress and by errors of the rest lengths."""
    figure, (left, middle, right) = panels(
        3,
        "Designs have responses of ±1 at no stress, or at the stress that they are for\n"
        f"({counted(ds)} of {parameters(ds)['n_vertices']} vertices, medians; random ℓ: s = {NETWORK['spread']:g})",
        height=4.4,
    )
    middles = 0.5 * (BINS[1:] + BINS[:-1])
    for n, population in enumerate(PAPER_POPULATIONS):
        left.semilogy(middles, ds.typical[:, n].mean("seed"), ms=4, **series(n), label=LABELS[population])
    left.set(xlabel="distance [$\\sqrt{V/N_v}$]", ylabel="median |η|", title="untrained")
    low, high = left.get_ylim()
    left.set_ylim(low * (low / high) ** 0.8, high)  # room for the names
    left.legend(frameon=False, fontsize=8, ncols=2, loc="lower center", columnspacing=0.6, handlelength=1)
    loads = parameters(ds)["loads"]
    for s, style in enumerate(STYLES):
        for n in sorted({len(loads) // 3, len(loads) - 1}):
            text = {"free": "", "limited": f", σ > {LIMITED:g}⟨σ⟩", "stressed": ", for t = 1e-3"}[style]
            kind = {**series(n), "ls": ("-", ":", "--")[s], "label": f"{loads[n]:.0%} of the faces{text}", "ms": 4}
            reached = (ds.trained_error[:, s, n] < REACHED).values
            for axes, x, values in ((middle, STRESSES, ds.past_error), (right, NOISES, ds.noise_error)):
                rows = values[:, s, n].values[reached]
                if len(rows):
                    axes.loglog(x, np.median(rows, axis=0), **kind)
    for axes in (middle, right):
        axes.axhline(LOST, color="0.7", lw=0.8)
    middle.set_ylim(bottom=1e-6)
    middle.set(xlabel="stress t  [k]", ylabel="largest deviation from ±1", title="trained, under stress")
    right.set(xlabel="errors of lengths", title="the same, t = 1e-3")
    legend_below(figure, middle, ncols=2)
    lettered(left, middle, right)
    return figure


def network_figure(ds):
    """One network before and after training: widths by tension, displacements, source and targets."""
    figure, axes = panels(2, "Eight targets of one source before and after training", height=4.2)
    one = ds.isel(seed=0)
    for n, (ax, title) in enumerate(zip(axes, ("stiffest network", "trained"), strict=True)):
        draw_stage(ax, one, n)
        ax.set_title(title)
    lettered(*axes)
    figure.legend(handles=response_legend(), frameon=False, ncols=3, fontsize=9, loc="outside lower center")
    return figure


def draw_stage(axes, one, n, strain=0.0):
    """The network before (0) or after training (1) at a strain of the source, its source, targets and motion.

    Arrows are drawn at no strain alone, where nothing moves.
    """
    x, u, L = one.places.values[n], one.moves.values[n], one.bonds.values[n]
    cell, edges = one.cell.values, one.edges.values
    x, L = x + strain * u, L + strain * (u[edges[:, 1]] - u[edges[:, 0]])
    offsets = np.round((L - x[edges[:, 1]] + x[edges[:, 0]]) @ np.linalg.inv(cell)).astype(int)
    lines, owner = periodic_segments(edges, offsets, cell, x)
    tension = one.stress.values[n] * np.linalg.norm(L, axis=1)
    axes.add_collection(LineCollection(list(lines), linewidths=(0.4 + tension / tension.mean())[owner], colors="0.7"))
    shown = one.shown.values.astype(int)
    shown = shown[shown[:, 0] >= 0]
    ends, images = shown[:, :2], shown[:, 2:]
    r = x[ends[:, 1]] - x[ends[:, 0]] + images @ cell
    strains = np.sum((u[ends[:, 1]] - u[ends[:, 0]]) * r, axis=1) / np.sum(r**2, axis=1)
    add_response(axes, cell, x, u if strain == 0 else np.zeros_like(u), ends, images, strains)


def movie(ds):
    """The stiffest and the trained network while the source opens and closes: frames of one period."""
    one = ds.isel(seed=0)
    for phase in np.linspace(0, 2 * np.pi, FRAMES, endpoint=False):
        figure, axes = panels(2, f"The source opens and closes by {SWING:.0%}", height=4.6)
        for n, (ax, title) in enumerate(zip(axes, ("stiffest network", "trained"), strict=True)):
            draw_stage(ax, one, n, SWING * np.sin(phase))
            ax.set_title(title)
        figure.legend(handles=response_legend()[:3], frameon=False, ncols=3, fontsize=9, loc="outside lower center")
        figure.set(size_inches=(7.2, 4.2), dpi=72)
        yield figure


# Claims


def claims(ds):
    """One source commands all faces; capacity; limits of stress; reciprocity; transmitters."""
    return [*_of_training(ds), *_of_capacity(ds), *_of_limits(ds)]


def _of_training(ds):
    loads = parameters(ds)["loads"]
    every = int(np.argmax(loads))
    errors = ds.trained_error[:, STYLES.index("free"), every].values
    best = ds.largest.mean("seed").values
    far = ds.typical.mean("seed").values[:, FAR]
    return [
        Claim.tested(
            "allostery-faces", f"one source commands {loads[every]:.0%} of the other faces, +1 or −1 at random", "",
            f"{int((errors < REACHED).sum())} of {plural(len(errors), 'network')}, largest error {errors.max():.1e}",
            (errors < REACHED).all(), "a search that fails is no proof", criterion="1e-6 in every network",
        ),
        Claim(
            "allostery-untrained", "median response of untrained populations at four spacings", "",
            ", ".join(f"{NAMES[p]} {a:.2g} (largest {b:.2g})" for p, a, b
                      in zip(PAPER_POPULATIONS, far, best, strict=True)), "measured",
        ),
        Claim.tested(
            "allostery-reciprocity", "the product of the responses of two pairs to each other is at most 1", "",
            f"largest {finite(ds.reciprocity).max():.3g}", finite(ds.reciprocity).max() <= 1 + 1e-9,
            "the compliance is not positive", criterion="1e-9", kind="check",
        ),
    ]  # fmt: skip


def _of_capacity(ds):
    sizes, found = parameters(ds)["sizes"], thresholds(ds)
    signs = found[:, KINDS.index("signs")]
    known = np.isfinite(signs)
    text = "; ".join(
        f"{kind}: " + ", ".join(f"{one:.2f} at N_v = {size}" for size, one in zip(sizes, found[:, k], strict=True))
        for k, kind in enumerate(KINDS)
    )
    holds = None if known.sum() < 2 else bool(signs[known][-1] > 0.8 * signs[known][0])
    return [
        Claim.tested(
            "allostery-capacity", "the number of conditions that half of the networks meet grows in proportion to N_v",
            "slower than N in overconstrained networks (Rocks et al. 2019)",
            f"part of N_b − 1 at which half of the searches succeed: {text}", holds,
            "fewer than two sizes have a threshold in the range" if holds is None else "it grows more slowly",
            criterion="part at the largest size above 0.8 of that at the smallest",
            sample="searches, which prove no limit",
        ),
    ]  # fmt: skip


def _of_limits(ds):
    loads = parameters(ds)["loads"]
    reached = ds.trained_error < REACHED
    without = [s for s, style in enumerate(STYLES) if style != "stressed"]
    slope = finite(ds.past_slope.where(reached & (ds.limit > 100 * STRESSES[0]))[:, without])
    stressed_at = int(np.argmin(np.abs(STRESSES - NOISY_STRESS)))
    held = ds.past_error[:, STYLES.index("stressed"), :, stressed_at].values
    text = []
    for s in without:
        style = STYLES[s]
        for n, load in enumerate(loads):
            values = finite(ds.limit[:, s, n].where(reached[:, s, n]))
            text.append(
                f"{style}, {load:.0%}: {np.median(values):.1e}" if len(values) else f"{style}, {load:.0%}: none"
            )
    return [
        Claim.tested(
            "allostery-slope", "under small stress responses leave their limit linearly, with the predicted slope", "",
            f"largest deviation of the slope {slope.max():.1e}" if len(slope) else "no design holds so far",
            None if not len(slope) else slope.max() < 0.05, "terms of the next order",
            criterion="5 % where the limit holds to 1 % beyond a hundred times the stress", kind="check",
        ),
        Claim(
            "allostery-held", f"networks with designs of ±1 under the stress t = {NOISY_STRESS:g}", "",
            ", ".join(f"{load:.0%} of the faces: {int((held[:, n] < REACHED).sum())} of {len(held)}"
                      for n, load in enumerate(loads)), "measured",
        ),
        Claim(
            "allostery-stress", "stress t [k] at which trained responses deviate by 1 %, medians", "", "; ".join(text),
            "measured",
        ),
        Claim(
            "allostery-path", "stress within one spacing of the lines from the source to its targets: ratio of its "
            "geometric mean to that elsewhere, and alignment of the tensions with the lines; medians", "",
            "; ".join(_path(ds, n, load) for n, load in enumerate(loads)), "measured",
        ),
    ]  # fmt: skip


def _path(ds, n, load):
    reached = ds.trained_error[:, 0, n] < REACHED
    stress, aligned = (finite(ds[name][:, 0, n].where(reached)) for name in ("path_stress", "path_alignment"))
    if not len(stress):
        return f"{load:.0%}: none"
    return f"{load:.0%}: {np.exp(np.median(stress)):.2f}, {np.median(aligned):+.2f}"


def check(parameters, axes):
    """Refuse settings that could only fail."""
    if min(parameters["sizes"]) < 24 or parameters["n_vertices"] < 24:
        raise StudyError("sizes and n_vertices must be at least 24, or no target is left for three sources")
    if not (0 < min(parameters["fractions"]) and 0 < min(parameters["loads"]) <= max(parameters["loads"]) <= 1):
        raise StudyError("fractions must be positive, and loads between 0 and 1")
    for size in parameters["sizes"]:
        check_network(check_voronoi, size)
    voronoi_check("starts", "steps")(parameters, axes)


CAPACITY, TRAINED = ("seed", "size", "fraction", "kind"), ("seed", "style", "load")

study = Study(
    name="allostery",
    title="Local responses on the critical manifold",
    references=SOURCES,
    axes=(networks(6),),
    parameters={
        "n_vertices": 100,
        "loads": (0.02, 0.1, 0.3, 1.0),
        "sizes": (50, 100, 200),
        "fractions": (0.4, 0.5, 0.6, 0.7, 0.8),
        "starts": 1,
        "steps": 600,
    },
    coordinates=(
        Coordinate("size", "sizes", "number of vertices"),
        Coordinate("fraction", "fractions", "number of conditions over N_b − 1"),
        Coordinate("load", "loads", "part of the other faces that are targets"),
    ),
    case=case,
    check=check,
    variables=(
        *numbers(("seed", "population", "bin"), typical="median |η| of diagonals by distance, untrained"),
        *numbers(
            ("seed", "population"),
            largest="largest |η| beyond two spacings",
            reciprocity="largest product η_ts η_st of two sources",
        ),
        *numbers(CAPACITY, "i4", n_conditions="number of conditions"),
        *numbers(CAPACITY, error="largest error of a response of the design"),
        *outcomes(CAPACITY, capacity_status="outcome of the design"),
        *numbers(
            TRAINED,
            trained_error="largest error of a response of the design",
            least_stress="least σ at Σσ² = N_b",
            largest_stress="largest σ",
            V_L="V_L of the design",
            path_stress="mean ln σ within one spacing of the lines from source to targets, less that elsewhere",
            path_alignment="Σ τ cos 2θ/Σ τ of the edges there, θ between edge and line",
            limit="least stress t at which a response deviates by 1 %, by its next order [k]",
            past_slope="relative deviation of the change at the least stress from its prediction",
        ),
        *numbers((*TRAINED, "stress_level"), past_error="largest deviation from ±1 at the stress tσ"),
        *numbers((*TRAINED, "noise"), noise_error="largest deviation with relative errors of rest lengths"),
        *numbers(("seed", "stage", "edge", "axis"), bonds="bond vectors before and after training"),
        *numbers(("seed", "stage", "edge"), stress="σ before and after training"),
        *numbers(("seed", "stage", "vertex", "axis"), places="coordinates", moves="motion per strain of the source"),
        *numbers(("seed", "pair", "place"), shown="source and targets: tail, head and image; −1 for none"),
        *numbers(("seed", "edge", "end"), "i4", edges="vertices at tail and head of each edge"),
        *numbers(("seed", "cell_vector", "axis"), cell="cell vectors as rows"),
        *outcomes(("seed",), status="outcome of the case"),
    ),
    figures={"capacity": capacity_figure, "responses": response_figure, "network": network_figure},
    animations={"movie": movie},
    claims=claims,
)
