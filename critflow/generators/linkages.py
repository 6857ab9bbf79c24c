"""The three-bar linkage, the smallest network of the paper."""

from __future__ import annotations

import numpy as np

from critflow.arguments import of_kind
from critflow.networks.network import Network


def three_bar_linkage(span: float = 3.0) -> Network:
    """Three edges in a row between two fixed points `span` apart (`3-barlinkage`): lengths ∝ 1/σ_α on a line.

    >>> import critflow as cf
    >>> cf.three_bar_linkage()
    Network(4 vertices, 3 edges, 2 dimensions, 2 pins, z = 1.5)
    """
    of_kind(float, span=span)
    return Network(
        np.array([[0, 1], [1, 2], [2, 3]]),
        pins={0: np.zeros(2), 3: np.array([span, 0.0])},
        positions=np.array([[0.0, 0.0], [span / 3, 0.3], [2 * span / 3, -0.3], [span, 0.0]]),
    )
