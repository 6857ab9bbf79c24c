"""Pruning towards a target: values of the networks that remain, greedy cuts, drift, bad input."""

import sys
from functools import cache

import numpy as np
import pytest
from problems import (
    Factorisations,
    length_variance,
    random_stress,
    square_octagon,
    tension_variance,
    with_random_stiffness,
)
from refusals import refused_changes

from critflow import CriticalManifold, SolveError, Status, elasticity, voronoi_network
from critflow_extras import edge_leverage, prune_towards, pruned

VALUES = {
    "B_0": lambda critical: elasticity(critical).value.bulk,
    "G_0": lambda critical: elasticity(critical).value.shear,
    "V_L": length_variance,
    "V_tau": tension_variance,
}


@cache
def critical(n_vertices=60):
    network = with_random_stiffness(voronoi_network(n_vertices, seed=1), seed=2)
    return CriticalManifold(network).configuration(random_stress(network.n_edges, seed=4))


@pytest.mark.parametrize("objective", VALUES)
def test_values_and_choices_are_those_of_new_factorisations(objective):
    before = critical()
    found = prune_towards(before, {objective: "smallest" if "V" in objective else "largest"}, cuts=6)
    assert found.ok and len(found.values) == 7
    kept, best = np.ones(before.network.n_edges, bool), np.nanargmax if "_0" in objective else np.nanargmin
    for edge, value in zip(found.cuts, found.values[1:], strict=True):
        part = pruned(before.network, kept)
        now = CriticalManifold(part.network).configuration(before.sigma[part.edges])
        after = edge_leverage(now, objective).value.after
        assert after[np.flatnonzero(part.edges == edge)[0]] == pytest.approx(after[best(after)], rel=1e-9)
        assert value == pytest.approx(after[best(after)], rel=1e-9)
        kept[edge] = False
    np.testing.assert_array_equal(found.edges, pruned(before.network, kept).edges)
    assert found.objective == pytest.approx(VALUES[objective](found.value), rel=1e-11)
    np.testing.assert_allclose(np.ptp(found.value.sigma / before.sigma[found.edges]), 0, atol=1e-12)


@pytest.mark.parametrize("seed", [None, 3])
def test_a_target_is_reached_or_the_distance_reported(seed):
    before = critical()
    target = 0.7 * elasticity(before).value.bulk
    found = prune_towards(before, {"B_0": target}, seed=seed, tolerance=0.03)
    assert found.ok and abs(found.objective / target - 1) < 0.03
    assert (np.diff(np.abs(found.values - target)) < 0).all()
    with pytest.raises(SolveError, match="no further") as refusal:
        prune_towards(before, {"B_0": target}, seed=seed, tolerance=1e-12)
    assert refusal.value.solution.status is Status.not_reached
    again = prune_towards(before, {"B_0": target}, seed=seed, tolerance=0.03)
    np.testing.assert_array_equal(again.cuts, found.cuts)


@pytest.mark.parametrize("seed", [None, 5])
def test_small_networks_reach_nearly_every_target(seed):
    reached = 0
    for number in range(5):
        network = voronoi_network(60, seed=number)
        start = CriticalManifold(network).configuration(network.stiffness)
        for part in (0.9, 0.8, 0.7, 0.6, 0.5):
            target = part * elasticity(start).value.bulk
            found = prune_towards(start, {"B_0": target}, seed=seed, throw=False)
            error = abs(elasticity(found.value).value.bulk / target - 1)
            assert found.ok == (error <= 1e-3)
            assert len(found.values) == len(found.cuts) + 1 and (np.diff(found.values) < 0).all()
            reached += found.ok
    assert reached == 25


@pytest.mark.parametrize("drift", [1e-10, 0.0])
def test_updates_are_as_accurate_as_new_factorisations(monkeypatch, drift):
    before, prune = critical(), sys.modules["critflow_extras.fronts.prune_towards"]
    monkeypatch.setattr(prune, "PRUNING_DRIFT", drift)
    found, counts = [], Factorisations(monkeypatch)
    made = counts(before.network, lambda: found.append(prune_towards(before, {"V_L": "smallest"}, cuts=30, seed=1)))
    assert made["P"] == 1 if drift else made["P"] > 10
    # Edges that hang on one vertex after a cut are not counted.
    assert len(found[0].edges) < before.network.n_edges - 30
    assert found[0].objective == pytest.approx(length_variance(found[0].value), rel=1e-11)


def test_cuts_end_where_every_further_one_opens_the_network():
    network = square_octagon()
    found = prune_towards(CriticalManifold(network).configuration(np.ones(6)), {"B_0": "largest"}, cuts=5, throw=False)
    assert found.status is Status.floppy and "opens" in found.note
    assert len(found.cuts) < 5 and found.value.residual < 1e-12


test_bad_input_is_one_sentence = refused_changes(
    lambda **changes: prune_towards(critical(), **({"targets": {"B_0": "largest"}} | changes)),
    ({"targets": {"B_0": "largest"}}, "target"),
    ({"targets": {"colour": "largest"}, "cuts": 1}, "colour"),
    ({"targets": {"B_0": -1.0}}, "positive"),
    ({"targets": {"B_0": 0.1, "V_L": 0.1}}, "one target"),
    ({"cuts": 90}, "89"),
    ({"cuts": 1, "seed": -1}, "seed"),
)
