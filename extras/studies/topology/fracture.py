"""Fracture and remodelling: edges are cut one at a time, and the network is strained to its new onset after each cut.

A network at the transition has one self-stress, so that a cut leaves it floppy at its rest lengths.  It becomes rigid
again at a strain γ_c on a path of deformations.  Each next edge is chosen by the tensions at that onset: the largest
(fracture), the smallest that is not zero (remodelling by enzymes that sever slack fibres), or any at random.
"""

import numpy as np
from critflow.studies.shared.figures import counted, heading, page, readable
from critflow.studies.shared.measurements import moduli_with_bounds
from critflow.studies.shared.reports import finite, parameters, series, spread
from critflow.studies.shared.tables import bounded, numbers, outcomes, padded, stacked
from scipy.stats import binom

import critflow as cf
import critflow_extras as ce
from critflow.engine import Claim
from critflow.engine.study import plural
from critflow.result import NetworkError
from critflow.taut_part import backbone

from ..shared.parts import draw_in_cell, segments

# Relative difference of tensions that only rounding tells apart; those of other edges differ by 1e-4 or more.
TIED = 1e-9
LAWS = {"largest": "largest tension", "smallest": "smallest tension", "random": "at random"}
PATHS = {"dilation": "dilation", "simple_shear": "simple shear"}
# The panels of each path: its own modulus at the onset among them.
MEASURES = {
    "critical_strain": "onset $\\gamma_c$  [%]",
    "B_0": "$B_0$ there  [k]",
    "G_0": "$G_0$ there  [k]",
    "alignment": "alignment",
    "taut_fraction": "taut edges  [%]",
}
DRAWN = {
    "dilation": ("critical_strain", "B_0", "alignment", "taut_fraction"),
    "simple_shear": ("critical_strain", "G_0", "alignment", "taut_fraction"),
}
PERCENT = ("critical_strain", "taut_fraction")


def sequences(parameters, seed):
    """All paths and laws from the configuration of equal lengths."""
    start = cf.optimize(cf.voronoi_network(parameters["n_vertices"], seed), "length_variance").value
    paths, pictures = [], [picture(start, 0, start.network.n_edges)]
    for p, path in enumerate(PATHS):
        runs = []
        for n, law in enumerate(LAWS):
            rng = np.random.default_rng([seed, p, n])
            steps = list(sequence(start, path, law, parameters["cuts"], rng))
            runs.append(curves(steps, start.network.n_edges, parameters["cuts"] + 1))
            if path == "simple_shear":
                whole = [critical for _, critical, _ in steps[: parameters["pictured"] + 1] if critical is not None]
                pictures.append(picture(whole[-1], len(whole) - 1, start.network.n_edges))
        paths.append(stacked(runs))
    return {**stacked(paths), **stacked(pictures)}


def sequence(critical, path, law, cuts, rng):
    """Status, configuration, and strain of the onset with its error, before and after each cut until it opens."""
    network, lengths = critical.network, critical.lengths
    yield cf.Status.ok, critical, (0.0, 0.0)
    for _ in range(cuts):
        kept = np.ones(network.n_edges, bool)
        kept[chosen(critical.tensions, law, rng)] = False
        try:
            network, edges, _ = ce.pruned(network, kept)
        except NetworkError:
            yield cf.Status.floppy, None, np.nan
            return
        lengths = lengths[edges]
        onset = ce.critical_strain(network, lengths, path, throw=False)
        # Bounds that differ by more than 1e-9 still give a configuration.
        if not np.isfinite(onset.value.strain):
            yield onset.status, None, np.nan
            return
        critical = onset.value.configuration
        try:
            backbone(critical)
        except cf.InputError:  # rounding leaves an edge taut that no other one balances
            yield cf.Status.ill_conditioned, None, np.nan
            return
        yield onset.status, critical, (onset.value.strain, onset.stats.error_bound)


def chosen(tensions, law, rng):
    """The edge that is cut next, among those under tension."""
    taut = np.flatnonzero(tensions > 0)
    if law == "random":
        return int(rng.choice(taut))
    tension = tensions[taut]
    extreme = tension.max() if law == "largest" else tension.min()
    # Edges in series have one tension: of those that only rounding tells apart the first is cut.
    return int(taut[np.argmax(np.abs(tension - extreme) <= TIED * extreme)])


