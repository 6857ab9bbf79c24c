"""One net under loads in three programs: `python -m extras.benchmarks.loaded_net` prints the lines of docs/tools.md.

It needs `pip install compas_fd jax_fdm`.  The net is a square of 30 × 30 meshes between straight edges, 841 free
vertices, with unequal force densities and forces.  Times are processor time, the least of seven; each program gets
arrays, and jax_fdm makes its data structure of them.
"""

import time

import jax
import numpy as np
from compas_fd.solvers import fd_numpy
from jax_fdm.datastructures import FDNetwork
from jax_fdm.equilibrium import fdm

import critflow as cf
import critflow_extras as ce

SIDE = 30


def cable_net():
    """Edges, positions (N_v, 3), fixed vertices, force densities and forces."""
    grid = cf.lattice("square", SIDE + 1, SIDE + 1)
    inner = (grid.offsets == 0).all(axis=1)
    x, y = grid.positions.round().T
    fixed = np.flatnonzero(np.isin(x, (0, SIDE)) | np.isin(y, (0, SIDE)))
    edges = grid.edges[inner & ~np.isin(grid.edges, fixed).all(axis=1)]
    used, edges = np.unique(edges, return_inverse=True)
    edges, fixed = edges.reshape(-1, 2), np.flatnonzero(np.isin(used, fixed))
    places, rng = np.column_stack([x, y, x * y / SIDE])[used], np.random.default_rng(0)
    forces = rng.standard_normal(places.shape)
    forces[fixed] = 0
    return edges, places, fixed, 1 + rng.random(len(edges)), forces


def critflow(edges, x, fixed, q, forces):
    """The network is made and checked."""
    network = cf.Network(edges, pins={v: x[v] for v in fixed})
    return ce.loaded(network, q, forces).value.coordinates


def compas_fd(edges, x, fixed, q, forces):
    found = fd_numpy(vertices=x, fixed=fixed.tolist(), edges=edges, forcedensities=q, loads=forces)
    return np.array(found.vertices)


def jax_fdm(edges, x, fixed, q, forces):
    network = FDNetwork.from_nodes_and_edges(x.tolist(), edges.tolist())
    network.nodes_supports(fixed.tolist())
    for edge, density in zip(edges.tolist(), q, strict=True):
        network.edge_forcedensity(tuple(edge), density)
    for vertex, force in enumerate(forces.tolist()):
        network.node_load(vertex, force)
    found = fdm(network)
    return np.array([found.node_coordinates(v) for v in range(len(x))])


def main():
    """Print a line for each program: its time and largest difference, relative to the first of critflow."""
    jax.config.update("jax_enable_x64", True)
    given = cable_net()
    manifold = cf.CriticalManifold(cf.Network(given[0], pins={v: given[1][v] for v in given[2]}))

    def again(edges, x, fixed, q, forces):
        return ce.loaded(manifold, q, forces).value.coordinates

    exact, unit = critflow(*given), 0.0
    for name, program in (
        ("critflow, the network made anew", critflow),
        ("critflow, one more σ", again),
        ("compas_fd", compas_fd),
        ("jax_fdm", jax_fdm),
    ):
        seconds = []
        for _ in range(8):
            copies = [array.copy() for array in given]  # compas_fd moves the vertices that it gets
            begin = time.process_time()
            found = program(*copies)
            seconds.append(time.process_time() - begin)
        least = min(seconds[1:])
        unit = unit or least
        print(f"| {name} | {1e3 * least:.1f} ms | {least / unit:.2g} | {np.abs(found - exact).max():.0e} |")


if __name__ == "__main__":
    main()
