"""Design at a fixed force network: exact gradients, targets met at the same linear response, refusals."""

from functools import cache

import numpy as np
import pytest
from problems import pinned_grid, random_stress, voronoi_3d

from critflow import (
    CriticalManifold,
    InputError,
    SolveError,
    Status,
    bulk_modulus_bound,
    elasticity,
    face_modes,
    isogonal_design,
    stiffening,
    voronoi_network,
)
from critflow.design.isogonal_design import _Family


@cache
def critical():
    network = voronoi_network(40, seed=3)
    network = network.with_stiffness(np.random.default_rng(1).uniform(0.5, 2.0, network.n_edges))
    return CriticalManifold(network).configuration(random_stress(network.n_edges, 5))


def area(configuration, face):
    """Area of a face by its corners."""
    faces = configuration.network.faces
    walk = slice(faces.starts[face], faces.starts[face + 1])
    c = np.cumsum(faces.signs[walk, None] * configuration.bond_vectors[faces.edges[walk]], axis=0)
    return 0.5 * np.sum(c[:, 0] * np.roll(c[:, 1], -1) - c[:, 1] * np.roll(c[:, 0], -1))


def test_gradients_are_those_of_central_differences():
    family = _Family(critical(), {"C_B": 1.0, "C_G": 1.0, "length_7": 1.0, "area_3": 1.0, "length_variance": 1.0}, 0.1)
    rng = np.random.default_rng(2)
    a, step = 0.05 * rng.standard_normal((2, family.n_modes))
    h = 1e-4
    up, down, up2, down2 = (family.at(a + n * h * step).constraints for n in (1, -1, 2, -2))
    numeric = (8 * (up - down) - (up2 - down2)) / (12 * h)
    point = family.at(a)
    np.testing.assert_allclose(point.rows(np.arange(len(numeric))) @ step, numeric, rtol=1e-7)


@pytest.mark.parametrize(
    "change",
    [
        {"C_B": 0.04},
        {"C_B": 0.02, "C_G": -0.02},
        {"length_3": 1.0, "area_5": (1.5, 1.6), "length_variance": (0.0, 0.3)},
    ],
    ids=str,
)
def test_targets_are_met_at_the_same_linear_response(change):
    before = critical()
    exact = stiffening(before).value
    targets = {name: x + getattr(exact, name) if name.startswith("C_") else x for name, x in change.items()}
    found = isogonal_design(before, targets)
    assert found.ok and found.stats.residual < 1e-11
    after, response = found.value, stiffening(found.value).value
    for name, x in targets.items():
        if name.startswith("C_"):
            assert getattr(response, name) == pytest.approx(x, rel=1e-9)
    if "length_3" in targets:
        assert after.lengths[3] == pytest.approx(1.0, rel=1e-11)
        assert 1.5 - 1e-11 <= area(after, 5) <= 1.6 + 1e-11
    moduli, same = elasticity(before).value, elasticity(after).value
    assert same.bulk == pytest.approx(moduli.bulk, rel=1e-13)
    assert same.shear == pytest.approx(moduli.shear, rel=1e-11)
    np.testing.assert_allclose(after.lengths, before.lengths + found.amplitudes @ face_modes(before).elongations)
    assert found.distance == pytest.approx(np.sqrt(np.mean(np.log(after.lengths / before.lengths) ** 2)), rel=1e-9)


def test_the_distance_is_that_of_an_optimum():
    before = critical()
    found = isogonal_design(before, {"area_5": 2.0, "area_2": 0.8})
    # At an optimum the gradient of the distance is the sum of those of the targets times their multipliers.
    family = _Family(before, {"area_5": 2.0, "area_2": 0.8}, 0.1)
    point = family.at(found.amplitudes[: family.n_modes] / family.unit)
    multipliers = np.array(list(found.multipliers.values())) * family.scale
    rest = point.gradient - multipliers @ point.rows(np.arange(2))
    assert np.abs(rest).max() < 0.02 * np.abs(point.gradient).max()
    # A multiplier is the derivative of the distance by the target.
    values = [isogonal_design(before, {"area_5": 2.0 + h, "area_2": 0.8}).preference for h in (1e-3, -1e-3)]
    assert np.diff(values)[0] / -2e-3 == pytest.approx(found.multipliers["area_5"], rel=1e-3)


def test_targets_out_of_reach_end_with_a_compromise():
    before = critical()
    least = -elasticity(before).value.bulk / 2
    found = isogonal_design(before, {"C_B": 0.99 * least}, throw=False)
    assert found.status is Status.infeasible
    assert least < found.achieved["C_B"] < stiffening(before).value.C_B
    with pytest.raises(SolveError, match="at least -B_0/2"):
        isogonal_design(before, {"C_B": 1.01 * least})
    with pytest.raises(SolveError, match="relax"):
        isogonal_design(before, {"length_3": 100.0})
    twice = isogonal_design(before, {"length_3": (1.0, 2.0), "length_variance": (0, 1.0)})
    assert twice.ok and twice.independent


def test_the_stiffest_force_network_fixes_its_coefficient():
    network = critical().network
    stiffest = CriticalManifold(network).configuration(network.stiffness)
    bound = bulk_modulus_bound(network)
    with pytest.raises(SolveError, match="every isogonal change") as refusal:
        isogonal_design(stiffest, {"C_B": 0.0})
    assert refusal.value.solution.status is Status.infeasible
    found = isogonal_design(stiffest, {"C_B": (-0.5001 * bound, -0.4999 * bound), "area_1": 1.2})
    assert found.ok and found.achieved["C_B"] == pytest.approx(-bound / 2, rel=1e-9)


def test_other_units_of_length_give_the_same_design():
    before, scale = critical(), 1e-4
    network = before.network.deformed(scale * np.eye(2))
    small = isogonal_design(CriticalManifold(network).configuration(before.sigma), {"length_3": 1e-4, "area_5": 1.5e-8})
    large = isogonal_design(before, {"length_3": 1.0, "area_5": 1.5})
    np.testing.assert_allclose(small.value.lengths, scale * large.value.lengths, rtol=1e-6)


@pytest.mark.parametrize(
    "targets, word",
    [
        ({}, "at least one"),
        ({"colour": 1.0}, "colour"),
        ({"area": 1.0}, "area_0"),
        ({"length_60": 1.0}, "60 edges"),
        ({"area_20": 1.0}, "20 faces"),
        ({"C_B": (2.0, 1.0)}, "low"),
        ({"C_B": np.inf}, "C_B"),
    ],
)
def test_bad_targets_are_refused_in_one_sentence(targets, word):
    with pytest.raises(InputError, match=word):
        isogonal_design(critical(), targets)


def test_bad_configurations_are_refused_in_one_sentence():
    with pytest.raises(InputError, match="two dimensions"):
        network = voronoi_3d()
        isogonal_design(CriticalManifold(network).configuration(np.ones(network.n_edges)), {"C_B": 0.0})
    network = pinned_grid(5)
    with pytest.raises(InputError, match="no isogonal mode"):
        isogonal_design(CriticalManifold(network).configuration(np.ones(network.n_edges)), {"length_0": 1.0})
    with pytest.raises(InputError, match="shortest"):
        isogonal_design(critical(), {"C_B": 0.0}, shortest=5.0)
