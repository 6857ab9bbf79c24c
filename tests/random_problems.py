"""Random valid networks for the fuzzer, and changes of description that must not change an answer.

Everything is drawn through the methods of `random.Random`, which Hypothesis can replace by draws that it shrinks.
"""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

import numpy as np
import problems

from critflow import CritflowError, CriticalManifold, Network, lattice, three_bar_linkage, voronoi_network

MOST_VERTICES = 8


@dataclass(frozen=True, eq=False)
class Problem:
    """A network and a positive stress (N_b,)."""

    network: Network
    sigma: np.ndarray

    @property
    def scale(self) -> float:
        """The unit of length."""
        network = self.network
        if network.cell is not None:
            return float(np.abs(network.cell).max())
        return float(np.abs(list(network.pins.values())).max())


def numbers(random: Random, *shape: int) -> np.ndarray:
    """Numbers between −1 and 1 with few digits, which shrink to simple ones."""
    flat = [random.randint(-64, 64) / 64 for _ in range(int(np.prod(shape)))]
    return np.array(flat).reshape(shape)


def magnitudes(random: Random, n: int, decades: float) -> np.ndarray:
    """Positive numbers (n,) over this number of decades."""
    return 10.0 ** (decades * (numbers(random, n) + 1) / 2)


def a_cell(random: Random, d: int) -> np.ndarray:
    """Cell vectors (d, d), of unit size, anisotropic, sheared or both."""
    cell = np.diag(magnitudes(random, d, random.choice([0, 0, 1, 4])))
    if random.random() < 0.5:
        cell = cell @ (np.eye(d) + np.triu(random.choice([1, 8]) * numbers(random, d, d), 1))
    return cell


def any_array(random: Random, values: np.ndarray) -> object:
    """The same values with another dtype, memory order or type."""
    values = np.asarray(values)
    dtypes = ["<i4", ">i8", "<i2"] if values.dtype.kind == "i" else [">f8", "<f8"]
    form = random.choice(["plain", "list", "fortran", "readonly", "strided", "dtype"])
    if form == "list":
        return values.tolist()
    if form == "fortran":
        return np.asfortranarray(values)
    if form == "readonly":
        values = values.copy()
        values.flags.writeable = False
    if form == "strided":
        return np.repeat(values, 2, axis=0)[::2]
    return values.astype(random.choice(dtypes)) if form == "dtype" else values


def a_graph(random: Random, n: int) -> np.ndarray:
    """Edges (N_b, 2) of a connected graph in which every vertex has two: a ring, chords, parallel edges, loops."""
    ring = [[i, (i + 1) % n] for i in range(n)]
    ring = ring if n > 2 else [[0, 1], [0, 1]]
    more = [[random.randrange(n), random.randrange(n)] for _ in range(random.randint(0, n + 2))]
    return np.array(ring + more)


def a_network(random: Random, scale: float) -> Network:
    """A network of up to `MOST_VERTICES` vertices; raises `CritflowError` where the draw is not valid."""
    d, n = random.choice([2, 2, 2, 3]), random.randint(2, MOST_VERTICES)
    edges = a_graph(random, n)
    periodic = random.random() < 0.75
    n_pins = random.choice([0, 0, 1, 2]) if periodic else random.choice([2, 3, n - 1])
    pins = {int(i): scale * numbers(random, d) for i in random.sample(range(n), min(n_pins, n - 1))}
    loops = edges[:, 0] == edges[:, 1]
    cell = offsets = None
    if periodic:
        cell = scale * a_cell(random, d)
        offsets = np.array([[random.choice([0, 0, 1, -1, 2]) for _ in range(d)] for _ in edges])
    else:
        edges = edges[~loops & ~np.isin(edges, list(pins)).all(axis=1)]
    stiffness = magnitudes(random, len(edges), random.choice([0, 0, 1, 3])) * random.choice([1.0, 1.0, 1e-9, 1e9])
    return Network(
        any_array(random, edges),
        None if offsets is None else any_array(random, offsets),
        None if cell is None else any_array(random, cell),
        any_array(random, stiffness),
        {i: any_array(random, p) for i, p in pins.items()},
        n_vertices=n,
    )


def a_lattice(random: Random, scale: float) -> Network:
    """A known network, in a deformed cell of another size."""
    network = random.choice(
        [
            lambda: voronoi_network(2 * random.randint(2, 8), seed=random.randint(0, 99)),
            lambda: lattice("honeycomb", random.randint(1, 3), random.randint(1, 3)),
            lambda: lattice("kagome", random.randint(1, 2), random.randint(1, 2)),
            lambda: lattice("square", random.randint(1, 3), random.randint(2, 3)),
            lambda: problems.triangular_lattice(random.randint(1, 3), random.randint(2, 3))[0],
            lambda: lattice("cubic", 1, random.randint(1, 2), 2),
            lambda: three_bar_linkage(),
        ]
    )()
    d = network.dimension
    F = np.eye(d) if random.random() < 0.5 else a_cell(random, d)
    return network.deformed(scale * F)


def a_problem(random: Random) -> Problem | None:
    """A random problem, or None where the network is refused."""
    scale = 10.0 ** random.choice([0, 0, 0, random.randint(-12, 12)])
    try:
        network = a_network(random, scale) if random.random() < 0.7 else a_lattice(random, scale)
        CriticalManifold(network)
    except CritflowError:
        return None
    sigma = magnitudes(random, network.n_edges, random.choice([0, 1, 1, 3, 6]))
    return Problem(network, sigma * random.choice([1.0, 1.0, 1e-6, 1e6]))


# The same problem in other words


def rotation(random: Random, d: int) -> np.ndarray:
    """A rotation or reflection (d, d), orthogonal to rounding."""
    return np.linalg.qr(numbers(random, d, d) + 2 * np.eye(d))[0]


def unimodular(random: Random, d: int) -> np.ndarray:
    """A whole matrix (d, d) of determinant ±1: other vectors of the same lattice."""
    U = np.eye(d, dtype=int)
    for _ in range(3):
        i, j = random.sample(range(d), 2)
        U[i] += random.choice([-2, -1, 1]) * U[j]
    return U


def relabelled(random: Random, network: Network) -> tuple[Network, np.ndarray]:
    """Other numbers and images of the vertices, order and direction of the edges; also the order of the edges."""
    if network.cell is not None and not network.pins:
        network = problems.rewrapped(network, random.randint(0, 99))
    copy, _, order, _ = problems.relabelled(network, random.randint(0, 99))
    return copy, order


def translated(random: Random, network: Network) -> Network:
    """All pins moved together."""
    shift = numbers(random, network.dimension) * max((np.abs(p).max() for p in network.pins.values()), default=1.0)
    pins = {i: p + shift for i, p in network.pins.items()}
    return Network(network.edges, network.offsets, network.cell, network.stiffness, pins, n_vertices=network.n_vertices)


def with_other_cell_vectors(random: Random, network: Network) -> Network:
    """The same lattice spanned by other vectors."""
    U = unimodular(random, network.dimension)
    inverse = np.round(np.linalg.inv(U)).astype(int)
    return Network(
        network.edges,
        network.offsets @ inverse,
        U @ network.cell,
        network.stiffness,
        network.pins,
        n_vertices=network.n_vertices,
    )
