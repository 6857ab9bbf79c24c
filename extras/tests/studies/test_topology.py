"""The study of cut networks, small: certified onsets, and updates that are as accurate as new factorisations."""

import numpy as np

from critflow import Status

STUDY = "topology"


def test_every_onset_after_a_cut_is_certified_or_the_network_has_come_apart(dataset):
    assert np.isin(dataset.strain_status, [Status.ok, Status.floppy, Status.missing]).all()
    assert (dataset.strain_status == Status.ok).any()


def test_pruned_networks_have_the_largest_modulus_of_their_edges(dataset):
    """At σ = k every pruned network is the stiffest of its edges."""
    np.testing.assert_allclose(dataset.pruned_part, 1, rtol=1e-10)
    assert (dataset.pruned_drift < 1e-10).all()
