"""Values of a record that no repair can correct: each is refused with one sentence."""

from __future__ import annotations

import numpy as np

from critflow.exchange.data import EDGE_VALUES, NetworkData
from critflow.networks.checks import check_ends, finite_rows
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
    finite_rows(data.positions, "positions", data.positions.shape)
    check_ends(data.edges, data.n_vertices)
    if np.abs(data.positions).max(initial=0.0) > _FAR:
        raise NetworkError(f"positions lie beyond {_FAR:.0e}: choose other units")
    for name, shape in (("offsets", (n, d)), ("bond_vectors", (n, d)), *((name, (n,)) for name in EDGE_VALUES)):
        if (values := getattr(data, name)) is not None:
            finite_rows(values, name, shape)
    if data.rest_lengths is not None and (short := np.flatnonzero(data.rest_lengths < 0)).size:
        raise NetworkError(f"rest_lengths[{short[0]}] = {data.rest_lengths[short[0]]} is negative: correct that value")
    if data.cell is not None:
        finite = np.isfinite(data.cell).all() and np.abs(data.cell).max() < _FAR
        sides = np.linalg.norm(data.cell, axis=1) if finite else np.zeros(1)
        if not sides.all() or abs(np.linalg.det(data.cell / sides[:, None])) < _NO_VOLUME:
            raise NetworkError("the cell vectors must be finite and span a volume: correct the cell")
