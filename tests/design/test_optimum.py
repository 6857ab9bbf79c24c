"""The fields of an optimum, by kind of method."""

from dataclasses import fields

import numpy as np
import pytest

from critflow import Solution, Status, optimize, upper_bound, voronoi_network
from critflow.design.optimize import objective_of
from critflow.quantities.optimum import Optimum

NETWORK = voronoi_network(60, seed=1)
# Each method with an objective, and the fields that it sets beyond value, status, stats, note and objective.
KINDS = {
    "closed form": ("bulk_modulus", "auto", {"bound", "objective_error"}),
    "cone program": ("length_variance", "conic", {"objective_error"}),
    "descent": ("tension_variance", "lbfgs", {"saddles", "starts"}),
}
DEFAULTS = {
    "objective_error": np.nan,
    "uncertainty": np.nan,
    "bound": np.nan,
    "collapsed_edges": [],
    "slack_edges": [],
    "saddles": None,
    "start": 0,
    "starts": [],
    "crossings": (),
    "nearest_singular": np.nan,
    "negative_pivots": None,
}


def is_default(value, default) -> bool:
    return value is None if default is None else np.array_equal(value, default, equal_nan=True)


def test_every_field_is_in_this_table():
    own = [field.name for field in fields(Optimum) if field.name not in {f.name for f in fields(Solution)}]
    assert own == ["objective", *DEFAULTS]


@pytest.mark.parametrize("kind", KINDS)
def test_fields_of_each_kind(kind):
    objective, method, expected = KINDS[kind]
    optimum = optimize(NETWORK, objective, method)
    assert isinstance(optimum, Optimum)
    assert optimum.status is Status.ok
    assert optimum.note == ""
    assert optimum.stats.residual < 1e-11
    value = optimum.value
    evaluated = objective_of(NETWORK, objective).evaluate(value)[0]
    assert optimum.objective == pytest.approx(evaluated, rel=1e-11, abs=1e-18)
    found = {name for name, default in DEFAULTS.items() if not is_default(getattr(optimum, name), default)}
    assert found == expected


def test_the_gap_to_the_bound():
    best = optimize(NETWORK, "bulk_modulus")
    assert best.bound == pytest.approx(upper_bound(NETWORK, "B_0"), rel=1e-14)
    assert best.gap == 1 - best.objective / best.bound
    assert abs(best.objective - best.bound) <= best.objective_error + 1e-14
    assert np.isnan(optimize(NETWORK, "tension_variance").gap)
