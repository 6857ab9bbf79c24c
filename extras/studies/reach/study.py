"""The reach of networks: which linear responses they can have, and at which strains they become rigid.

Responses at the transition with positive stresses and with any (`support`), Poisson's ratios by stiffnesses
(`poisson`), and the rigidity surfaces of the populations (`surfaces`).

Random rest lengths (`random_lengths`) have s = 0.1, not the 0.3 of the paper, so that every edge carries tension.
"""

from critflow.studies.shared.checks import check_network, check_positive, voronoi_check
from critflow.studies.shared.tables import network_study

from critflow import Status, delaunay_network, voronoi_network
from critflow.engine import Coordinate
from critflow.result import StudyError

from ..shared.parts import NARROW
from . import poisson, support, surfaces


def case(parameters, *, seed):
    """Both reaches of one network, the ratios of a triangulated cell, and surfaces of the first networks."""
    return {
        "status": Status.ok,
        **support.responses(parameters, seed),
        **poisson.ratios(parameters, seed),
        **surfaces.surfaces(parameters, seed),
    }


def check(parameters, axes):
    """Refuse settings that could only fail."""
    if parameters["directions"] < 3 or not min(parameters["thresholds"]) > 0:
        raise StudyError("directions must be at least 3, and thresholds positive")
    for ratio in parameters["ratios"]:
        if not -1 < ratio < 1:
            raise StudyError(f"ratios={ratio} must lie between -1 and 1")
    for size in parameters["sizes"]:
        check_network(delaunay_network, size, 0)
    check_positive(parameters, "excess", "surface_directions")
    check_network(voronoi_network, parameters["surface_vertices"], 0)
    voronoi_check("spread")(parameters, axes)


def claims(ds):
    """What positive stresses attain, Poisson's ratios by design, and shears that make networks rigid."""
    return [*support.claims(ds), *poisson.claims(ds), *surfaces.claims(ds)]


study = network_study(
    name="reach",
    title="The reach of networks: linear responses and onsets",
    parameters={
        "n_vertices": 100,
        "directions": 24,
        "thresholds": (0.3, 0.1),
        "samples": 60,
        "ascent": 150,
        "sizes": (24, 36, 48, 60, 72, 84, 96, 112, 128, 144),
        "ratios": tuple(round(-0.8 + 1.7 * n / 12, 6) for n in range(13)),
        "surface_vertices": 100,
        "surface_directions": 32,
        "excess": 0.05,
        **NARROW,
    },
    coordinates=(Coordinate("ratio", "ratios", "requested Poisson's ratio"),),
    case=case,
    extras=("poisson",),
    check=check,
    variables=(*support.VARIABLES, *poisson.VARIABLES, *surfaces.VARIABLES),
    figures={"reach": support.figure, "poisson": poisson.figure, "surfaces": surfaces.figure},
    claims=claims,
)
