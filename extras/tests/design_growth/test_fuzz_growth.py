"""Random valid networks through the quantities of this folder."""

from fuzzing import answers_or_explains, critical_of

import critflow
import critflow_extras as ce
from critflow import CriticalManifold

CALLS = {
    "least C_B": lambda p, r: critflow.quantity(p.network, "C_B").extreme(CriticalManifold(p.network))[0],
    "properties": lambda p, r: ce.properties(critical_of(p), ["B_0", "C_B"]),
}

test_answers_or_explains = answers_or_explains(CALLS)
