"""The Gaussian curvature against eigenvalues in 60 digits, and where it is infinite."""

import mpmath as mp
import numpy as np
import pytest
from problems import random_stress

from critflow import CriticalManifold, Network, Status, lattice, voronoi_network
from critflow.critical.curvature import principal_curvatures
from critflow.critical.gaussian import gaussian_curvature


def radii(network, sigma):
    """Eigenvalues of −|σ|B but the smallest one, that of σ, in 60 digits."""
    with mp.workdps(60):
        g = mp.matrix(network.free_incidence.toarray().astype(int).tolist())
        b = mp.matrix(network.boundary_vectors.tolist())
        S = mp.diag([mp.mpf(float(s)) for s in sigma])
        inverse = (g.T * S * g) ** -1
        L = b - g * (inverse * (g.T * (S * b)))
        response, size = g * inverse * g.T, mp.norm(mp.matrix([mp.mpf(float(s)) for s in sigma]))
        n, d = network.n_edges, network.dimension
        B = mp.matrix(n, n)
        for i in range(n):
            for j in range(n):
                B[i, j] = size * response[i, j] * mp.fsum(L[i, k] * L[j, k] for k in range(d))
        return sorted(mp.eigsy(B, eigvals_only=True), key=abs)[1:]


def in_cell(network, cell):
    return Network(network.edges, network.offsets, np.asarray(cell, dtype=float))


@pytest.mark.parametrize("cell", [np.diag([1.0, 1.0]), np.diag([100.0, 10_000.0]), [[1e-3, 0.0], [1e-3, 1e-5]]])
@pytest.mark.parametrize("compressed", [0, 3])
def test_log_size_signs_and_bound_in_any_cell(cell, compressed):
    network = in_cell(voronoi_network(6, seed=2), cell)
    sigma = random_stress(network.n_edges, 3)
    sigma[:compressed] *= -0.7
    found = gaussian_curvature(CriticalManifold(network), sigma)
    expected = radii(network, sigma)
    log_size = -float(mp.fsum(mp.log(abs(r)) for r in expected))
    assert abs(found.value.log_size - log_size) < found.stats.residual < 1e-6
    assert found.value.n_negative == sum(r < 0 for r in expected)


@pytest.mark.parametrize(
    "network",
    [lattice("square", 3, 3), lattice("kagome", 2, 2), lattice("triangular", 3, 3), lattice("cubic", 2, 2, 2)],
    ids=["square", "kagome", "triangular", "cubic"],
)
def test_several_self_stresses_make_it_infinite(network):
    manifold, sigma = CriticalManifold(network), np.ones(network.n_edges)
    found = gaussian_curvature(manifold, sigma, throw=False)
    # The kagome lattice has as many edges as coordinates; its lines of edges are stressed independently.
    assert found.status in (Status.singular, Status.ill_conditioned)
    assert not np.isfinite(found.value.log_size)
    sharp = principal_curvatures(manifold, sigma, 3, "sharp", throw=False)
    assert sharp.status is Status.stalled and np.isnan(sharp.value.radii).all()
    assert principal_curvatures(manifold, sigma, 3, "flat").ok


def test_large_networks_with_a_radius_below_the_softness_have_a_status():
    # Lines of edges: one self-stress each.
    network = lattice("square", 24, 24)
    cut = np.ones(network.n_edges, bool)
    cut[:: network.n_edges // 3] = False
    part = Network(network.edges[cut], network.offsets[cut], network.cell)
    found = gaussian_curvature(CriticalManifold(part), np.ones(part.n_edges), throw=False)
    assert found.status is Status.ill_conditioned and np.isnan(found.value.log_size)
