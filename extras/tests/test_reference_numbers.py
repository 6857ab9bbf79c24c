"""Numbers of the literature on underconstrained networks and vertex models, computed again, none of them adjusted."""

import numpy as np
import pytest
from problems import SQRT3
from scipy.optimize import brentq

from critflow import (
    CriticalManifold,
    Deformation,
    Status,
    critical_from_lengths,
    delaunay_network,
    elasticity,
    lattice,
    strain_path,
    voronoi_network,
)
from critflow.engine import stable_rng
from critflow.taut_part import backbone
from critflow_extras import certify, critical_from_perimeters, critical_strain, diluted, fibre_network, pruned
from critflow_extras.anisotropy.tensors import voigt
from critflow_extras.pruning.pruning import carrying_part

SHEAR = Deformation.simple_shear(2)
LENGTH = np.sqrt(4 / (3 * SQRT3))


def shape_index(network):
    found = critical_from_perimeters(network, np.ones(network.faces.n_faces), throw=False)
    assert found.status in (Status.ok, Status.edge_collapse)
    return found.value.shape_index.mean()


def test_critical_shape_index_of_hexagons():
    # The perimeter of the regular hexagon of unit area
    assert shape_index(lattice("honeycomb", 4, 4)) == pytest.approx(np.sqrt(8 * SQRT3), abs=1e-10)


@pytest.mark.sweep
def test_critical_shape_index_of_the_disordered_vertex_model():
    # Bi, Lopez, Schwarz, Manning, Nature Physics 11, 1074 (2015): 3.81
    shapes = [shape_index(voronoi_network(1000, seed)) for seed in range(8)]
    assert np.mean(shapes) == pytest.approx(3.81, abs=0.005)


def least_length(shear):
    """Least length of equal edges of the honeycomb in simple shear, at unit area a vertex."""
    network = lattice("honeycomb", 3, 3)
    scale = np.sqrt(network.n_vertices / network.volume)
    sheared = network.deformed(scale * SHEAR.gradient(shear))
    return critical_from_lengths(sheared, np.ones(network.n_edges)).value.lengths.mean()


def test_least_length_of_the_honeycomb_and_its_growth_with_shear():
    assert least_length(0.0) == pytest.approx(LENGTH, abs=1e-10)
    # ℓ₀ + b γ², b = 3ℓ₀/8, by differences at two strains with the next order removed
    b = [(least_length(h) + least_length(-h) - 2 * least_length(0.0)) / (2 * h**2) for h in (0.01, 0.02)]
    assert (4 * b[0] - b[1]) / 3 == pytest.approx(3 / 8 * LENGTH, abs=1e-6)


def without_shear_stress(network):
    """The network in the sheared cell in which equal lengths are critical without shear stress."""

    def stress(gamma):
        one = critical_from_lengths(network.deformed(SHEAR.gradient(gamma)), np.ones(network.n_edges)).value
        return one.sigma @ (one.bond_vectors[:, 0] * one.bond_vectors[:, 1])

    return network.deformed(SHEAR.gradient(brentq(stress, -0.5, 0.5, xtol=1e-12)))


def test_the_shear_modulus_past_an_onset_is_three_times_the_stress_over_the_strain():
    """Merkel, Baumgarten, Tighe, Manning, PNAS 116, 6560 (2019): (G − G_c) γ_c/σ = 3 for γ_c → 0.

    γ is measured from the cell without shear stress.  Equal lengths that fit the cell sheared by γ_c have this onset.
    """
    network, onsets, ratios = without_shear_stress(voronoi_network(100, seed=0)), np.array([0.05, 0.1]), []
    for onset in onsets:
        critical = critical_from_lengths(network.deformed(SHEAR.gradient(onset)), np.ones(network.n_edges)).value
        strains = 1e-4 * onset * np.array([1.0, 2.0])
        path = strain_path(critical, strains, deformation="simple_shear", taut_only=True).value
        ratio = (path.modulus - elasticity(critical).value.shear) * onset / path.stress[:, 0, 1]
        ratios.append(2 * ratio[0] - ratio[1])
    assert np.polyfit(onsets**2, ratios, 1)[1] == pytest.approx(3.0, abs=0.03)


def as_made(network):
    """Critical under the lengths that the edges are made with."""
    lengths = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    return critical_from_lengths(network, lengths, throw=False)


