"""The displacement to an exact equilibrium, against the high-precision reference, and where it is refused."""

import numpy as np
import pytest
from problems import NETWORKS, random_stress, strained

from critflow import CriticalManifold, equilibrium, three_bar_linkage, voronoi_network
from critflow.refinement import exact_displacement, inverse_norm
from critflow.sparse import laplacian
from workflows.benchmarks import reference

ROUNDING = np.finfo(float).eps


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-6, 1e-2])
@pytest.mark.parametrize("name", ["voronoi", "voronoi 3D", "pinned grid"])
def test_displacement_to_the_balance_of_a_constant_stress(name, size):
    # With σ fixed the equilibrium is linear, P (x* − x) = f, and any start leads to it.
    network = NETWORKS[name]()
    sigma = random_stress(network.n_edges, 1)
    manifold = CriticalManifold(network)
    x = manifold.configuration(sigma).coordinates.copy()
    x[network.free] += size * np.random.default_rng(2).standard_normal((len(network.free), network.dimension))
    found = exact_displacement(network, x, lambda _: sigma, manifold.prestress.factorize(sigma).solve)
    exact = reference.configuration(network, sigma).coordinates[network.free]
    error = (reference.numbers(x[network.free], found.displacement) - exact).astype(float)
    # The displacement is a double, and its forces are rounded by 2⁻⁷⁷ of the largest.
    rounding = ROUNDING * np.abs(found.displacement).max() + 1e-22
    assert np.abs(error).max() <= found.remainder + rounding
    assert found.remainder <= ROUNDING * np.abs(x).max()
    L = reference.numbers(network.free_incidence.toarray()) @ exact + reference.numbers(network.boundary_vectors)
    assert reference.largest_error(found.bond_vectors, L) <= 4 * ROUNDING * np.abs(found.bond_vectors).max()


@pytest.mark.parametrize("gamma", [1e-3, 0.1, 0.8])
def test_remainder_contains_the_rounding_of_the_tensions(gamma):
    # Past the transition tensions are of order γ, and so are the forces of their roundings.
    state = equilibrium(strained(voronoi_network(16, seed=1), gamma)).value
    found = state.exact_displacement(state.factorize())
    exact = reference.equilibrium(state.network, state.rest_lengths, state.coordinates).coordinates
    end = reference.numbers(state.coordinates[state.network.free_rows], found.displacement)
    error = (end - exact[state.network.free_rows]).astype(float)
    apart = np.abs(error - error.mean(axis=0)).max()
    assert 0.01 * gamma * ROUNDING < apart <= found.remainder < 10 * gamma * ROUNDING


def balanced():
    """A network with its prestress matrix, a stress and the coordinates that it balances."""
    manifold, sigma = CriticalManifold(voronoi_network(40, seed=1)), random_stress(60, 1)
    return manifold.network, manifold.prestress, sigma, manifold.configuration(sigma).coordinates.copy()


def test_corrections_that_do_not_shrink_have_no_bound():
    network, prestress, sigma, x = balanced()
    x[network.free] += 1e-3
    solve = prestress.factorize(sigma).solve
    for gain in (0.1, 2.0, -1.0):
        found = exact_displacement(network, x, lambda _: sigma, lambda f, gain=gain: gain * solve(f))
        assert found.remainder == np.inf, gain


def test_small_corrections_of_a_regularised_matrix_prove_nothing():
    # The displacement is ten roundings; corrections by P + shift are below one because of the shift alone.
    network, prestress, sigma, x = balanced()
    x[network.free] += 1e-14 * np.random.default_rng(2).standard_normal((len(network.free), 2))
    solve = prestress.factorize(sigma, 100.0).solve
    assert np.isfinite(exact_displacement(network, x, lambda _: sigma, solve).remainder)
    assert exact_displacement(network, x, lambda _: sigma, solve, regularised=True).remainder == np.inf


@pytest.mark.parametrize("seed", range(3))
def test_norm_of_an_inverse(seed):
    network = voronoi_network(60, seed=seed)
    factor = laplacian(network).factorize(random_stress(network.n_edges, seed))
    P = factor.multiply(np.eye(len(network.free)))
    exact = 1 / np.linalg.eigvalsh(P)[0]
    once = factor.solve(np.random.default_rng(seed).standard_normal(len(P)))
    assert exact / 3 < inverse_norm(factor, once) <= exact * (1 + 1e-12)
    assert 0 < inverse_norm(factor, np.zeros_like(once)) <= exact * (1 + 1e-12)


def corrections(sizes, regularised, force=1.0, unit=1.0):
    """`exact_displacement` with solves that give corrections of these sizes, and residual forces of a size."""
    network = NETWORKS["voronoi"]()
    sigma, steps = unit * random_stress(network.n_edges, 1), iter(sizes)
    x = CriticalManifold(network).configuration(sigma).coordinates.copy()
    x[network.free] += force * np.random.default_rng(2).standard_normal((len(network.free), 2))

    def solve(forces):
        out = np.zeros_like(forces)
        out[0, 0] = next(steps)
        return out

    return exact_displacement(network, x, lambda _: sigma, solve, regularised), np.abs(x).max() * ROUNDING


def test_corrections_that_do_not_shrink_are_noise_only_at_the_size_of_rounding():
    found, rounding = corrections([1e-3, 1.0], regularised=False)
    assert found.remainder == np.inf
    size = 0.3 * rounding
    for unit in (2.0**-60, 1.0, 2.0**60):
        found, _ = corrections([size, size], False, 1.0, unit)
        assert 2 * size <= found.remainder < 2.1 * size
        assert corrections([size, size], True, 1.0, unit)[0].remainder == np.inf
        # A regularised matrix hides nothing where forces are those of rounding themselves.
        line, sigma = three_bar_linkage(), unit * np.ones(3)
        for force, limit in ((4e-16, np.isfinite), (1e-14, np.isinf)):
            x = CriticalManifold(line).configuration(np.ones(3)).coordinates.copy()
            x[line.free[0], 1] += force
            assert limit(exact_displacement(line, x, lambda _: sigma, lambda f: 1e-20 * (f != 0), True).remainder)  # noqa: B023
    # Two corrections that shrink by half leave half of the last.
    found, rounding = corrections([1e-18, 1e-19], regularised=True)
    assert 5e-20 <= found.remainder < 1e-19
