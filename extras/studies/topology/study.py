"""Networks at the transition whose edges are cut.

Fracture and remodelling, in which the network is strained to its new onset after each cut (`fracture`), and pruning at
constant stress (`pruning`).
"""

from critflow.studies.shared.checks import check_positive, voronoi_check
from critflow.studies.shared.tables import network_study

from critflow import Status
from critflow.result import StudyError

from . import fracture, pruning


def case(parameters, *, seed):
    """The cuts of one network, and those of a larger one."""
    return {
        "status": Status.ok,
        **fracture.sequences(parameters, seed),
        **pruning.pruned(parameters, seed),
    }


def check(parameters, axes):
    """Refuse settings that could only fail."""
    voronoi_check("cuts")(parameters, axes)
    check_positive(parameters, "pruned_edges")
    for cuts, n_vertices in (("cuts", "n_vertices"), ("pruned_edges", "pruned_vertices")):
        if parameters[cuts] >= parameters[n_vertices]:
            raise StudyError(f"{cuts}={parameters[cuts]} must be smaller than the number of vertices")


def claims(ds):
    """What cuts do to a network."""
    return [*fracture.claims(ds), *pruning.claims(ds)]


study = network_study(
    name="topology",
    title="Fracture, remodelling and pruning of networks at the transition",
    parameters={"n_vertices": 64, "cuts": 16, "pictured": 6, "pruned_vertices": 300, "pruned_edges": 90},
    case=case,
    check=check,
    variables=(*fracture.VARIABLES, *pruning.VARIABLES),
    figures={"topology": fracture.figure, "pruning": pruning.figure},
    claims=claims,
)
