"""Random valid networks through the functions of this folder."""

from fuzzing import answers_or_explains, geometry

import critflow_extras as ce

CALLS = {
    "examine": lambda p, r: ce.examine(*geometry(p)[:2]),
}

test_answers_or_explains = answers_or_explains(CALLS)
