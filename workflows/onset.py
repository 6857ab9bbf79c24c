"""The onset of rigidity: critical strains by network and deformation, and rigidity surfaces.

Floppy networks become rigid at a strain γ_c.  For six families of networks γ_c is computed against the coordination
z = 2 N_b/N_v under four deformations, with the networks as built: rest lengths are the initial lengths.

In Voronoi networks the rest lengths of the populations of the paper, lengthened by 5 %, give rigidity surfaces in the
plane of pure shear and dilation.  The stiffness past an onset is in the study `reference_numbers`.
"""

import numpy as np
from matplotlib.figure import Figure

import critflow as cf
from critflow.extras.cables.rigidity_surface import strain_plane
from critflow.figures.plot import COLOURS
from critflow.networks.deformation import DEFORMATIONS
from critflow.result import StudyError
from critflow.workflow import Axis, Claim, Coordinate, Study, Variable
from critflow.workflow.study import plural

from .shared.checks import check_network, check_positive
from .shared.figures import lettered
from .shared.populations import LABELS, PAPER_POPULATIONS, configuration
from .shared.reports import finite, parameters, series, status_counts

FAMILIES = ("triangular", "kagome", "phantom", "mikado", "delaunay", "voronoi")
PURE_SHEAR, DILATION = np.diag([1.0, -1.0]), np.eye(2)


def network_of(family, n_vertices, z, seed):
    """A network of a family with coordination z; raises `InputError` for a z that the family does not have."""
    side = round(np.sqrt(n_vertices))
    if family == "triangular":
        return cf.diluted(cf.lattice("triangular", side, side), z, seed)
    if family == "kagome":
        side = round(np.sqrt(n_vertices / 3))
        return cf.diluted(cf.lattice("kagome", side, side), z, seed)
    if family == "phantom":
        return cf.fibre_network("phantom", side, side, z=z, seed=seed)
    if family == "mikado":
        return cf.fibre_network("mikado", n_vertices, z=z, seed=seed)
    whole = (cf.delaunay_network if family == "delaunay" else cf.voronoi_network)(n_vertices, seed)
    return whole if family == "voronoi" and z == 3 else cf.diluted(whole, z, seed)


def case(parameters, *, family, seed):
    """γ_c of one family at every z and deformation; of Voronoi networks also surfaces."""
    found = against_coordination(parameters, family, seed)
    return (
        {"status": cf.Status.ok} | found | surfaces(parameters, PAPER_POPULATIONS if family == "voronoi" else (), seed)
    )


def against_coordination(parameters, family, seed):
    """γ_c, its bounds' distance, the fraction of taut edges and the outcome, (z, deformation) each."""
    shape = len(parameters["z"]), len(parameters["deformations"])
    strain, gap, taut = (np.full(shape, np.nan) for _ in range(3))
    status = np.full(shape, int(cf.Status.missing))
    for row, z in enumerate(parameters["z"]):
        try:
            network = network_of(family, parameters["n_vertices"], z, seed)
        except cf.InputError:
            continue
        lengths = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
        for column, deformation in enumerate(parameters["deformations"]):
            onset = cf.critical_strain(network, lengths, deformation, throw=False)
            status[row, column] = onset.status
            if all(onset.value.proven):
                strain[row, column], gap[row, column] = onset.value.strain, onset.value.upper - onset.value.lower
                taut[row, column] = onset.value.taut.mean()
    return {
        "critical_strain": strain,
        "critical_strain_error_bound": gap,
        "taut_fraction": taut,
        "strain_status": status,
    }


def surfaces(parameters, populations, seed):
    """Points and normals of the rigidity surfaces of populations, in the plane of pure shear and dilation; else NaN."""
    manifold = cf.CriticalManifold(cf.voronoi_network(parameters["surface_vertices"], seed))
    directions = strain_plane(PURE_SHEAR, DILATION, parameters["n_directions"])
    strain, gap, taut = np.full((3, len(PAPER_POPULATIONS), len(directions)), np.nan)
    point, normal = np.full((2, *strain.shape, 2), np.nan)
    for n, population in enumerate(populations):
        critical = configuration(manifold, parameters, seed, population).value
        if not np.isfinite(critical.lengths).all():
            continue
        lengths = (1 + parameters["excess"]) * critical.lengths
        surface = cf.rigidity_surface(manifold.network, lengths, directions)
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


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    if unknown := sorted(set(parameters["deformations"]) - set(DEFORMATIONS)):
        raise StudyError(f"there is no deformation {unknown[0]!r}: choose among {', '.join(DEFORMATIONS)}")
    check_positive(parameters, "excess", "n_directions", "spread")
    for name in ("n_vertices", "surface_vertices"):
        check_network(cf.voronoi_network, parameters[name], axes["seed"][0])


