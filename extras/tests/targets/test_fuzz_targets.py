"""Random valid networks through the functions of this folder."""

from fuzzing import answers_or_explains, critical_of, geometry
from random_problems import numbers

import critflow
import critflow_extras as ce

CALLS = {
    "design faces": lambda p, r: ce.design(
        critical_of(p), {"length[0]": abs(float(numbers(r, 1)[0]))}, change="faces", max_steps=20
    ),
    "design stiffness": lambda p, r: ce.design(
        critflow.spring_state(p.network, geometry(p)[2], geometry(p)[1]),
        {"B_0": 0.5 + r.random(), "G_0": 0.5 + r.random()},
        change="stiffness",
        max_steps=60,
    ),
    "design stress": lambda p, r: ce.design(p.network, {"V_L": 0.2 * r.random()}, max_steps=20),
}

test_answers_or_explains = answers_or_explains(CALLS)
