"""LAMMPS with the springs of a state: `harmonic` bonds in a periodic cell, and minimisers that start from it again."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from critflow import write_network
from critflow.networks.network import Array
from critflow.springs.state import SpringState

from .timing import peer


def representable(state: SpringState) -> bool:
    """Whether every edge joins nearest images, as LAMMPS takes bonds, in a square box."""
    cell = state.network.cell
    square = cell is not None and np.array_equal(cell, cell[0, 0] * np.eye(2))
    return square and bool(2 * np.abs(state.bond_vectors).max() < cell[0, 0])  # type: ignore[index]


class Lammps:
    """Springs of a plane state in LAMMPS, silent, without pair forces; ghosts reach beyond the longest bond.

    The first cell vector is along x, as in a cell under simple shear, so that coordinates are not turned.
    """

    def __init__(self, state: SpringState):
        # The wheel links to the MPI of the package `mpich`, next to the interpreter.
        for library in Path(sys.prefix, "lib").glob("libmpi.so.12"):
            ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
        self._run = peer("lammps").lammps(cmdargs=["-log", "none", "-screen", "none"])
        with TemporaryDirectory() as folder:
            data = Path(folder, "springs.data")
            write_network(state, data)
            self._run.commands_string(
                f"""units lj
                dimension 2
                atom_style molecular
                atom_modify map array
                bond_style harmonic
                comm_modify cutoff {1.2 * float(state.lengths.max()) + 0.3!r}
                read_data {data}
                fix plane all enforce2d
                thermo 100000000
                thermo_modify norm no"""
            )
        start = np.array(self._run.gather_atoms("x", 1, 3))
        self._start = (ctypes.c_double * len(start))(*start)

    def relax(
        self, style: str, options: str, max_force: float, most_steps: int, time_step: float = 0.005
    ) -> tuple[Array, int, float]:
        """Wrapped coordinates (N_v, 2), iterations and the largest force component, from the start.

        time_step  the first one of FIRE, which may grow tenfold; the default is that of LAMMPS
        """
        run = self._run
        begin = run.extract_global("ntimestep")
        run.scatter_atoms("x", 1, 3, self._start)
        run.commands_string(
            f"""timestep {time_step!r}
            min_style {style}
            min_modify norm inf {options}
            minimize 0.0 {max_force!r} {most_steps} {10 * most_steps}"""
        )
        x = np.array(run.gather_atoms("x", 1, 3)).reshape(-1, 3)[:, :2]
        return x, run.extract_global("ntimestep") - begin, run.get_thermo("fmax")

    @property
    def energy(self) -> float:
        """Energy at the present coordinates."""
        return float(self._run.get_thermo("pe"))

    def close(self) -> None:
        """End LAMMPS."""
        self._run.close()