def table():
    """Names, dimensions, types and meanings of the stored variables."""
    case, path, surface = ("family", "seed"), ("z", "deformation"), ("population", "direction")

    def variable(name, dims, long_name, dtype="f8", **more):
        return Variable(name, (*case, *dims), dtype, long_name=long_name, **more)

    yield variable("critical_strain", path, "strain at which the network becomes rigid")
    yield variable("critical_strain_error_bound", path, "distance of the bounds on it")
    yield variable("taut_fraction", path, "part of the edges that are taut there")
    yield variable("strain_status", path, "outcome by z and deformation", "i1", flags=cf.Status)
    yield variable("surface_strain", surface, "distance of the rigidity surface along each direction")
    yield variable("surface_strain_error_bound", surface, "distance of the bounds on it")
    yield variable("surface_point", (*surface, "component"), "its pure shear and dilation")
    yield variable("surface_normal", (*surface, "component"), "its normal, the macroscopic stress, likewise")
    yield variable("surface_taut", surface, "part of the edges that are taut there")
    yield variable("status", (), "whether the case was computed", "i1", flags=cf.Status)


TITLES = {
    "simple_shear": "simple shear",
    "pure_shear": "pure shear",
    "uniaxial": "uniaxial, sides fixed",
    "dilation": "dilation (volumetric)",
}


def onsets_by_coordination(ds, family, deformation):
    """γ_c (z, seed), zero where a network is rigid as built, and the z at which every seed has a network.

    At low coordinations most seeds have no part that spans the cell, and the few that have one are atypical.
    """
    one = ds.sel(family=family, deformation=deformation).transpose("z", "seed", ...)
    status = one.strain_status.values
    strain = np.where(status == cf.Status.rigid, 0.0, one.critical_strain.values)
    return strain, np.isfinite(strain).all(axis=1)


def coordination_figure(ds):
    """γ_c and the fraction of taut edges against z, by family, for the first deformation."""
    name = str(ds.deformation.values[0])
    figure = Figure(figsize=(9.5, 4.2), dpi=130, layout="constrained")
    onsets, taut = figure.subplots(1, 2)
    for n, family in enumerate(map(str, ds.family.values)):
        strain, complete = onsets_by_coordination(ds, family, name)
        share = ds.taut_fraction.sel(deformation=name, family=family).transpose("z", "seed").values
        z = ds.z.values + 0.012 * (n - (ds.sizes["family"] - 1) / 2)  # so that bars stand side by side
        _draw_family(onsets, z, strain, complete, series(n), family)
        _draw_family(taut, z, np.where(strain > 0, share, np.nan), complete, series(n), family)
    onsets.set(ylabel=f"critical strain $\\gamma_c$, {TITLES.get(name, name)}", ylim=(0, None))
    taut.set(ylabel="part of the edges that are taut there", ylim=(0, 1.05))
    for axes in (onsets, taut):
        axes.set_xlabel("coordination $z$")
    onsets.legend(fontsize=8.5, frameon=False)
    lettered(onsets, taut)
    figure.suptitle(
        f"Networks with fewer edges become rigid later: $N_v$ = {parameters(ds)['n_vertices']}, mean and standard "
        f"deviation of {ds.sizes['seed']} networks\nopen: some seeds have no onset at this coordination",
        fontsize=10.5,
    )
    return figure


def _draw_family(axes, z, values, complete, style, label):
    """Means over seeds with their deviations up to the first z where every network is rigid.

    Points where some seeds miss are open and not joined: they are of other networks.
    """
    mean = np.array([np.mean(known) if len(known := finite(row)) else np.nan for row in values])
    width = np.array([np.std(known) if len(known := finite(row)) else np.nan for row in values])
    rigid = np.flatnonzero(complete & (mean == 0))
    shown = np.isfinite(mean) & (np.arange(len(z)) <= (rigid[0] if len(rigid) else len(z)))
    for each, more in ((shown & complete, {"label": label}), (shown & ~complete, {"ls": "none", "mfc": "white"})):
        if each.any():
            axes.errorbar(z[each], mean[each], width[each], **style, **more, ms=4.5, capsize=2, elinewidth=0.8)


