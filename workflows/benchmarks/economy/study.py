"""Cost saved by computing only the requested variables: the same numbers by a short and by a long route.

The short route computes the requested numbers alone; the long route computes all variables, or does not use the theory
of the critical manifold.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from critflow import (
    Status,
    StudyError,
    optimize,
    stiffening,
    strain_path,
    transition_moduli,
    voronoi_network,
)
from critflow.linalg.matrices import edge_blocks
from critflow.mechanics.strain_path import check_strains
from critflow.networks.random_networks import check_voronoi
from critflow.workflow import Axis, Coordinate, Study, Variable, decimals, stable_rng

from ...shared.checks import check_network, check_positive
from ...shared.measurements import planar_member, table
from ...shared.populations import prepared
from ..timing import Accuracy, Method, benchmark
from .report import claims, ratio_figure, summary

QUESTIONS = ("growth", "member", "moduli", "configuration", "optimum")
VARIABLES = {variable.name: variable for variable in table(planar=True)}
ALL = tuple(VARIABLES)
# The variables that the short route of the question "member" stores.
FEW = ("status", "C_B_exact", "bulk_modulus_0")


class Routes(NamedTuple):
    """Functions that compute the same numbers by a short and by a long route."""

    short: object
    long: object


def member(parameters, seed, names=ALL):
    """The arrays of one member of the ensemble: the variables of these names, as they are stored."""
    settings = {**parameters, "fit_window": max(parameters["strains"])}
    arrays = planar_member(settings, seed=seed, population="random_stress", wanted=frozenset(names))
    return {name: VARIABLES[name].cast(arrays[name]) for name in names}


def routes(manifold, parameters, seed):
    """Both routes to the answer of every question, for a random stress on one network."""
    network = manifold.network
    sigma = np.abs(stable_rng(seed, "economy").standard_normal(network.n_edges))
    critical = manifold.configuration(sigma)
    strains = np.array(parameters["strains"])

    def fitted():
        path = strain_path(network, critical, strains, tensors=False, pattern=manifold.hessian).value
        return np.polyfit(strains, path.bulk_modulus, 1)[0]

    def just_past():
        return strain_path(
            network, critical, [parameters["past"]], tensors=False, pattern=manifold.hessian
        ).value.bulk_modulus[0]

    def by_hessian():
        # Springs of stiffness σ and no rest length: force balance as an equilibrium, all directions in one matrix.
        values = edge_blocks(np.zeros_like(sigma), critical.bond_vectors, sigma)
        force = -(network.divergence @ (sigma[:, None] * network.boundary_vectors))
        return manifold.hessian.factorize(values).solve(force.ravel()).reshape(force.shape)

    return {
        "growth": Routes(lambda: stiffening(manifold, critical).value.C_B, fitted),
        "member": Routes(
            lambda: member(parameters, seed, FEW)["C_B_exact"],
            lambda: member(parameters, seed)["C_B_exact"],
        ),
        "moduli": Routes(lambda: transition_moduli(critical).bulk, just_past),
        "configuration": Routes(lambda: manifold.balance(sigma).coordinates, by_hessian),
        "optimum": Routes(
            lambda: optimize(manifold, "bulk_modulus").objective,
            lambda: optimize(manifold, "bulk_modulus", "lbfgs", start=sigma, throw=False).objective,
        ),
    }


def case(parameters, *, seed):
    """Seconds of both routes, the difference of their answers, and the bytes of one member of the ensemble."""
    manifold = prepared(voronoi_network, parameters["n_vertices"], seed, parameters["hard_core"])
    questions, arrays = routes(manifold, parameters, seed), member(parameters, seed).values()
    seconds = np.full((2, len(parameters["questions"])), np.nan)
    difference = np.full(len(parameters["questions"]), np.nan)
    for n, name in enumerate(parameters["questions"]):
        reference = np.asarray(questions[name].short())

        def accuracy(answer, reference=reference):
            return Accuracy(float(np.abs(answer - reference).max() / np.abs(reference).mean()))

        both = [Method(route, lambda _, run=run: run(), accuracy) for route, run in questions[name]._asdict().items()]
        timings = benchmark(both, parameters["repeats"])
        for timing in timings:
            if timing.accuracy.status is Status.failed:
                raise RuntimeError(f"{name} by the {timing.method.name} route: {timing.note}")
        seconds[:, n] = [timing.median for timing in timings]
        difference[n] = timings[1].accuracy.error
    return {
        "status": Status.ok,
        "seconds_short": seconds[0],
        "seconds_long": seconds[1],
        "difference": difference,
        "bytes_of_all": sum(array.nbytes for array in arrays),
        "bytes_of_scalars": sum(array.nbytes for array in arrays if array.ndim == 0),
    }


def check(parameters, axes):
    """Refuse settings that could only fail, before anything runs."""
    if unknown := sorted(set(parameters["questions"]) - set(QUESTIONS)):
        raise StudyError(f"there is no question {unknown[0]!r}: choose among {', '.join(QUESTIONS)}")
    if len(check_strains(parameters["strains"])) < 3:
        raise StudyError("a fit with an error needs at least three strains")
    check_positive(parameters, "hard_core", "past", "repeats")
    check_network(check_voronoi, parameters["n_vertices"], parameters["hard_core"])


EACH = ("seed", "question")

study = Study(
    name="economy",
    title="Cost saved by computing only the requested variables",
    axes=(Axis("seed", range(5), "seed of the network", noun="networks"),),
    parameters={
        "n_vertices": 1000,
        "hard_core": 0.82,
        "questions": QUESTIONS,
        "strains": decimals("0.001:0.010:0.001"),
        "past": 1e-6,
        "repeats": 7,
    },
    coordinates=(Coordinate("question", "questions", "requested quantity"),),
    case=case,
    check=check,
    workers=1,
    variables=(
        Variable("seconds_short", EACH, "f8", long_name="median time of the short route", units="s", volatile=True),
        Variable("seconds_long", EACH, "f8", long_name="median time of the long route", units="s", volatile=True),
        Variable("difference", EACH, "f8", long_name="largest difference of the answers over their mean size"),
        Variable("bytes_of_all", ("seed",), "i8", long_name="bytes of all arrays of one member of the ensemble"),
        Variable("bytes_of_scalars", ("seed",), "i8", long_name="bytes of its numbers without inner dimensions"),
        Variable("status", ("seed",), "i1", long_name="whether the case was computed", flags=Status),
    ),
    figures={"economy": ratio_figure},
    claims=claims,
    summary=summary,
)
