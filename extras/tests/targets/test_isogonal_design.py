"""Design at a fixed force network: exact gradients, targets met at the same linear response, refusals."""

from functools import cache

import numpy as np
import pytest
from derivatives import assert_derivative
from problems import face_areas, pinned_grid, random_stress, voronoi_3d

from critflow import (
    CriticalManifold,
    InputError,
    SolveError,
    Status,
    elasticity,
    stiffening,
    upper_bound,
    voronoi_network,
)
from critflow.isogonal import face_modes
from critflow_extras import design
from critflow_extras.targets.faces import FaceAmplitudes
from critflow_extras.targets.problem import TargetProblem, parse_targets
from critflow_extras.targets.targets import least_change


@cache
def critical():
    network = voronoi_network(40, seed=3)
    network = network.with_stiffness(np.random.default_rng(1).uniform(0.5, 2.0, network.n_edges))
    return CriticalManifold(network).configuration(random_stress(network.n_edges, 5))


def changed(before, targets, **options):
    return design(before, targets, change="faces", **options)


def test_gradients_are_those_of_central_differences():
    variables, targets = FaceAmplitudes(critical()), dict.fromkeys(("C_B", "C_G", "length[7]", "area[3]", "V_L"), 1.0)
    family = TargetProblem(variables, least_change(variables), parse_targets(variables.network, targets))
    rng = np.random.default_rng(2)
    a, step = 0.05 * rng.standard_normal((2, variables.n_modes))
    rows = family.at(a).rows(np.arange(len(family.low)))
    assert_derivative(lambda z: family.at(z).constraints, lambda direction: rows @ direction, a, [step], 1e-4, 1e-7)


@pytest.mark.parametrize(
    "change",
    [{"C_B": 0.04}, {"C_B": 0.02, "C_G": -0.02}, {"length[3]": 1.0, "area[5]": (1.5, 1.6), "V_L": (0.0, 0.3)}],
    ids=str,
)
def test_targets_are_met_at_the_same_linear_response(change):
    before = critical()
    exact = stiffening(before).value
    targets = {name: x + getattr(exact, name) if name.startswith("C_") else x for name, x in change.items()}
    found = changed(before, targets)
    assert found.ok and found.stats.residual < 1e-11
    after, response = found.value, stiffening(found.value).value
    for name, x in targets.items():
        if name.startswith("C_"):
            assert getattr(response, name) == pytest.approx(x, rel=1e-9)
    if "length[3]" in targets:
        assert after.lengths[3] == pytest.approx(1.0, rel=1e-11)
        assert 1.5 - 1e-11 <= face_areas(after.network.faces, after.bond_vectors)[5] <= 1.6 + 1e-11
    moduli, same = elasticity(before).value, elasticity(after).value
    assert same.bulk == pytest.approx(moduli.bulk, rel=1e-13)
    assert same.shear == pytest.approx(moduli.shear, rel=1e-11)
    modes = face_modes(before).elongations.toarray()
    change = after.lengths - before.lengths
    np.testing.assert_allclose(modes.T @ np.linalg.lstsq(modes.T, change, rcond=None)[0], change, atol=1e-12)
    assert found.distance == pytest.approx(np.sqrt(np.mean(np.log(after.lengths / before.lengths) ** 2)), rel=1e-9)


def test_the_distance_is_that_of_an_optimum():
    before = critical()
    found = changed(before, {"area[5]": 2.0, "area[2]": 0.8})
    # A multiplier is the derivative of the distance by the target.
    values = [changed(before, {"area[5]": 2.0 + h, "area[2]": 0.8}).preference for h in (1e-3, -1e-3)]
    assert np.diff(values)[0] / -2e-3 == pytest.approx(found.targets["area[5]"].multiplier, rel=1e-3)


def test_targets_out_of_reach_end_with_a_compromise():
    before = critical()
    least = -elasticity(before).value.bulk / 2
    found = changed(before, {"C_B": 0.99 * least}, throw=False)
    assert found.status is Status.not_reached and not found.reached
    assert least < found.targets["C_B"].value < stiffening(before).value.C_B
    with pytest.raises(SolveError, match="at least -B_0/2"):
        changed(before, {"C_B": 1.01 * least})
    with pytest.raises(SolveError, match="relax"):
        changed(before, {"length[3]": 100.0})
    twice = changed(before, {"length[3]": (1.0, 2.0), "V_L": (0, 1.0)})
    assert twice.ok and twice.independent


def test_the_stiffest_force_network_fixes_its_coefficient():
    network = critical().network
    stiffest = CriticalManifold(network).configuration(network.stiffness)
    bound = upper_bound(network, "B_0")
    with pytest.raises(SolveError, match="every isogonal change") as refusal:
        changed(stiffest, {"C_B": 0.0})
    assert refusal.value.solution.status is Status.infeasible
    found = changed(stiffest, {"C_B": (-0.5001 * bound, -0.4999 * bound), "area[1]": 1.2})
    assert found.ok and found.targets["C_B"].value == pytest.approx(-bound / 2, rel=1e-9)


def test_other_units_of_length_give_the_same_design():
    before, scale = critical(), 1e-4
    network = before.network.deformed(scale * np.eye(2))
    small = changed(CriticalManifold(network).configuration(before.sigma), {"length[3]": 1e-4, "area[5]": 1.5e-8})
    large = changed(before, {"length[3]": 1.0, "area[5]": 1.5})
    np.testing.assert_allclose(small.value.lengths, scale * large.value.lengths, rtol=1e-6)


def test_bad_configurations_are_refused_in_one_sentence():
    with pytest.raises(InputError, match="two dimensions"):
        network = voronoi_3d()
        changed(CriticalManifold(network).configuration(np.ones(network.n_edges)), {"C_B": 0.0})
    network = pinned_grid(5)
    with pytest.raises(InputError, match="no isogonal mode"):
        changed(CriticalManifold(network).configuration(np.ones(network.n_edges)), {"length[0]": 1.0})
    with pytest.raises(InputError, match="limits"):
        changed(critical(), {"C_B": 0.0}, within={"lengths": (5.0, None)})
