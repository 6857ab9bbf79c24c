"""Networks in other units of stiffness and length: numbers change by powers of these units and by nothing else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

# Units of stiffness and length: powers of two, so that products with them are exact.
UNITS = [(2.0**-40, 1.0), (2.0**30, 1.0), (1.0, 2.0**-21), (2.0**-18, 2.0**21)]


def in_units(network, stiffness, length):
    scaled = network.deformed(length * np.eye(network.dimension))
    return scaled.with_stiffness(stiffness * network.stiffness)


@dataclass(frozen=True)
class Units:
    """A unit of stiffness and one of length, with those of the numbers that follow from them."""

    stiffness: float = 1.0
    length: float = 1.0

    def __str__(self):
        return "plain" if self == PLAIN else f"unit of length {self.length:g}"

    number = one = 1.0
    area = property(lambda self: self.length**2)
    force = property(lambda self: self.stiffness * self.length)
    energy = property(lambda self: self.stiffness * self.length**2)
    pressure = property(lambda self: self.stiffness / self.length)  # stress and moduli in space, in the plane stiffness
    softness = property(lambda self: 1 / self.stiffness)
    compliance = property(lambda self: 1 / self.pressure)

    def network(self, network):
        return in_units(network, self.stiffness, self.length)


# Both ways, since a tolerance may be too small or too large.
PLAIN, SCALED, INVERSE = Units(), Units(2.0**-18, 2.0**21), Units(2.0**40, 2.0**-21)


def same_in_units(table, rtol=0.0, others=(SCALED, INVERSE)):
    """A test of every row of a table: results are the same in other units, to the last bit.

    table   a function of a network and units, whose results it names by unit, and a function that makes the network
    rtol    of results with roots of volumes, which round
    others  units; linear programs need large lengths, since their solver has an absolute tolerance of 1e-7
    """

    @pytest.mark.parametrize("name", table)
    def test(name):
        measured, make = table[name]
        plain = measured(make(), PLAIN)
        for units in others:
            scaled = measured(units.network(make()), units)
            for unit, values in plain.items():
                for n, (value, other) in enumerate(zip(values, scaled[unit], strict=True)):
                    if value is None or isinstance(value, str):
                        assert other == value
                    else:
                        other = np.asarray(other) / getattr(units, unit)
                        np.testing.assert_allclose(other, value, rtol=rtol, atol=0, err_msg=f"{unit} {n}")

    return test
