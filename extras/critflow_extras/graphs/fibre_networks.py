"""Networks of straight fibres that are linked where they cross: phantom triangular lattices and Mikado networks.

At most two fibres meet at a vertex, so that z <= 4.  A fibre has the stretching modulus 1: a segment of length ℓ is a
spring of stiffness 1/ℓ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from critflow.arguments import generator, of_kind, shown
from critflow.calls import running
from critflow.checks import check_size, components
from critflow.lattices import lattice
from critflow.networks import Array, IntArray, Network, periodic_network
from critflow.result import InputError
from critflow_extras.graphs.dilution import diluted, with_coordination
from critflow_extras.pruning.pruning import CarryingPart, carrying_part, pruned


@running("fibre_network")
def fibre_network(kind: str, *size: int, z: float | None = None, seed: int | np.random.Generator = 0) -> Network:
    """Straight fibres that are linked where they cross, to the mean coordination z = 2 N_b/N_v.

    kind  "phantom": the triangular lattice of unit edges in which one of the three fibres at each vertex, chosen at
          random, passes without a link, so that four edges of 1, 2, ... spacings meet there; one edge of every
          fibre, chosen at random, is cut, since fibres that close around the cell would be rigid by themselves; more
          are removed at random to reach z (Broedersz, Sheinman, MacKintosh, Phys. Rev. Lett. 108, 078102, 2012; Licup
          et al., PNAS 112, 9573, 2015)
          "mikado": rods of one length at random places and angles in a periodic square, V = N_v; they grow until z
          edges meet at a vertex, to 1/N_v, and parts that carry no tension are removed (Wilhelm, Frey, Phys. Rev. Lett.
          91, 108103, 2003; Head, Levine, MacKintosh, ibid. 108102)
    size  columns and rows of the lattice, 20 × 20 by default; vertices among the rods, 1000 by default and reached to
          a few per cent
    z     for "phantom" at most the one of all fibres cut once, near 4 − 6/n for n × n and the default; between 2 and 4,
          and 3.6 by default, for "mikado"

    Raises `InputError` for another kind, and for a size and a z that are out of reach.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> ce.fibre_network("phantom", 9, 9, z=3.2, seed=1).dimension, ce.fibre_network("mikado", 60, seed=1).dimension
    (2, 2)
    """
    of_kind(str, kind=kind)
    of_kind(float, None, z=z)
    seed = of_kind(int, np.random.Generator, seed=seed)
    if kind not in _KINDS:
        raise InputError(f"no fibre network is called {shown(kind)}: choose one of {', '.join(_KINDS)}")
    make, usual_size, usual_z = _KINDS[kind]
    if len(size) not in (0, len(usual_size)):
        raise InputError(f"the size of a {kind} network is {len(usual_size)} whole numbers, not {len(size)}")
    return make(*(size or usual_size), usual_z if z is None else z, generator(seed))


def _phantom(columns: int, rows: int, z: float | None, rng: np.random.Generator) -> Network:
    """The diluted triangular lattice of which a fibre at each vertex passes without a link, and each fibre is cut."""
    triangles = lattice("triangular", columns, rows)
    n_vertices = triangles.n_vertices
    unlinked = rng.integers(3, size=n_vertices)
    # The lattice lists its edges by direction, each time in the order of the vertices that they leave.
    following, step = triangles.edges[:, 1].reshape(3, -1), triangles.offsets.reshape(3, n_vertices, 2)
    edges, offsets = [], []
    for direction in range(3):
        tail = np.flatnonzero(unlinked != direction)
        head, offset = following[direction, tail], step[direction, tail]
        while (passed := unlinked[head] == direction).any():
            offset = offset + np.where(passed[:, None], step[direction, head], 0)
            head = np.where(passed, following[direction, head], head)
        line = components(np.column_stack([np.arange(n_vertices), following[direction]]), n_vertices)
        uncut = ~_one_of_each(line[tail], rng)
        edges.append(np.column_stack([tail, head])[uncut])
        offsets.append(offset[uncut])
    given = {"offsets": np.concatenate(offsets), "cell": triangles.cell, "positions": triangles.positions}
    network = _with_fibre_stiffness(pruned(np.concatenate(edges), **given).network)
    return network if z is None else diluted(network, z, rng)


def _one_of_each(group: IntArray, rng: np.random.Generator) -> NDArray[np.bool_]:
    """A mask with one member of each group, chosen at random."""
    order = rng.permutation(len(group))
    chosen = np.zeros(len(group), bool)
    chosen[order[np.unique(group[order], return_index=True)[1]]] = True
    return chosen


def _mikado(n_vertices: int, z: float, rng: np.random.Generator) -> Network:
    """The network of n_vertices (4 − z)/2 rods that have grown until z edges meet at a vertex."""
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
    network = pruned(edges, offsets=offsets, cell=side * np.eye(2), positions=side * crossings.places).network
    length = side * crossings.length[n_crossings - n_removed - 1]
    note = f"z = {part.coordination:.6g} with {n_rods} rods of length {length:.6g}; {network.note}"
    assert network.cell is not None and network.positions is not None
    planar = periodic_network(network.edges, network.offsets, network.cell, network.positions)
    return _with_fibre_stiffness(replace(planar, note=note))


# Maker, size and z where none are given, of each kind.
_KINDS: dict[str, tuple[Callable[..., Network], tuple[int, ...], float | None]] = {
    "phantom": (_phantom, (20, 20), None),
    "mikado": (_mikado, (1000,), 3.6),
}


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
    near = scipy.spatial.cKDTree(centres).sparse_distance_matrix(
        scipy.spatial.cKDTree(copies), longest, output_type="coo_matrix"
    )
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
