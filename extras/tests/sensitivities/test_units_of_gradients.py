"""Values, errors, gradients and extreme values in other units of stiffness and length: the same digits."""

from functools import partial

import numpy as np
import pytest
from problems import NETWORKS, random_stress, voronoi_3d, with_random_stiffness
from units import in_units, same_in_units

from critflow import CriticalManifold, quantity, voronoi_network
from critflow.manifold import StressedBonds
from critflow_extras import properties
from critflow_extras.sensitivities.gradients import by_stiffness

# Quantities of a network, and the power of the unit of stiffness and of length that they have in d dimensions.
POWERS = {
    **dict.fromkeys(("B_0", "G_0", "C_B", "C_G", "modulus[uniaxial]"), lambda d: (1, 2 - d)),
    **dict.fromkeys(("V_L", "V_tau"), lambda d: (0, 0)),
}


def quantities(network, units, signed=False):
    d, manifold = network.dimension, CriticalManifold(network)
    sigma = random_stress(network.n_edges, 1)
    sigma[::6] *= -0.3 if signed else 1
    critical = manifold.configuration(sigma)
    found = properties(critical, list(POWERS))
    one = {}
    for name in POWERS:
        k, length = POWERS[name](d)
        unit, goal = units.stiffness**k * units.length**length, quantity(network, name)
        numbers = (found.values[name], found.errors[name], found.by_stress[name], goal.unit(network))
        one[name] = np.concatenate([np.ravel(value) / unit for value in (*numbers, goal.extreme(manifold, not signed))])
        one[f"{name} by stiffness"] = found.by_stiffness[name] * (units.stiffness / unit)
    return {"number": [*one.values()]}


NETWORK, SPACE = NETWORKS["voronoi, random stiffness"], lambda: with_random_stiffness(voronoi_3d(), 4)
test_quantities_in_other_units = same_in_units(
    {"plane": (quantities, NETWORK), "plane, signed": (partial(quantities, signed=True), NETWORK)}
    | {"space": (quantities, SPACE)},
    rtol=1e-14,
)


@pytest.mark.parametrize(("name", "of_root"), [("B_0", 2), ("V_L", 0), ("V_tau", 0)])
def test_bits_by_stiffness_do_not_depend_on_units(name, of_root):
    """`of_root` is the power of the root of stiffness in the value."""
    network, random = voronoi_network(8, seed=0), np.random.default_rng(0)
    plain, measured = CriticalManifold(network), quantity(network, name)
    # Units of length and roots of those of stiffness.
    units = [(2.0**-20, 2.0**3), (2.0**-3, 2.0**-9), (2.0**5, 2.0), (2.0**13, 2.0**-4), (2.0**20, 1.0)]
    scaled = [CriticalManifold(in_units(network, root**2, length)) for length, root in units]
    # Powers of numbers are off by a last bit once in some thousand cases.
    for n in range(4000):
        sigma, L = 0.3 + random.random(12), random.standard_normal((12, 2))
        (length, root), manifold = units[n % len(units)], scaled[n % len(units)]
        here = by_stiffness(measured, StressedBonds(plain, sigma, L))
        there = by_stiffness(measured, StressedBonds(manifold, root * root * sigma, length * L))
        assert (there == here * root ** (of_root - 2)).all()
