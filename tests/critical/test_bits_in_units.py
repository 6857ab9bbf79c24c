"""Values and partial derivatives have the same bits in other units: scalars are squared by products."""

import numpy as np
import pytest
from units import in_units

from critflow import CriticalManifold, quantity, voronoi_network
from critflow.quantities import StressedBonds

NETWORK = voronoi_network(8, seed=0)
PLAIN = CriticalManifold(NETWORK)
# Units of length and roots of those of stiffness.
UNITS = [(2.0**-20, 2.0**3), (2.0**-3, 2.0**-9), (2.0**5, 2.0), (2.0**13, 2.0**-4), (2.0**20, 1.0)]
SCALED = [CriticalManifold(in_units(NETWORK, root**2, length)) for length, root in UNITS]
# Powers of length and of √stiffness in the values.
POWERS = {"B_0": (0, 2), "V_L": (0, 0), "V_tau": (0, 0)}


@pytest.mark.parametrize("name", POWERS)
def test_bits_do_not_depend_on_units(name):
    random, (of_length, of_root), measured = np.random.default_rng(0), POWERS[name], quantity(NETWORK, name)
    # Powers of numbers are off by a last bit once in some thousand cases.
    for n in range(4000):
        sigma, L = 0.3 + random.random(12), random.standard_normal((12, 2))
        (length, root), manifold = UNITS[n % len(UNITS)], SCALED[n % len(UNITS)]
        stiffness, unit = root * root, length**of_length * root**of_root
        here, there = StressedBonds(PLAIN, sigma, L), StressedBonds(manifold, stiffness * sigma, length * L)
        value, (by_sigma, by_L) = measured.evaluate(here)
        other, (other_by_sigma, other_by_L) = measured.evaluate(there)
        assert other == value * unit
        assert (other_by_sigma == by_sigma * (unit / stiffness)).all()
        assert (other_by_L == by_L * (unit / length)).all()
