"""Fracture and remodelling: edges are cut one at a time, and the network is strained to its new onset after each cut.

A network at the transition has one self-stress, so that a cut leaves it floppy at its rest lengths.  It becomes rigid
again at a strain γ_c on a path of deformations.  Each next edge is chosen by the tensions at that onset: the largest
(fracture), the smallest that is not zero (remodelling by enzymes that sever slack fibres), or any at random.
"""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from critflow import Status, critical_strain, optimize, pruned, voronoi_network
from critflow.critical.backbone import backbone
from critflow.result import NetworkError, StudyError
from critflow.workflow import Claim

from ..shared.checks import check_network, check_positive
from ..shared.measurements import known_moduli
from ..shared.reports import finite, series, spread, status_counts
from .parts import undefined

LAWS = {"largest": "largest tension", "smallest": "smallest tension", "random": "at random"}
PATHS = {"dilation": "dilation", "simple_shear": "simple shear"}

PARAMETERS = {"n_vertices": 64, "cuts": 16, "pictured": 6}
VARIABLES = {
    "critical_strain": (("path", "law", "cut"), "strain of the onset after each number of cuts"),
    "strain_status": (("path", "law", "cut"), "its outcome"),
    "bulk_modulus": (("path", "law", "cut"), "bulk modulus B_0 at the onset [k]"),
    "shear_modulus": (("path", "law", "cut"), "shear modulus G_0 at the onset [k]"),
    "alignment": (("path", "law", "cut"), "nematic order of the taut edges, weighted by length"),
    "taut_fraction": (("path", "law", "cut"), "part of the initial edges that is under tension"),
    "segments": (("picture", "edge", "end", "axis"), "ends of the edges in simple shear: start, then one law each"),
    "segment_tension": (("picture", "edge"), "their tensions, relative to the largest"),
    "pictured_cuts": (("picture",), "number of cuts in each picture"),
}


def sizes(parameters):
    """Sizes of the inner dimensions."""
    return {
        "path": len(PATHS),
        "law": len(LAWS),
        "cut": parameters["cuts"] + 1,
        "picture": 1 + len(LAWS),
        "edge": 3 * parameters["n_vertices"] // 2,
        "end": 2,
        "axis": 2,
    }


def check(parameters):
    """Refuse settings that could only fail."""
    check_positive(parameters, "cuts")
    check_network(voronoi_network, parameters["n_vertices"], 0)
    if parameters["cuts"] >= parameters["n_vertices"]:
        raise StudyError(f"cuts={parameters['cuts']} must be smaller than the number of vertices")


def case(parameters, seed):
    """All paths and laws from the configuration of equal lengths."""
    start = optimize(voronoi_network(parameters["n_vertices"], seed), "length_variance").value
    found = undefined(VARIABLES, sizes(parameters))
    draw(found, 0, start, 0)
    for p, path in enumerate(PATHS):
        for n, law in enumerate(LAWS):
            rng = np.random.default_rng([seed, p, n])
            for cut, (status, critical, strain) in enumerate(sequence(start, path, law, parameters["cuts"], rng)):
                found["strain_status"][p, n, cut] = status
                if critical is None:
                    continue
                for name, value in measures(critical, strain, start.network.n_edges).items():
                    found[name][p, n, cut] = value
                if path == "simple_shear" and cut <= parameters["pictured"]:
                    draw(found, 1 + n, critical, cut)
    return found


def draw(found, picture, critical, cuts):
    """Store the edges of a configuration for a drawing, with their tails inside the cell."""
    network, n = critical.network, critical.network.n_edges
    tail = critical.coordinates[network.edges[:, 0]]
    tail = (tail @ np.linalg.inv(network.cell) % 1.0) @ network.cell
    found["segments"][picture], found["segment_tension"][picture] = np.nan, np.nan
    found["segments"][picture, :n] = np.stack([tail, tail + critical.bond_vectors], axis=1)
    found["segment_tension"][picture, :n] = critical.tensions / critical.tensions.max()
    found["pictured_cuts"][picture] = cuts


