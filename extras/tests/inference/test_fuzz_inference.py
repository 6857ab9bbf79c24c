"""Random valid networks through the functions of this folder."""

from fuzzing import answers_or_explains, geometry
from random_problems import numbers

import critflow_extras as ce

CALLS = {
    "nearest_critical": lambda p, r: ce.nearest_critical(
        p.network, geometry(p)[1] * (1 + 0.01 * numbers(r, *geometry(p)[1].shape)), max_steps=30
    ),
}

test_answers_or_explains = answers_or_explains(CALLS)
