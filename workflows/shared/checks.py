"""Checks of parameters before a run, for several studies."""

import os

from critflow import InputError
from critflow.deformation import DEFORMATIONS
from critflow.points import check_voronoi
from critflow.result import StudyError

# Peak memory of a network with the analysis of its matrices, measured at 100,000 and 400,000 vertices.
BYTES_A_VERTEX = 1600


def check_positive(parameters, *names):
    """Raise `StudyError` for parameters that are not positive."""
    for name in names:
        if not parameters[name] > 0:
            raise StudyError(f"{name}={parameters[name]} must be positive")


def check_known(noun, names, known):
    """Raise `StudyError` for a name that is not among the known ones."""
    if unknown := sorted(set(names) - set(known)):
        raise StudyError(f"there is no {noun} {unknown[0]!r}: choose among {', '.join(known)}")


def check_network(check, n_vertices, *arguments):
    """Raise `StudyError` for sizes and hard cores without a network, and for networks beyond the memory.

    check  `check_voronoi` or `check_foam`: a check of all arguments that makes no network
    """
    try:
        check(n_vertices, *arguments)
    except InputError as error:
        raise StudyError(str(error)) from error
    needed, present = n_vertices * BYTES_A_VERTEX, os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if needed > present:
        raise StudyError(
            f"n_vertices={n_vertices} needs about {needed / 1e9:.0f} GB for each worker process, and this machine has "
            f"{present / 1e9:.0f} GB: choose fewer vertices"
        )


def voronoi_check(*positive):
    """The check of a study of Voronoi networks: their size, and settings that must be positive."""

    def check(parameters, axes):
        check_positive(parameters, *positive)
        check_network(check_voronoi, parameters["n_vertices"])

    return check


def check_fit(parameters):
    """Raise `StudyError` unless a line, or the curve of `fit_degree`, can be fitted to the strains in the window."""
    window, needed = parameters["fit_window"], int(parameters.get("fit_degree", 1)) + 2
    inside = sum(strain <= window * (1 + 1e-12) for strain in parameters["strains"])
    if inside < needed:
        raise StudyError(
            f"fit_window={window:g} contains {inside} of the strains, and the fits of C_B and C_G need {needed}: give "
            f"more strains up to {window:g}, or a wider fit_window"
        )


def check_deformation(name):
    """Raise `StudyError` for names that are not deformations of a fixed cell: free sides loosen every network."""
    known = [known for known in DEFORMATIONS if known != "uniaxial_free"]
    if name not in known:
        raise StudyError(f"deformation={name} must be one of {', '.join(known)}")
