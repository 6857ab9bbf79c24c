"""Random valid networks through the functions of this folder."""

import numpy as np
from fuzzing import answers_or_explains, critical_of, geometry

import critflow_extras as ce
from critflow_extras.tensegrity.second_order import second_order_rigidity
from critflow_extras.tensegrity.signed_stress import signed_stress

CALLS = {
    "second_order_rigidity": lambda p, r: second_order_rigidity(*geometry(p)[:2]),
    "stability": lambda p, r: ce.stability(critical_of(p)),
    "signed_stress": lambda p, r: signed_stress(*geometry(p)[:2], np.sign(p.sigma).astype(int)),
    "signed_stress any": lambda p, r: signed_stress(*geometry(p)[:2], [r.choice([-1, 0, 1]) for _ in p.sigma]),
}

test_answers_or_explains = answers_or_explains(CALLS)
