"""Stiffening coefficients: against strain paths, closed forms, and the high-precision reference."""

from dataclasses import astuple, replace
from functools import partialmethod

import numpy as np
import pytest
from problems import (
    HONEYCOMB_BULK_MODULUS,
    SMALL_NETWORKS,
    UNPINNED,
    bounds_over_errors,
    critical_of,
    random_stress,
    reordered,
    slack_lattice,
    taut_rows,
)
from responses import assert_limit_of_paths

from critflow import (
    CriticalManifold,
    Deformation,
    Hookean,
    Network,
    PowerLaw,
    SpringLaw,
    Status,
    WormLike,
    lattice,
    stiffening,
    strain_path,
    voronoi_network,
)
from critflow.growth import StrainedEnergy, coefficients, strains_of_growth
from critflow.manifold import critical_configuration
from critflow.quantities import dilation, pure_shear
from critflow.saddles import Saddle
from critflow.springs import HOOKEAN
from critflow.taut_part import backbone
from workflows.benchmarks import reference

A, B = np.array([[0.3, 0.8], [-0.2, 0.5]]), np.array([[0.2, -1.0], [0.4, 0.1]])


def curved(gamma, order, omega):
    """F = 1 + sin(ωγ)/ω A + (1 − cos ωγ)/ω² B, and its derivatives."""
    sin, cos = np.sin(omega * gamma), np.cos(omega * gamma)
    if order == 0:
        return np.eye(2) + sin / omega * A + (1 - cos) / omega**2 * B
    return (cos * A + sin / omega * B, -omega * sin * A + cos * B)[order - 1]


LAWS = {"cubic": PowerLaw(3), "power 4.5": PowerLaw(4.5), "worm-like": WormLike(0.4)}


class Mixed(SpringLaw):
    """Two materials: every third edge is worm-like, the others are Hookean."""

    def of_each(self, name, e, rest, k):
        worm_like, hookean = (getattr(law, name)(e, rest, k) for law in (WormLike(0.4), Hookean()))
        return np.where(np.arange(len(e)) % 3 == 0, worm_like, hookean)

    energy, tension = partialmethod(of_each, "energy"), partialmethod(of_each, "tension")
    stiffness, stiffening = partialmethod(of_each, "stiffness"), partialmethod(of_each, "stiffening")


# A network, its law and its path.
GROWTHS = {
    **{name: (name, Hookean(), "dilation") for name in UNPINNED},
    **{f"{law}, {name}": (name, LAWS[law], "dilation") for law in LAWS for name in ("2D, random stiffness", "3D")},
    "a law for each edge": ("2D, random stiffness", Mixed(), "dilation"),
    "simple shear": ("2D, oblique", Hookean(), "simple_shear"),
    "uniaxial": ("2D, random stiffness", Hookean(), "uniaxial"),
    "shrinking": ("2D", Hookean(), -np.eye(2) / 2),
    "uniaxial of a law": ("2D, random stiffness", PowerLaw(4.5), "uniaxial"),
    "curved": ("2D", Hookean(), Deformation("curved", 2, lambda gamma, order: curved(gamma, order, 1.0))),
    "exponential": ("2D", Hookean(), Deformation.exponential(A)),
    "simple shear in space": ("3D", Hookean(), Deformation.simple_shear(3, "yz")),
    "pure shear in space": ("3D, random stiffness", Hookean(), Deformation.pure_shear(3, "xz")),
}


@pytest.mark.parametrize("name", GROWTHS)
def test_exact_stiffening_is_the_limit_of_paths(name):
    case, law, deformation = GROWTHS[name]
    assert_limit_of_paths(critical_of(UNPINNED[case](), 2), deformation, law=law)


