"""Numbers of the literature on underconstrained networks and vertex models, computed again, none of them adjusted.

Each quantity is a function in `measures.py`; its value in the literature, the source and the rule of comparison are in
`report.py`.
"""

import numpy as np

from critflow import voronoi_network
from critflow.result import Status, StudyError
from critflow.workflow import Axis, Study, Variable

from ..shared.checks import check_network, check_positive
from . import measures
from .report import QUANTITIES, claims, curves


def case(parameters, *, seed, quantity):
    """One number, and the curve behind it."""
    found = getattr(measures, quantity)(parameters, seed)
    x, y = np.full((2, measures.POINTS), np.nan)
    x[: len(found.x)], y[: len(found.y)] = found.x, found.y
    return {"value": found.value, "x": x, "y": y, "status": found.status}


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    check_positive(parameters, "columns", "candidates", "z")
    if len(parameters["onsets"]) > measures.POINTS or not min(parameters["onsets"]) > 0:
        raise StudyError(f"onsets={parameters['onsets']} must be at most {measures.POINTS} positive strains")
    for key in ("n_vertices", "n_vertices_cells"):
        check_network(voronoi_network, parameters[key])


study = Study(
    name="reference_numbers",
    title="Numbers of the literature on underconstrained networks and vertex models",
    references="the source of each number is in its claim",
    axes=(
        Axis("seed", range(8), "seed of the networks", noun="networks"),
        Axis("quantity", tuple(QUANTITIES), "quantity of the literature", key="quantities"),
    ),
    parameters={
        "n_vertices": 400,
        "n_vertices_cells": 1000,
        "onsets": (0.025, 0.05, 0.1, 0.2),
        "z": 3.4,
        "columns": 6,
        "candidates": 10,
    },
    case=case,
    check=check,
    variables=(
        Variable("value", ("quantity", "seed"), "f8", long_name="the number that the literature gives"),
        Variable("x", ("quantity", "seed", "point"), "f8", long_name="abscissa of the curve behind the number"),
        Variable("y", ("quantity", "seed", "point"), "f8", long_name="ordinate of the curve behind the number"),
        Variable("status", ("quantity", "seed"), "i1", long_name="outcome", flags=Status),
    ),
    figures={"curves": curves},
    claims=claims,
)
