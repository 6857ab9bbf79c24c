"""Random valid networks through the functions of this folder."""

import numpy as np
from fuzzing import a_deformation, answers_or_explains, geometry
from random_problems import numbers

import critflow_extras as ce


def loose(problem, random):
    """Rest lengths a little above those of the critical configuration."""
    return geometry(problem)[2] * (1.05 + 0.05 * numbers(random, len(problem.sigma)))


def surface_points(surface):
    """The strains of the rays that meet the surface, and nothing of the others, which have a status."""
    return surface.strains[surface.found], surface.normals[surface.found], surface.error_bounds[surface.found]


CALLS = {
    "critical_strain": lambda p, r: ce.critical_strain(p.network, loose(p, r), a_deformation(p, r)),
    "rigidity_surface": lambda p, r: surface_points(
        ce.rigidity_surface(p.network, loose(p, r), [np.eye(p.network.dimension)])
    ),
}

test_answers_or_explains = answers_or_explains(CALLS)
