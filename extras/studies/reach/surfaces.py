"""Rigidity surfaces of the populations: the strains at which a floppy network becomes rigid.

In Voronoi networks the rest lengths of the populations of the paper, lengthened by 5 %, leave the network floppy until
it is strained to a surface in the plane of pure shear and dilation.  Its normal is the macroscopic stress.
"""

import numpy as np
from critflow.studies.shared.figures import counted, legend_below, lettered, panels
from critflow.studies.shared.populations import LABELS, NAMES, PAPER_POPULATIONS, configuration
from critflow.studies.shared.reports import finite, parameters
from critflow.studies.shared.tables import bounded, numbers

import critflow as cf
import critflow_extras as ce
from critflow.engine import Claim
from critflow.engine.study import plural
from critflow.pictures import COLOURS
from critflow_extras.cables.rigidity_surface import strain_plane

PURE_SHEAR, DILATION = np.diag([1.0, -1.0]), np.eye(2)
DASHES = ("-", (0, (5, 1.5)), (0, (1, 1)), "-", (0, (3, 1, 1, 1)), "-")


def surfaces(parameters, seed):
    """Points and normals of the rigidity surfaces of populations, in the plane of pure shear and dilation."""
    manifold = cf.CriticalManifold(cf.voronoi_network(parameters["surface_vertices"], seed))
    directions = strain_plane(PURE_SHEAR, DILATION, parameters["surface_directions"])
    strain, gap, taut = np.full((3, len(PAPER_POPULATIONS), len(directions)), np.nan)
    point, normal = np.full((2, *strain.shape, 2), np.nan)
    for n, population in enumerate(PAPER_POPULATIONS):
        critical = configuration(manifold, parameters, seed, population).value
        if not np.isfinite(critical.lengths).all():
            continue
        lengths = (1 + parameters["excess"]) * critical.lengths
        surface = ce.rigidity_surface(manifold.network, lengths, directions)
        strain[n], gap[n], point[n] = surface.strains, surface.error_bounds, _plane(surface.points)
        normal[n], taut[n] = _plane(surface.normals), np.where(surface.found, surface.taut / len(lengths), np.nan)
    return {
        "surface_strain": strain,
        "surface_strain_error_bound": gap,
        "surface_taut": taut,
        "surface_point": point,
        "surface_normal": normal,
    }


def _plane(tensors):
    """Components of tensors (n, d, d) along pure shear and dilation, (n, 2)."""
    return np.stack([np.einsum("nij,ij->n", tensors, A) / np.sum(A * A) for A in (PURE_SHEAR, DILATION)], axis=1)


SURFACE = ("seed", "population", "surface_direction")
VARIABLES = (
    *bounded(SURFACE, surface_strain="distance of the rigidity surface along each direction"),
    *numbers((*SURFACE, "component"), surface_point="its pure shear and dilation"),
    *numbers((*SURFACE, "component"), surface_normal="its normal, the macroscopic stress, likewise"),
    *numbers(SURFACE, surface_taut="part of the edges that are taut there"),
)


def figure(ds):
    """The rigidity surface of each population in the plane of pure shear and dilation, and its taut edges."""
    one, excess = ds.isel(seed=0), 100 * parameters(ds)["excess"]
    figure, (whole, taut) = panels(
        2,
        "Every population becomes rigid at one dilation, in pure shear at about four times that\n"
        f"({counted(ds)} of {parameters(ds)['surface_vertices']} vertices; A: the first, B: their mean; random ℓ: "
        f"s = {parameters(ds)['spread']:g})",
        height=3.3,
        width_ratios=(1.6, 1),
    )
    angle = 360 * np.arange(ds.sizes["surface_direction"]) / ds.sizes["surface_direction"]
    # From compression along one axis to compression along the other, through dilation.
    order = np.argsort((angle + 90) % 360)
    angle = ((angle + 90) % 360 - 90)[order]
    for n, population in enumerate(PAPER_POPULATIONS):
        points = 100 * one.surface_point.values[n][order]
        style = {"color": COLOURS[n % len(COLOURS)], "label": LABELS[population], "linestyle": DASHES[n], "lw": 1.5}
        whole.plot(*points.T, **style)
        taut.plot(angle, 100 * ds.surface_taut[:, n].mean("seed").values[order], **style)
        if n == 0:
            normals = one.surface_normal.values[n][order]
            unit = normals / np.linalg.norm(normals, axis=1)[:, None]
            arrows = {"angles": "xy", "color": style["color"], "width": 0.003, "scale": 22, "headwidth": 4}
            whole.quiver(*points[::2].T, *unit[::2].T, **arrows)
    whole.plot(0, 0, "k+", markersize=8)
    whole.annotate("floppy", (0, 0), (0, -13), textcoords="offset points", fontsize=9, ha="center")
    whole.set(xlabel="pure shear $(F_{xx} - F_{yy})/2$  [%]", ylabel="dilation $(F_{xx} + F_{yy})/2 - 1$  [%]")
    whole.set_aspect("equal")
    whole.margins(0.06, 0.12)
    whole.set_title(f"rest lengths {excess:g} % too long; arrows: stress")
    taut.set(xlabel="direction of strain", ylabel="taut edges at the onset  [%]", ylim=(0, 105))
    taut.set_xticks([0, 90, 180], ["shear\nalong x", "dilation", "shear\nalong y"])
    taut.set_title("few edges carry it past shear")
    legend_below(figure, whole, ncols=6)
    lettered(whole, taut)
    return figure


def claims(ds):
    """The pure shear that makes each population rigid."""
    shear = ds.surface_strain.isel(surface_direction=0).transpose("population", "seed").values
    text = ", ".join(
        f"{NAMES[population]} {100 * np.mean(known):.0f} %"
        for population, values in zip(PAPER_POPULATIONS, shear, strict=True)
        if len(known := finite(values))
    )
    return [
        Claim(
            "reach-surfaces", "pure shear at which floppy populations become rigid, means", "", text, "measured",
            sample=plural(ds.sizes["seed"], "network"),
        )
    ]  # fmt: skip
