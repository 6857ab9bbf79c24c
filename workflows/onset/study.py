"""The onset of rigidity: critical strains by network and deformation, rigidity surfaces, and stiffness past an onset.

Floppy networks become rigid at a strain γ_c.  For six families of networks γ_c is computed against the coordination
z = 2 N_b/N_v under four deformations, with the networks as built: rest lengths are the initial lengths.

In Voronoi networks the rest lengths of the populations of the paper, lengthened by 5 %, give rigidity surfaces in the
plane of pure shear and dilation.  Equal rest lengths that become rigid at chosen shears γ_c, forwards and backwards,
give the shear modulus past the onset: (G − G_c) γ_c/σ_xy tends to 3 as γ_c → 0 (Merkel, Baumgarten, Tighe and Manning
2019).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from critflow import (
    CriticalManifold,
    InputError,
    Status,
    critical_from_lengths,
    critical_strain,
    delaunay_network,
    diluted,
    fibre_network,
    lattice,
    rigidity_surface,
    strain_path,
    voronoi_network,
)
from critflow.networks.deformation import DEFORMATIONS, deformation_of
from critflow.onset.rigidity_surface import strain_plane
from critflow.result import StudyError
from critflow.workflow import Axis, Coordinate, Study, Variable

from ..shared.checks import check_network, check_positive
from ..shared.populations import PAPER_POPULATIONS, configuration
from .report import claims, coordination_figure, stiffening_figure, summary, surface_figure

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
    """γ_c of one family at every z and deformation; of Voronoi networks also surfaces and stiffness."""
    found = against_coordination(parameters, family, seed)
    surface, past = empty_surfaces(parameters), empty_past(parameters)
    if family == "voronoi":
        fill_surfaces(surface, parameters, seed)
        fill_past(past, parameters, seed)
    return {"status": Status.ok} | found | surface | past


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
    return {"critical_strain": strain, "strain_gap": gap, "taut_fraction": taut, "strain_status": status}


def empty_surfaces(parameters):
    """Undefined surfaces."""
    shape = len(PAPER_POPULATIONS), parameters["n_directions"]
    sizes = {"surface_strain": (), "surface_taut": (), "surface_point": (2,), "surface_normal": (2,)}
    return {name: np.full((*shape, *size), np.nan) for name, size in sizes.items()}


def fill_surfaces(found, parameters, seed):
    """Points and normals of the rigidity surface of each population, in the plane of pure shear and dilation."""
    manifold = CriticalManifold(voronoi_network(parameters["surface_vertices"], seed))
    directions = strain_plane(PURE_SHEAR, DILATION, parameters["n_directions"])
    for n, population in enumerate(PAPER_POPULATIONS):
        critical = configuration(manifold, parameters, seed, population).value
        if not np.isfinite(critical.lengths).all():
            continue
        lengths = (1 + parameters["excess"]) * critical.lengths
        surface = rigidity_surface(manifold.network, lengths, directions)
        found["surface_strain"][n] = surface.strains
        found["surface_taut"][n] = np.where(surface.found, surface.taut / len(lengths), np.nan)
        found["surface_point"][n] = _plane(surface.points)
        found["surface_normal"][n] = _plane(surface.normals)


def _plane(tensors):
    """Components of tensors (n, d, d) along pure shear and dilation, (n, 2)."""
    return np.stack([np.einsum("nij,ij->n", tensors, A) / np.sum(A * A) for A in (PURE_SHEAR, DILATION)], axis=1)


@lru_cache(maxsize=1)
def _network(n_vertices, seed):
    return voronoi_network(n_vertices, seed)


def empty_past(parameters):
    """Undefined moduli and stresses past the onset."""
    shape, steps = (len(parameters["onsets"]), 2), len(parameters["past"])
    sizes = {"onset_error": (), "onset_taut": (), "past_modulus": (steps,), "past_stress": (steps,)}
    return {name: np.full((*shape, *size), np.nan) for name, size in sizes.items()}


def fill_past(found, parameters, seed):
    """Shear modulus and shear stress past onsets at given shears, on their taut edges: (onset, direction, strain)."""
    network = _network(parameters["stiffening_vertices"], seed)
    steps, shear = np.array(parameters["past"]), deformation_of("simple_shear", 2)
    for place in np.ndindex(found["onset_error"].shape):
        sign = (1, -1)[place[1]]
        strain = sign * parameters["onsets"][place[0]]
        # Equal lengths that are critical at this shear; their onset from rest must be there again.
        ratio = critical_from_lengths(network.deformed(shear.gradient(strain)), np.ones(network.n_edges), throw=False)
        lengths = np.full(network.n_edges, ratio.ratio)
        onset = critical_strain(network, lengths, shear, direction=sign, throw=False)
        if not onset.ok:
            continue
        found["onset_error"][place], found["onset_taut"][place] = abs(onset.strain - strain), onset.taut.mean()
        path = strain_path(onset, strain * steps, deformation=shear, taut_only=True, throw=False).value
        found["past_modulus"][place], found["past_stress"][place] = path.modulus, sign * path.stress[:, 0, 1]


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    if unknown := sorted(set(parameters["deformations"]) - set(DEFORMATIONS)):
        raise StudyError(f"there is no deformation {unknown[0]!r}: choose among {', '.join(DEFORMATIONS)}")
    if len(parameters["past"]) < 3 or sorted(set(parameters["past"])) != list(parameters["past"]):
        raise StudyError("past must be at least three increasing strains, in units of the onset")
    check_positive(parameters, "excess", "n_directions", "spread")
    for name in ("n_vertices", "surface_vertices", "stiffening_vertices"):
        check_network(voronoi_network, parameters[name], axes["seed"][0])


def table():
    """Names, dimensions, types and meanings of the stored variables."""
    case, onset = ("family", "seed"), ("onset", "sign")
    path, surface, past = ("z", "deformation"), ("population", "direction"), (*onset, "strain")

    def variable(name, dims, long_name, dtype="f8", **more):
        return Variable(name, (*case, *dims), dtype, long_name=long_name, **more)

    yield variable("critical_strain", path, "strain at which the network becomes rigid")
    yield variable("strain_gap", path, "distance of the bounds on it")
    yield variable("taut_fraction", path, "part of the edges that are taut there")
    yield variable("strain_status", path, "outcome by z and deformation", "i1", flags=Status)
    yield variable("surface_strain", surface, "distance of the rigidity surface along each direction")
    yield variable("surface_point", (*surface, "component"), "its pure shear and dilation")
    yield variable("surface_normal", (*surface, "component"), "its normal, the macroscopic stress, likewise")
    yield variable("surface_taut", surface, "part of the edges that are taut there")
    yield variable("onset_error", onset, "distance of the onset from the shear at which its lengths are critical")
    yield variable("onset_taut", onset, "part of the edges that are taut there")
    yield variable("past_modulus", past, "shear modulus past the onset [k]")
    yield variable("past_stress", past, "shear stress past the onset [k]")
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
        "stiffening_vertices": 400,
        "onsets": (0.02, 0.05, 0.1, 0.2),
        "past": (0.0005, 0.001, 0.002, 0.004),
        "threshold": 0.1,
        "spread": 0.1,
    },
    coordinates=(
        Coordinate("z", "z", "mean coordination"),
        Coordinate("deformation", "deformations", "deformation"),
        Coordinate("onset", "onsets", "shear at the onset"),
        Coordinate("strain", "past", "shear past the onset, in units of the onset"),
    ),
    case=case,
    check=check,
    variables=tuple(table()),
    figures={"coordination": coordination_figure, "surfaces": surface_figure, "stiffening": stiffening_figure},
    claims=claims,
    summary=summary,
)
