"""Moduli of springs at rest against the number of edges, from fewer than motions to many more, in sixty digits."""

import numpy as np
import pytest
from problems import TRIANGULAR_BULK_MODULUS, TRIANGULAR_SHEAR_MODULUS
from references_at_rest import moduli_at_rest

from critflow import Status, elasticity, lattice
from workflows.benchmarks.failure_map.problems import DIFFICULTIES


@pytest.mark.parametrize("extra", DIFFICULTIES["extra_edges"].strengths)
def test_networks_with_fewer_edges_are_floppy_and_the_moduli_of_others_are_within_their_errors(extra, seed=0):
    network = DIFFICULTIES["extra_edges"].problem(extra, seed, 16).network
    # The positions of a Voronoi tessellation have a self-stress.
    generic = network.positions + 0.1 * np.random.default_rng(seed).standard_normal(network.positions.shape)
    found = elasticity(network, generic)
    moduli = found.value.bulk, found.value.shear, found.value.shear_stress_corrected
    if extra <= 0:
        assert found.status is Status.floppy and not np.any(moduli)
        return
    assert found.ok
    bulk, shear = moduli_at_rest(network, generic)
    errors = found.value.errors
    for value, exact, bound in zip(
        moduli, (bulk, shear, shear), (errors.bulk, errors.shear, errors.shear), strict=True
    ):
        assert abs(float(exact - value)) <= bound < 1e-10 * float(bulk)


def test_references_have_the_moduli_of_the_triangular_lattice():
    network = lattice("triangular", 3, 3)
    found = moduli_at_rest(network, network.positions).astype(float)
    np.testing.assert_allclose(found, [TRIANGULAR_BULK_MODULUS, TRIANGULAR_SHEAR_MODULUS], rtol=1e-14)
