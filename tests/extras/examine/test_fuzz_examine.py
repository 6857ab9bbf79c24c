"""Random valid networks through the functions of this extra."""

from fuzzing import answers_or_explains, geometry

import critflow

CALLS = {
    "examine": lambda p, r: critflow.examine(*geometry(p)[:2]),
}

test_answers_or_explains = answers_or_explains(CALLS)
