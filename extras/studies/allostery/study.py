"""Local responses on the critical manifold: how far they reach untrained, and how many one network can be given.

Sources and targets are diagonals of faces.  The response η is the relative change of a target per relative change of a
source at vanishing stress; designs change the stress from σ = k.  A design that is not reached is no proof that there
is none, with one exception: η_ts η_st = G_ts²/(G_ss G_tt) lies between 0 and 1, so that conditions never name a source
as the target of another.

In overconstrained networks of springs, trained by cutting, Rocks et al. find that the number of targets that one source
can command has a sharp limit which grows more slowly than the number of vertices.

Random rest lengths (`random_lengths`) have s = 0.1, not the 0.3 of the paper, so that every edge carries tension.
"""

from critflow.studies.shared.checks import check_network, check_voronoi, voronoi_check
from critflow.studies.shared.reports import PAPER
from critflow.studies.shared.tables import network_study, numbers, outcomes

from critflow.engine import Coordinate
from critflow.result import StudyError

from .claims import claims
from .figures import capacity_figure, movie, network_figure, response_figure
from .measurements import case

SOURCES = (
    f"{PAPER}; Rocks et al., Limits of multifunctionality in tunable networks (PNAS 116, 2506, 2019); Rocks et al., "
    "Designing allostery-inspired response in mechanical networks (PNAS 114, 2520, 2017); Yan et al., Architecture and "
    "coevolution of allosteric materials (PNAS 114, 2526, 2017)"
)


def check(parameters, axes):
    """Refuse settings that could only fail."""
    if min(parameters["sizes"]) < 24 or parameters["n_vertices"] < 24:
        raise StudyError("sizes and n_vertices must be at least 24, or no target is left for three sources")
    if not (0 < min(parameters["fractions"]) and 0 < min(parameters["loads"]) <= max(parameters["loads"]) <= 1):
        raise StudyError("fractions must be positive, and loads between 0 and 1")
    for size in parameters["sizes"]:
        check_network(check_voronoi, size)
    voronoi_check("starts", "steps")(parameters, axes)


CAPACITY, TRAINED = ("seed", "size", "fraction", "kind"), ("seed", "style", "load")

study = network_study(
    name="allostery",
    title="Local responses on the critical manifold",
    references=SOURCES,
    n=6,
    parameters={
        "n_vertices": 100,
        "loads": (0.02, 0.1, 0.3, 1.0),
        "sizes": (50, 100, 200, 400),
        "fractions": (0.3, 0.4, 0.5, 0.6, 0.7, 0.8),
        "starts": 1,
        "steps": 600,
    },
    coordinates=(
        Coordinate("size", "sizes", "number of vertices"),
        Coordinate("fraction", "fractions", "number of conditions over N_b − 1"),
        Coordinate("load", "loads", "part of the other faces that are targets"),
    ),
    case=case,
    check=check,
    variables=(
        *numbers(("seed", "population", "bin"), typical="median |η| of diagonals by distance, untrained"),
        *numbers(
            ("seed", "population"),
            largest="largest |η| beyond two spacings",
            reciprocity="largest product η_ts η_st of two sources",
        ),
        *numbers(CAPACITY, "i4", n_conditions="number of conditions"),
        *numbers(CAPACITY, error="largest error of a response of the design"),
        *outcomes(CAPACITY, capacity_status="outcome of the design"),
        *numbers(
            TRAINED,
            trained_error="largest error of a response of the design",
            least_stress="least σ at Σσ² = N_b",
            largest_stress="largest σ",
            V_L="V_L of the design",
            path_stress="mean ln σ within one spacing of the lines from source to targets, less that elsewhere",
            path_alignment="Σ τ cos 2θ/Σ τ of the edges there, θ between edge and line",
            limit="least stress t at which a response deviates by 1 %, by its next order [k]",
            past_slope="relative deviation of the change at the least stress from its prediction",
        ),
        *numbers((*TRAINED, "stress_level"), past_error="largest deviation from ±1 at the stress tσ"),
        *numbers((*TRAINED, "noise"), noise_error="largest deviation with relative errors of rest lengths"),
        *numbers(("seed", "stage", "edge", "axis"), bonds="bond vectors before and after training"),
        *numbers(("seed", "stage", "edge"), stress="σ before and after training"),
        *numbers(("seed", "stage", "vertex", "axis"), places="coordinates", moves="motion per strain of the source"),
        *numbers(("seed", "pair", "place"), shown="source and targets: tail, head and image; −1 for none"),
        *numbers(("seed", "edge", "end"), "i4", edges="vertices at tail and head of each edge"),
        *numbers(("seed", "cell_vector", "axis"), cell="cell vectors as rows"),
    ),
    figures={"capacity": capacity_figure, "responses": response_figure, "network": network_figure},
    animations={"movie": movie},
    claims=claims,
)
