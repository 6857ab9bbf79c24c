"""Values of a record that no repair can correct: each is refused with one sentence."""

from __future__ import annotations

import numpy as np

from critflow.exchange.data import EDGE_VALUES, NetworkData, counted
from critflow.result import NetworkError

# Volumes of unit cell vectors below this are none.
_NO_VOLUME = 1e-9
# Squares of coordinates beyond this overflow.
_FAR = 1e100


def check(data: NetworkData) -> None:
    """Refuse values that no repair can correct."""
    n, d = data.n_edges, data.positions.shape[-1]
    if data.edges.ndim != 2 or data.edges.shape[1:] != (2,) or not n:
        raise NetworkError("the source has no edges: give pairs of vertices")
    if data.positions.ndim != 2 or not 1 <= d <= 3:
        raise NetworkError(f"positions must have two or three columns, not the shape {data.positions.shape}")
    bad = np.flatnonzero(~np.isfinite(data.positions).all(axis=1))
    if len(bad):
        raise NetworkError(
            f"the positions of {counted(len(bad), 'vertex')} are not numbers, vertex {data.name(int(bad[0]))} first: "
            "correct them"
        )
    outside = np.flatnonzero(((data.edges < 0) | (data.edges >= data.n_vertices)).any(axis=1))
    if len(outside):
        raise NetworkError(
            f"{counted(len(outside), 'edge', 'names')} vertices that do not exist, edge {outside[0]} first (of "
            f"{data.n_vertices} vertices): add them, or check whether counting begins at 0 or 1"
        )
    if np.abs(data.positions).max(initial=0.0) > _FAR:
        raise NetworkError(f"positions lie beyond {_FAR:.0e}: choose other units")
    for name, shape in (("offsets", (n, d)), ("bond_vectors", (n, d)), *((name, (n,)) for name in EDGE_VALUES)):
        values = getattr(data, name)
        if values is None:
            continue
        if values.shape != shape:
            raise NetworkError(f"{name} must have shape {shape}, one row for each edge, not {values.shape}")
        wrong = ~np.isfinite(values) | ((values < 0) if name == "rest_lengths" else False)
        if wrong.any():
            edge = int(np.argwhere(wrong)[0, 0])
            raise NetworkError(f"{name} of edge {edge} is {values[edge]}: correct that value")
    if data.cell is not None:
        finite = np.isfinite(data.cell).all() and np.abs(data.cell).max() < _FAR
        sides = np.linalg.norm(data.cell, axis=1) if finite else np.zeros(1)
        if not sides.all() or abs(np.linalg.det(data.cell / sides[:, None])) < _NO_VOLUME:
            raise NetworkError("the cell vectors must be finite and span a volume: correct the cell")