def curves(steps, n_edges, n):
    """The measures of a sequence after each number of cuts, (n,) each, and their outcomes."""
    measured = stacked([measures(critical, strain, n_edges) for _, critical, strain in steps if critical is not None])
    status = padded([int(status) for status, _, _ in steps], n, int(cf.Status.missing))
    return {"strain_status": status, **{name: padded(values, n) for name, values in measured.items()}}


def measures(critical, strain, n_edges):
    """The stored numbers of one critical configuration; `strain` of its onset and the bound on its error."""
    (bulk, shear), (bulk_error, shear_error) = moduli_with_bounds(critical)
    taut = critical.sigma > 0
    L = critical.bond_vectors[taut]
    double = (L[:, 0] + 1j * L[:, 1]) ** 2 / critical.lengths[taut]
    return {
        "critical_strain": strain[0],
        "critical_strain_error_bound": strain[1],
        "B_0": bulk,
        "B_0_error_bound": bulk_error,
        "G_0": shear,
        "G_0_error_bound": shear_error,
        "alignment": abs(double.sum()) / critical.lengths[taut].sum(),
        "taut_fraction": taut.sum() / n_edges,
    }


def picture(critical, cuts, n_edges):
    """The edges of a configuration and their tensions."""
    return {
        "segments": padded(segments(critical), n_edges),
        "segment_tension": padded(critical.tensions / critical.tensions.max(), n_edges),
        "pictured_cuts": cuts,
    }


def figure(ds):
    """Pictures of one network, and measures against the number of cuts: a column a measure, a row a path."""
    figure = page(
        6.4,
        "Cut at its largest tensions a network falls apart after a dozen cuts; cut at its smallest it lasts\n"
        f"({counted(ds)} of {parameters(ds)['n_vertices']} vertices: mean and 68 %; ×: half of them have come apart)",
    )
    pictures, plots = figure.subfigures(2, 1, height_ratios=(1, 1.9))
    draw_pictures(pictures, ds.isel(seed=0), parameters(ds)["n_vertices"])
    rows = plots.subplots(len(PATHS), len(DRAWN["dilation"]), sharex=True, squeeze=False)
    for row, (letter, (path, title)) in enumerate(zip("BC", PATHS.items(), strict=True)):
        for axes, name in zip(rows[row], DRAWN[path], strict=True):
            for n, law in enumerate(LAWS.values()):
                draw_curve(axes, (100 if name in PERCENT else 1) * ds[name].values[:, row, n], n, law)
            axes.set(ylabel=MEASURES[name], ylim=(0, None))
            readable(axes)
        rows[row, 0].set_title(f"$\\bf{{{letter}}}$  {title} to the onset", loc="left", fontsize=9)
    for axes in rows[-1]:
        axes.set_xlabel("edges cut")
    handles, labels = rows[0, 0].get_legend_handles_labels()
    labels = [f"edge that is cut: {labels[0]}", *labels[1:]]
    plots.legend(handles, labels, fontsize=9, frameon=False, ncols=3, loc="outside lower center")
    return figure


def draw_curve(axes, values, n, label):
    """Mean and spread while at least half of the networks are whole; a cross at the end."""
    whole = np.isfinite(values).mean(axis=0) > 0.5
    cuts, at, colour = np.flatnonzero(whole), values[:, whole], series(n)["color"]
    mean = np.nanmean(at, axis=0)
    axes.plot(cuts, mean, color=colour, label=label, linestyle=("-", "--", "-.")[n])
    low, high = np.nanpercentile(at, [16, 84], axis=0)
    axes.fill_between(cuts, low, high, color=colour, alpha=0.2, linewidth=0)
    if not whole.all():
        axes.plot(cuts[-1], mean[-1], "x", color=colour, markersize=7, markeredgewidth=2)


def draw_pictures(figure, one, n_vertices):
    """One network at the start and after some cuts by each law, in simple shear, with its cell."""
    strains = one.critical_strain.values[list(PATHS).index("simple_shear")]
    for n, axes in enumerate(figure.subplots(1, one.sizes["picture"])):
        shear = strains[max(n - 1, 0), int(one.pictured_cuts[n])]
        tension = one.segment_tension.values[n]
        lines, tension = one.segments.values[n][np.isfinite(tension)], tension[np.isfinite(tension)]
        title = f"{int(one.pictured_cuts[n])} cuts:\n{list(LAWS.values())[n - 1]}" if n else "before\nthe first cut"
        colour = series(n - 1)["color"] if n else "0.15"
        for some, width, shade in ((tension <= 0, 0.8, "0.75"), (tension > 0, 0.4, colour)):
            draw_in_cell(axes, lines[some], width + 3.5 * tension[some], n_vertices, shear, colors=shade)
        axes.set_title(title, fontsize=9)
    heading(figure, "A", "one network in simple shear at its onset; width: tension, grey: slack")


