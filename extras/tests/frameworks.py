"""Frameworks of the literature, as edges and coordinates, and networks of them without rigid motions."""

import numpy as np

from critflow import Network, lattice


def grounded(edges, x):
    """The network of a framework on bars to the ground that only exclude rigid motions: they never carry a self-stress.

    One vertex has bars in all directions of space, the next in all but one, and so on: d(d + 1)/2 bars.
    """
    n, d = x.shape
    # Vertices that are far from each other, and bars in directions that are not special.
    order = [0, int(np.linalg.norm(x - x[0], axis=1).argmax())]
    if d == 3:
        along = x[order[1]] - x[0]
        order.append(int(np.linalg.norm(np.cross(x - x[0], along), axis=1).argmax()))
    rng = np.random.default_rng(7)
    bars, pins = [], {}
    for rank, vertex in enumerate(order):
        for axis in np.linalg.qr(rng.standard_normal((d, d)))[0][: d - rank]:
            pins[n + len(bars)] = x[vertex] + axis
            bars.append([vertex, n + len(bars)])
    return Network(np.concatenate([edges, bars]), pins=pins), np.concatenate([x, list(pins.values())])


def pinned_at_one(edges, x):
    """The network of a framework with one vertex fixed, about which it rotates."""
    return Network(edges, pins={0: x[0]})


def bipartite(m, n):
    return np.array([[i, m + j] for i in range(m) for j in range(n)])


def double_banana():
    """Two bipyramids that share their apexes, 0 and 1, and rotate about the line through them."""
    rings = [(2, 3, 4), (5, 6, 7)]
    edges = [[apex, v] for ring in rings for v in ring for apex in (0, 1)]
    edges += [[ring[i], ring[i - 1]] for ring in rings for i in range(3)]
    x = [[0, 0, 1.3], [0, 0, -1.0], [1, 0.1, 0.2], [2, 0.9, -0.1], [2.1, -0.8, 0.1]]
    x += [[-1.1, 0.2, 0.1], [-2, 0.8, 0.3], [-1.9, -1, -0.2]]
    return np.array(edges), np.array(x)


_PRISM = np.array([[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]])


def desargues(centre=(0.3, 0.2), factors=(1.9, 2.3, 1.6)):
    """Two triangles in perspective from a point: the lines of the three bars between them meet there."""
    inner = np.array([[1.0, 0.1], [-0.4, 0.9], [-0.5, -0.8]])
    outer = np.array(centre) + np.array(factors)[:, None] * (inner - centre)
    return _PRISM, np.concatenate([inner, outer])


def desargues_parallel(lengths=(1.0, 1.0, 1.0)):
    """Two triangles with parallel bars; of equal lengths, one is a translation of the other."""
    inner = np.array([[1.0, 0.1], [-0.4, 0.9], [-0.5, -0.8]])
    return _PRISM, np.concatenate([inner, inner + np.array(lengths)[:, None] * np.array([3.0, 0.7])])


def bipartite_on_conic():
    """K(3,3) on an ellipse."""
    angle = np.array([0.2, 2.1, 4.0, 1.1, 3.3, 5.4])
    return bipartite(3, 3), np.stack([2 * np.cos(angle), np.sin(angle)], axis=1)


def dixon():
    """K(3,3) with its two classes on two perpendicular lines (Dixon's first mechanism)."""
    return bipartite(3, 3), np.array([[1.0, 0], [-1.7, 0], [2.6, 0], [0, 0.8], [0, -1.3], [0, 2.1]])


def bipartite_on_quadric():
    """K(4,6) on an ellipsoid."""
    rng = np.random.default_rng(3)
    x = rng.standard_normal((10, 3))
    return bipartite(4, 6), x / np.linalg.norm(x, axis=1)[:, None] * [1.0, 1.3, 0.8]


_OCTAHEDRON = np.array([[i, j] for i in range(6) for j in range(i) if i - j != 3])


def octahedron():
    corners = np.eye(3)
    return _OCTAHEDRON, np.concatenate([corners, -corners])


