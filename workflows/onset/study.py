"""The onset of rigidity: critical strains by network and deformation, and rigidity surfaces.

Floppy networks become rigid at a strain γ_c.  For six families of networks γ_c is computed against the coordination
z = 2 N_b/N_v under four deformations, with the networks as built: rest lengths are the initial lengths.

In Voronoi networks the rest lengths of the populations of the paper, lengthened by 5 %, give rigidity surfaces in the
plane of pure shear and dilation.  The stiffness past an onset is in the study `reference_numbers`.
"""

import numpy as np

from critflow import (
    CriticalManifold,
    InputError,
    Status,
    critical_strain,
    delaunay_network,
    diluted,
    fibre_network,
    lattice,
    rigidity_surface,
    voronoi_network,
)
from critflow.networks.deformation import DEFORMATIONS
from critflow.onset.rigidity_surface import strain_plane
from critflow.result import StudyError
from critflow.workflow import Axis, Coordinate, Study, Variable

from ..shared.checks import check_network, check_positive
from ..shared.populations import PAPER_POPULATIONS, configuration
from .report import claims, coordination_figure, surface_figure

FAMILIES = ("triangular", "kagome", "phantom", "mikado", "delaunay", "voronoi")
PURE_SHEAR, DILATION = np.diag([1.0, -1.0]), np.eye(2)


def network_of(family, n_vertices, z, seed):
    """A network of a family with coordination z; raises `InputError` for a z that the family does not have."""
    side = round(np.sqrt(n_vertices))
    if family == "triangular":
        return diluted(lattice("triangular", side, side), z, seed)
    if family == "kagome":
        side = round(np.sqrt(n_vertices / 3))
        return diluted(lattice("kagome", side, side), z, seed)
    if family == "phantom":
        return fibre_network("phantom", side, side, z=z, seed=seed)
    if family == "mikado":
        return fibre_network("mikado", n_vertices, z=z, seed=seed)
    whole = (delaunay_network if family == "delaunay" else voronoi_network)(n_vertices, seed)
    return whole if family == "voronoi" and z == 3 else diluted(whole, z, seed)


def case(parameters, *, family, seed):
    """γ_c of one family at every z and deformation; of Voronoi networks also surfaces."""
    found = against_coordination(parameters, family, seed)
    return {"status": Status.ok} | found | surfaces(parameters, PAPER_POPULATIONS if family == "voronoi" else (), seed)


def against_coordination(parameters, family, seed):
    """γ_c, its bounds' distance, the fraction of taut edges and the outcome, (z, deformation) each."""
    shape = len(parameters["z"]), len(parameters["deformations"])
    strain, gap, taut = (np.full(shape, np.nan) for _ in range(3))
    status = np.full(shape, int(Status.missing))
    for row, z in enumerate(parameters["z"]):
        try:
            network = network_of(family, parameters["n_vertices"], z, seed)
        except InputError:
            continue
        lengths = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
        for column, deformation in enumerate(parameters["deformations"]):
            onset = critical_strain(network, lengths, deformation, throw=False)
            status[row, column] = onset.status
            if all(onset.value.proven):
                strain[row, column], gap[row, column] = onset.strain, onset.upper - onset.lower
                taut[row, column] = onset.taut.mean()
    return {
        "critical_strain": strain,
        "critical_strain_error_bound": gap,
        "taut_fraction": taut,
        "strain_status": status,
    }


def surfaces(parameters, populations, seed):
    """Points and normals of the rigidity surfaces of populations, in the plane of pure shear and dilation; else NaN."""
    manifold = CriticalManifold(voronoi_network(parameters["surface_vertices"], seed))
    directions = strain_plane(PURE_SHEAR, DILATION, parameters["n_directions"])
    strain, gap, taut = np.full((3, len(PAPER_POPULATIONS), len(directions)), np.nan)
    point, normal = np.full((2, *strain.shape, 2), np.nan)
    for n, population in enumerate(populations):
        critical = configuration(manifold, parameters, seed, population).value
        if not np.isfinite(critical.lengths).all():
            continue
        lengths = (1 + parameters["excess"]) * critical.lengths
        surface = rigidity_surface(manifold.network, lengths, directions)
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
        check_network(voronoi_network, parameters[name], axes["seed"][0])


def table():
    """Names, dimensions, types and meanings of the stored variables."""
    case, path, surface = ("family", "seed"), ("z", "deformation"), ("population", "direction")

    def variable(name, dims, long_name, dtype="f8", **more):
        return Variable(name, (*case, *dims), dtype, long_name=long_name, **more)

    yield variable("critical_strain", path, "strain at which the network becomes rigid")
    yield variable("critical_strain_error_bound", path, "distance of the bounds on it")
    yield variable("taut_fraction", path, "part of the edges that are taut there")
    yield variable("strain_status", path, "outcome by z and deformation", "i1", flags=Status)
    yield variable("surface_strain", surface, "distance of the rigidity surface along each direction")
    yield variable("surface_strain_error_bound", surface, "distance of the bounds on it")
    yield variable("surface_point", (*surface, "component"), "its pure shear and dilation")
    yield variable("surface_normal", (*surface, "component"), "its normal, the macroscopic stress, likewise")
    yield variable("surface_taut", surface, "part of the edges that are taut there")
    yield variable("status", (), "whether the case was computed", "i1", flags=Status)


study = Study(
    name="onset",
    title="The onset of rigidity under any deformation",
    references="Merkel, Baumgarten, Tighe and Manning, PNAS 116, 6560 (2019); Gandikota et al. (2022)",
    axes=(
        Axis("seed", range(4), "seed of the network", noun="networks"),
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