def sequence(critical, path, law, cuts, rng):
    """Status, configuration and strain of the onset, before and after each cut until the network opens."""
    network, lengths = critical.network, critical.lengths
    yield Status.ok, critical, 0.0
    for _ in range(cuts):
        kept = np.ones(network.n_edges, bool)
        kept[chosen(critical.tensions, law, rng)] = False
        try:
            network, edges, _ = pruned(network, kept)
        except NetworkError:
            yield Status.floppy, None, np.nan
            return
        lengths = lengths[edges]
        onset = critical_strain(network, lengths, path, throw=False)
        # Bounds that differ by more than 1e-9 still give a configuration.
        if not np.isfinite(onset.strain):
            yield onset.status, None, np.nan
            return
        critical = onset.configuration
        yield onset.status, critical, onset.strain


def chosen(tensions, law, rng):
    """The edge that is cut next, among those under tension."""
    taut = np.flatnonzero(tensions > 0)
    if law == "random":
        return int(rng.choice(taut))
    return int(taut[tensions[taut].argmax() if law == "largest" else tensions[taut].argmin()])


def measures(critical, strain, total):
    """The stored numbers of one critical configuration."""
    parts = [known_moduli(part.configuration) for part in backbone(critical).components]
    taut = critical.sigma > 0
    L = critical.bond_vectors[taut]
    double = (L[:, 0] + 1j * L[:, 1]) ** 2 / critical.lengths[taut]
    return {
        "critical_strain": strain,
        "bulk_modulus": sum(part.bulk for part in parts),
        "shear_modulus": sum(part.shear for part in parts),
        "alignment": abs(double.sum()) / critical.lengths[taut].sum(),
        "taut_fraction": taut.sum() / total,
    }


PANELS = {
    "critical_strain": "onset $\\gamma_c$",
    "bulk_modulus": "$B_0$ there  [k]",
    "shear_modulus": "$G_0$ there  [k]",
    "alignment": "alignment",
    "taut_fraction": "part under tension",
}


def figure(ds, parameters):
    """Pictures of one network, and measures against the number of cuts: a column a measure, a row a path."""
    drawn = Figure(figsize=(11, 7.6), dpi=130, layout="constrained")
    pictures, plots = drawn.subfigures(2, 1, height_ratios=(1, 1.75))
    _pictures(pictures, ds.isel(seed=0))
    panels = plots.subplots(len(PATHS), len(PANELS), sharex=True, squeeze=False)
    for row, title in enumerate(PATHS.values()):
        for axes, (name, label) in zip(panels[row], PANELS.items(), strict=True):
            for n, law in enumerate(LAWS.values()):
                _curve(axes, ds[name].isel(path=row, law=n).transpose("seed", "cut").values, n, law)
            axes.set(ylabel=label, ylim=(0, None))
            axes.spines[["top", "right"]].set_visible(False)
        panels[row, 0].set_title(f"strained by {title}", loc="left", fontweight="bold", fontsize=10.5)
    for axes in panels[-1]:
        axes.set_xlabel("edges cut")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    labels = [f"edge that is cut: {labels[0]}", *labels[1:]]
    plots.legend(handles, labels, fontsize=9.5, frameon=False, ncols=3, loc="outside lower center")
    drawn.suptitle(
        "Fracture and remodelling: one edge is cut, the network strained to its new onset, and so on\n"
        f"$N_v$ = {parameters['n_vertices']}, {ds.sizes['seed']} networks: mean and 68 %; "
        "× : half of them have come apart",
        fontsize=11,
    )
    return drawn


def _curve(axes, values, n, label):
    """Mean and spread while at least half of the networks are whole; a cross at the end."""
    whole = np.isfinite(values).mean(axis=0) > 0.5
    cuts, at, colour = np.flatnonzero(whole), values[:, whole], series(n)["color"]
    mean = np.nanmean(at, axis=0)
    axes.plot(cuts, mean, color=colour, label=label)
    low, high = np.nanpercentile(at, [16, 84], axis=0)
    axes.fill_between(cuts, low, high, color=colour, alpha=0.2, linewidth=0)
    if not whole.all():
        axes.plot(cuts[-1], mean[-1], "x", color=colour, markersize=9, markeredgewidth=2.5)


