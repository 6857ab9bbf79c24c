"""Random valid networks through the functions of this folder."""

import numpy as np
from fuzzing import answers_or_explains, geometry, relaxed

import critflow

CALLS = {
    "elasticity of rest lengths": lambda p, r: critflow.elasticity(
        p.network.deformed(1.001 * np.eye(p.network.dimension)), relaxed(p, r).value.coordinates, geometry(p)[2]
    ),
    "elasticity at rest": lambda p, r: critflow.elasticity(*geometry(p)[:2]),
}

test_answers_or_explains = answers_or_explains(CALLS)
