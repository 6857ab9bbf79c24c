"""Polynomial extrapolation of a path from its last points and velocities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from critflow.networks.network import Array

# Beyond this number of previous steps ahead a polynomial extrapolates worse than a straight line.
_FARTHEST = 2
# Points of the path from which it is extrapolated.
_MOST_POINTS = 3


@dataclass(frozen=True, eq=False)
class Predictor:
    """Extrapolates a path y(γ) from its last two or three points, whichever predicted the last one better.

    points  (γ, y, dy/dγ) of the last points, the newest last; y and dy/dγ (n,), the latter None if it is unknown
    better  index of the better prediction: from two points 0, from all −1
    """

    points: tuple[tuple[float, Array, Array | None], ...]
    better: int = -1

    @classmethod
    def at(cls, strain: float, y: Array, velocity: Array | None = None) -> Predictor:
        """The predictor at the first point of a path."""
        return cls(((strain, y, velocity),))

    def extended(self, strain: float, y: Array, velocity: Array | None, predicted: Array) -> Predictor:
        """The predictor with a further point, of which `changes` were predicted; the last three are kept."""
        better = self.better
        if len(predicted) > 1:
            better = int(np.abs(predicted - (y - self.points[-1][1])).max(axis=1).argmin())
        return Predictor((*self.points[1 - _MOST_POINTS :], (strain, y, velocity)), better)

    def chosen(self, changes: Array) -> Array:
        """The change (n,) to use of those predicted."""
        return np.asarray(changes[self.better if len(changes) > 1 else 0])

    def changes(self, strain: float) -> Array:
        """Extrapolated changes of y from the newest point (1 or 2, n): from two points, and from three."""
        last, y, velocity = self.points[-1]
        if velocity is None:
            return np.zeros((1, len(y)))
        ahead, behind = strain - last, last - self.points[-2:][0][0]
        if abs(ahead) > _FARTHEST * abs(behind):
            return (velocity * ahead)[None]
        values = [part for _, there, rate in self.points for part in (there - y, rate) if part is not None]
        weights = [_weights(self.points[-n:], strain) for n in range(2, len(self.points) + 1)]
        return np.array([[0.0] * (len(values) - len(row)) + row for row in weights]) @ np.array(values)


def _weights(points: tuple[tuple[float, Array, Array | None], ...], strain: float) -> list[float]:
    """The weights in a Hermite polynomial at a strain: of the value and, if known, the velocity of each point."""
    weights = list[float]()
    for here, _, velocity in points:
        value, slope = 1.0, 0.0
        for there, _, rate in points:
            if there != here:
                order = 1 if rate is None else 2
                value *= ((strain - there) / (here - there)) ** order
                slope += order / (here - there)
        weights += [value] if velocity is None else [value * (1 - (strain - here) * slope), value * (strain - here)]
    return weights