@pytest.mark.parametrize("omega", [1.0, 20.0, 1000.0])
@pytest.mark.parametrize("given", [1, 2], ids=["F", "F and its rate"])
def test_errors_of_difference_quotients_are_in_those_of_the_results(omega, given):
    exact = Deformation("curved", 2, lambda gamma, order: curved(gamma, order, omega))
    own = Deformation.path(*(exact.gradient, 2, exact.rate)[: 1 + given])
    critical = critical_of(UNPINNED["2D"](), 2)
    one, other = stiffening(critical, deformation=exact), stiffening(critical, deformation=own)
    apart = np.abs(np.subtract(astuple(one.value), astuple(other.value)))
    errors = np.array(astuple(other.stats.error_bound))
    assert (apart <= errors + astuple(one.stats.error_bound)).all() and errors[6] < 1e-2 * abs(one.value.C)
    for measure in ("moduli", "energy"):
        one, other = (strain_path(critical, [1e-3], path, measure=measure).value for path in (exact, own))
        assert abs(one.modulus - other.modulus) <= one.modulus_error + other.modulus_error
        assert one.modulus_error < other.modulus_error < 1e-4 * abs(one.modulus)


@pytest.mark.parametrize(
    "network, sigma, deformation, status, word",
    [
        # The stress of the honeycomb is isotropic, so that no shear works on it.
        (lattice("honeycomb", 3, 3), 1.0, "simple_shear", Status.floppy, "no work"),
        (voronoi_network(20, seed=1), -1.0, "dilation", Status.unstable, ""),
    ],
    ids=["floppy", "unstable"],
)
def test_paths_without_coefficients_have_a_status(network, sigma, deformation, status, word):
    critical = CriticalManifold(network).configuration(np.full(network.n_edges, sigma))
    solution = stiffening(critical, throw=False, deformation=deformation)
    assert solution.status is status and word in solution.note
    assert np.isnan(astuple(solution.value)).all()


def test_slack_edges_do_not_change_the_coefficients_of_the_taut_part():
    network, _, critical = slack_lattice()
    whole = stiffening(critical, deformation="uniaxial")
    part = backbone(critical)
    assert astuple(whole.value) == astuple(stiffening(part.configuration, deformation="uniaxial").value)
    soft = stiffening(replace(critical, network=network.with_stiffness(0.5)), deformation="uniaxial")
    assert soft.value.C == pytest.approx(0.5 * whole.value.C, rel=1e-11)


def test_coefficients_of_disconnected_taut_parts_add_up():
    # n rows of n springs: E = ½ n² γ² in the volume n²(1 + γ), so that M = 1/(1 + γ).
    solution = stiffening(taut_rows(4), deformation="uniaxial")
    assert (solution.value.modulus_0, solution.value.C) == pytest.approx((1.0, -1.0), rel=1e-12)
    assert solution.value.bulk_0 == pytest.approx(0.25, rel=1e-13)
    across = stiffening(taut_rows(4), throw=False, deformation=np.diag([0.0, 1.0]))
    assert across.status is Status.floppy and "one of 4 taut parts" in across.note


