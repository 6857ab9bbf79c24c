"""Networks of straight fibres that are linked where they cross: phantom triangular lattices and Mikado networks.

At most two fibres meet at a vertex, so that z <= 4.  A fibre has the stretching modulus 1: a segment of length ℓ is a
spring of stiffness 1/ℓ.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from critflow.arguments import checked, generator
from critflow.generators.dilution import diluted, with_coordination
from critflow.generators.lattices import periodic_network, triangular_network
from critflow.networks.network import Array, IntArray, Network
from critflow.networks.pruning import CarryingPart, carrying_part, pruned_network
from critflow.networks.support import check_size
from critflow.result import InputError


@checked
def phantom_network(
    columns: int = 20, rows: int = 20, z: float = 4.0, seed: int | np.random.Generator = 0, edge_length: float = 1.0
) -> Network:
    """The triangular lattice in which one of the three fibres at each vertex, chosen at random, passes without a link.

    Every vertex then has four edges, of 1, 2, ... lattice spacings; edges are removed at random to reach z <= 4
    (Broedersz, Sheinman, MacKintosh, Phys. Rev. Lett. 108, 078102, 2012; Licup et al., PNAS 112, 9573, 2015).
    Raises `InputError` for a z out of reach and for sizes that are no whole numbers.

    >>> import critflow as cf
    >>> cf.phantom_network(6, 6, z=3.4, seed=1).dimension
    2
    """
    rng = generator(seed)
    lattice = triangular_network(columns, rows, edge_length)
    n_vertices = lattice.n_vertices
    unlinked = rng.integers(3, size=n_vertices)
    # The lattice lists its edges by direction, each time in the order of the vertices that they leave.
    following, step = lattice.edges[:, 1].reshape(3, -1), lattice.offsets.reshape(3, n_vertices, 2)
    edges, offsets = [], []
    for direction in range(3):
        tail = np.flatnonzero(unlinked != direction)
        head, offset = following[direction, tail], step[direction, tail]
        while (passed := unlinked[head] == direction).any():
            offset = offset + np.where(passed[:, None], step[direction, head], 0)
            head = np.where(passed, following[direction, head], head)
        edges.append(np.column_stack([tail, head]))
        offsets.append(offset)
    assert lattice.cell is not None and lattice.positions is not None
    network = Network(np.concatenate(edges), np.concatenate(offsets), lattice.cell, positions=lattice.positions)
    network = _with_fibre_stiffness(network)
    return diluted(network, z, rng)


@checked
def mikado_network(n_vertices: int = 1000, z: float = 3.6, seed: int | np.random.Generator = 0) -> Network:
    """Rods of one length at random places and angles in a periodic square, linked where they cross; V = N_v.

    The rods, of which there are n_vertices (4 − z)/2, grow until z edges meet at a vertex, to 1/N_v; free ends and
    other parts that carry no tension are removed, and n_vertices is reached to a few per cent (Wilhelm, Frey, Phys.
    Rev. Lett. 91, 108103, 2003; Head, Levine, MacKintosh, ibid. 108102).
    Raises `InputError` for z outside 2 < z < 4, and for so few vertices that z is out of reach.

    >>> import critflow as cf
    >>> cf.mikado_network(n_vertices=60, seed=1).dimension
    2
    """
    if not (np.isfinite(n_vertices) and int(n_vertices) == n_vertices and n_vertices >= 1):
        raise InputError(f"n_vertices must be a positive whole number, not {n_vertices}")
    if not 2 < z < 4:
        raise InputError(f"z of a Mikado network must be between 2 and 4, not {z}: two rods cross at a vertex")
    check_size(n_vertices)
    n_rods = round(n_vertices * (4 - z) / 2)
    if n_rods < 2:
        raise InputError(f"a Mikado network of z = {z:g} needs at least {int(np.ceil(4 / (4 - z)))} vertices")
    # A rod of length ℓ has 2 n_rods ℓ²/π crossings, and 4/(4 − z) of them give the coordination without its free ends.
    longest = 1.5 * np.sqrt(np.pi / 2 * 4 / (4 - z) / n_rods)
    rng = generator(seed)
    centres, angles = rng.random((n_rods, 2)), np.pi * rng.random(n_rods)
    crossings = _crossings(centres, angles, longest)
    n_crossings = len(crossings.length)

    def after(n_removed: int) -> CarryingPart:
        edges, offsets = _segments(crossings, n_crossings - n_removed)
        return carrying_part(edges, offsets, {}, n_crossings)

    # Rods that shrink leave out their crossings one by one.
    part, n_removed = with_coordination(after, n_crossings, z, 2)
    edges, offsets = _segments(crossings, n_crossings - n_removed)
    side = np.sqrt(part.n_vertices)
    pruned = pruned_network(edges, offsets, side * np.eye(2), positions=side * crossings.places).network
    length = side * crossings.length[n_crossings - n_removed - 1]
    note = f"z = {part.coordination:.6g} with {n_rods} rods of length {length:.6g}; {pruned.note}"
    assert pruned.cell is not None and pruned.positions is not None
    planar = periodic_network(pruned.edges, pruned.offsets, pruned.cell, pruned.positions)
    return _with_fibre_stiffness(replace(planar, note=note))


class _Crossings(NamedTuple):
    """Crossings of rods, in the order in which they appear as the rods grow.

    length  (n,) length of the rods at which two of them cross
    places  (n, 2) in the unit square
    rods    (n, 2) the two rods that cross
    along   (n, 2) distance of the crossing from the centre of each rod
    images  (n, 2, 2) cell of the crossing when the centre of each rod is in cell zero
    """

    length: Array
    places: Array
    rods: IntArray
    along: Array
    images: IntArray


def _crossings(centres: Array, angles: Array, longest: float) -> _Crossings:
    """All crossings of rods with lengths up to `longest` in the periodic unit square."""
    reach = range(-int(longest) - 1, int(longest) + 2)
    images = np.array(list(product(reach, repeat=2)))
    copies = (centres[None] + images[:, None]).reshape(-1, 2)
    near = cKDTree(centres).sparse_distance_matrix(cKDTree(copies), longest, output_type="coo_matrix")
    first, second, image = near.row, near.col % len(centres), images[near.col // len(centres)]
    once = first < second
    first, second, image = first[once], second[once], image[once]
    along = np.column_stack([np.cos(angles), np.sin(angles)])
    apart = centres[second] + image - centres[first]
    turn = np.sin(angles[second] - angles[first])
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (apart[:, 0] * along[second, 1] - apart[:, 1] * along[second, 0]) / turn
        t = (apart[:, 0] * along[first, 1] - apart[:, 1] * along[first, 0]) / turn
    length = 2 * np.maximum(np.abs(s), np.abs(t))
    chosen = np.flatnonzero(length <= longest)
    chosen = chosen[np.argsort(length[chosen], kind="stable")]
    first, second, image, s, t = first[chosen], second[chosen], image[chosen], s[chosen], t[chosen]
    places = centres[first] + s[:, None] * along[first]
    wrap = np.floor(places).astype(int)
    return _Crossings(
        length[chosen],
        places - wrap,
        np.column_stack([first, second]),
        np.column_stack([s, t]),
        np.stack([wrap, wrap - image], axis=1),
    )


def _segments(crossings: _Crossings, n_crossings: int) -> tuple[IntArray, IntArray]:
    """Edges (n, 2) and offsets (n, 2) between successive crossings of each rod, among the first `n_crossings`."""
    rods = crossings.rods[:n_crossings].ravel()
    order = np.lexsort((crossings.along[:n_crossings].ravel(), rods))
    before, after = order[:-1], order[1:]
    same = rods[before] == rods[after]
    before, after = before[same], after[same]
    images = crossings.images[:n_crossings].reshape(-1, 2)
    return np.column_stack([before // 2, after // 2]), images[after] - images[before]


def _with_fibre_stiffness(network: Network) -> Network:
    assert network.positions is not None
    return network.with_stiffness(1 / np.linalg.norm(network.bond_vectors(network.positions), axis=1))
