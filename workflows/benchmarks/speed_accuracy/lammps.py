"""LAMMPS with the springs of a state: `harmonic` bonds in a periodic box, and minimisers that start from it again."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from critflow.mechanics.springs import SpringState
from critflow.networks.network import Array

from ..timing import peer


def representable(state: SpringState) -> bool:
    """Whether every edge joins nearest images, as LAMMPS takes bonds, in a square box."""
    cell = state.network.cell
    square = cell is not None and np.array_equal(cell, cell[0, 0] * np.eye(2))
    return square and bool(2 * np.abs(state.bond_vectors).max() < cell[0, 0])  # type: ignore[index]


class Lammps:
    """Springs in LAMMPS, silent, with no pair forces; ghosts reach beyond the longest bond."""

    def __init__(self, state: SpringState):
        # The wheel links to the MPI of the package `mpich`, next to the interpreter.
        for library in Path(sys.prefix, "lib").glob("libmpi.so.12"):
            ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
        self._run = peer("lammps").lammps(cmdargs=["-log", "none", "-screen", "none"])
        self._side = float(state.network.cell[0, 0])  # type: ignore[index]
        with TemporaryDirectory() as folder:
            data = Path(folder, "springs.data")
            data.write_text(_data(state, self._side))
            self._run.commands_string(
                f"""units lj
                dimension 2
                atom_style bond
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

    def relax(self, style: str, options: str, max_force: float, most_steps: int) -> tuple[Array, int, float]:
        """Wrapped coordinates (N_v, 2), iterations and the largest force component, from the start."""
        run = self._run
        begin = run.extract_global("ntimestep")
        run.scatter_atoms("x", 1, 3, self._start)
        run.commands_string(
            f"""min_style {style}
            min_modify norm inf {options}
            minimize 0.0 {max_force!r} {most_steps} {10 * most_steps}"""
        )
        x = np.array(run.gather_atoms("x", 1, 3)).reshape(-1, 3)[:, :2]
        return x, run.extract_global("ntimestep") - begin, run.get_thermo("fmax")


def _data(state: SpringState, side: float) -> str:
    """The data file: one type of bond for each edge, because rest lengths differ."""
    network, x = state.network, np.mod(state.coordinates, side)
    springs = enumerate(zip(network.stiffness.tolist(), state.rest_lengths.tolist(), strict=True))
    lines = ["springs", "", f"{len(x)} atoms", f"{network.n_edges} bonds", "1 atom types"]
    lines += [f"{network.n_edges} bond types", "", f"0 {side!r} xlo xhi", f"0 {side!r} ylo yhi", "-1 1 zlo zhi"]
    lines += ["", "Masses", "", "1 1.0", "", "Bond Coeffs", ""]
    lines += [f"{e + 1} {k / 2!r} {rest!r}" for e, (k, rest) in springs]
    lines += ["", "Atoms", ""] + [f"{i + 1} 1 1 {a!r} {b!r} 0.0" for i, (a, b) in enumerate(x.tolist())]
    lines += ["", "Bonds", ""] + [f"{e + 1} {e + 1} {i + 1} {j + 1}" for e, (i, j) in enumerate(network.edges.tolist())]
    return "\n".join(lines) + "\n"
