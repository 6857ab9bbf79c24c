"""Polynomial extrapolation of a path from its last points and velocities."""

from __future__ import annotations

import numpy as np

from critflow.networks.network import Array

# Beyond this number of previous steps ahead a polynomial extrapolates worse than a straight line.
_FARTHEST = 2
# Points of the path from which it is extrapolated.
_MOST_POINTS = 3


class Predictor:
    """Extrapolates the path (y, q)(γ) from its last two or three points, whichever predicted the last one better."""

    def __init__(self, start: Array, velocity: Array | None = None):
        self._points: list[tuple[float, Array, Array | None]] = [(0.0, start, velocity)]
        # The changes (1 or 2, n) extrapolated last, from two points and from three, and the strain there.
        self._changes, self._strain, self._better = np.zeros((1, len(start))), np.nan, -1

    @property
    def last(self) -> Array:
        """The last point (n,)."""
        return self._points[-1][1]

    def add(self, strain: float, y: Array, velocity: Array | None) -> None:
        """Add a point of the path (n,) with its velocity dy/dγ; the last three are kept."""
        if strain == self._strain and len(self._changes) > 1:
            self._better = int(np.abs(self._changes - (y - self.last)).max(axis=1).argmin())
        self._points = [*self._points[1 - _MOST_POINTS :], (strain, y, velocity)]

    def displacement(self, strain: float) -> Array:
        """Extrapolated change of y (n,) from the last point."""
        last, y, velocity = self._points[-1]
        self._strain = np.nan
        if velocity is None:
            return np.zeros_like(y)
        ahead, behind = strain - last, last - self._points[-2:][0][0]
        if abs(ahead) > _FARTHEST * abs(behind):
            return velocity * ahead
        # Conditions on a polynomial that vanishes at the last point, in units of the last step.
        rows, values, counts = [_monomial_rates(0.0)], [velocity * behind], []
        for there, y_there, velocity_there in self._points[-2::-1]:
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
        self._changes, self._strain = weights @ np.array(values), strain
        return np.asarray(self._changes[self._better if len(counts) > 1 else 0])


_POWERS = np.arange(1, 2 * _MOST_POINTS)


def _monomials(t: float) -> Array:
    """t, t², …, of as many powers as a Hermite polynomial of the points may have."""
    return np.power(t, _POWERS)


def _monomial_rates(t: float) -> Array:
    """Derivatives of `_monomials`."""
    return np.asarray(_POWERS * np.power(t, _POWERS - 1))
