"""Thirteen critical configurations of each network, of which the first is drawn: the figure `Networks` of the paper.

A least V_L.  B, C least V_τ, C after an isogonal change.  D largest B_0 at σ = k.  E, F two isogonal changes of D.
G, H, I largest G_0 at three thresholds r.  J, K random rest lengths of the printed spread: as the protocol of the paper
records them in its box, and exactly at the transition, which leaves more edges slack.  L, M random stresses.

The least V_τ need not be attained: in about one network of six some edge shrinks to zero length
(`edge_collapse`).  The network drawn, seed 0, attains it; the statements are tested in all networks.

With `network=FILE` the network is that of a file; seeds are then those of the random panels.
"""

from functools import lru_cache, partial

import numpy as np

import critflow as cf
from critflow.engine import Axis, Study, stable_rng
from critflow.isogonal import affine_bulk_modulus, face_modes
from critflow.points import STANDARD_HARD_CORE
from critflow.quantities import flat_directions
from critflow.result import StudyError

from ..paper.verdicts import committed_run
from ..shared import populations
from ..shared.checks import check_positive
from ..shared.measurements import moduli_with_bounds, of_configuration
from ..shared.own_network import check_planar, with_digest
from ..shared.reports import PAPER
from ..shared.tables import NETWORK, PLANE, bounded, networks, numbers, of_network, outcomes
from .report import PANELS, claims, gallery, verify

# Distance between the faces that panels C and F inflate, in units of the root of the mean area of a vertex.
SPACING = 4.4
# Eigenvalues of the Hessian of B_0 below FLAT times the largest count as zero; computed up to MOST_EDGES edges.
FLAT, MOST_EDGES = 1e-9, 1500


@lru_cache(maxsize=2)
def prepared(n_vertices, seed, hard_core, own=""):
    """Manifold, bound of B_0 and faces to inflate of one network, which its panels share."""
    manifold = populations.prepared(cf.voronoi_network, n_vertices, seed, hard_core, own)
    network = manifold.network
    at = face_centres(manifold.configuration(network.stiffness)) @ np.linalg.inv(network.cell)
    chosen = np.zeros(len(at), bool)
    for face in stable_rng(seed, "chosen faces").permutation(len(at)):
        apart = (np.mod(at[chosen] - at[face] + 0.5, 1.0) - 0.5) @ network.cell
        chosen[face] = (np.linalg.norm(apart, axis=1) > SPACING).all()
    return manifold, cf.upper_bound(manifold, "B_0"), chosen


def face_centres(critical):
    """Mean of the corners of every face, (n_faces, 2)."""
    faces, ends = critical.network.faces, critical.network.edges
    sides = faces.signs[:, None] * critical.bond_vectors[faces.edges]
    corners, first = np.cumsum(sides, axis=0) - sides, faces.starts[:-1]
    start = np.where(faces.signs > 0, *ends[faces.edges].T)[first]
    return critical.coordinates[start] + np.add.reduceat(corners, first) / faces.sizes[:, None] - corners[first]


def configuration(manifold, chosen, parameters, seed, panel) -> tuple[cf.Solution, np.ndarray]:
    """The solution of a panel, and the isogonal amplitude of every face."""
    network, amplitudes = manifold.network, np.zeros(len(chosen))
    kind, _, variant = panel.rpartition("_")
    plain = panel in populations.POPULATIONS
    population = populations.POPULATIONS[panel if plain else kind]
    rng = stable_rng(seed, population.stream if plain else f"{population.stream}_{variant}")
    if callable(population.rule):
        return population.rule(manifold, parameters, rng), amplitudes
    if kind == "max_G_0":
        options = {"threshold": parameters["thresholds"][int(variant) - 1], "starts": parameters["starts"], "rng": rng}
        return cf.optimize(manifold, population.rule, **options, throw=False), amplitudes
    found = cf.optimize(manifold, population.rule, throw=False)
    if plain or not np.isfinite(found.value.coordinates).all():
        return found, amplitudes
    modes = face_modes(found.value)
    if variant == "designed":
        weights = np.bincount(network.faces.edges, np.repeat(chosen, network.faces.sizes), network.n_edges)
        best = modes.largest(weights, parameters["shortest"], throw=False)
        return best, best.amplitudes
    direction = chosen.astype(float)
    if variant == "wave":
        at = face_centres(found.value) @ np.linalg.inv(network.cell)
        direction = -np.cos(2 * np.pi * at).sum(axis=1)
    amplitudes = parameters["fraction"] * modes.limit(direction) * direction
    return cf.Solution(modes.walk(amplitudes), found.status, found.stats), amplitudes


