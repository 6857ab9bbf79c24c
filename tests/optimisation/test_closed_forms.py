"""Optima in closed form: the largest moduli with their bounds and errors."""

import numpy as np
import pytest
from problems import (
    dense_bond_vectors,
    modulus_by_formula,
    oblique,
    square_octagon,
    voronoi_3d,
    with_random_stiffness,
)
from scipy.optimize import linprog, minimize_scalar

from critflow import (
    CriticalManifold,
    SolveError,
    Status,
    lattice,
    optimize,
    upper_bound,
    voronoi_network,
)
from critflow.numerics import EPS
from critflow.optima import largest_modulus
from critflow.quantities import dilation, pure_shear, transition_modulus
from workflows.benchmarks import reference
from workflows.benchmarks.high_precision import MP, dot, numbers
from workflows.shear.compression import least_compressed_length


def bound_of(network, strain):
    """The largest modulus of an affine strain or deformation."""
    held = network.network if isinstance(network, CriticalManifold) else network
    return upper_bound(network, transition_modulus(held, strain))


J = np.array([[0.0, -1.0], [1.0, 0.0]])
NETWORKS = {
    "voronoi": lambda: voronoi_network(100, seed=1),
    "random stiffness": lambda: with_random_stiffness(voronoi_network(40, seed=2), 3),
    "oblique": lambda: oblique(with_random_stiffness(voronoi_network(40, seed=3), 4)),
    "square-octagon": lambda: square_octagon(),
    "honeycomb": lambda: lattice("honeycomb", 4, 4),
}
STRAINS = {
    "dilation": dilation(2),
    "pure shear": pure_shear(2),
    "simple shear": np.array([[0.0, 1.0], [0.0, 0.0]]),
    "uniaxial": np.diag([1.0, 0.0]),
    "any": np.array([[0.3, -0.8], [0.5, 0.1]]),
}


@pytest.mark.parametrize("strain", STRAINS.values(), ids=STRAINS)
@pytest.mark.parametrize("name", NETWORKS)
def test_the_bound_by_its_formula(name, strain):
    network = NETWORKS[name]()
    k, A = network.stiffness, 0.5 * (strain + strain.T)
    L = dense_bond_vectors(network, k)

    def cost(w):
        return np.sum(k[:, None] * (L @ (A + w * J).T) ** 2) / abs(np.linalg.det(network.cell))

    # A parabola in ω: three values give its least one exactly.
    low, middle, high = cost(-1.0), cost(0.0), cost(1.0)
    least = middle - (high - low) ** 2 / (8 * (high + low - 2 * middle))
    assert bound_of(network, strain) == pytest.approx(least, rel=1e-12)
    # An independent minimiser finds no lower one; its error is 1e-8 in ω, so 1e-15 in the value.
    assert minimize_scalar(cost).fun == pytest.approx(least, rel=1e-13)


ATTAINED = [
    (network, strain)
    for network in ("voronoi", "random stiffness", "oblique")
    for strain in ("dilation", "pure shear", "simple shear", "any")
] + [("square-octagon", "dilation"), ("square-octagon", "any"), ("oblique", "uniaxial")]


@pytest.mark.parametrize("name, strain", ATTAINED)
def test_a_configuration_attains_the_bound(name, strain):
    network, strain = NETWORKS[name](), STRAINS[strain]
    solution = largest_modulus(network, strain)
    assert solution.status is Status.ok
    critical, bound = solution.value, bound_of(network, strain)
    # Balance in units of the tensions; the coordinates come from a linear solve of their own.
    assert critical.residual < 1e-12
    np.testing.assert_allclose(
        critical.bond_vectors, network.bond_vectors(critical.coordinates), rtol=0, atol=1e-13 * np.sqrt(network.volume)
    )
    A = 0.5 * (strain + strain.T)
    assert modulus_by_formula(network, critical.sigma, critical.bond_vectors, A) == pytest.approx(bound, rel=1e-12)
    # The stress alone has this configuration, whatever the inertia of its prestress matrix.
    dense = dense_bond_vectors(network, critical.sigma)
    np.testing.assert_allclose(dense, critical.bond_vectors, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "name, strain, status",
    [
        # The forces of a uniaxial strain of an isotropic network are parallel, so nothing closes across them.
        ("honeycomb", "uniaxial", Status.singular),
        # By symmetry links along the axes carry a force at right angles to them, so that they have no length.
        ("square-octagon", "pure shear", Status.edge_collapse),
    ],
)
def test_a_bound_that_is_only_approached_has_no_configuration(name, strain, status):
    network = NETWORKS[name]()
    solution = largest_modulus(network, STRAINS[strain])
    assert solution.status is status
    assert np.isnan(solution.value.coordinates).all()
    assert np.isnan(solution.value.sigma).all()
    assert solution.objective == solution.bound == bound_of(network, STRAINS[strain])
    assert np.isnan(solution.gap)
    with pytest.raises(SolveError, match="no optimum"):
        optimize(network, transition_modulus(network, STRAINS[strain]), signs="any")


@pytest.mark.parametrize("name", ["voronoi", "random stiffness"])
def test_nearly_parallel_forces_close(name):
    solution = largest_modulus(NETWORKS[name](), STRAINS["uniaxial"])
    assert solution.ok and abs(solution.gap) < 1e-10 and solution.value.residual < 1e-12


def modes_of(network, critical):
    """Isogonal modes (n, N_v·2) of a configuration by singular values, directions of its forces, and g."""
    force = critical.sigma[:, None] * critical.bond_vectors
    unit, g = force / np.linalg.norm(force, axis=1)[:, None], network.free_incidence.toarray()
    _, values, right = np.linalg.svd(np.hstack([(unit @ J.T)[:, [axis]] * g for axis in (0, 1)]))
    return right[np.count_nonzero(values > 1e-10) :], unit, g


