"""Random valid networks through the functions of this folder."""

from fuzzing import answers_or_explains, critical_of

import critflow_extras as ce

CALLS = {"properties": lambda p, r: ce.properties(critical_of(p), ["V_tau", "V_L"])}

test_answers_or_explains = answers_or_explains(CALLS)
