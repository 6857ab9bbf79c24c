"""Drawings to cut, SVG, and solids to print, STL and 3MF, in millimetres.

Periodic networks are cut at the border of their cell.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import scipy

from critflow.pictures import BORDER, TENSION_COLOURS, images_in_cell
from critflow.result import InputError
from critflow_extras.drawing.scales import varied, widely
from critflow_extras.files.data import Array, IntArray, NetworkData, bond_vectors_of, optional

# STL has no field for units, and programs show its header of 80 bytes.
_HEADER = b"critflow network, lengths in millimetres".ljust(80)
# Sides of a strut; part of the radius by which struts end inside the balls, so that those in one line share no vertex
# when a program joins equal ones.
_SIDES, _INSET = 12, 0.2
# Rectangles of the bar of colours; largest size in mm, of which STL's single precision leaves micrometres.
_BAR, _LARGEST = 32, 1e5


def write_svg(
    data: NetworkData, path: Path, size: float = 100.0, width: float = 0.5, by_stiffness: bool | None = None
) -> None:
    """An SVG drawing whose larger side is `size` mm, with lines `width` mm wide.

    by_stiffness  a strip of a sheet has k ∝ width/|L|: widths ∝ k|L| of the mean `width`, for a cutter.  None: the
                  same where k varies, with colours by k and a legend below the network, for the eye

    Raises `InputError` for sizes that are not positive and finite.
    """
    require_sizes(size=size, width=width)
    segments, edges, low, high = planar_segments(data)
    scale = size / float((high - low).max())
    across, down = (scale * (high - low)).tolist()
    flipped = scale * np.stack([segments[..., 0] - low[0], high[1] - segments[..., 1]], axis=-1)
    lines = [f"M{a[0]:.6f} {a[1]:.6f}L{b[0]:.6f} {b[1]:.6f}" for a, b in flipped.tolist()]
    k = stiffnesses_of(data)
    coloured = by_stiffness is None and varied(k)
    widths = width * relative_sections(data) if by_stiffness or coloured else np.array([width])
    colours = [hexadecimal(place) for place in strengths(k)] if coloured else ["black"] * data.n_edges
    if len(widths) == 1:
        paths = _line("".join(lines), "black", width)
    else:
        parts = zip(lines, edges.tolist(), strict=True)
        paths = "".join(_line(line, colours[edge], float(widths[edge])) for line, edge in parts)
    legend, below = _legend(k, size, across, down) if coloured else ("", 0.0)
    margin = float(widths.max())
    view = f"{-margin:.6f} {-margin:.6f} {across + 2 * margin:.6f} {down + below + 2 * margin:.6f}"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" '
        f'width="{across + 2 * margin:.6f}mm" height="{down + below + 2 * margin:.6f}mm" '
        f'viewBox="{view}"><title>critflow network, millimetres</title>'
        f"{paths}{legend}</svg>\n",
        encoding="utf-8",
    )


def _line(line: str, colour: str, wide: float) -> str:
    return f'<path d="{line}" fill="none" stroke="{colour}" stroke-linecap="round" stroke-width="{wide:.6g}"/>'


def _legend(k: Array, size: float, across: float, down: float) -> tuple[str, float]:
    """A bar of the colours of stiffnesses (N_b,) below a drawing, with both ends in numbers, and its height in mm."""
    letters, top = 0.03 * size, down + 0.04 * size
    low = float(k.min()) if widely(k) else 0.0
    step = 0.5 * across / _BAR
    pieces = "".join(
        f'<rect x="{0.25 * across + n * step:.6f}" y="{top:.6f}" width="{1.05 * step:.6f}" '
        f'height="{0.8 * letters:.6f}" fill="{hexadecimal((n + 0.5) / _BAR)}"/>'
        for n in range(_BAR)
    )
    font = f'y="{top + 0.8 * letters:.6f}" font-family="sans-serif" font-size="{letters:.6g}"'
    ends = ((0.24, "end", f"k = {low:.4g}"), (0.76, "start", f"{k.max():.4g}{' (log)' if low else ''}"))
    texts = "".join(
        f'<text x="{place * across:.6f}" {font} text-anchor="{anchor}">{words}</text>' for place, anchor, words in ends
    )
    return f"<g>{pieces}{texts}</g>", 0.04 * size + 2 * letters


def require_sizes(**sizes: float) -> None:
    """Raise `InputError` for a length in mm that is not positive, or so large that its coordinates overflow."""
    for name, value in sizes.items():
        if not 0 < value <= _LARGEST:
            raise InputError(f"{name}={value:g} must be positive and at most {_LARGEST:g}, in millimetres")


def write_solid(
    data: NetworkData, path: Path, size: float = 100.0, radius: float = 1.0, by_stiffness: bool | None = None
) -> None:
    """STL or 3MF of struts of a radius in mm with balls at their ends; the longest extent of the network is `size` mm.

    by_stiffness  struts have k = E π r²/|L|: radii ∝ √(k|L|), whose mean cross section is that of `radius`; None: where
                  k varies

    Struts and balls are closed bodies that overlap; slicers join them.
    Raises `InputError` for sizes that are not positive and finite, and for struts wider than the solid.
    """
    require_sizes(size=size, radius=radius)
    if radius > size:
        raise InputError(
            f"radius={radius:g} mm is more than the whole solid of size={size:g} mm: give a smaller radius"
        )
    by_stiffness = varied(stiffnesses_of(data)) if by_stiffness is None else by_stiffness
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


def stiffnesses_of(data: NetworkData) -> Array:
    """k (N_b,), one where the record has none."""
    return np.ones(data.n_edges) if data.stiffness is None else data.stiffness


def relative_sections(data: NetworkData) -> Array:
    """Cross sections of elastic struts of the stiffnesses k = E A/|L|, over their mean, (N_b,)."""
    sections = stiffnesses_of(data) * np.linalg.norm(bond_vectors_of(data), axis=1)
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


def strengths(values: Array) -> Array:
    """The place of positive values (n,) between the light and the dark end of the colours, from 0 to 1."""
    if not widely(values):
        return np.asarray(values / values.max())
    low, high = np.log([values.min(), values.max()])
    return np.asarray((np.log(values) - low) / (high - low))


def hexadecimal(strength: float) -> str:
    """The colour of a place from 0 to 1, interpolated between `TENSION_COLOURS`."""
    ends = np.array([[int(colour[n : n + 2], 16) for n in (1, 3, 5)] for colour in TENSION_COLOURS])
    place = np.linspace(0, 1, len(ends))
    red, green, blue = (round(float(np.interp(strength, place, channel))) for channel in ends.T)
    return f"#{red:02x}{green:02x}{blue:02x}"