def phantom_lattice():
    """Under random stress: with the lengths as made, all cables of a straight fibre become taut at once."""
    network = fibre_network("phantom", 10, 10, z=3.4, seed=0)
    stress = np.abs(np.random.default_rng(0).standard_normal(network.n_edges))
    return CriticalManifold(network).solve(stress)


CRITICAL = {
    "honeycomb": lambda: as_made(lattice("honeycomb", 10, 10)),
    "Voronoi": lambda: as_made(voronoi_network(100, seed=0)),
    "Delaunay": lambda: as_made(diluted(delaunay_network(100, seed=0), 3.4, seed=0)),
    "phantom": phantom_lattice,
}


@pytest.mark.parametrize("name", CRITICAL)
def test_the_shear_modulus_grows_in_proportion_to_an_isotropic_tension(name):
    """Lee, Merkel, Soft Matter (2022), doi:10.1039/D2SM00075J; G is the derivative of the energy."""
    found = CRITICAL[name]()
    assert found.status in (Status.ok, Status.slack_edges)
    critical = max(backbone(found.value).components, key=lambda part: part.network.n_edges)
    path = strain_path(critical, np.geomspace(1e-6, 1e-4, 8)).value
    tension = np.einsum("nii->n", path.stress) / 2
    excess = path.shear_modulus - elasticity(critical).value.shear
    assert np.polyfit(np.log(tension), np.log(excess), 1)[0] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_random_networks_have_one_self_stress_at_their_onset_in_shear(seed):
    # Vermeulen, Bose, Storm, Ellenbroek, Phys. Rev. E 96, 053003 (2017)
    network = diluted(delaunay_network(100, seed), 3.4, seed)
    lengths = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
    onset = critical_strain(network, lengths, "simple_shear").value
    assert certify(onset).n_self_stresses == 1


def reflex(faces, bond_vectors):
    """Whether each corner of each face, in the order of its sides, turns by more than a straight angle."""
    side = faces.signs[:, None] * bond_vectors[faces.edges]
    following = np.arange(1, len(side) + 1)
    following[faces.starts[1:] - 1] = faces.starts[:-1]
    after = side[following]
    turn = side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0]
    return turn < -1e-9 * np.linalg.norm(side, axis=1) * np.linalg.norm(after, axis=1)


def poisson(network):
    """(B − G)/(B + G) of the Voigt averages of springs at rest; infinite where nothing resists dilation."""
    found = elasticity(network, network.positions)
    B, G = voigt(found.value)
    return (B - G) / (B + G) if found.ok and B > 1e-6 * G else np.inf


def without(network, edge):
    """The network without an edge, or None if other edges go with it or a face is no longer convex."""
    kept = np.arange(network.n_edges) != edge
    part = carrying_part(network.edges[kept], network.offsets[kept], {}, network.n_vertices)
    if len(part.edges) < network.n_edges - 1:
        return None
    smaller = pruned(network, kept).network
    return None if reflex(smaller.faces, smaller.bond_vectors(smaller.positions)).any() else smaller


def test_reflex_corners():
    network = voronoi_network(20, seed=1)
    assert not reflex(network.faces, network.bond_vectors(network.positions)).any()
    # A vertex at distance from its three neighbours sees them in a half-plane, which leaves a reflex corner.
    moved = network.positions.copy()
    moved[0] += 3.0
    assert reflex(network.faces, network.bond_vectors(moved)).any()


@pytest.mark.sweep
def test_triangular_lattices_pruned_with_convex_faces_become_auxetic():
    """Hagh, Thorpe, Phys. Rev. B 98, 100101 (2018): ν → −1 next to z = 4.

    Each step removes the edge, of ten chosen at random, that leaves the least ν.
    """
    network, rng = lattice("triangular", 6, 6), stable_rng(0, "pruned")
    assert poisson(network) == pytest.approx(1 / 3, rel=1e-12)
    while 2 * (network.n_edges - 2) / network.n_vertices > 4:
        candidates = (without(network, edge) for edge in rng.permutation(network.n_edges))
        convex = [one for one, _ in zip(filter(None, candidates), range(10), strict=False)]
        if not convex:
            break
        network = min(convex, key=poisson)
    assert poisson(network) == pytest.approx(-1.0, abs=0.05)
