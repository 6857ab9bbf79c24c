"""The onset of rigidity by its name among the quantities."""

import pytest

from critflow import InputError, lattice, optimize, quantity
from critflow.quantities import names


def test_onsets_are_named():
    network = lattice("honeycomb", 2, 2)
    assert quantity(network, "onset[uniaxial]").name == "onset[uniaxial]"
    assert "onset[simple_shear]" in names(network)


@pytest.mark.parametrize("method", ["auto", "newton"])
def test_an_onset_is_no_quantity_of_a_stress(method):
    with pytest.raises(InputError, match="rest_lengths"):
        optimize(lattice("honeycomb", 2, 2), "onset[simple_shear]", method)
