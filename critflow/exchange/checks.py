"""Values of a record that no repair can correct: each is refused with one sentence."""

from __future__ import annotations

import numpy as np

from critflow.exchange.data import NetworkData, counted
from critflow.result import NetworkError

# Volumes of unit cell vectors below this are none.
_NO_VOLUME = 1e-9
# Squares of coordinates beyond this overflow.
_FAR = 1e100


def check(data: NetworkData) -> None:
    """Refuse values that no repair can correct."""
    if data.edges.ndim != 2 or data.edges.shape[1:] != (2,) or not data.n_edges:
        raise NetworkError("the source has no edges: give pairs of vertices")
    if data.positions.ndim != 2 or not 1 <= data.dimension <= 3:
        raise NetworkError(f"positions must have two or three columns, not the shape {data.positions.shape}")
    bad = np.flatnonzero(~np.isfinite(data.positions).all(axis=1))
    if len(bad):
        name = data.name(int(bad[0]))
        raise NetworkError(
            f"the positions of {counted(len(bad), 'vertex')} are not numbers, vertex {name} first: correct them"
        )
    outside = np.flatnonzero(((data.edges < 0) | (data.edges >= data.n_vertices)).any(axis=1))
    if len(outside):
        raise NetworkError(
            f"{counted(len(outside), 'edge', 'names')} vertices that do not exist, edge {outside[0]} first (of "
            f"{data.n_vertices} vertices): add them, or check whether counting begins at 0 or 1"
        )
    _check_values(data)


def _check_values(data: NetworkData) -> None:
    """Refuse a cell and values of edges that are undefined or have a wrong shape."""
    if np.abs(data.positions).max(initial=0.0) > _FAR:
        raise NetworkError(f"positions lie beyond {_FAR:.0e}: choose other units")
    cell = data.cell
    if cell is not None:
        sides = np.linalg.norm(cell, axis=1) if np.isfinite(cell).all() and np.abs(cell).max() < _FAR else np.zeros(1)
        if not sides.all() or abs(np.linalg.det(cell / sides[:, None])) < _NO_VOLUME:
            raise NetworkError("the cell vectors must be finite and span a volume: correct the cell")
    for name in ("offsets", "bond_vectors"):
        values = getattr(data, name)
        if values is not None and values.shape != (data.n_edges, data.dimension):
            raise NetworkError(f"{name} must have shape {(data.n_edges, data.dimension)}, not {values.shape}")
    for name in ("bond_vectors", "stiffness", "rest_lengths", "force_densities"):
        values = getattr(data, name)
        if values is None:
            continue
        wrong = ~np.isfinite(values) | ((values < 0) if name == "rest_lengths" else False)
        if wrong.any():
            edge = int(np.argwhere(wrong)[0, 0])
            raise NetworkError(f"{name} of edge {edge} is {values[edge]}: correct that value")