def test_it_is_the_nearest_of_those_that_attain_the_bound():
    network = voronoi_network(40, seed=5)
    start = dense_bond_vectors(network, network.stiffness)
    near = largest_modulus(network, pure_shear(2)).value
    # Isogonal changes of it attain the bound as well; all lie farther from the configuration at σ = k.
    modes, _, g = modes_of(network, near)
    assert len(modes) == network.n_vertices // 2 - 1
    distance = np.sum((near.bond_vectors - start) ** 2)
    for mode in modes:
        change = g @ mode.reshape(2, -1).T
        # At the nearest configuration the gradient of the distance vanishes in all their directions.
        assert np.sum((near.bond_vectors - start) * change) == pytest.approx(0, abs=1e-11)
        assert np.sum((near.bond_vectors + 0.1 * change - start) ** 2) > distance


@pytest.mark.parametrize("name", ["voronoi", "oblique"])
def test_no_attaining_configuration_has_less_compression(name):
    network = NETWORKS[name]()
    least = least_compressed_length(network, pure_shear(2))
    near = largest_modulus(network, pure_shear(2)).value
    modes, unit, g = modes_of(network, near)
    elongations = modes @ np.hstack([unit[:, [axis]] * g for axis in (0, 1)]).T
    lengths = np.einsum("ad,ad->a", unit, near.bond_vectors)
    # Σ max(−ℓ, 0) of all amplitudes a is convex: least Σ p with p ≥ 0 and p + ℓ + a·E ≥ 0.
    n, m = elongations.shape
    found = linprog(
        np.repeat([0.0, 1.0], [n, m]),
        A_ub=np.hstack([-elongations.T, -np.eye(m)]),
        b_ub=lengths,
        bounds=[(None, None)] * n + [(0, None)] * m,
    )
    assert found.fun == pytest.approx(least, rel=1e-8)


def test_a_dilation_needs_no_compression():
    assert least_compressed_length(voronoi_network(60, seed=1), dilation(2)) == pytest.approx(0, abs=1e-9)


def test_stresses_of_both_signs_keep_their_digits():
    # P has 500 negative eigenvalues here; unrefined, the coordinates are off by 1e-10.
    manifold = CriticalManifold(voronoi_network(1000, seed=1))
    critical = largest_modulus(manifold, pure_shear(2)).value
    again = manifold.solve(critical.sigma)
    assert again.negative_pivots > 400
    np.testing.assert_allclose(again.value.bond_vectors, critical.bond_vectors, rtol=0, atol=2e-11)


def test_three_dimensions_have_the_bound_but_for_dilations_no_configuration():
    network = with_random_stiffness(voronoi_3d(), 1)
    assert bound_of(network, pure_shear(3)) > 0
    assert largest_modulus(network, dilation(3)).gap == pytest.approx(0, abs=1e-13)


# Through optimize


def test_optimize_returns_it_when_compression_is_allowed():
    network = voronoi_network(60, seed=1)
    bound = bound_of(network, pure_shear(2))
    for method in ("auto", "closed_form"):
        solution = optimize(network, "shear_modulus", method, signs="any")
        assert solution.stats.method == "closed_form"
        assert solution.objective == pytest.approx(bound, rel=1e-12)
        assert (solution.value.sigma < 0).any()


@pytest.mark.parametrize("n_vertices", [20, 60, 1000])
def test_the_bound_is_never_below_the_value_that_attains_it(n_vertices):
    """Both are sums that are rounded; README's first example prints them next to each other."""
    for seed in range(12):
        best = optimize(voronoi_network(n_vertices=n_vertices, seed=seed), "B_0")
        assert best.objective <= best.bound <= best.objective * (1 + 1e-12)


# Errors against sixty digits, from both sides, at stiffnesses other than one


SMALL = [with_random_stiffness(voronoi_network(12, seed), seed + 1) for seed in range(4)]


@pytest.mark.parametrize("name", ["modulus[uniaxial]", "G_0"])
def test_the_error_of_a_closed_form_covers_value_and_bound(name):
    for network in SMALL:
        optimum = optimize(network, name, "closed_form", signs="any")
        exact = reference.configuration(network, optimum.value.sigma)
        stress = (exact.sigma[:, None] * exact.bond_vectors).T @ exact.bond_vectors
        energy = (exact.sigma**2 * dot(exact.bond_vectors, exact.bond_vectors) / numbers(network.stiffness)).sum()
        work = stress[0, 0] if "uniaxial" in name else stress[0, 1]
        value = work**2 / (reference.volume(network) * energy)
        rounding = EPS * network.n_edges * optimum.bound
        assert abs(MP.mpf(optimum.objective) - value) <= optimum.objective_error
        # The largest value lies between that of this stress and the bound.
        assert abs(optimum.bound - optimum.objective) + 0.9 * rounding <= optimum.objective_error
        assert optimum.objective_error < 10 * EPS * optimum.stats.condition


@pytest.mark.parametrize("network", SMALL)
def test_the_error_of_the_largest_bulk_modulus_covers_its_value(network):
    optimum = optimize(network, "B_0")
    exact = reference.configuration(network, network.stiffness)
    energy = (numbers(network.stiffness) * dot(exact.bond_vectors, exact.bond_vectors)).sum()
    value = energy / (network.dimension**2 * reference.volume(network))
    assert abs(MP.mpf(optimum.objective) - value) <= optimum.objective_error < 1e-11