def after(ds, name, path, law, cut):
    """The finite values over the networks after a number of cuts."""
    return finite(ds[name].values[:, list(PATHS).index(path), list(LAWS).index(law), cut])


def life(ds, path, law):
    """Number of cuts after which each network comes apart, the number of cuts + 1 for those that do not."""
    strain = ds.critical_strain.values[:, list(PATHS).index(path), list(LAWS).index(law)]
    return np.isfinite(strain).sum(axis=1)


def claims(ds):
    """What fracture and remodelling do to a network."""
    cuts = parameters(ds)["cuts"]
    few = max(cuts // 6, 1)
    onsets = {law: after(ds, "critical_strain", "dilation", law, few) for law in LAWS}
    rows = ds.critical_strain.values[:, list(PATHS).index("dilation"), :, few]
    order = np.diff(rows[:, [list(LAWS).index(law) for law in ("smallest", "random", "largest")]], axis=1)
    ordered = int((order > 0).all(axis=1).sum())
    lives = {law: life(ds, "simple_shear", law) for law in LAWS}
    sooner, later = (int((sign * (lives["smallest"] - lives["largest"]) > 0).sum()) for sign in (1, -1))
    chance = binom.cdf(later, sooner + later, 0.5) if sooner + later else 1.0
    pair = ds.alignment.values[:, list(PATHS).index("simple_shear"), list(LAWS).index("smallest")][:, [0, few]]
    first, aligned = pair[np.isfinite(pair).all(axis=1)].T
    n_aligned = int((aligned > first).sum())
    return [
        Claim.tested(
            "topology-onset",
            "cuts of large tension delay the onset more than random ones, cuts of small tension less", "order",
            f"γ_c in dilation after {few} cuts: "
            + ", ".join(f"{LAWS[law]} {spread(strains)}" for law, strains in onsets.items()),
            ordered == len(rows), f"the order is another in {plural(len(rows) - ordered, 'network')}",
            criterion="this order in every network",
        ),
        Claim.tested(
            "topology-life", "networks come apart after fewer cuts of the largest tension than of the smallest",
            "order",
            f"median cuts until they come apart in shear (at most {cuts + 1} observed): "
            + ", ".join(f"{LAWS[law]} {np.median(n):.3g}" for law, n in lives.items()),
            None if chance >= 0.05 else True, "too few networks come apart",
            f"sooner in {plural(sooner, 'network')}, later in {later}",
            criterion="sign test of the networks, p < 0.05",
        ),
        Claim.tested(
            "topology-alignment", "shear to the onset aligns the taut edges of remodelled networks", "increase",
            f"{spread(first)} before the first cut, {spread(aligned)} after {few} cuts; increases in {n_aligned} of "
            f"{plural(len(first), 'network')}", 0 < len(first) == n_aligned, "the alignment decreases in some",
            criterion="every network", sample=plural(len(aligned), "network"),
        ),
    ]  # fmt: skip


VARIABLES = (
    *bounded(
        ("seed", "path", "law", "cut"),
        critical_strain="strain of the onset after each number of cuts",
        B_0="bulk modulus B_0 at the onset [k]",
        G_0="shear modulus G_0 at the onset [k]",
    ),
    *numbers(
        ("seed", "path", "law", "cut"),
        alignment="nematic order of the taut edges, weighted by length",
        taut_fraction="part of the initial edges that is under tension",
    ),
    *outcomes(("seed", "path", "law", "cut"), strain_status="outcome of the search for the onset"),
    *numbers(("seed", "picture", "edge", "end", "axis"), segments="edges in simple shear: start, then each law"),
    *numbers(("seed", "picture", "edge"), segment_tension="their tensions, relative to the largest"),
    *numbers(("seed", "picture"), "i4", pictured_cuts="number of cuts in each picture"),
)
