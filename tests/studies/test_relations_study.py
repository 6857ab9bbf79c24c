"""The study of the relations, small: effective-medium theory by closed forms, theorems on every network."""

import json

import numpy as np
import pytest

from critflow import CriticalManifold, Status, elasticity, upper_bound, voronoi_network
from workflows.relations.medium import LAWS, drawn, gap, gap_of_law, medium, share_of_stress

STUDY = "relations"
THEOREMS = {
    *("shear-growth", "shear-growth-any", "shear-growth-space", "pairs", "growth-curvature", "missing-stiffness"),
    "largest-moduli",
}


def test_every_theorem_holds_on_every_network(dataset, folder):
    claims = {claim["key"]: claim for claim in json.loads((folder / "claims.json").read_text())}
    assert {claims[key]["verdict"] for key in THEOREMS} == {"holds"}
    assert claims["shear-growth-signs"]["verdict"] == "holds"
    solved = dataset.solve_status == Status.ok
    assert (dataset.gap.notnull() == solved).all() and solved.mean() > 0.8
    assert dataset.gap.sel(population="max_B_0").max() < 1e-12
    assert np.isfinite(dataset.C_G_bound.sel(population=["min_V_L", "max_B_0", "random_stress"])).all()


@pytest.mark.parametrize("part", [0.8, 0.9])
def test_the_medium_of_diluted_edges(part):
    """A part p of equal edges at z = 3 has m = 3p − 2, and m = (zp/2 − 1)/(z/2 − 1) in general."""
    sigma = (np.arange(1000) < 1000 * part).astype(float)
    assert medium(sigma) == pytest.approx(3 * part - 2, rel=1e-12)
    assert medium(sigma, 4) == pytest.approx(2 * part - 1, rel=1e-12)


@pytest.mark.parametrize("coordination", [3, 4, 6])
def test_lengths_are_the_derivative_of_the_medium(coordination):
    sigma, change = drawn(np.random.default_rng(1), "exponential", 50) + 0.1, np.zeros(50)
    change[7] = 1e-5
    slope = (medium(sigma + change, coordination) - medium(sigma - change, coordination)) / 2e-5
    x, mean = share_of_stress(sigma, coordination)
    square = 1 / (mean * (x + coordination / 2 - 1) ** 2)
    assert square[7] == pytest.approx(50 * slope, rel=1e-7)
    assert np.sum(sigma * square) == pytest.approx(50 * medium(sigma, coordination), rel=1e-12)
    # B_0 = (Σσ|L|²)²/Σσ²|L|² up to a factor, which is 50 of equal stresses.
    assert gap(sigma, coordination) == pytest.approx(50 * (sigma**2 @ square) / (sigma @ square) ** 2 - 1, rel=1e-12)


def test_predicted_gaps_of_laws():
    """By quadrature elsewhere: half-normal, exponential and log-normal stresses."""
    known = {"half_normal": 0.371, "exponential": 0.478, "uniform": 0.308, "log_normal_0.8": 0.195}
    for law, value in known.items():
        assert gap_of_law(law) == pytest.approx(value, abs=1e-3)
    assert gap_of_law("half_normal", 4) == pytest.approx(0.417, abs=2e-3)
    assert gap(np.ones(10)) == 0


def test_laws_have_their_moments():
    rng = np.random.default_rng(2)
    means = {"half_normal": np.sqrt(2 / np.pi), "exponential": 1.0, "uniform": 0.5, "log_normal_0.4": np.exp(0.08)}
    for law, mean in means.items():
        assert np.mean(drawn(rng, law, 40_000)) == pytest.approx(mean, rel=0.02)
    assert (drawn(rng, "log_normal_2", 100) > 0).all() and set(means) < set(LAWS)


def test_random_stresses_follow_the_theory_network_by_network():
    manifold = CriticalManifold(voronoi_network(400, seed=1))
    largest, apart = upper_bound(manifold, "B_0"), []
    for seed in range(10):
        sigma = drawn(np.random.default_rng(seed), "half_normal", 600)
        measured = largest / elasticity(manifold.configuration(sigma)).value.bulk - 1
        apart.append(measured - gap(sigma))
    # The uneven tension alone, 1/(1 + V_τ), is off by 0.2.
    assert abs(np.mean(apart)) < 0.03
