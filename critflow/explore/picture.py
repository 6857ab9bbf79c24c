"""Drawings of the page: line segments with their colours, from arrays; also the edge or face nearest to a pointer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from critflow.figures.plot import COMPRESSED, SLACK, TENSION_MAP, face_polygon, periodic_segments, polygon_images
from critflow.networks.faces import Faces
from critflow.networks.network import Array, IntArray, Network

SHADES = 32
# Numbers of the two colours after the shades of tension.
_SLACK, _COMPRESSED = SHADES, SHADES + 1
# Edges with less than this part of the mean |tension| carry none.
_NO_TENSION = 1e-9
_CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


def _palette() -> list[str]:
    """Hexadecimal colours: the shades of tension from light to dark, slack, compressed."""
    shades = (np.asarray(TENSION_MAP(np.linspace(0, 1, SHADES)))[:, :3] * 255).round().astype(int)
    return [*("#{:02x}{:02x}{:02x}".format(*shade) for shade in shades.tolist()), SLACK, COMPRESSED]


PALETTE = _palette()


@dataclass(frozen=True, eq=False)
class Drawing:
    """Line segments in the order in which they are drawn.

    segments  (n, 2, 2) end points
    shades    (n,) number of the colour in `PALETTE`
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


def shades_of(tensions: Array) -> NDArray[np.uint8]:
    """The number of the colour of each tension (n,), from zero to the 99th percentile."""
    size = np.abs(tensions)
    scale = float(np.percentile(size, 99)) or 1.0
    shade = np.minimum(size / scale * SHADES, SHADES - 1).astype(np.uint8)
    slack = size <= _NO_TENSION * (float(size.mean()) or 1.0)
    return np.where(slack, _SLACK, np.where(tensions < 0, _COMPRESSED, shade)).astype(np.uint8)


def network_drawing(network: Network, coordinates: Array, tensions: Array) -> Drawing:
    """The network with its edges coloured by tension, each edge in all images that touch the cell."""
    if network.cell is not None:
        return periodic_drawing(network.edges, network.offsets, network.cell, coordinates, tensions)
    low, high = coordinates.min(axis=0), coordinates.max(axis=0)
    margin = 0.03 * float(np.max(high - low))
    outline = low - margin + _CORNERS * (high - low + 2 * margin)
    return _ordered(coordinates[network.edges], np.arange(network.n_edges), tensions, outline)


def periodic_drawing(edges: IntArray, offsets: IntArray, cell: Array, coordinates: Array, tensions: Array) -> Drawing:
    """A periodic graph, such as a network or its reciprocal force diagram, with its edges coloured by tension."""
    return _ordered(*periodic_segments(edges, offsets, cell, coordinates), tensions, _CORNERS @ cell)


def _ordered(segments: Array, edges: IntArray, tensions: Array, outline: Array) -> Drawing:
    """Slack edges first, then from light to dark, compressed ones last."""
    shades = shades_of(tensions)[edges]
    order = np.argsort(np.where(shades == _SLACK, -1, shades.astype(int)), kind="stable")
    return Drawing(segments[order], shades[order], edges[order], outline)


def face_outlines(faces: Faces, face: int, network: Network, coordinates: Array, L: Array) -> list[Array]:
    """The corners (n_sides, 2) of a face, in all images that touch the cell."""
    polygon = face_polygon(faces, face, network.edges, coordinates, L)
    return [polygon] if network.cell is None else polygon_images(polygon, network.cell)
