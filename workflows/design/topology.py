"""Fracture and remodelling: edges are cut one at a time, and the network is strained to its new onset after each cut.

A network at the transition has one self-stress, so that a cut leaves it floppy at its rest lengths.  It becomes rigid
again at a strain γ_c on a path of deformations.  Each next edge is chosen by the tensions at that onset: the largest
(fracture), the smallest that is not zero (remodelling by enzymes that sever slack fibres), or any at random.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from critflow import (
    NetworkError,
    Status,
    StudyError,
    backbone,
    critical_strain,
    optimize,
    prune,
    voronoi_network,
)
from critflow.workflow import Claim

from ..shared.checks import check_network, check_positive
from ..shared.measurements import known_moduli
from ..shared.reports import finite, series, spread

LAWS = {"largest": "largest tension", "smallest": "smallest tension", "random": "at random"}
PATHS = {"dilation": "dilation", "simple_shear": "simple shear"}

PARAMETERS = {"n_vertices": 100, "cuts": 30}
VARIABLES = {
    "critical_strain": (("path", "law", "cut"), "strain of the onset after each number of cuts"),
    "strain_status": (("path", "law", "cut"), "its outcome"),
    "bulk_modulus": (("path", "law", "cut"), "bulk modulus B_0 at the onset [k]"),
    "shear_modulus": (("path", "law", "cut"), "shear modulus G_0 at the onset [k]"),
    "alignment": (("path", "law", "cut"), "nematic order of the taut edges, weighted by length"),
    "taut_fraction": (("path", "law", "cut"), "part of the initial edges that is under tension"),
}


def sizes(parameters):
    """Sizes of the inner dimensions."""
    return {"path": len(PATHS), "law": len(LAWS), "cut": parameters["cuts"] + 1}


def check(parameters):
    """Refuse settings that could only fail."""
    check_positive(parameters, "cuts")
    check_network(voronoi_network, parameters["n_vertices"], 0)
    if parameters["cuts"] >= parameters["n_vertices"]:
        raise StudyError(f"cuts={parameters['cuts']} must be smaller than the number of vertices")


def case(parameters, seed):
    """All paths and laws from the configuration of equal lengths."""
    start = optimize(voronoi_network(parameters["n_vertices"], seed), "length_variance").value
    shape = tuple(sizes(parameters).values())
    found = {name: np.full(shape, np.nan) for name in VARIABLES}
    found["strain_status"] = np.full(shape, int(Status.missing))
    for p, path in enumerate(PATHS):
        for n, law in enumerate(LAWS):
            rng = np.random.default_rng([seed, p, n])
            for cut, (status, values) in enumerate(sequence(start, path, law, parameters["cuts"], rng)):
                found["strain_status"][p, n, cut] = status
                for name, value in values.items():
                    found[name][p, n, cut] = value
    return found


def sequence(critical, path, law, cuts, rng):
    """Status and measures of the critical configuration, and after each cut until the network opens."""
    network, lengths = critical.network, critical.lengths
    total = network.n_edges
    yield Status.ok, measures(critical, 0.0, total)
    for _ in range(cuts):
        edge = chosen(critical.tensions, law, rng)
        kept = np.ones(network.n_edges, bool)
        kept[edge] = False
        try:
            network, edges, _ = prune(network, kept)
        except NetworkError:
            yield Status.floppy, {}
            return
        lengths = lengths[edges]
        onset = critical_strain(network, lengths, path, throw=False)
        # Bounds that differ by more than 1e-9 still give a configuration.
        if not np.isfinite(onset.strain):
            yield onset.status, {}
            return
        critical = onset.configuration
        yield onset.status, measures(critical, onset.strain, total)


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
    "bulk_modulus": "$B_0$ at the onset  [k]",
    "shear_modulus": "$G_0$ at the onset  [k]",
    "alignment": "alignment of the taut edges",
    "taut_fraction": "part of the edges under tension",
}


def figure(ds, parameters):
    """Measures against the number of cuts: a column a measure, a row a path."""
    drawn = Figure(figsize=(3.1 * len(PANELS), 5.6), dpi=110, layout="constrained")
    panels = drawn.subplots(len(PATHS), len(PANELS), sharex=True, squeeze=False)
    for row, title in enumerate(PATHS.values()):
        for axes, (name, label) in zip(panels[row], PANELS.items(), strict=True):
            for n, law in enumerate(LAWS.values()):
                values = ds[name].isel(path=row, law=n).transpose("seed", "cut").values
                known = np.isfinite(values).any(axis=0)
                cuts, at = np.arange(len(known))[known], values[:, known]
                style = series(n)
                axes.plot(cuts, np.nanmean(at, axis=0), color=style["color"], label=law)
                low, high = np.nanpercentile(at, [16, 84], axis=0)
                axes.fill_between(cuts, low, high, color=style["color"], alpha=0.2, linewidth=0)
            axes.set(ylabel=label, ylim=(0, None))
            axes.spines[["top", "right"]].set_visible(False)
        panels[row, 0].set_title(title, loc="left", fontweight="bold")
    for axes in panels[-1]:
        axes.set_xlabel("edges cut")
    panels[0, 0].legend(fontsize=8.5, frameon=False, title="cut by", title_fontsize=8.5)
    drawn.suptitle(
        f"Fracture and remodelling, $N_v$ = {parameters['n_vertices']}: strained to the onset after each cut; "
        f"mean and 68 % of {ds.sizes['seed']} networks",
        fontsize=11,
    )
    return drawn


def claims(ds, parameters):
    """What fracture and remodelling do to a network."""
    middle = {
        law: finite(ds.critical_strain.isel(path=0, law=n, cut=parameters["cuts"] // 2).values)
        for n, law in enumerate(LAWS)
    }
    value = ", ".join(f"{LAWS[law]} {spread(at)}" for law, at in middle.items())
    ordered = all(len(at) for at in middle.values()) and middle["largest"].mean() > middle["smallest"].mean()
    return [
        Claim.tested(
            "DesignFracture",
            "cutting the largest tension delays rigidity more than cutting the smallest",
            "order",
            f"γ_c in dilation after {parameters['cuts'] // 2} cuts: {value}",
            ordered,
            "the order is another",
        )
    ]
