"""Newton's method on states that refuse every step: its damping ends, and rounding counts as convergence."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from critflow import Network, Status, equilibrium, spring_state
from critflow.equilibria import newton
from critflow.springs import SpringState

UNITS = pytest.mark.parametrize("unit", [1.0, 2.0**-40, 2.0**40])


@dataclass(frozen=True, eq=False, repr=False)
class Stuck(SpringState):
    """Springs under tension that no step moves, with the shifts of their factors."""

    shifts: list[float] = field(default_factory=list, kw_only=True)

    def moved(self, displacement):
        return self

    def factorize(self, shift=0.0):
        assert len(self.shifts) < 50
        self.shifts.append(shift / self.stiffness_scale)
        return super().factorize(shift)


class Late(Stuck):
    """Springs that half of each step moves, after two shifts at which they are refused."""

    def moved(self, displacement):
        return SpringState.moved(self, 0.5 * displacement) if len(self.shifts) >= 3 else self


class Almost(Stuck):
    """Springs whose force is a few roundings."""

    @property
    def max_force(self):
        return 9e-14 * self.stiffness_scale * self.length_scale


def chain(kind, unit=1.0):
    """A vertex between two pins, off the middle, whose springs are under tension."""
    network = Network([[0, 1], [1, 2]], pins={0: [0, 0], 2: [2, 0]}, stiffness=np.full(2, unit))
    springs = spring_state(network, [0.5, 0.5], [[0, 0], [1.2, 0], [2, 0]])
    return kind(springs.network, springs.rest_lengths, springs.coordinates, springs.bond_vectors)


@UNITS
def test_damping_grows_tenfold_until_steps_are_shorter_than_rounding(unit):
    state = chain(Stuck, unit)
    assert equilibrium(state, throw=False).status is Status.stalled
    assert state.shifts[0] == 0
    np.testing.assert_allclose(state.shifts[1:], 10.0 ** np.arange(-9, 7), rtol=1e-9)


@UNITS
def test_the_shift_is_never_below_the_least(unit):
    state = chain(Late, unit)
    end, factor = newton(state, 1e-3, 100, 1e-4)
    assert end.ok and factor is None and end.stats.steps > 5
    np.testing.assert_allclose(state.shifts[:4], [1e-4, 1e-3, 1e-2, 1e-3], rtol=1e-9)
    np.testing.assert_allclose(state.shifts[4:], 1e-4, rtol=1e-9)


@pytest.mark.parametrize(("tolerance", "ok"), [(1e-14, True), (8e-15, False)])
def test_rounding_within_ten_tolerances_is_convergence(tolerance, ok):
    end, _ = newton(chain(Almost), tolerance, 100)
    assert end.status is (Status.ok if ok else Status.stalled) and end.stats.steps == 0
