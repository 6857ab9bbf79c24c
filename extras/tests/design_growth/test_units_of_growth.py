"""The least C_B in other units of stiffness and length: the same stresses, with values in these units."""

from functools import partial

from problems import NETWORKS
from units import same_in_units

from critflow import optimize
from critflow_extras import foam_network


def least(network, units, value):
    found = optimize(network, "C_B", throw=False)
    ends = found.status, found.note, found.stats.steps, found.stats.residual, found.gap, found.value.sigma
    return {"number": ends, value: (found.objective, found.objective_error)}


def in_space(network, units):
    return {"pressure": (optimize(network, "C_B").objective,)}


test_the_least_growth_in_other_units = same_in_units({"plane": (partial(least, value="stiffness"), NETWORKS["tiny"])})
test_the_least_growth_in_space_in_other_units = same_in_units(
    {"space": (in_space, partial(foam_network, 60, seed=1))}, rtol=1e-9
)
