"""A pair of vertices across each face of a planar network, as sources and targets of local responses."""

from __future__ import annotations

from typing import Any

import numpy as np

from critflow.arguments import of_kind
from critflow.networks import Network
from critflow.result import InputError
from critflow_extras.local.pairs import spelled_pair


def face_diagonals(network: Network) -> list[tuple[int, int, tuple[int, ...]]]:
    """(i, j, image) of two opposite vertices of each face with at least four sides, in the order of the faces.

    Left out are faces whose two vertices an edge joins, or which are images of one vertex.

    >>> import critflow as cf
    >>> from critflow_extras.local.diagonals import face_diagonals
    >>> len(face_diagonals(cf.lattice("honeycomb", 3, 3)))
    9
    """
    network = of_kind(Network, network=network)
    if network.faces is None:
        raise InputError("the network has no faces, so that none has a diagonal: give pairs of vertices")
    joined = {(*edge, *offset) for edge, offset in zip(network.edges.tolist(), network.offsets.tolist(), strict=True)}
    diagonals = []
    for first, last in zip(network.faces.starts[:-1], network.faces.starts[1:], strict=True):
        i, j, image = _across(network, int(first), int(last))
        edges = {(i, j, *image), (j, i, *(-n for n in image))}
        if last - first >= 4 and i != j and not edges & joined:
            diagonals.append((i, j, image))
    return diagonals


def _across(network: Network, first: int, last: int) -> tuple[int, int, tuple[int, ...]]:
    """The first vertex of a walk around a face, the one half of its sides later, and the image of that."""
    assert network.faces is not None
    edges = network.faces.edges[first : first + (last - first) // 2]
    signs = network.faces.signs[first : first + (last - first) // 2]
    start = int(network.edges[edges[0], 0 if signs[0] > 0 else 1])
    end = int(network.edges[edges[-1], 1 if signs[-1] > 0 else 0])
    return start, end, tuple(int(n) for n in np.sum(signs[:, None] * network.offsets[edges], axis=0))


def response_name(source: Any, target: Any, stress: float = 0.0) -> str:
    """local[i-j:n:m,k-l:n:m], the name of the response of a target (k, l, image) to a source (i, j, image).

    stress  t of the stress tσ, in units of k; in the limit of no stress the name has none

    Raises `InputError` for pairs without an image or with numbers that are not whole, and for a negative stress.

    >>> from critflow_extras.local.diagonals import response_name
    >>> response_name((3, 50, (1, 0)), (20, 77, (0, 0)))
    'local[3-50:1:0,20-77:0:0]'
    """
    of_kind(float, stress=stress)
    if not 0 <= stress < np.inf:
        raise InputError(f"stress must be zero or a positive number, not {stress:.3g}")
    under = f",{float(stress)!r}" if stress else ""
    return f"local[{spelled_pair(source, 'source')},{spelled_pair(target, 'target')}{under}]"
