"""Fixed vertices of a free patch: by list, mask, hull, degree or box; a patch without any gets a proposal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull, QhullError

from critflow.exchange.data import Array, NetworkData, counted
from critflow.result import InputError, NetworkError

Pins = str | Sequence[int | str] | ArrayLike | None

# Vertices within this part of the size of the patch from its border are on it.
_ON_BORDER = 1e-6


def with_pins(data: NetworkData, pins: Pins) -> NetworkData:
    """The data with fixed vertices.

    pins  "hull", "degree" (vertices of one edge), "box" (vertices on the bounding box), "border" (vertices at the edges
          of a picture), names or indices of vertices, or a mask (N_v,)
    """
    if pins is None:
        return data
    chosen = _by_rule(data, pins) if isinstance(pins, str) else _listed(data, pins)
    if not len(chosen):
        raise InputError(f"no vertex is fixed by pins={pins!r:.40}: choose another rule, or list vertices")
    note = f"{counted(len(chosen), 'vertex', 'is')} fixed" + (f" ({_RULES[pins]})" if isinstance(pins, str) else "")
    return replace(data, pins=tuple(map(int, chosen))).noting(note)


def hull_volume(positions: Array) -> float:
    """Volume (area in two dimensions) of the convex hull of vertices (N_v, d)."""
    if positions.shape[1] == 1:
        return float(np.ptp(positions))
    try:
        return float(ConvexHull(positions).volume)
    except (QhullError, ValueError):
        raise InputError("the vertices span no convex hull: name the volume as a number, such as volume=1.0") from None


def require_boundary(data: NetworkData) -> NetworkData:
    """The record itself; `NetworkError` with a proposal where it has neither a cell nor fixed vertices."""
    if data.cell is not None or data.pins:
        return data
    proposals = []
    for rule, meaning in _RULES.items():
        count = len(_by_rule(data, rule))
        if count:
            proposals.append(f"pins='{rule}' fixes {count} ({meaning})")
    raise NetworkError(
        f"the network has neither a cell nor fixed vertices, so it collapses; which of its {data.n_vertices} vertices "
        f"are fixed? {'; '.join(proposals)}; or give a list of vertices, or a cell"
    )


_RULES = {
    "hull": "the corners and sides of the convex hull",
    "degree": "vertices of a single edge",
    "box": "vertices on the bounding box",
    "border": "vertices at the edges of the picture",
}


def _by_rule(data: NetworkData, rule: str) -> NDArray[np.intp]:
    if rule not in _RULES:
        raise InputError(f"no rule for fixed vertices is called {rule!r}: choose {', '.join(_RULES)}, or give a list")
    if rule == "border":
        return np.array(data.border, np.intp)
    if rule == "degree":
        return np.flatnonzero(np.bincount(data.edges.ravel(), minlength=data.n_vertices) == 1)
    # Vertices without edges leave the network, and are no part of its border.
    used = np.unique(data.edges)
    x = data.positions[used]
    size = float(np.ptp(x, axis=0).max()) or 1.0
    if rule == "box":
        near = np.minimum(x - x.min(axis=0), x.max(axis=0) - x) <= _ON_BORDER * size
        return used[near.any(axis=1)]
    try:
        hull = ConvexHull(x)
    except (QhullError, ValueError):
        return np.zeros(0, np.intp)
    # Also the vertices on straight sides, which are no corners of the hull.
    distance = x @ hull.equations[:, :-1].T + hull.equations[:, -1]
    return used[(distance >= -_ON_BORDER * size).any(axis=1)]


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
            raise InputError(
                f"the fixed vertex {value!r} does not exist: give names or indices of vertices of the source"
            )
        chosen.append(index)
    return np.unique(np.array(chosen, dtype=np.intp))
