"""One cable net in four programs: what each gives, in how many lines and in which time.

`python -m workflows.benchmarks.same_network` prints the table of docs/tools.md; it needs `pip install compas_fd jax_fdm
pyrigi`.  The net is a square grid without the bars of its border, whose ends are fixed, with unequal force densities.
The lines are those of each function below, without its first two.
"""

from __future__ import annotations

import inspect
import time

import jax
import numpy as np
from compas_fd.solvers import fd_numpy
from jax_fdm.datastructures import FDNetwork
from jax_fdm.equilibrium import fdm
from pyrigi import Framework, Graph

import critflow as cf

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


def pyrigi(edges, x, fixed, q):
    """flexes and self-stresses of the framework without supports"""
    framework = Framework(Graph(edges.tolist()), dict(enumerate(x[:, :2].tolist())))
    return framework.is_inf_rigid(numerical=True)


def main():
    """Print a row for each program: its best time of twenty, after a first call."""
    jax.config.update("jax_enable_x64", True)
    net = cable_net()
    exact = critflow(*net)
    for program in (critflow, compas_fd, jax_fdm, pyrigi):
        seconds = []
        for _ in range(21):
            begin = time.perf_counter()
            found = program(*net)
            seconds.append(time.perf_counter() - begin)
        error = f"{np.abs(found - exact).max():.0e}" if program in (compas_fd, jax_fdm) else ""
        lines = len(inspect.getsource(program).splitlines()) - 2
        print(f"| {program.__name__} | {program.__doc__} | {lines} | {1e3 * min(seconds[1:]):.1f} ms | {error} |")


if __name__ == "__main__":
    main()