def test_taut_parts_of_which_a_strain_loosens_some_have_a_status():
    """A cable along x and one along y, under a strain that stretches the first."""
    edges, offsets = [[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [1, 3]], [[0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 0]]
    network, x = Network(edges, offsets, 2 * np.eye(2)), np.array([[0, 0], [1, 0], [0.3, 0.2], [0.3, 1.2]])
    crossed = critical_configuration(network, np.array([1.0, 1, 1, 1, 0, 0]), x)
    solution = stiffening(crossed, throw=False, deformation=np.diag([1.0, -1.0]))
    assert solution.status is Status.slack_edges and "loosens others" in solution.note
    assert np.isnan(astuple(solution.value)).all()


@pytest.mark.parametrize("n_cells", [8, 20])
def test_parts_joined_by_slack_edges_have_the_largest_residual_and_the_sum_of_errors(n_cells):
    networks = [voronoi_network(n_cells, seed=seed) for seed in (1, 2)]
    parts = [CriticalManifold(one).configuration(random_stress(one.n_edges, 3)) for one in networks]
    a, b = networks
    slack = np.array([[1, 1 + a.n_vertices], [2, 2 + a.n_vertices]])
    edges, offsets = np.concatenate([a.edges, b.edges + a.n_vertices, slack]), [a.offsets, b.offsets, 0 * slack]
    sigma = np.concatenate([*(part.sigma for part in parts), [0.0, 0.0]])
    coordinates = np.concatenate([part.coordinates for part in parts])
    whole = critical_configuration(Network(edges, np.concatenate(offsets), a.cell), sigma, coordinates)
    found, alone = stiffening(whole), [stiffening(part) for part in backbone(whole).components]
    residuals = [one.stats.residual for one in alone]
    assert found.stats.residual == max(residuals) > 1.5 * min(residuals)
    for total, each in (
        (found.value, [s.value for s in alone]),
        (found.stats.error_bound, [s.stats.error_bound for s in alone]),
    ):
        np.testing.assert_allclose(astuple(total), np.sum([astuple(one) for one in each], axis=0), rtol=1e-14)
    np.testing.assert_allclose(
        astuple(found.value), np.sum([astuple(stiffening(part).value) for part in parts], axis=0), rtol=1e-10
    )


@pytest.mark.parametrize("k", [1.0, 2.5])
def test_stiffening_of_the_honeycomb_in_closed_form(k):
    # All edges stretch alike, E(γ) = N_b E(ℓ√(1 + γ)), so that C_B = ½ B_0 (ℓE'''/k − 1); no shear stretches any.
    network = lattice("honeycomb", 3, 3, edge_length=0.8).with_stiffness(k)
    critical = CriticalManifold(network).configuration(np.ones(network.n_edges))
    shears = []
    for law, steepness in ((Hookean(), 0), (PowerLaw(3), 1), (PowerLaw(5.5), 3.5), (WormLike(0.2), 5)):
        found = stiffening(critical, law=law).value
        assert found.bulk_0 == pytest.approx(k * HONEYCOMB_BULK_MODULUS, rel=1e-12)
        assert found.C_B == pytest.approx(0.5 * found.bulk_0 * (steepness - 1), rel=1e-11, abs=1e-12)
        shears.append(found.C_G)
    np.testing.assert_allclose(shears, shears[0], rtol=1e-12)


def exact_stiffening(network, sigma):
    return reference.stiffening(network, reference.configuration(network, sigma))


@pytest.mark.parametrize("decades", [0, 2, 4])
def test_stiffening_coefficients(decades):
    ratios = []
    for network in (*(make() for make in SMALL_NETWORKS.values()), voronoi_network(12, seed=8)):
        stress = 10 ** (decades * (np.random.default_rng(5).random(network.n_edges) - 0.5))
        sigma = CriticalManifold(network).configuration(stress).sigma
        solutions = [
            stiffening(CriticalManifold(other).configuration(sigma[order])) for other, order in reordered(network)
        ]
        assert {solution.status for solution in solutions} == {Status.ok}
        values, errors = zip(
            *((astuple(s.value)[:5], astuple(s.stats.error_bound)[:5]) for s in solutions), strict=True
        )
        assert np.max(errors) < 1e-10
        ratios += bounds_over_errors(values, errors, exact_stiffening(network, sigma))
    assert np.median(ratios) < 60


@pytest.mark.parametrize("decades", [4, 8, 10, 12])
def test_stiffening_with_a_nearly_collapsed_edge(decades):
    # Two neighbours with weak other edges: the edge between them has a length of 10^−decades.
    network = voronoi_network(16, seed=1)
    stress = 0.5 + np.random.default_rng(3).random(network.n_edges)
    weak = np.isin(network.edges, network.edges[7]).sum(axis=1) == 1
    stress[weak] *= 10.0**-decades
    manifold = CriticalManifold(network)
    critical = manifold.configuration(stress)
    assert critical.lengths.min() < 10.0 ** (1 - decades)
    solution = stiffening(critical, manifold=manifold)
    bounds_over_errors(
        astuple(solution.value)[:5], astuple(solution.stats.error_bound)[:5], exact_stiffening(network, critical.sigma)
    )


def test_stiffnesses_are_those_of_the_manifold():
    network = voronoi_network(40, seed=1)
    critical = CriticalManifold(network).configuration(np.ones(network.n_edges))
    soft = CriticalManifold(network.with_stiffness(0.5 * network.stiffness))
    half, whole = stiffening(critical, manifold=soft).value, stiffening(critical).value
    assert half.bulk_0 == pytest.approx(whole.bulk_0 / 2, rel=1e-12)


def test_stiffening_corrects_inaccurate_coordinates():
    # The stress determines the solution; coordinates are the start of the iteration.
    network = SMALL_NETWORKS["voronoi"]()
    critical = CriticalManifold(network).configuration(random_stress(18, 1))
    x = critical.coordinates + 1e-9 * np.random.default_rng(2).standard_normal((12, 2))
    x[0] = 0.0
    moved = type(critical)(network, critical.sigma, x, network.bond_vectors(x))
    solution = stiffening(moved)
    bounds_over_errors(
        astuple(solution.value)[:5], astuple(solution.stats.error_bound)[:5], exact_stiffening(network, critical.sigma)
    )


@pytest.mark.parametrize("n_vertices", [40, 400])
def test_elastic_responses_balance_to_rounding(n_vertices):
    """The second solve corrects displacements and multipliers of the first."""
    network = voronoi_network(n_vertices, seed=1)
    critical = CriticalManifold(network).configuration(
        np.exp(np.random.default_rng(1).standard_normal(network.n_edges))
    )
    L, sigma = critical.bond_vectors, critical.sigma
    energy = StrainedEnergy(network, sigma, L, Saddle(network), HOOKEAN, [dilation(2), pure_shear(2)])
    for response in energy.responses:
        s = sigma / np.linalg.norm(sigma)
        pulls = s[:, None] * response.rate + response.multipliers[:, None] * L
        size = np.abs(pulls).max()
        assert np.abs(network.divergence @ pulls).max() < 5e-15 * size
        slip = np.sum(L * response.rate, axis=1) - response.amplitude * s * critical.lengths**2
        assert np.abs(slip).max() < 5e-15 * np.abs(response.rate).max()


def test_the_condition_is_the_largest_amplification_of_errors_of_bond_vectors():
    """Σ |∂C/∂L||L| over |C|, from differences of the derivatives of the energy at given bond vectors."""
    network, path = SMALL_NETWORKS["voronoi"](), Deformation.uniaxial(2)
    critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 1))
    strains, saddle, V = strains_of_growth(path), Saddle(network), network.volume

    def thirds(L):
        energy = StrainedEnergy(network, critical.sigma, L, saddle, HOOKEAN, strains)
        values = coefficients(energy, V, path)[0]
        return values[[2, 3, 6]] + values[[0, 1, 5]]  # without the change of the volume, of rate 1

    L, slopes = critical.bond_vectors, np.zeros((3, *critical.bond_vectors.shape))
    for at in np.ndindex(L.shape):
        step = np.zeros(L.shape)
        step[at] = 1e-6
        slopes[:, *at] = (thirds(L + step) - thirds(L - step)) / 2e-6
    growth = thirds(L) - np.array(astuple(stiffening(critical, deformation=path).value))[[0, 1, 5]]
    amplified = np.sum(np.linalg.norm(slopes, axis=2) * critical.lengths, axis=1) / np.abs(growth)
    assert amplified.max() > 2 * amplified.min()
    assert stiffening(critical, deformation=path).stats.condition == pytest.approx(amplified.max(), rel=1e-5)


def test_the_residual_is_the_largest_of_all_strains():
    """A path adds a strain to the dilation and the shear, which are solved for every path."""
    pairs = []
    for make in SMALL_NETWORKS.values():
        network = make()
        critical = CriticalManifold(network).configuration(random_stress(network.n_edges, 1))
        pairs.append([stiffening(critical, deformation=path).stats.residual for path in ("dilation", "uniaxial")])
    of_two, of_three = np.transpose(pairs)
    assert (of_two <= of_three).all() and (of_two < of_three).any()
