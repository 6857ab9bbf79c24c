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

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import checked
from critflow.networks.faces import PlanarFaces
from critflow.networks.network import Array, IntArray, Network
from critflow.networks.support import check_size
from critflow.result import InputError

# The side 2 and height √3 of the rhombus that triangular lattices of every kind repeat.
_RHOMBUS = np.array([[2.0, 0.0], [1.0, np.sqrt(3)]])

# One edge of a unit cell: its tail, its head, and the offset of the cell of the head.
Bond = tuple[int, int, tuple[int, ...]]


@checked
def honeycomb_network(columns: int = 4, rows: int = 4, edge_length: float = 1.0) -> Network:
    """The honeycomb of columns × rows hexagons in its oblique cell: three edges a vertex, B_0 = √3 k/6 at σ = k.

    >>> import critflow as cf
    >>> cf.honeycomb_network(2, 2)
    Network(8 vertices, 12 edges, 2 dimensions, periodic, z = 3)
    """
    # An upper vertex joins the lower one below it and the lower ones of the two cells that meet above it.
    bonds: list[Bond] = [(1, 0, (0, 0)), (1, 0, (0, 1)), (1, 0, (-1, 1))]
    return _repeated([[np.sqrt(3), 0.0], [np.sqrt(3) / 2, 1.5]], [[0, 0], [0, 1]], bonds, (columns, rows), edge_length)


@checked
def square_network(columns: int = 4, rows: int = 4, edge_length: float = 1.0) -> Network:
    """The square lattice: four edges a vertex, B_0 = k/2; each of its columns + rows lines is stressed alone.

    >>> import critflow as cf
    >>> cf.square_network(2, 2)
    Network(4 vertices, 8 edges, 2 dimensions, periodic, z = 4)
    """
    bonds: list[Bond] = [(0, 0, (1, 0)), (0, 0, (0, 1))]
    return _repeated(np.eye(2), [[0, 0]], bonds, (columns, rows), edge_length)


@checked
def triangular_network(columns: int = 4, rows: int = 4, edge_length: float = 1.0) -> Network:
    """The triangular lattice: six edges a vertex, overconstrained; springs at rest have B = √3 k/2 and G = √3 k/4.

    >>> import critflow as cf
    >>> cf.triangular_network(3, 3)
    Network(9 vertices, 27 edges, 2 dimensions, periodic, z = 6)
    """
    bonds: list[Bond] = [(0, 0, (1, 0)), (0, 0, (0, 1)), (0, 0, (-1, 1))]
    return _repeated(_RHOMBUS / 2, [[0, 0]], bonds, (columns, rows), edge_length)


@checked
def kagome_network(columns: int = 4, rows: int = 4, edge_length: float = 1.0) -> Network:
    """The kagome lattice of corner-sharing triangles: four edges a vertex; B = √3 k/4 and G = √3 k/8 at rest.

    >>> import critflow as cf
    >>> cf.kagome_network(2, 2)
    Network(12 vertices, 24 edges, 2 dimensions, periodic, z = 4)
    """
    # Each vertex begins two edges: across the triangle that points up, and across the one that points down.
    bonds: list[Bond] = [
        (0, 1, (0, 0)), (0, 2, (0, 0)), (1, 2, (0, 0)),
        (1, 0, (1, 0)), (2, 0, (0, 1)), (2, 1, (-1, 1)),
    ]  # fmt: skip
    return _repeated(_RHOMBUS, [[0, 0], _RHOMBUS[0] / 2, _RHOMBUS[1] / 2], bonds, (columns, rows), edge_length)


@checked
def diamond_network(columns: int = 3, rows: int = 3, layers: int = 3, edge_length: float = 1.0) -> Network:
    """The diamond lattice in three dimensions: four edges a vertex, B_0 = √3 k/(12 a) at σ = k.

    >>> import critflow as cf
    >>> cf.diamond_network(2, 2, 2)
    Network(16 vertices, 32 edges, 3 dimensions, periodic, z = 4)
    """
    face_centred = (np.ones((3, 3)) - np.eye(3)) * 2 / np.sqrt(3)
    bonds: list[Bond] = [(0, 1, (0, 0, 0)), (0, 1, (-1, 0, 0)), (0, 1, (0, -1, 0)), (0, 1, (0, 0, -1))]
    basis = [np.zeros(3), np.ones(3) / np.sqrt(3)]
    return _repeated(face_centred, basis, bonds, (columns, rows, layers), edge_length)


@checked
def cubic_network(columns: int = 3, rows: int = 3, layers: int = 3, edge_length: float = 1.0) -> Network:
    """The simple cubic lattice: six edges a vertex, B_0 = k/(3 a); each of its straight lines is stressed alone.

    >>> import critflow as cf
    >>> cf.cubic_network(2, 2, 2)
    Network(8 vertices, 24 edges, 3 dimensions, periodic, z = 6)
    """
    bonds: list[Bond] = [(0, 0, (1, 0, 0)), (0, 0, (0, 1, 0)), (0, 0, (0, 0, 1))]
    return _repeated(np.eye(3), [np.zeros(3)], bonds, (columns, rows, layers), edge_length)


def _repeated(
    lattice: ArrayLike, basis: Sequence[ArrayLike], bonds: Sequence[Bond], repeats: tuple[int, ...], edge_length: float
) -> Network:
    """A unit cell with lattice vectors (d, d) as rows, vertices (m, d) and bonds, repeated along each vector."""
    if not all(isinstance(n, int | np.integer) and n >= 1 for n in repeats):
        shown = " × ".join(map(str, repeats))
        raise InputError(f"a lattice needs whole numbers of at least 1 of unit cells in every direction, not {shown}")
    if not (np.isfinite(edge_length) and edge_length > 0):
        raise InputError(f"the edge length of a lattice must be positive and finite, not {edge_length}")
    check_size(int(np.prod(repeats, dtype=float)) * len(basis))
    vectors, vertices = edge_length * np.asarray(lattice), edge_length * np.asarray(basis)
    cells = np.array(list(np.ndindex(*repeats)))
    if len(cells) * len(vertices) == 1:
        raise InputError("a lattice of a single vertex has no free vertex: request more unit cells")
    positions = ((cells @ vectors)[:, None] + vertices).reshape(-1, len(vectors))
    edges, offsets = [], []
    for tail, head, step in bonds:
        image, there = np.divmod(cells + step, repeats)
        number = np.ravel_multi_index(tuple(there.T), repeats)
        edges.append(np.stack([len(vertices) * np.arange(len(cells)) + tail, len(vertices) * number + head], axis=1))
        offsets.append(image)
    return periodic_network(
        np.concatenate(edges), np.concatenate(offsets), vectors * np.array(repeats)[:, None], positions
    )


def periodic_network(edges: IntArray, offsets: IntArray, cell: Array, positions: Array) -> Network:
    """A periodic network of unit stiffness; in the plane with the faces of its embedding, which must not cross."""
    if len(cell) != 2:
        return Network(edges, offsets, cell, positions=positions)
    bond_vectors = positions[edges[:, 1]] - positions[edges[:, 0]] + offsets @ cell
    return Network(edges, offsets, cell, positions=positions, faces=PlanarFaces(edges, bond_vectors, len(positions)))
