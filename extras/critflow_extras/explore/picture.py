"""Drawings of the page: line segments with their colours, from arrays; also the edge or face nearest to a pointer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from numpy.typing import NDArray

from critflow.faces import Faces
from critflow.networks import Array, IntArray, Network
from critflow.pictures import COMPRESSED, SLACK, TENSION_MAP, face_polygon, periodic_segments, polygon_images

SHADES = 32
# Numbers of the two colours after the shades of tension.
_SLACK, _COMPRESSED = SHADES, SHADES + 1
# Edges with less than this part of the mean |tension| carry none.
_NO_TENSION = 1e-9
# Lengths that differ by less than this part of the largest are equal: their rounding has no colours.
_EQUAL = 1e-6
_CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
# On a dark page strong edges are light.
_DARK_TENSION_MAP = LinearSegmentedColormap.from_list("dark", ["#2b5580", "#4f93c4", "#a9d0ee", "#ffffff"])
_DARK_SLACK = "#68727c"

QUANTITIES = {
    "tension": "tension τ / ⟨τ⟩",
    "length": "length |L|, units of the network",
    "stress": "stress σ / ⟨σ⟩",
    "stiffness": "stiffness k, units of the network",
}
"""What colours the edges, by name, with the label of the colour bar."""


def _palette(colours: Callable[[Array], Any], slack: str) -> list[str]:
    """Hexadecimal colours: the shades from small to large values, slack, compressed."""
    shades = (np.asarray(colours(np.linspace(0, 1, SHADES)))[:, :3] * 255).round().astype(int)
    return [*("#{:02x}{:02x}{:02x}".format(*shade) for shade in shades.tolist()), slack, COMPRESSED]


PALETTES = {"light": _palette(TENSION_MAP, SLACK), "dark": _palette(_DARK_TENSION_MAP, _DARK_SLACK)}


@dataclass(frozen=True, eq=False)
class Drawing:
    """Line segments in the order in which they are drawn.

    segments  (n, 2, 2) end points
    shades    (n,) number of the colour in a palette of `PALETTES`
    edges     (n,) the edge of each segment
    outline   (m, 2) corners of the region shown; segments are cut there
    """

    segments: Array
    shades: NDArray[np.uint8]
    edges: IntArray
    outline: Array

    def nearest(self, point: Array) -> int:
        """The segment nearest to a point (2,)."""
        start, along = self.segments[:, 0], self.segments[:, 1] - self.segments[:, 0]
        square = np.maximum(np.einsum("ad,ad->a", along, along), np.finfo(float).tiny)
        part = np.clip(np.einsum("ad,ad->a", point - start, along) / square, 0, 1)
        return int(np.sum((start + part[:, None] * along - point) ** 2, axis=1).argmin())

    def side(self, segment: int, point: Array) -> int:
        """1 if a point (2,) lies to the left of a segment, else 0."""
        start, end = self.segments[segment]
        u, v = end - start, point - start
        return int(u[0] * v[1] - u[1] * v[0] > 0)


class Shades(NamedTuple):
    """Numbers of colours (n,), and the values at both ends of the colour bar."""

    numbers: NDArray[np.uint8]
    low: float
    high: float


def edge_values(quantity: str, sigma: Array, lengths: Array, stiffness: Array) -> Array:
    """The values (N_b,) of one of `QUANTITIES`: tensions and stresses over the mean of their sizes."""
    if quantity in ("length", "stiffness"):
        return lengths if quantity == "length" else stiffness
    values = sigma * lengths if quantity == "tension" else sigma
    return values / (float(np.abs(values).mean()) or 1.0)


def shades_of(values: Array, sigma: Array | None, from_zero: bool = True, logarithmic: bool = False) -> Shades:
    """Colours of the sizes of values (n,): from zero, or the 1st percentile, to the 99th; σ tells slack and compressed.

    sigma      None: neither is told
    from_zero  False for values that are never near zero, such as lengths
    """
    size = np.abs(values)
    low, high = np.percentile(size, [1, 99]).tolist()
    if from_zero or high - low <= _EQUAL * high:
        low = 0.0
    along = (
        np.log(np.maximum(size, low) / low) / np.log(high / low) if logarithmic else (size - low) / (high - low or 1)
    )
    shade = np.clip(along * SHADES, 0, SHADES - 1).astype(np.uint8)
    if sigma is None:
        return Shades(shade, low, high)
    slack = np.abs(sigma) <= _NO_TENSION * (float(np.abs(sigma).mean()) or 1.0)
    return Shades(np.where(slack, _SLACK, np.where(sigma < 0, _COMPRESSED, shade)).astype(np.uint8), low, high)


def network_drawing(network: Network, coordinates: Array, shades: NDArray[np.uint8]) -> Drawing:
    """The network with the colours (N_b,) of its edges, each edge in all images that touch the cell."""
    if network.cell is not None:
        return periodic_drawing(network.edges, network.offsets, network.cell, coordinates, shades)
    low, high = coordinates.min(axis=0), coordinates.max(axis=0)
    margin = 0.03 * float(np.max(high - low))
    outline = low - margin + _CORNERS * (high - low + 2 * margin)
    return _ordered(coordinates[network.edges], np.arange(network.n_edges), shades, outline)


def periodic_drawing(
    edges: IntArray, offsets: IntArray, cell: Array, coordinates: Array, shades: NDArray[np.uint8]
) -> Drawing:
    """A periodic graph, such as a network or its reciprocal force diagram, with the colours (N_b,) of its edges."""
    return _ordered(*periodic_segments(edges, offsets, cell, coordinates), shades, _CORNERS @ cell)


def _ordered(segments: Array, edges: IntArray, shades: NDArray[np.uint8], outline: Array) -> Drawing:
    """Slack edges first, then from small to large values, compressed ones last."""
    order = np.argsort(np.where(shades == _SLACK, 0, shades + 1)[edges], kind="stable")
    return Drawing(segments[order], shades[edges[order]], edges[order], outline)


def face_outlines(faces: Faces, face: int, network: Network, coordinates: Array, L: Array) -> list[Array]:
    """The corners (n_sides, 2) of a face, in all images that touch the cell."""
    polygon = face_polygon(faces, face, network.edges, coordinates, L)
    return [polygon] if network.cell is None else polygon_images(polygon, network.cell)
