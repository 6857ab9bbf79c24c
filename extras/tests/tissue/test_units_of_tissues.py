"""Critical tissues in other units of length, and perimeters in units of their own."""

import numpy as np
import pytest
from units import INVERSE, SCALED, Units, same_in_units

from critflow import Status, stiffening, voronoi_network
from critflow_extras import critical_from_perimeters


def perimeters(spread):
    return np.exp(spread * np.random.default_rng(1).standard_normal(20))


def fitted(network, units, spread=0.02):
    found = critical_from_perimeters(network, units.length * perimeters(spread), throw=False)
    ends = (found.status, found.note, found.slack_faces, found.collapsed_edges, found.stats.residual, found.ratio)
    critical = found.value.configuration
    return {"number": (*ends, critical.sigma, found.value.face_tensions), "length": (critical.coordinates,)}


def stiffened(network, units):
    stiffness = units.stiffness * np.random.default_rng(2).uniform(0.5, 2.0, 20)
    tissue = critical_from_perimeters(network, units.length * perimeters(0.02), stiffness=stiffness).value
    found = stiffening(tissue, deformation="simple_shear")
    value, bound = found.value, found.stats.error_bound
    return {"number": (found.status,), "stiffness": (value.C, value.C_B, bound.modulus_0, bound.C)}


def network():
    return voronoi_network(40, seed=2)


FAR = [SCALED, INVERSE, Units(length=2.0**-40), Units(length=2.0**13), Units(length=2.0**40)]
test_tissues_in_other_units = same_in_units(
    {
        "in tension": (fitted, network),
        "slack": (lambda net, units: fitted(net, units, 0.3), network),
        "stiffening": (stiffened, network),
    },
    others=FAR,
)


@pytest.mark.parametrize("exponent", [-40, -3, 13, 40])
def test_perimeters_in_units_of_their_own(exponent):
    unit = 2.0**exponent
    here, other = (critical_from_perimeters(network(), u * perimeters(0.02)) for u in (1.0, unit))
    assert here.status is other.status is Status.ok and other.ratio * unit == here.ratio
    np.testing.assert_array_equal(other.value.configuration.coordinates, here.value.configuration.coordinates)
