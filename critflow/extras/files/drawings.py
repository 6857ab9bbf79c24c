"""Drawings to cut, SVG, and solids to print, STL and 3MF, in millimetres.

Periodic networks are cut at the border of their cell.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import scipy

from critflow.extras.files.data import Array, IntArray, NetworkData, bond_vectors_of, optional
from critflow.networks.periodic_cell import BORDER, images_in_cell
from critflow.result import InputError

# STL has no field for units, and programs show its header of 80 bytes.
_HEADER = b"critflow network, lengths in millimetres".ljust(80)
# Sides of a strut; part of the radius by which struts end inside the balls, so that those in one line share no vertex
# when a program joins equal ones.
_SIDES, _INSET = 12, 0.2


def write_svg(
    data: NetworkData, path: Path, size: float = 100.0, width: float = 0.5, by_stiffness: bool = False
) -> None:
    """An SVG drawing whose larger side is `size` mm, with lines `width` mm wide.

    by_stiffness  a strip of a sheet has k ∝ width/|L|: widths ∝ k|L| of the mean `width`
    """
    segments, edges, low, high = planar_segments(data)
    scale = size / float((high - low).max())
    across, down = scale * (high - low)
    flipped = scale * np.stack([segments[..., 0] - low[0], high[1] - segments[..., 1]], axis=-1)
    lines = [f"M{a[0]:.6f} {a[1]:.6f}L{b[0]:.6f} {b[1]:.6f}" for a, b in flipped.tolist()]
    widths = width * relative_sections(data) if by_stiffness else np.array([width])
    parts = zip(lines, widths[edges], strict=True) if by_stiffness else [("".join(lines), width)]
    style = 'fill="none" stroke="black" stroke-linecap="round"'
    paths = "".join(f'<path d="{line}" {style} stroke-width="{wide:.6g}"/>' for line, wide in parts)
    margin = float(widths.max())
    view = f"{-margin:.6f} {-margin:.6f} {across + 2 * margin:.6f} {down + 2 * margin:.6f}"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" '
        f'width="{across + 2 * margin:.6f}mm" height="{down + 2 * margin:.6f}mm" '
        f'viewBox="{view}"><title>critflow network, millimetres</title>'
        f"{paths}</svg>\n",
        encoding="utf-8",
    )


def write_solid(
    data: NetworkData, path: Path, size: float = 100.0, radius: float = 1.0, by_stiffness: bool = False
) -> None:
    """STL or 3MF of struts of a radius in mm with balls at their ends; the longest extent of the network is `size` mm.

    by_stiffness  struts have k = E π r²/|L|: radii ∝ √(k|L|), whose mean cross section is that of `radius`

    Struts and balls are closed bodies that overlap; slicers join them.
    """
    if not radius > 0 or not size > 0:
        raise InputError("size and radius of a solid must be positive, in millimetres")
    trimesh = optional("trimesh")
    pieces, edges = clipped_segments(data)
    segments = np.zeros((*pieces.shape[:2], 3))
    segments[..., : data.dimension] = pieces * (size / float(np.ptp(pieces.reshape(-1, data.dimension), axis=0).max()))
    radii = radius * (np.sqrt(relative_sections(data))[edges] if by_stiffness else np.ones(len(edges)))
    bodies = []
    for (a, b), r in zip(segments, radii, strict=True):
        inset = (b - a) * min(0.25, _INSET * r / float(np.linalg.norm(b - a)))
        bodies.append(trimesh.creation.cylinder(r, sections=_SIDES, segment=[a + inset, b - inset]))
    # One ball where ends are close, of the largest strut that ends there; of ends in a chain more than one may stay.
    points, largest = segments.reshape(-1, 3), np.repeat(radii, 2)
    order, ball = np.arange(len(points)), trimesh.creation.icosphere(subdivisions=1)
    pairs = scipy.spatial.KDTree(points).query_pairs(_INSET * float(radii.min()), output_type="ndarray")
    np.minimum.at(order, pairs.max(axis=1), pairs.min(axis=1))
    np.maximum.at(largest, order, np.repeat(radii, 2))
    for n in np.flatnonzero(order == np.arange(len(points))):
        bodies.append(trimesh.Trimesh(points[n] + largest[n] * ball.vertices, ball.faces, process=False))
    solid = trimesh.util.concatenate(bodies)
    solid.apply_translation(-segments.min(axis=(0, 1)))
    # The unit of trimesh's 3MF files is the millimetre.
    content = solid.export(file_type=path.suffix.lower()[1:])
    path.write_bytes(_HEADER + content[80:] if path.suffix.lower() == ".stl" else content)


def relative_sections(data: NetworkData) -> Array:
    """Cross sections of elastic struts of the stiffnesses k = E A/|L|, over their mean, (N_b,)."""
    k = np.ones(data.n_edges) if data.stiffness is None else data.stiffness
    sections = k * np.linalg.norm(bond_vectors_of(data), axis=1)
    return np.asarray(sections / sections.mean())


def planar_segments(data: NetworkData) -> tuple[Array, IntArray, Array, Array]:
    """End points (n, 2, 2) of all edges, cut at the border of the cell, their edges, and the corners of the drawing."""
    segments, edges = clipped_segments(data)
    corners = segments.reshape(-1, 2) if data.cell is None else np.array(list(product((0, 1), repeat=2))) @ data.cell
    return segments, edges, corners.min(axis=0), corners.max(axis=0)


def clipped_segments(data: NetworkData) -> tuple[Array, IntArray]:
    """End points (n, 2, d) of edges, and the edge of each; of a periodic network all images, cut at its cell."""
    start = data.positions[data.edges[:, 0]]
    L = bond_vectors_of(data)
    if data.cell is None:
        return np.stack([start, start + L], axis=1), np.arange(data.n_edges)
    ends, edges = images_in_cell(np.stack([start, start + L], axis=1) @ np.linalg.inv(data.cell))
    tail, step = ends[:, 0], ends[:, 1] - ends[:, 0]
    flat = np.abs(step) < 2 * BORDER
    # Liang and Barsky: the part of the line inside the unit cell; in a direction without extent all of it is inside.
    with np.errstate(divide="ignore", invalid="ignore"):
        first, last = np.sort([-tail / step, (1 - tail) / step], axis=0)
    enter = np.maximum(np.where(flat, 0, first).max(axis=1), 0)
    leave = np.minimum(np.where(flat, 1, last).min(axis=1), 1)
    pieces = np.stack([tail + enter[:, None] * step, tail + leave[:, None] * step], axis=1) @ data.cell
    inside = leave > enter + 1e-12
    return pieces[inside], edges[inside]
