"""Onsets of six families of networks against the coordination z = 2 N_b/N_v: certified, and none rises with z."""

import numpy as np
import pytest

from critflow import InputError, Status, delaunay_network, lattice, voronoi_network
from critflow_extras import critical_strain, diluted, fibre_network

FAMILIES = {
    "triangular": lambda z, seed: diluted(lattice("triangular", 7, 7), z, seed),
    "kagome": lambda z, seed: diluted(lattice("kagome", 4, 4), z, seed),
    "phantom": lambda z, seed: fibre_network("phantom", 7, 7, z=z, seed=seed),
    "mikado": lambda z, seed: fibre_network("mikado", 48, z=z, seed=seed),
    "delaunay": lambda z, seed: diluted(delaunay_network(48, seed), z, seed),
    "voronoi": lambda z, seed: diluted(voronoi_network(48, seed), z, seed),
}
# Sparse networks of these families are parts of the denser ones of the same seed.
NESTED = ("triangular", "kagome", "phantom", "delaunay", "voronoi")


def onsets(family, seed, deformation="simple_shear"):
    """Solutions by z of the networks as built, whose rest lengths are their initial lengths; where there are any."""
    found = {}
    for z in (2.6, 3.0, 3.4, 3.8):
        try:
            network = FAMILIES[family](z, seed)
        except InputError:  # the family has no network of this coordination
            continue
        assert 2 * network.n_edges / network.n_vertices == pytest.approx(z, abs=4 / network.n_vertices)
        lengths = np.linalg.norm(network.bond_vectors(network.positions), axis=1)
        found[z] = critical_strain(network, lengths, deformation, throw=False)
    return found


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("deformation", ["simple_shear", "dilation"])
def test_bounds_on_an_onset_meet(family, deformation):
    found = onsets(family, 1, deformation)
    # Of a network that is at its transition as built, rounding decides whether it is rigid there.
    assert found and {one.status for one in found.values()} <= {
        Status.ok,
        Status.rigid,
        Status.floppy,
        Status.undecided,
    }
    for solution in found.values():
        onset = solution.value
        if all(onset.proven):
            assert onset.upper - onset.lower < 1e-9 * (1 + abs(onset.strain))


@pytest.mark.parametrize("family", NESTED)
@pytest.mark.parametrize("seed", [1, 2])
def test_no_onset_rises_with_the_coordination(family, seed):
    rigid = (Status.rigid, Status.undecided)
    strains = [0.0 if one.status in rigid else one.value.strain for one in onsets(family, seed).values()]
    known = np.array(strains)[np.isfinite(strains)]
    assert (np.diff(known) <= 1e-9).all()