def bricard(symmetry):
    """A flexible octahedron with opposite vertices exchanged by a half-turn, or two of three pairs by a reflection."""
    rng = np.random.default_rng(11)
    x = rng.standard_normal((3, 3))
    if symmetry == "line":
        return _OCTAHEDRON, np.concatenate([x, x * [-1, -1, 1]])
    opposite = x * [1, 1, -1]
    # The third pair lies in the plane of the reflection.
    x[2, 2], opposite[2] = 0.0, [0.7, -1.1, 0.0]
    return _OCTAHEDRON, np.concatenate([x, opposite])


def double_watt(mirrored):
    """Two of Watt's linkages whose tracing points are joined by a bar (Connelly and Servatius, 1994).

    The tracing points move on lines up to third order.  Mirror images bend apart: a mechanism with a cusp.
    """
    h, r, span = 0.8, 1.6, 5.0
    one = np.array([[-r, h], [r, -h], [0, h], [0, -h], [-0.7, 0.1], [0, 0]])  # pins A, B, then P, Q, T, M
    two = one * [-1 if mirrored else 1, 1] + [span, 0.0]
    half = np.array([[0, 2], [2, 3], [3, 1], [2, 4], [3, 4], [4, 5], [2, 5]])
    edges = np.concatenate([half, half + 6, [[5, 11]]])
    x = np.concatenate([one, two])
    return Network(edges, pins={v: x[v] for v in (0, 1, 6, 7)}), x


def snelson_prism(twist=5 * np.pi / 6):
    """Three struts and nine cables; edges, coordinates, signs."""
    angle = 2 * np.pi * np.arange(3) / 3
    foot = np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)
    head = np.stack([np.cos(angle + twist), np.sin(angle + twist), np.full(3, 1.5)], axis=1)
    i = np.arange(3)
    cables = np.concatenate([np.stack([i, (i + 1) % 3], 1), np.stack([3 + i, 3 + (i + 1) % 3], 1)])
    # Heads are turned against the feet, the cable of a foot leads to the head one third of a turn back.
    sides, struts = np.stack([i, 3 + (i - 1) % 3], 1), np.stack([i, 3 + i], 1)
    return np.concatenate([cables, sides, struts]), np.concatenate([foot, head]), np.repeat([1, 1, 1, -1], 3)


def cauchy_polygon(n):
    """A convex polygon of cables with struts between next but one vertices, all but two (Connelly, 1982)."""
    i = np.arange(n)
    x = np.stack([np.cos(2 * np.pi * i / n), np.sin(2 * np.pi * i / n)], axis=1) * [1.3, 1.0]
    edges = np.concatenate([np.stack([i, (i + 1) % n], 1), np.stack([i[: n - 2], i[2:]], 1)])
    return edges, x, np.repeat([1, -1], [n, n - 2])


def twisted_kagome(columns, twist):
    """The kagome lattice with its triangles rotated by ± an angle, in a cell that shrinks with the cosine."""
    plain = lattice("kagome", columns, columns)
    L = plain.bond_vectors(plain.positions)
    turn = np.array([[np.cos(twist), -np.sin(twist)], [np.sin(twist), np.cos(twist)]])
    # Triangles of one orientation lie within a unit cell of three vertices, the others between cells.
    within = (plain.edges[:, 0] // 3 == plain.edges[:, 1] // 3) & ~plain.offsets.any(axis=1)
    rotated = np.where(within[:, None], L @ turn.T, L @ turn)
    network = Network(plain.edges, plain.offsets, np.cos(twist) * plain.cell)
    g = network.incidence.toarray()
    return network, np.linalg.lstsq(g, rotated - network.boundary_vectors, rcond=None)[0]


def chain(signed_lengths, dimension=2, shift=0.0):
    """Bars in a row along x from the origin, each of a signed length; between pins, displaced by `shift`."""
    places = np.concatenate([[0.0], np.cumsum(signed_lengths)])
    x = np.zeros((len(places), dimension))
    x[:, 0], x[:, 1] = places, shift
    n = len(signed_lengths)
    return Network(np.stack([np.arange(n), np.arange(1, n + 1)], 1), pins={0: x[0], n: x[-1]}), x


def star(pins, dimension=2):
    """One vertex at the origin, joined to pins on the x axis."""
    x = np.zeros((1 + len(pins), dimension))
    x[1:, 0] = pins
    return Network([[0, i + 1] for i in range(len(pins))], pins={i + 1: p for i, p in enumerate(x[1:])}), x