def surface_figure(ds):
    """The rigidity surface of each population in the plane of pure shear and dilation, with stresses as normals."""
    one = ds.sel(family="voronoi").isel(seed=0)
    figure = Figure(figsize=(12, 4.4), dpi=110, layout="constrained")
    whole, taut = figure.subplots(1, 2, width_ratios=(1.7, 1))
    angle = 360 * np.arange(ds.sizes["direction"]) / ds.sizes["direction"]
    # From compression along one axis to compression along the other, through dilation.
    order = np.argsort((angle + 90) % 360)
    angle = ((angle + 90) % 360 - 90)[order]
    for n, population in enumerate(PAPER_POPULATIONS):
        points, normals = one.surface_point.values[n][order], one.surface_normal.values[n][order]
        style = {"color": COLOURS[n % len(COLOURS)], "label": LABELS[population]}
        whole.plot(100 * points[:, 0], 100 * points[:, 1], "-", linewidth=1.5, **style)
        # Curves that agree stay visible below each other.
        width = 0.6 * (len(PAPER_POPULATIONS) - n)
        taut.plot(angle, 100 * one.surface_taut.values[n][order], linewidth=width, **style)
        if n == 0:
            unit = normals / np.linalg.norm(normals, axis=1)[:, None]
            whole.quiver(
                *100 * points.T, *unit.T, angles="xy", color=style["color"], width=0.002, scale=30, headwidth=4
            )
    whole.plot(0, 0, "k+", markersize=9)
    whole.annotate("floppy, unstrained", (0, 0), (0, -15), textcoords="offset points", fontsize=9, ha="center")
    whole.set(xlabel="pure shear $(F_{xx} - F_{yy})/2$  [%]", ylabel="dilation $(F_{xx} + F_{yy})/2 - 1$  [%]")
    whole.set_aspect("equal")
    whole.margins(0.06, 0.1)
    whole.legend(fontsize=8.5, frameon=False, loc="lower center", ncols=2)
    taut.set(xlabel="direction: 0° pure shear, 90° dilation  [°]", ylabel="taut edges at the onset  [%]")
    taut.set_xticks([0, 45, 90, 135, 180])
    taut.set(xlim=(-45, 225), ylim=(0, 105))
    lettered(whole, taut)
    excess = parameters(ds)["excess"]
    figure.suptitle(
        f"Rigidity surfaces of one network, rest lengths {100 * excess:g} % above those of each population; "
        f"arrows: macroscopic stress of {LABELS[PAPER_POPULATIONS[0]]}",
        fontsize=11,
    )
    return figure


def claims(ds):
    """The statements on onsets."""
    return [_bounds(ds), *_order(ds)]


def _bounds(ds):
    counts, found = status_counts(ds.strain_status), int(np.isfinite(ds.critical_strain.values).sum())
    gap, stalled = (
        float((ds.critical_strain_error_bound / (1 + np.abs(ds.critical_strain))).max()),
        counts.get("stalled", 0),
    )
    return Claim.tested(
        "OnsetBounds", "bounds on the critical strain differ by less than 1e-9", "< 1e-9 (1 + γ_c)",
        f"largest difference {gap:.1g}; outcomes {counts}", gap < 1e-9 and not stalled,
        f"{stalled} searches stalled before their bounds met",
        criterion="1e-9 (1 + γ_c) in every search", sample=plural(found, "onset"), kind="check",
    )  # fmt: skip


def _order(ds):
    """γ_c never rises with z, network by network: but for mikado, sparse networks are parts of others."""
    deformation = str(ds.deformation.values[0])
    for family in map(str, ds.family.values):
        strain, _ = onsets_by_coordination(ds, family, deformation)
        known = [(ds.z.values[np.isfinite(row)], row[np.isfinite(row)]) for row in strain.T]
        rises = [f"{z[n]:g} to {z[n + 1]:g}" for z, row in known for n in np.flatnonzero(np.diff(row) > 1e-9)]
        steps = sum(max(len(row) - 1, 0) for _, row in known)
        if steps:
            ends = [f"{row[at]:.3g} at z = {z[at]:g}" for z, row in known[:1] for at in (0, -1)]
            yield Claim.tested(
                f"OnsetCoordination-{family}", f"the critical strain of {family} networks falls with z", "decreasing",
                f"rises in {len(rises)} of {steps} steps; first network: γ_c = {', '.join(ends)}", not rises,
                f"between z = {', '.join(rises)}, where networks of other z are not parts of each other",
                criterion=f"no rise between two z of a network, in {TITLES.get(deformation, deformation)}",
                kind="ours" if family == "mikado" else "check",
            )  # fmt: skip


study = Study(
    name="onset",
    title="The onset of rigidity under any deformation",
    references="Merkel, Baumgarten, Tighe and Manning, PNAS 116, 6560 (2019); Gandikota et al. (2022)",
    axes=(
        Axis("seed", range(4), "seed of the network", noun="network"),
        Axis("family", FAMILIES, "family of networks", key="families"),
    ),
    parameters={
        "n_vertices": 400,
        "z": (2.6, 2.8, 3.0, 3.2, 3.4, 3.6, 3.8),
        "deformations": ("simple_shear", "pure_shear", "uniaxial", "dilation"),
        "surface_vertices": 200,
        "n_directions": 48,
        "excess": 0.05,
        "threshold": 0.1,
        "spread": 0.1,
    },
    coordinates=(
        Coordinate("z", "z", "mean coordination"),
        Coordinate("deformation", "deformations", "deformation"),
    ),
    case=case,
    check=check,
    variables=tuple(table()),
    figures={"coordination": coordination_figure, "surfaces": surface_figure},
    claims=claims,
)
