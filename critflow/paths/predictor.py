"""Polynomial extrapolation of a path from its last points and velocities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from critflow.networks.network import Array

# Beyond this number of previous steps ahead a polynomial extrapolates worse than a straight line.
_FARTHEST = 2
# Points of the path from which it is extrapolated.
_MOST_POINTS = 3
_POWERS = np.arange(1, 2 * _MOST_POINTS)


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
        """Extrapolated changes of y from the newest point (1 or 2, n): from two points, and from three.

        Hermite polynomials y − y_0 = Σ_k c_k t^k in t = (γ − γ_0)/(γ_0 − γ_1), with one condition for each value and
        each velocity.
        """
        last, y, velocity = self.points[-1]
        if velocity is None:
            return np.zeros((1, len(y)))
        ahead, behind = strain - last, last - self.points[-2:][0][0]
        if abs(ahead) > _FARTHEST * abs(behind):
            return (velocity * ahead)[None]
        rows, values, counts = [_monomial_rates(0.0)], [velocity * behind], []
        for there, y_there, velocity_there in self.points[-2::-1]:
            place = (there - last) / behind
            rows.append(_monomials(place))
            values.append(y_there - y)
            if velocity_there is not None:
                rows.append(_monomial_rates(place))
                values.append(velocity_there * behind)
            counts.append(len(rows))
        weights = np.zeros((len(counts), len(rows)))
        for weight, n in zip(weights, counts, strict=True):
            weight[:n] = np.linalg.solve(np.array(rows)[:n, :n].T, _monomials(ahead / behind)[:n])
        return np.asarray(weights @ np.array(values))


def _monomials(t: float) -> Array:
    """t, t², …, of as many powers as a Hermite polynomial of the points may have."""
    return np.power(t, _POWERS)


def _monomial_rates(t: float) -> Array:
    """Derivatives of `_monomials`."""
    return np.asarray(_POWERS * np.power(t, _POWERS - 1))
