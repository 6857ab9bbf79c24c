"""Which growth with strain goes with which bulk modulus at the transition.

Triples (B_0, C_B, C_G) that other networks attain (`triples`), three designs of one B_0 strained far (`curves`), and
one force network whose lengths change (`isogonal`).

Random rest lengths (`random_lengths`) have s = 0.1, not the 0.3 of the paper, so that every edge carries tension.
"""

from critflow.studies.shared.checks import check_network, voronoi_check
from critflow.studies.shared.tables import network_study

from critflow import Status, voronoi_network
from critflow.engine import Coordinate
from critflow.result import StudyError

from ..shared.parts import NARROW
from . import curves, isogonal, triples


def case(parameters, *, seed):
    """The designs of one network."""
    return {
        "status": Status.ok,
        **triples.designs(parameters, seed),
        **curves.paths(parameters, seed),
        **isogonal.family(parameters, seed),
    }


def check(parameters, axes):
    """Refuse settings that could only fail."""
    voronoi_check("stress_spread", "spread")(parameters, axes)
    check_network(voronoi_network, parameters["isogonal_vertices"], 0)
    unknown = [source for source in parameters["sources"] if source not in triples.SOURCES]
    if unknown:
        raise StudyError(f"no source is called {unknown[0]!r}: choose from {', '.join(triples.SOURCES)}")


def claims(ds):
    """The least growth, the designed curves, and the growths of one force network."""
    return [*triples.claims(ds), *curves.claims(ds), *isogonal.claims(ds)]


study = network_study(
    name="stiffening",
    title="Which growth goes with which bulk modulus",
    extras=("C_B", "C_G"),
    parameters={
        "n_vertices": 400,
        **NARROW,
        "stress_spread": 0.4,
        "sources": triples.SOURCES,
        "isogonal_vertices": 64,
        "coefficients": (-0.08, -0.04, 0.0, 0.1, 0.2),
        "strains": (0.002, 0.005, 0.01, 0.02, 0.04, 0.07, 0.1),
    },
    coordinates=(
        Coordinate("coefficient", "coefficients", "requested C_B of one force network [k]"),
        Coordinate("strain", "strains", "dilation of one force network"),
    ),
    case=case,
    check=check,
    variables=(*triples.VARIABLES, *curves.VARIABLES, *isogonal.VARIABLES),
    figures={"stiffening": triples.figure, "curves": curves.figure, "isogonal": isogonal.figure},
    claims=claims,
)
