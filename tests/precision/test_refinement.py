"""Error bounds: never below the true errors and close to them; a status where no digits remain.

True errors come from the high-precision reference on the same floating-point input.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy.linalg
from problems import NETWORKS, random_stress, sheared, square_octagon

from critflow import (
    CriticalConfiguration,
    CriticalManifold,
    Network,
    Status,
    critical_from_lengths,
    lattice,
    optimize,
    three_bar_linkage,
    voronoi_network,
)
from critflow.double_double import extended
from critflow.refinement import ExtendedGeometry, Refinement
from critflow.taut_part import backbone
from workflows.benchmarks import reference

NETWORK = voronoi_network(12, seed=1)
PLAIN = lattice("honeycomb", 2, 2)


def wide(p: float, seed: int, network: Network = NETWORK, signed: bool = False) -> np.ndarray:
    """Stresses over 10^±p."""
    rng = np.random.default_rng(seed)
    sigma = 10 ** (p * rng.uniform(-1, 1, network.n_edges))
    return sigma * rng.choice([-1.0, 1.0], network.n_edges) if signed else sigma


def towards_singular(network: Network, distance: float, seed: int) -> np.ndarray:
    """Stresses on a line from positive ones, at a relative distance (< 0: beyond it) from the first singular P."""
    rng = np.random.default_rng(seed)
    start, end = random_stress(network.n_edges, seed), rng.standard_normal(network.n_edges)
    g = network.free_incidence.toarray()
    roots = scipy.linalg.eigvals(g.T @ (start[:, None] * g), -(g.T @ ((end - start)[:, None] * g)))
    first = min(root.real for root in roots if abs(root.imag) < 1e-9 and 0 < root.real < 1)
    return start + first * (1 - distance) * (end - start)


def with_small_edges(decades: float, seed: int) -> np.ndarray:
    """Stresses of which a third is smaller by this number of decades."""
    sigma = random_stress(NETWORK.n_edges, seed)
    sigma[np.random.default_rng(seed).random(NETWORK.n_edges) < 1 / 3] *= 10.0**-decades
    return sigma


def balanced_vertex(distance: float, seed: int) -> np.ndarray:
    """Stresses of both signs whose sum at a vertex nearly vanishes, so that a pivot does."""
    sigma = wide(1.0, seed, signed=True)
    around = np.flatnonzero((NETWORK.edges == 4).any(axis=1))
    sigma[around[0]] = -sigma[around[1:]].sum() * (1 + distance)
    return sigma


def scaled(sigma: np.ndarray) -> np.ndarray:
    """With Σσ² = N_b, as it is stored: the configuration then has no error from the rounding of that scale."""
    return sigma * np.sqrt(len(sigma) / np.sum(sigma**2))


SEEDS = (1, 2, 3)
DIFFICULTIES = {
    **{f"wide {p}": [(NETWORK, wide(p, s)) for s in SEEDS] for p in (0.5, 2, 4, 6, 8, 10, 14, 20)},
    **{f"signed {p}": [(NETWORK, wide(p, s, signed=True)) for s in SEEDS] for p in (0.5, 2, 4, 6, 8, 10)},
    **{
        f"singular {sign}1e-{q}": [(NETWORK, towards_singular(NETWORK, float(f"{sign}1e-{q}"), s)) for s in SEEDS]
        for q in (1, 4, 8, 11, 12, 13, 14, 15, 16)
        for sign in "+-"
    },
    **{f"small edges 1e-{q}": [(NETWORK, with_small_edges(q, s)) for s in SEEDS] for q in (4, 8, 12, 16, 30)},
    **{f"small pivot 1e-{q}": [(NETWORK, balanced_vertex(10.0**-q, s)) for s in SEEDS] for q in (4, 8, 12, 15, 17)},
    **{
        # By symmetry the null vector of P is orthogonal to the forces; only a vector without symmetry detects it.
        f"symmetric 1e-{q}": [
            (square_octagon(), np.array([1.0, 1, 1, 1, -1 + 10.0**-q, 0.7])),
            (three_bar_linkage(), np.array([1, 1, -0.5 * (1 + 10.0**-q)])),
        ]
        for q in (4, 8, 12, 14)
    },
    # An edge from a vertex to an image of itself exerts no force at any stress.
    "own images": [(NETWORKS["own images"](), np.array([1.0, 2, 3, 4, 5, 6, 1e14, 1e17]))],
    "shear": [(sheared(NETWORK, 30.0), random_stress(18, 4))],
    "pins": [(NETWORKS["pinned grid"](), random_stress(24, 4)), (NETWORKS["pinned star"](), random_stress(5, 4))],
    "alike": [(PLAIN, np.ones(PLAIN.n_edges)), (NETWORK, np.full(18, 1e-200)), (NETWORK, np.full(18, -1e200))],
}


def exact_configuration(network: Network, sigma: np.ndarray) -> reference.Configuration:
    return reference.configuration(network, sigma, digits=reference.digits_for(sigma))


@cache
def answers(name: str) -> list:
    """Solutions of a difficulty, each with pairs of true errors and bounds."""
    return [errors_and_bounds(network, sigma) for network, sigma in DIFFICULTIES[name]]


def errors_and_bounds(network: Network, sigma: np.ndarray):
    """The solution, and pairs of true error and bound: of the coordinates, and of each bond vector."""
    solution = CriticalManifold(network).solve(sigma)
    if not solution.ok:
        assert np.isnan(solution.value.coordinates).all()
        assert np.isnan(solution.value.bond_vectors).all()
        return solution, []
    assert solution.value.error_bound == solution.stats.error_bound
    return solution, pairs(solution.value, sigma)


def pairs(value: CriticalConfiguration, sigma: np.ndarray) -> list:
    """Pairs of true error and bound of a configuration, as one of a stress."""
    true = exact_configuration(value.network, sigma)
    off = reference.numbers(value.bond_vectors) - true.bond_vectors
    bonds = zip(reference.lengths(off).astype(float), value.bond_errors, strict=True)
    return [(reference.largest_error(value.coordinates, true.coordinates), value.error_bound), *bonds]


@pytest.mark.parametrize("name", DIFFICULTIES)
def test_no_error_exceeds_its_bound(name):
    for solution, found in answers(name):
        # The bounds hold for the given stress, and for the stored one, whose scale is rounded.
        stored = pairs(solution.value, solution.value.sigma) if solution.ok else []
        for error, bound in found + stored:
            assert error <= bound


def test_bounds_are_close():
    """Of stresses that are scaled: the last rounding is nearly all; of others, the rounding of the scale as well."""
    ratios, rescaled = [], []
    for name in DIFFICULTIES:
        for (network, _), (solution, found) in zip(DIFFICULTIES[name], answers(name), strict=True):
            # An error of 1e-60 is zero: the reference has 60 digits.
            rescaled += [bound / error for error, bound in found if error > 1e-30 * bound]
            scaled = errors_and_bounds(network, solution.value.sigma)[1]
            assert all(error <= bound for error, bound in scaled)
            ratios += [bound / error for error, bound in scaled if error > 1e-30 * bound]
    assert np.median(rescaled) < 5
    assert len(ratios) > 1000
    # The error is mostly the last rounding, which is known.
    assert np.median(ratios) < 1.1
    assert np.quantile(ratios, 0.9) < 100


# Beyond these strengths the condition of P exceeds double precision.
ILL_CONDITIONED = ["wide 10", "wide 14", "wide 20", "signed 10", "small edges 1e-16", "small edges 1e-30"]
ILL_CONDITIONED += ["symmetric 1e-14"]
ILL_CONDITIONED += [f"singular {sign}1e-{q}" for q in (13, 14, 15, 16) for sign in "+-"]


@pytest.mark.parametrize("name", [name for name in DIFFICULTIES if name not in ILL_CONDITIONED])
def test_well_conditioned_stresses_are_solved(name):
    assert [solution.status for solution, _ in answers(name)] == [Status.ok] * len(answers(name))


@pytest.mark.parametrize("name", ILL_CONDITIONED)
def test_ill_conditioned_stresses_have_a_status(name):
    statuses = {solution.status for solution, _ in answers(name)}
    assert statuses <= {Status.ok, Status.ill_conditioned, Status.singular}
    if name in ("singular +1e-16", "singular -1e-16", "symmetric 1e-14", "wide 20"):
        assert statuses != {Status.ok}


def test_unstressed_vertex_is_singular():
    sigma = np.ones(NETWORK.n_edges)
    sigma[(NETWORK.edges == 5).any(axis=1)] = 0.0
    solution = CriticalManifold(NETWORK).solve(sigma)
    assert solution.status is Status.singular
    assert np.isnan(solution.stats.error_bound)


def test_short_edges_have_small_relative_errors():
    # An edge of stress 10⁹ is about 10⁻⁹ long; its digits are not lost in the coordinates, which are larger.
    sigma = random_stress(18, 2)
    sigma[7] = 1e9
    sigma = scaled(sigma)
    value = CriticalManifold(NETWORK).configuration(sigma)
    assert value.lengths[7] < 1e-8
    assert value.bond_errors[7] < 3e-16 * value.lengths[7]
    true = exact_configuration(NETWORK, sigma).bond_vectors[7]
    assert reference.largest_error(value.bond_vectors[7], true) < 3e-16 * value.lengths[7]


@pytest.mark.parametrize("signed", [False, True])
def test_condition_is_skeels(signed):
    sigma = wide(1.0, 5, signed=signed)
    solution = CriticalManifold(NETWORK).solve(sigma)
    g = NETWORK.free_incidence.toarray()
    inverse = np.abs(np.linalg.inv(g.T @ (sigma[:, None] * g)))
    # The library bounds |P| by twice its diagonal of |σ|.
    skeel = (inverse @ (2 * np.abs(g).T @ np.abs(sigma))).max()
    if signed:
        assert skeel / 10 < solution.stats.condition <= skeel * (1 + 1e-9)
    else:
        assert solution.stats.condition == pytest.approx(skeel, rel=1e-9)


def test_wrong_factor_is_refined_or_rejected():
    # A factor of another stress contracts errors slowly or not at all; the proof does not depend on it.
    sigma = random_stress(18, 6)
    manifold, geometry = CriticalManifold(NETWORK), ExtendedGeometry(NETWORK)
    true = exact_configuration(NETWORK, sigma)
    for distance in (0.0, 1e-6, 1e-2, 0.3, 3.0, 30.0):
        other = sigma * (1 + distance * np.random.default_rng(1).random(18))
        start = manifold.balance(other)
        refined = Refinement(geometry, extended(sigma), start.factor, start.coordinates)
        assert refined.certain == (distance < 1)
        if refined.certain:
            assert reference.largest_error(refined.x, true.coordinates[NETWORK.free]) <= refined.error
            assert refined.error < 1e-15
            assert reference.largest_error(refined.L, true.bond_vectors) < 3e-16


@pytest.mark.parametrize("spread, seed", [(0.0, 0), (0.05, 1), (0.1, 2), (0.3, 0)])
def test_coordinates_from_lengths_are_within_the_bound(spread, seed):
    # At a spread of 0.3 an edge is nearly slack, and errors are a hundred times larger.
    lengths = 1 + spread * np.random.default_rng(seed).standard_normal(18)
    network = voronoi_network(12, seed=seed)
    solution = critical_from_lengths(network, lengths)
    value = solution.value
    true = reference.critical_from_lengths(network, lengths, value.sigma, value.coordinates)
    error = reference.largest_error(value.coordinates, true.coordinates)
    assert error <= solution.stats.error_bound < 10 * error
    assert np.isfinite(solution.stats.condition)


MADE = {
    "given": lambda network: CriticalManifold(network).configuration(random_stress(network.n_edges, 3)),
    "least length variance": lambda network: optimize(network, "V_L").value,
    "least tension variance": lambda network: optimize(network, "V_tau", tolerance=1e-6).value,
    "lengths": lambda network: critical_from_lengths(network, np.linspace(0.9, 1.1, network.n_edges)).value,
}


@pytest.mark.parametrize("maker", MADE)
def test_bounds_hold_for_the_stored_stress(maker):
    for seed in range(3):
        value = MADE[maker](voronoi_network(16, seed=seed))
        found = pairs(value, value.sigma)
        assert all(error <= bound for error, bound in found)
        assert found[0][1] < 100 * found[0][0]


def test_bounds_hold_for_the_stored_stress_of_a_taut_part():
    for seed in range(4):
        lengths = np.random.default_rng(seed).uniform(0.2, 1.8, 30)
        whole = critical_from_lengths(voronoi_network(20, seed=1), lengths, throw=False).value
        found = backbone(whole)
        part, stored = found.configuration, whole.sigma[found.taut]
        assert found.n_slack > 0 and np.sum(stored**2) == pytest.approx(30, rel=1e-14)
        as_stored = replace(
            part, bond_vectors=whole.bond_vectors[found.taut], bond_errors=whole.bond_errors[found.taut]
        )
        compared = pairs(part, part.sigma) + pairs(as_stored, stored)[1:]
        assert all(error <= bound for error, bound in compared)
        assert max(bound for _, bound in compared) < 1e-14


def test_slack_edges_have_no_bounds():
    lengths = np.random.default_rng(0).uniform(0.2, 1.8, 60)
    solution = critical_from_lengths(voronoi_network(40, seed=1), lengths, throw=False)
    assert solution.status is Status.slack_edges
    assert np.isnan(solution.stats.error_bound)
    slack = solution.value.sigma == 0
    assert np.isnan(solution.value.bond_errors[slack]).all()
    assert (solution.value.bond_errors[~slack] < 1e-15).all()
