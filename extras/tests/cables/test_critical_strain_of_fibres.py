"""Onset of rigidity of fibres and packings: weak tensions, and slack chains as straight as taut ones."""

import numpy as np
import pytest
from onsets import check

from critflow import SolveError, Status, critical_from_lengths
from critflow_extras import critical_strain, fibre_network, packing_network, rigidity_surface


def as_built(n_vertices, z, seed):
    network = fibre_network("mikado", n_vertices, z=z, seed=seed)
    return network, np.linalg.norm(network.bond_vectors(network.positions), axis=1)


@pytest.mark.parametrize("seed, deformation", [(2, "simple_shear"), (4, "uniaxial"), (10, "simple_shear")])
def test_straight_fibres_with_weak_tensions(seed, deformation):
    # Crossings hardly deflect straight fibres: tensions down to 1e-8 of the mean are not those of slack edges, and
    # rounding of the shortest edges does not decide on the bounds.
    network, lengths = as_built(60, 3.7, seed)
    check(critical_strain(network, lengths, deformation), lengths)


def test_stresses_that_stay_unresolved_are_reported():
    network, lengths = as_built(60, 3.7, 0)
    onset = critical_strain(network, lengths, "uniaxial", throw=False)
    assert onset.status is Status.stalled
    assert all(onset.value.proven)
    assert onset.value.upper - onset.value.lower < 1e-10
    assert "weakest" in onset.note
    # The strain and its bounds are known all the same.
    with pytest.raises(SolveError, match="known"):
        critical_strain(network, lengths, "uniaxial")
    surface = rigidity_surface(network, lengths, np.diag([1.0, 0.0])[None])
    assert surface.found.all() and surface.strains[0] == onset.value.strain


def test_slack_chains_as_straight_as_taut_ones_do_not_widen_the_bounds():
    # Cone programs place the middle of such a chain to 1e-9 only.
    network = packing_network(300, z=3.2, seed=3)
    one = np.ones(network.n_edges)
    lengths = 1.02 * critical_from_lengths(network, one, throw=False).ratio * one
    onset = critical_strain(network, lengths, "simple_shear")
    assert all(onset.value.proven) and onset.value.upper - onset.value.lower < 1e-11
