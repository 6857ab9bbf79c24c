"""Regular lattices, periodic in an oblique cell: their counts, stresses and moduli are known in closed form.

Every lattice is a unit cell of vertices and edges, repeated.  A small number of repeats is not a special case: edges
that join the same two vertices through different images, or a vertex to its image, are different edges.
At σ = k the bulk modulus is B_0 = Σ k|L|²/(d² V), in units of k a^(2−d) for edges of length a:

    lattice      edges a vertex   B_0     independent self-stresses
    honeycomb          3          √3/6    1
    square             4          1/2     one a straight line: columns + rows
    kagome             4          √3/4    one a straight line: columns + rows + gcd(columns, rows)
    triangular         6          √3/2    N_v + 2
    diamond            4          √3/12   1
    cubic              6          1/3     one a straight line
"""

from __future__ import annotations

import numpy as np

from critflow.arguments import is_number, of_kind, shown
from critflow.checks import check_size
from critflow.networks import Array, Network, periodic_network
from critflow.result import InputError

# The side 2 and height √3 of the rhombus that triangular lattices of every kind repeat.
_RHOMBUS = np.array([[2.0, 0.0], [1.0, np.sqrt(3)]])
# Unit cells along each vector where no numbers are given, by dimension.
_CELLS = {2: (4, 4), 3: (3, 3, 3)}


# Of each lattice of unit edge length the part that is repeated: lattice vectors as rows (d, d), vertices (m, d), and of
# each edge the tail, the head, and the offset of the cell of the head.
_UNIT_CELLS: dict[str, tuple[Array, Array, tuple[tuple[int, int, tuple[int, ...]], ...]]] = {
    # An upper vertex joins the lower one below it and the lower ones of the two cells that meet above it.
    "honeycomb": (
        np.array([[np.sqrt(3), 0.0], [np.sqrt(3) / 2, 1.5]]),
        np.array([[0.0, 0.0], [0.0, 1.0]]),
        ((1, 0, (0, 0)), (1, 0, (0, 1)), (1, 0, (-1, 1))),
    ),
    "square": (np.eye(2), np.zeros((1, 2)), ((0, 0, (1, 0)), (0, 0, (0, 1)))),
    "triangular": (_RHOMBUS / 2, np.zeros((1, 2)), ((0, 0, (1, 0)), (0, 0, (0, 1)), (0, 0, (-1, 1)))),
    # Each vertex begins two edges: across the triangle that points up, and across the one that points down.
    "kagome": (
        _RHOMBUS,
        np.array([[0.0, 0.0], *(_RHOMBUS / 2)]),
        ((0, 1, (0, 0)), (0, 2, (0, 0)), (1, 2, (0, 0)), (1, 0, (1, 0)), (2, 0, (0, 1)), (2, 1, (-1, 1))),
    ),
    # Face-centred, with two vertices a cell.
    "diamond": (
        (np.ones((3, 3)) - np.eye(3)) * 2 / np.sqrt(3),
        np.array([np.zeros(3), np.ones(3) / np.sqrt(3)]),
        ((0, 1, (0, 0, 0)), (0, 1, (-1, 0, 0)), (0, 1, (0, -1, 0)), (0, 1, (0, 0, -1))),
    ),
    "cubic": (np.eye(3), np.zeros((1, 3)), ((0, 0, (1, 0, 0)), (0, 0, (0, 1, 0)), (0, 0, (0, 0, 1)))),
}


def lattice(name: str, *cells: int, edge_length: float = 1.0) -> Network:
    """A regular lattice: a number of unit cells along each lattice vector, in an oblique periodic cell.

    name   "honeycomb", "square", "triangular" or "kagome" in the plane; "diamond" or "cubic" in space
    cells  columns and rows, and layers in space; 4 × 4 or 3 × 3 × 3 by default

    Honeycomb and diamond lattices have one self-stress, square, kagome and cubic ones a self-stress for each straight
    line; triangular ones are overconstrained.  Raises `InputError` for other names and numbers.

    >>> import critflow as cf
    >>> cf.lattice("honeycomb", 2, 2)
    Network(8 vertices, 12 edges, 2 dimensions, periodic, z = 3)
    >>> cf.lattice("cubic", 2, 2, 2)
    Network(8 vertices, 24 edges, 3 dimensions, periodic, z = 6)
    """
    of_kind(str, name=name)
    of_kind(float, edge_length=edge_length)
    if name not in _UNIT_CELLS:
        raise InputError(f"no lattice is called {shown(name)}: choose one of {', '.join(_UNIT_CELLS)}")
    vectors, vertices, bonds = _UNIT_CELLS[name]
    numbers = cells or _CELLS[len(vectors)]
    if len(numbers) != len(vectors) or not all(is_number(n) and n >= 1 and float(n).is_integer() for n in numbers):
        raise InputError(
            f"a {name} lattice needs whole numbers of at least 1 of unit cells in {len(vectors)} directions, not "
            f"{' × '.join(map(shown, numbers))}"
        )
    repeats = tuple(map(int, numbers))
    if not (np.isfinite(edge_length) and edge_length > 0):
        raise InputError(f"the edge length of a lattice must be positive and finite, not {edge_length}")
    check_size(int(np.prod(repeats, dtype=float)) * len(vertices))
    vectors, vertices = edge_length * vectors, edge_length * vertices
    corners = np.array(list(np.ndindex(*repeats)))
    if len(corners) * len(vertices) == 1:
        raise InputError("a lattice of a single vertex has no free vertex: request more unit cells")
    positions = ((corners @ vectors)[:, None] + vertices).reshape(-1, len(vectors))
    edges, offsets = [], []
    for tail, head, step in bonds:
        image, place = np.divmod(corners + step, repeats)
        number = np.ravel_multi_index(tuple(place.T), repeats)
        edges.append(np.stack([len(vertices) * np.arange(len(corners)) + tail, len(vertices) * number + head], axis=1))
        offsets.append(image)
    return periodic_network(
        np.concatenate(edges), np.concatenate(offsets), vectors * np.array(repeats)[:, None], positions
    )


def three_bar_linkage(span: float = 3.0) -> Network:
    """Three edges in a row between two fixed points `span` apart (`3-barlinkage`): lengths ∝ 1/σ_α on a line.

    >>> import critflow as cf
    >>> cf.three_bar_linkage()
    Network(4 vertices, 3 edges, 2 dimensions, 2 pins, z = 1.5)
    """
    of_kind(float, span=span)
    return Network(
        np.array([[0, 1], [1, 2], [2, 3]]),
        pins={0: np.zeros(2), 3: np.array([span, 0.0])},
        positions=np.array([[0.0, 0.0], [span / 3, 0.3], [2 * span / 3, -0.3], [span, 0.0]]),
    )