def pressure(critical):
    """P = Σσ|L|²/2V, which is set to one to fix the scale that a self-stress leaves open."""
    return critical.sigma @ critical.lengths**2 / (2 * critical.network.volume)


def case(parameters, *, seed, panel):
    """One configuration, its tensions at unit pressure, and its moduli at the transition."""
    own = parameters.get("network", "")
    manifold, bound, chosen = prepared(parameters["n_vertices"], seed, parameters["hard_core"], own)
    network = manifold.network
    found, amplitudes = configuration(manifold, chosen, parameters, seed, panel)
    shared = {**of_network(network), "chosen": chosen.astype("i1"), "status": found.status, "B_0_bound": bound}
    if not np.isfinite(found.value.coordinates).all():
        return shared
    critical = found.value
    (bulk, shear), (bulk_error, shear_error) = moduli_with_bounds(critical)
    flat = (np.nan, np.nan, np.nan)
    if panel.startswith("max_B_0") and network.n_edges <= MOST_EDGES:
        zero = flat_directions(critical, tolerance=FLAT)
        flat = (zero.n_flat, *zero.gap)
    return {
        **shared,
        **of_configuration(critical),
        "tension": critical.tensions / pressure(critical),
        "amplitude": amplitudes,
        "B_0": bulk,
        "B_0_error_bound": bulk_error,
        "B_0_affine": affine_bulk_modulus(critical),
        "G_0": shear,
        "G_0_error_bound": shear_error,
        "flat_directions": float(flat[0]),
        "flat_largest": flat[1],
        "curved_smallest": flat[2],
        "iterations": found.stats.steps,
    }


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    if len(parameters["thresholds"]) != 3 or not min(parameters["thresholds"]) > 0:
        raise StudyError(f"thresholds={parameters['thresholds']} must be three positive numbers, for panels G, H and I")
    if not 0 < parameters["fraction"] < 1:
        raise StudyError(f"fraction={parameters['fraction']} must lie between 0 and 1, where the first edge vanishes")
    check_positive(parameters, "spread", "shortest", "starts", "hard_core")
    check_planar(parameters, planar_faces_needed=True)


MEMBER = ("panel", "seed")
VARIABLES = (
    *NETWORK,
    *numbers(("seed", "face"), "i1", chosen="1 for the faces that panels C and F inflate"),
    *numbers(("seed",), B_0_bound="largest B_0 that any stress can give, in units of k"),
    *numbers(
        (*MEMBER, "edge"),
        sigma="geometric stress (tension per length), sum of squares N_b",
        tension="edge tension at unit pressure, sum of tension times length 2 V",
        length="edge length",
    ),
    *numbers((*MEMBER, "vertex", "axis"), position="coordinates of the vertices"),
    *numbers((*MEMBER, "face"), amplitude="isogonal amplitude of each face, as a length"),
    *numbers(
        MEMBER,
        V_L="variance of the lengths over their squared mean, V_L",
        V_tau="variance of the tensions over their squared mean, V_τ",
        B_0_affine="bulk modulus if the dilation stayed affine, in units of k",
        stressed_fraction="part of the edges with stress of any sign",
        tension_fraction="part of the edges under tension",
        flat_directions="null directions of the Hessian of B_0 over the stresses, at its maxima",
        flat_largest="largest eigenvalue counted as null, over the largest of all",
        curved_smallest="smallest eigenvalue not counted as null, over the largest of all",
    ),
    *bounded(
        MEMBER,
        B_0="bulk modulus at the transition, in units of k",
        G_0="shear modulus at the transition, in units of k",
    ),
    *numbers(MEMBER, position_error_bound="bound on the error of position"),
    *outcomes(MEMBER, status="outcome of finding the configuration"),
    *numbers(MEMBER, residual="largest unbalanced force over the mean tension"),
    *numbers(MEMBER, "i4", iterations="iterations of the method that found the configuration"),
)


study = Study(
    name="gallery",
    version=3,
    title="Thirteen critical configurations of each network",
    references=f"{PAPER}, figure Networks",
    committed=committed_run("gallery"),
    axes=(
        networks(10),
        Axis("panel", PANELS, "critical configuration, by its panel in the figure"),
    ),
    parameters={
        "n_vertices": 400,
        "hard_core": STANDARD_HARD_CORE,
        "thresholds": (0.1, 0.03, 0.01),
        "starts": 4,
        "spread": populations.SETTINGS["spread"],
        "fraction": 0.9,
        "shortest": 0.15,
        "network": "",
    },
    coordinates=PLANE,
    case=case,
    check=check,
    complete=partial(with_digest, 400),
    variables=VARIABLES,
    figures={"gallery": gallery},
    claims=claims,
    verify=verify,
)
