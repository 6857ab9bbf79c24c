"""The study of cut networks, small: certified onsets, and updates that are as accurate as new factorisations."""

import numpy as np
import pytest

from critflow import Status
from studies.topology import fracture

STUDY = "topology"


def test_every_onset_after_a_cut_is_certified_or_the_network_has_come_apart(dataset):
    assert np.isin(dataset.strain_status, [Status.ok, Status.floppy, Status.missing]).all()
    assert (dataset.strain_status == Status.ok).any()


def test_pruned_networks_have_the_largest_modulus_of_their_edges(dataset):
    """At σ = k every pruned network is the stiffest of its edges."""
    np.testing.assert_allclose(dataset.pruned_part, 1, rtol=1e-10)
    assert (dataset.pruned_drift < 1e-10).all()


@pytest.mark.parametrize("law, cut", [("largest", 1), ("smallest", 4)])
def test_of_edges_in_series_the_first_is_cut(law, cut):
    """They have one tension, so that rounding, which depends on the processor, must not choose."""
    for rounding in (-1e-15, 0.0, 1e-15):
        tensions = np.array([1.0, 2.0, 0.0, 2.0 + rounding, 0.5, 0.5 - rounding])
        assert fracture.chosen(tensions, law, None) == cut
