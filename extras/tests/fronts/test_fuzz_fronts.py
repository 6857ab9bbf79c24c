"""Random valid networks through the functions of this folder."""

import numpy as np
from fuzzing import answers_or_explains, critical_of

import critflow_extras as ce


def leverage_of(problem):
    """Values after the cut of each edge, each with an error."""
    leverage = ce.edge_leverage(critical_of(problem))
    assert (np.isnan(leverage.value.errors) == np.isnan(leverage.value.after)).all()


CALLS = {
    "pareto": lambda p, r: ce.pareto(p.network, {"V_tau": "smallest", "V_L": "smallest"}, 3, max_steps=40),
    "edge_leverage": lambda p, r: leverage_of(p),
    "prune_towards": lambda p, r: ce.prune_towards(critical_of(p), {"V_tau": "smallest"}, cuts=2),
}

test_answers_or_explains = answers_or_explains(CALLS)
