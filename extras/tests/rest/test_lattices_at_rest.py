"""Moduli of regular lattices at rest against closed forms."""

import pytest
from lattices import CASES, LATTICES

from critflow import elasticity, lattice


@pytest.mark.parametrize("name, size", CASES)
@pytest.mark.parametrize("edge_length", [1.0, 0.4])
def test_moduli_of_lattices(name, size, edge_length):
    *_, bulk, shear = LATTICES[name]
    network = lattice(name, *size, edge_length=edge_length)
    unit = edge_length ** (2 - network.dimension)
    found = elasticity(network, network.positions).value
    assert found.bulk == pytest.approx(bulk * unit, rel=1e-12)
    assert found.shear == pytest.approx(shear * unit, rel=1e-12, abs=1e-14)
