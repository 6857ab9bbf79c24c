"""The boundary of a record: image offsets of the edges of a periodic cell, and fixed vertices of a free patch.

Offsets follow from bond vectors, or by the nearest image where it is unambiguous; fixed vertices from a list, a mask or
a rule.  A patch without any gets a proposal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from critflow.checks import doubtful_offsets
from critflow.faces import planar_faces
from critflow.result import InputError, NetworkError
from critflow_extras.files.data import Array, IntArray, NetworkData, bond_vectors_of, counted

Pins = str | Sequence[int | str] | ArrayLike | None

# Edges longer than this part of the least height of the cell have a second image at most 1.5 times as long.
_UNAMBIGUOUS = 0.4
# Bond vectors and positions agree with whole offsets to this part of a cell vector.
_WHOLE = 0.05
# An offset is reversed where the opposite one shortens the edge to less than this part.
_NEARER = 0.5
# Where so large a part of the edges across the boundary has opposite offsets, these point from head to tail.
_REVERSED = 0.5
# Vertices within this part of the size of the patch from its border are on it.
_ON_BORDER = 1e-6


class UnheldNetwork(NetworkError):
    """A network that has neither a cell nor fixed vertices; `rules` of `pins` fix some."""

    def __init__(self, sentence: str, rules: tuple[str, ...]):
        super().__init__(sentence)
        self.rules = rules


def with_pins(data: NetworkData, pins: Pins) -> NetworkData:
    """The data with fixed vertices.

    pins  "outer_face", "two_edges" (vertices of one or two edges), "degree" (of one edge), "hull" (on the convex hull),
          "box" (on the bounding box), "border" (at the edges of a label mask), names or indices of vertices, or a mask
    """
    if pins is None:
        return data
    if isinstance(pins, str) and pins not in _RULES:
        raise InputError(f"no rule for fixed vertices is called {pins!r}: choose {_NAMES} or give a list")
    chosen = _RULES[pins][1](data) if isinstance(pins, str) else _listed(data, pins)
    if not len(chosen):
        raise InputError(f"no vertex is fixed by pins={pins!r:.40}: choose another rule, {_NAMES}, or list vertices")
    note = f"{counted(len(chosen), 'vertex', 'is')} fixed" + (f" ({_RULES[pins][0]})" if isinstance(pins, str) else "")
    if data.pins and set(data.pins) != set(np.asarray(chosen).tolist()):
        note += f", in place of the {len(data.pins)} of the source"
    return replace(data, pins=tuple(map(int, chosen))).noting(note)


def hull_volume(positions: Array) -> float:
    """Volume (area in two dimensions) of the convex hull of vertices (N_v, d)."""
    if positions.shape[1] == 1:
        return float(np.ptp(positions))
    try:
        return float(scipy.spatial.ConvexHull(positions).volume)
    except (scipy.spatial.QhullError, ValueError):
        raise InputError("the vertices span no convex hull: name the volume as a number, such as volume=1.0") from None


def require_boundary(data: NetworkData) -> NetworkData:
    """The record itself; `UnheldNetwork` with a proposal where it has neither a cell nor fixed vertices."""
    if data.cell is not None or data.pins:
        return data
    counts = {rule: len(fixed(data)) for rule, (_, fixed) in _RULES.items()}
    proposals = [f"pins='{rule}' fixes {count} ({_RULES[rule][0]})" for rule, count in counts.items() if count]
    raise UnheldNetwork(
        f"the network has neither a cell nor fixed vertices, so it collapses; which of its {data.n_vertices} vertices "
        f"are fixed? {'; '.join(proposals)}; or give a list of vertices, or a cell; examine(FILE) tries every rule",
        tuple(rule for rule, count in counts.items() if count),
    )


def _of_few_edges(data: NetworkData, most: int) -> NDArray[np.intp]:
    """The vertices of at least one edge and at most some number of them."""
    degree = np.bincount(data.edges.ravel(), minlength=data.n_vertices)
    return np.flatnonzero((degree > 0) & (degree <= most))


def _on_outer_face(data: NetworkData) -> NDArray[np.intp]:
    """The vertices of edges that border no polygon or only one; none where edges cross, or in space."""
    if data.dimension != 2:
        return np.zeros(0, np.intp)
    try:
        faces = planar_faces(data.edges, bond_vectors_of(data), data.n_vertices)
    except NetworkError:
        return np.zeros(0, np.intp)
    return np.unique(data.edges[np.bincount(faces.edges, minlength=data.n_edges) < 2])


def _on_border(data: NetworkData, of_hull: bool) -> NDArray[np.intp]:
    """The vertices on the convex hull, also within its straight sides, or on the bounding box."""
    # Vertices without edges leave the network, and are no part of its border.
    used = np.unique(data.edges)
    x = data.positions[used]
    if of_hull:
        try:
            hull = scipy.spatial.ConvexHull(x)
        except (scipy.spatial.QhullError, ValueError):
            return np.zeros(0, np.intp)
        inside = -(x @ hull.equations[:, :-1].T + hull.equations[:, -1])
    else:
        inside = np.minimum(x - x.min(axis=0), x.max(axis=0) - x)
    size = float(np.ptp(x, axis=0).max()) or 1.0
    return used[(inside <= _ON_BORDER * size).any(axis=1)]


# What each rule fixes, in words, and the vertices of a record that it fixes.
_RULES: dict[str, tuple[str, Callable[[NetworkData], NDArray[np.intp]]]] = {
    "hull": ("the corners and sides of the convex hull", lambda data: _on_border(data, of_hull=True)),
    "outer_face": ("the vertices of the outer face", _on_outer_face),
    "two_edges": ("vertices of one or two edges", lambda data: _of_few_edges(data, 2)),
    "degree": ("vertices of a single edge", lambda data: _of_few_edges(data, 1)),
    "box": ("vertices on the bounding box", lambda data: _on_border(data, of_hull=False)),
    "border": ("vertices at the edges of the picture", lambda data: np.array(data.border, np.intp)),
}
_NAMES = ", ".join(map(repr, _RULES))


def _listed(data: NetworkData, pins: Sequence[int | str] | ArrayLike) -> NDArray[np.intp]:
    values = np.asarray(pins)
    if values.dtype == bool:
        if values.shape != (data.n_vertices,):
            raise InputError(f"a mask of fixed vertices must have shape ({data.n_vertices},), not {values.shape}")
        return np.flatnonzero(values)
    names = {name: n for n, name in enumerate(data.ids)} if data.ids else {}
    chosen = []
    for value in values.ravel().tolist():
        index = names.get(str(value)) if names else value
        if not isinstance(index, int) or not 0 <= index < data.n_vertices:
            raise InputError(f"the fixed vertex {value!r} does not exist: give names or indices of the source")
        chosen.append(index)
    return np.unique(np.array(chosen, dtype=np.intp))


def with_offsets(data: NetworkData, nearest: bool = False) -> NetworkData:
    """The data with an image offset for each edge.

    nearest  accept the nearest image of edges that are long compared with the cell

    Raises `InputError` where bond vectors do not fit the cell, or where the nearest image is ambiguous.
    """
    if data.cell is None:
        return replace(data, offsets=None, bond_vectors=None)
    tail, head = data.edges.T
    difference = data.positions[head] - data.positions[tail]
    if data.bond_vectors is not None:
        exact = (data.bond_vectors - difference) @ np.linalg.inv(data.cell)
        off = np.flatnonzero(np.abs(exact - np.round(exact)).max(axis=1) > _WHOLE)
        if len(off):
            raise InputError(
                f"the bond vectors of {counted(len(off), 'edge')} differ from the positions by no whole number of cell "
                f"vectors, edge {off[0]} first: check cell and units"
            )
        return replace(data, offsets=np.round(exact).astype(np.int64), bond_vectors=None)
    images = _nearest(difference, data.cell)
    length = np.linalg.norm(difference + images @ data.cell, axis=1)
    if data.offsets is not None:
        return _consistent(data, np.linalg.norm(difference + data.offsets @ data.cell, axis=1), images, length)
    # Least distance between opposite faces of the cell.
    height = float(1 / np.linalg.norm(np.linalg.inv(data.cell), axis=0).max())
    unclear = np.flatnonzero(length > _UNAMBIGUOUS * height)
    if len(unclear) and not (nearest or data.nearest_images):
        i, j = data.edges[unclear[0]]
        raise InputError(
            f"{counted(len(unclear), 'edge', 'is')} longer than {_UNAMBIGUOUS} of the height of the cell, so the image "
            f"is ambiguous (vertices {data.name(i)} and {data.name(j)}): give offsets or bond_vectors, or nearest=True"
        )
    part = length.max() / height
    note = f"image offsets are those of nearest images; the longest edge is {part:.2f} of the height of the cell"
    return replace(data, offsets=images).noting(note)


def _consistent(data: NetworkData, length: Array, images: IntArray, shortest: Array) -> NetworkData:
    """Given offsets; where a convention is wrong, with the sign reversed on edges that are thereby nearest images.

    length    (N_b,) with the given offsets, and `shortest` with those of the nearest images

    A few edges that are longer than the cell may be meant: they stay, with a sentence.
    """
    assert data.cell is not None and data.offsets is not None
    doubtful, n_crossing, contradicted = doubtful_offsets(data.edges, data.offsets, data.cell, data.positions)
    reverse = (data.offsets == -images).all(axis=1) & (shortest < _NEARER * length)
    if not contradicted and reverse.sum() <= max(1, _REVERSED * n_crossing):
        if not len(doubtful):
            return data
        edge = doubtful[0]
        i, j = (data.name(int(vertex)) for vertex in data.edges[edge])
        return data.noting(
            f"{counted(len(doubtful), 'edge', 'is')} longer than the cell, between vertices {i} and {j} first: "
            f"{length[edge]:.3g}, the nearest image {shortest[edge]:.3g}; the offsets were kept as given"
        )
    wrong = doubtful[~reverse[doubtful]]
    if len(wrong):
        raise InputError(
            f"the offsets of {counted(len(wrong), 'edge')} contradict the positions: edge {wrong[0]} has the length "
            f"{length[wrong[0]]:.3g}, its nearest image {shortest[wrong[0]]:.3g}: correct them, or leave them out"
        )
    turned = replace(data, offsets=np.where(reverse[:, None], images, data.offsets))
    return turned.repairing(
        f"the offsets of {counted(int(reverse.sum()), 'edge')} pointed from head to tail; their sign was reversed"
    )


def _nearest(difference: Array, cell: Array) -> IntArray:
    """Offsets of the nearest images, among the neighbours of the rounded ones (cells may be oblique)."""
    base = -np.round(difference @ np.linalg.inv(cell)).astype(np.int64)
    best, length = base, np.linalg.norm(difference + base @ cell, axis=1)
    for step in np.ndindex(*(3,) * len(cell)):
        trial = base + np.array(step) - 1
        size = np.linalg.norm(difference + trial @ cell, axis=1)
        shorter = size < length * (1 - 1e-12)
        best, length = np.where(shorter[:, None], trial, best), np.where(shorter, size, length)
    return best
