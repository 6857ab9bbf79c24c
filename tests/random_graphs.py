"""Random graphs in a cell or on pins, of which some blocks collapse."""

import numpy as np

CELL = np.array([[2.0, 0.0], [0.5, 1.0]])
# Two of them coincide up to a vector of the cell, two are the same.
PLACES = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 0.0], [0.0, 0.0]])


def random_graph(rng):
    """A connected graph with parallel edges, loops, a few offsets and a few pins: edges, offsets, cell, pins, N_v."""
    n, periodic = int(rng.integers(2, 12)), rng.random() < 0.6
    more = int(rng.integers(0, n))
    edges = [(rng.integers(0, i), i) for i in range(1, n)] + [tuple(rng.integers(0, n, 2)) for _ in range(more)]
    edges = rng.permutation(n)[np.array(edges)]
    chosen = rng.choice(n, min(n - 1, int(rng.integers(0 if periodic else 1, 4))), replace=False)
    pins = {int(i): PLACES[rng.integers(0, 4)] for i in chosen}
    offsets = rng.integers(-1, 2, (len(edges), 2)) * (rng.random((len(edges), 1)) < 0.2) * periodic
    image = rng.integers(-2, 3, (n, 2)) * periodic
    image[list(pins)] = 0
    return edges, offsets + image[edges[:, 1]] - image[edges[:, 0]], CELL if periodic else None, pins, n
