"""Design for a target: the properties that a network at the transition can have, and the cost of each.

Each question is a module of this folder, listed in `MODULES`; a module contains

    PARAMETERS                  settings and their defaults; `--set MODULE_key=value` changes them
    VARIABLES                   name -> (dimensions of one case, long name).  Real numbers; a name that ends in `status`
                                contains codes of `Status`, one that ends in `seconds` a time, which differs by run
    sizes(parameters)           dimension -> size
    case(parameters, seed)      computes one case: name -> array; variables that are missing are undefined (NaN).  The
                                optional `status` is the outcome of the case, `Status.ok` by default
    figure(ds, parameters)      draws one figure
    claims(ds, parameters)      returns the claims (`critflow.workflow.Claim`)
    summary(ds, parameters)     returns the numbers of `summary.json` (optional)
    check(parameters)           raises `StudyError` for settings that could only fail (optional)

`ds` is the dataset of the module alone, under the names that it declares, with dimensions (seed, ...) and `ds.status`
by seed.  A module imports `critflow`, `workflows.shared`, and of this folder `panels` and `parts` only; randomness
comes from the seed.  `--set parts=MODULE` runs one module, `--set seeds=0:2` fewer networks.
"""

from __future__ import annotations

from critflow.result import Status, StudyError
from critflow.workflow import Axis, Study, Variable

from . import (
    curves,
    fronts,
    isogonal,
    onset_targets,
    poisson,
    pruning,
    reach,
    stiffening_targets,
    stress_targets,
    topology,
)
from .parts import all_parameters, complete, figure_of, name_of, own_parameters, table
from .report import claims_of, summary_of

MODULES = (
    *(isogonal, topology, pruning, poisson, fronts, reach),
    *(stress_targets, stiffening_targets, onset_targets, curves),
)
PARTS = {name_of(module): module for module in MODULES}


def case(parameters, *, seed, part):
    """One case of one module."""
    module = PARTS[part]
    return complete(MODULES, part, parameters, module.case(own_parameters(module, parameters), seed))


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    for part in axes["part"]:
        if hasattr(PARTS[part], "check"):
            try:
                PARTS[part].check(own_parameters(PARTS[part], parameters))
            except StudyError as error:
                raise StudyError(f"of {part}: {error}") from error


study = Study(
    name="design",
    title="Design for a target: response, stiffening, onset and topology",
    references="Hain, Santangelo and Manning (arXiv:2407.13939), and beyond",
    axes=(
        Axis("seed", range(10), "seed of the network", noun="networks"),
        Axis("part", tuple(PARTS), "question", key="parts"),
    ),
    parameters=all_parameters(MODULES),
    case=case,
    check=check,
    variables=(
        *table(MODULES),
        Variable("status", ("part", "seed"), "i1", long_name="outcome of the case", flags=Status),
    ),
    figures={name: figure_of(module) for name, module in PARTS.items()},
    claims=claims_of(MODULES),
    summary=summary_of(MODULES),
)