def _pictures(figure, one):
    """One network at the start and after some cuts by each law, in simple shear."""
    panels = figure.subplots(1, one.sizes["picture"])
    titles = ["before the first cut", *(f"{law}" for law in LAWS.values())]
    for n, (axes, title) in enumerate(zip(panels, titles, strict=True)):
        lines = one.segments.isel(picture=n).transpose("edge", "end", "axis").values
        tension = one.segment_tension.isel(picture=n).values
        known = np.isfinite(tension)
        taut = known & (tension > 0)
        axes.add_collection(LineCollection(lines[known & ~taut], colors="0.75", linewidths=0.8))
        colour = "0.15" if n == 0 else series(n - 1)["color"]
        axes.add_collection(LineCollection(lines[taut], colors=colour, linewidths=0.4 + 3.5 * tension[taut]))
        axes.autoscale_view()
        axes.set_aspect("equal")
        axes.set_anchor("N")
        axes.set_axis_off()
        cuts = int(one.pictured_cuts.values[n])
        axes.set_title(title if n == 0 else f"after {cuts} cuts: {title}", fontsize=10.5)
    figure.supxlabel("simple shear to the onset; width: tension; grey: slack", fontsize=10)


def _at(ds, name, path, law, cut):
    """The finite values over the networks after a number of cuts."""
    return finite(ds[name].isel(path=list(PATHS).index(path), law=list(LAWS).index(law), cut=cut).values)


def _life(ds, path, law):
    """Number of cuts after which each network comes apart, (seeds,), the number of cuts + 1 for those that do not."""
    found = ds.critical_strain.isel(path=list(PATHS).index(path), law=list(LAWS).index(law))
    return np.isfinite(found.transpose("seed", "cut").values).sum(axis=1)


def claims(ds, parameters):
    """What fracture and remodelling do to a network."""
    few = max(parameters["cuts"] // 6, 1)
    return [
        _onsets(ds, few),
        _survival(ds, parameters["cuts"]),
        *(_alignment(ds, few, path) for path in ("simple_shear",)),
        _bounds(ds),
    ]


def _onsets(ds, few):
    found = {law: _at(ds, "critical_strain", "dilation", law, few) for law in LAWS}
    value = ", ".join(f"{LAWS[law]} {spread(at)}" for law, at in found.items())
    means = [np.mean(found[law]) if len(found[law]) else np.inf for law in ("smallest", "random", "largest")]
    return Claim.tested(
        "DesignFractureOnset",
        "cuts of large tension delay the onset more than random ones, cuts of small tension less",
        "order",
        f"γ_c in dilation after {few} cuts: {value}",
        bool((np.diff(means) > 0).all()),
        "the order is another",
    )


def _survival(ds, cuts):
    life = {law: _life(ds, "simple_shear", law) for law in LAWS}
    value = ", ".join(f"{LAWS[law]} {np.median(at):.3g}" for law, at in life.items())
    return Claim.tested(
        "DesignFractureLife",
        "networks come apart after fewer cuts of the largest tension than of the smallest",
        "order",
        f"median cuts until they come apart in shear (at most {cuts + 1} observed): {value}",
        np.median(life["largest"]) < np.median(life["smallest"]) or min(map(np.min, life.values())) > cuts,
        "the order is another",
    )


def _alignment(ds, few, path):
    before, after = (_at(ds, "alignment", path, "smallest", cut) for cut in (0, few))
    return Claim.tested(
        "DesignAlignment",
        "shear to the onset aligns the taut edges of remodelled networks",
        "increase",
        f"{spread(before)} before the first cut, {spread(after)} after {few} cuts",
        len(after) > 0 and after.mean() > before.mean(),
        "the alignment decreases",
    )


def _bounds(ds):
    counts = status_counts(ds.strain_status)
    tried = sum(n for name, n in counts.items() if name != "missing")
    known = counts.get("ok", 0) + counts.get("floppy", 0)
    return Claim.tested(
        "DesignFractureBounds",
        "every onset after a cut is certified by bounds within 1e-9, or the network has come apart",
        "all",
        f"{known} of {tried}: {counts}",
        known == tried,
        "some bounds are estimates or further apart",
    )


def summary(ds, parameters):
    """Onsets and moduli after some cuts, and the number of cuts until networks come apart."""
    cuts = [cut for cut in (0, 1, 5, 10, 20) if cut <= parameters["cuts"]]
    return {
        path: {
            law: {
                "cuts until apart, median": float(np.median(_life(ds, path, law))),
                **{name: {str(cut): spread(_at(ds, name, path, law, cut)) for cut in cuts} for name in PANELS},
            }
            for law in LAWS
        }
        for path in PATHS
    }
