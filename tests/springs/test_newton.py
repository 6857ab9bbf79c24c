"""Newton's method on states that refuse every step: its damping ends, and rounding counts as convergence."""

import numpy as np
import pytest

from critflow import Status
from critflow.equilibria import newton


class Factor:
    indefinite = False

    def solve(self, forces):
        return np.asarray(forces)


class Stuck:
    """A state of constant energy and force, in any unit of stiffness."""

    lengths, length_scale, energy = np.ones(1), 1.0, 1.0

    def __init__(self, force, unit=1.0):
        self.stiffness_scale, self.forces, self.max_force = unit, np.array([[force * unit]]), force * unit
        self.shifts = []

    def taut(self):
        return True

    def moved(self, displacement):
        return self

    def factorize(self, pattern, shift=0.0):
        assert len(self.shifts) < 50
        self.shifts.append(shift)
        return Factor()


@pytest.mark.parametrize("unit", [1.0, 2.0**-40, 2.0**40])
def test_damping_grows_tenfold_until_steps_are_shorter_than_rounding(unit):
    state = Stuck(1.0, unit)
    assert newton(state, 1e-13, 100, None).status is Status.stalled
    shifts = np.array(state.shifts) / unit
    assert shifts[0] == 0
    np.testing.assert_allclose(shifts[1:], 10.0 ** np.arange(-9, 7), rtol=1e-9)


class Relaxing(Stuck):
    """A state whose steps halve the force, after two shifts at which they are refused."""

    def moved(self, displacement):
        if len(self.shifts) < 3:
            return self
        after = Relaxing(0.5 * self.max_force / self.stiffness_scale, self.stiffness_scale)
        after.shifts = self.shifts
        return after


@pytest.mark.parametrize("unit", [1.0, 2.0**-40, 2.0**40])
def test_the_shift_is_never_below_the_least(unit):
    state = Relaxing(1.0, unit)
    end = newton(state, 1e-3, 100, None, 1e-4)
    assert end.status is Status.ok and end.factor is None
    shifts = np.array(state.shifts) / unit
    np.testing.assert_allclose(shifts[:4], [1e-4, 1e-3, 1e-2, 1e-3], rtol=1e-9)
    np.testing.assert_allclose(shifts[4:], 1e-4, rtol=1e-9)


@pytest.mark.parametrize(("force", "tolerance", "ok"), [(9e-14, 1e-14, True), (9e-14, 8e-15, False)])
def test_rounding_within_ten_tolerances_is_convergence(force, tolerance, ok):
    end = newton(Stuck(force), tolerance, 100, None)
    assert end.status is (Status.ok if ok else Status.stalled) and end.steps == 0
