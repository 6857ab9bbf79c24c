"""Random valid networks through the functions of this folder."""

import numpy as np
from fuzzing import answers_or_explains, geometry

import critflow
import critflow_extras as ce
from critflow_extras.tissue.face_springs import FaceSprings


def tissue_of(problem):
    """Faces at a critical configuration, with the perimeters as those at rest."""
    network, x, lengths = geometry(problem)
    faces = FaceSprings.of(network, 1.0, None)
    return ce.tissue(network, np.asarray(faces.sides @ lengths), x)


CALLS = {
    "elasticity of a tissue": lambda p, r: critflow.elasticity(tissue_of(p)),
    "critical_from_perimeters": lambda p, r: ce.critical_from_perimeters(
        p.network, 3.7 * np.ones(len(FaceSprings.of(p.network, 1.0, None).stiffness))
    ),
}

test_answers_or_explains = answers_or_explains(CALLS)
