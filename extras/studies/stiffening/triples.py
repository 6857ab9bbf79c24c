"""Triples (B_0, C_B, C_G) of the populations of other networks as targets of a design.

Each triple is attained by a configuration of another random network of the same size.  That of the largest B_0 has
C_B = −B_0/2, which only the stiffest configuration of a network attains: a network with another largest B_0 cannot
(`quantity`), and `design` refuses it.  One design of each network is strained, and the growth of its moduli
fitted.
"""

import numpy as np
from critflow.studies.shared.figures import counted, legend_below, lettered, panels
from critflow.studies.shared.measurements import coefficients
from critflow.studies.shared.populations import LABELS, PAPER_POPULATIONS, configuration
from critflow.studies.shared.reports import parameters, series
from critflow.studies.shared.tables import bounded, numbers, outcomes, stacked

import critflow as cf
import critflow_extras as ce
from critflow.engine import Claim, stable_rng
from critflow.engine.study import plural

from ..shared.parts import MISSED, seconds, timed

STIFFEST = "max_B_0"
SOURCES = (*PAPER_POPULATIONS, "log-normal stress")
NAMES = ("B_0", "C_B", "C_G")
# Strains at which the growth is fitted by a parabola, and seeds of the networks that attain the targets.
STRAINS = np.linspace(0.0, 4e-4, 9)[1:]
OTHER = 100


def designs(parameters, seed):
    """Designs of one network for the triples of another one; the first is strained."""
    manifold = cf.CriticalManifold(cf.voronoi_network(parameters["n_vertices"], seed))
    other = cf.CriticalManifold(cf.voronoi_network(parameters["n_vertices"], seed + OTHER))
    triples = [attained(other, parameters, seed + OTHER, source) for source in parameters["sources"]]
    made, rows = zip(*(designed(manifold, targets) for targets in triples), strict=True)
    return {"fitted": fitted(made[0].value), **stacked(rows)}


def attained(manifold, parameters, seed, source):
    """The triple of one configuration of another network."""
    if source in PAPER_POPULATIONS:
        return triple(configuration(manifold, parameters, seed, source).value)[0]
    sigma = np.exp(parameters["stress_spread"] * stable_rng(seed, source).standard_normal(manifold.network.n_edges))
    return triple(manifold.configuration(sigma))[0]


def triple(critical):
    """B_0, C_B, C_G and the bounds on their errors."""
    return [numbers[[0, 2, 3]] for numbers in coefficients(critical)]


def designed(manifold, targets):
    """One design, with its error and its cost."""
    made, time = timed(ce.design, manifold, dict(zip(NAMES, targets, strict=True)), throw=False)
    achieved, errors = triple(made.value)
    return made, {
        "target": targets,
        "achieved": achieved,
        "achieved_error_bound": errors,
        "error": np.abs(achieved - targets).max() / np.abs(targets).max(),
        "distance": made.distance,
        "target_status": made.status,
        "target_seconds": time,
    }


def fitted(critical):
    """B_0, C_B, C_G of the moduli on a path of dilation."""
    path = cf.strain_path(critical, STRAINS, throw=False).value
    (_, C_B, B_0), (_, C_G, _) = (np.polyfit(STRAINS, moduli, 2) for moduli in (path.bulk_modulus, path.shear_modulus))
    return B_0, C_B, C_G


VARIABLES = (
    *numbers(("seed", "source", "name"), target="B_0, C_B, C_G of a configuration of another network"),
    *bounded(("seed", "source", "name"), achieved="values of the design, by stiffening()"),
    *numbers(
        ("seed", "source"),
        error="largest error relative to the largest of the three",
        distance="root mean square change of log σ from σ = 1",
    ),
    *outcomes(("seed", "source"), target_status="outcome of the design"),
    *seconds(("seed", "source"), target_seconds="processor time of the design [s]"),
    *numbers(("seed", "name"), fitted="B_0, C_B and C_G of a strain path of the first design"),
)


def figure(ds):
    """C_B and C_G against B_0 of the configurations of other networks, all designed but those of the largest B_0."""
    figure, (bulk, shear) = panels(
        2,
        "The stiffer a network, the less its bulk modulus grows: down to $C_B = -B_0/2$, never below\n"
        f"({counted(ds)} of {parameters(ds)['n_vertices']} vertices; filled: designed in another network as well)",
        height=3.9,
    )
    for n, source in enumerate(parameters(ds)["sources"]):
        targets, missed = ds.target.values[:, n], np.isin(ds.target_status.values[:, n], MISSED)
        style, label = series(n), LABELS.get(source, source)
        label += f", s = {parameters(ds)['spread']:g}" if source == "random_lengths" else ""
        label += ": the bound allows no design" if missed.all() else ""
        for axes, column in ((bulk, 1), (shear, 2)):
            for some, face in ((~missed, style["color"]), (missed, "none")):
                axes.scatter(
                    *targets[some][:, [0, column]].T, s=22, facecolors=face, edgecolors=style["color"],
                    marker=style["marker"], label=label if some.any() and some[0] else None,
                )  # fmt: skip
    B = np.nanquantile(ds.target.values[..., 0], (0, 1)) * (0.97, 1.02)
    bulk.fill_between(B, -B / 2, -0.75 * B.max(), color="0.88", linewidth=0, label="impossible: $C_B < -B_0/2$")
    bulk.set(xlabel="$B_0$  [k]", ylabel="$C_B$  [k]", xlim=B, ylim=(-0.75 * B.max(), None))
    bulk.set_title("growth of the bulk modulus")
    shear.axhline(0, color="0.6", linewidth=0.8, zorder=0)
    shear.set(xlabel="$B_0$  [k]", ylabel="$C_G$, energy convention  [k]", xlim=B)
    shear.set_title("growth of the shear modulus")
    legend_below(figure, bulk, ncols=3)
    lettered(bulk, shear)
    return figure


def claims(ds):
    """The least growth."""
    stiffest = np.array(parameters(ds)["sources"]) == STIFFEST
    B_0, C_B, _ = np.moveaxis(ds.target.values, 2, 0)
    above = C_B / B_0 + 0.5
    closest, others = np.abs(above[:, stiffest]).max(initial=0.0), above[:, ~stiffest].min(initial=np.inf)
    return [
        Claim.tested(
            "stiffening-least", "no configuration has C_B below −B_0/2, and only the stiffest of a network attains it",
            "", f"C_B/B_0 + 1/2: {closest:.0e} for max B_0, at least {others:.3f} for the others",
            closest < 1e-9 and others > 0, "the least growth is another one",
            criterion="equality to 1e-9 for max B_0, every other one above", sample=plural(C_B.size, "configuration"),
        )
    ]  # fmt: skip
