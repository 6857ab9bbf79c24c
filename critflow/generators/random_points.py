"""Random sequential addition: points of a hard core in the periodic unit cube, up to saturation."""

from __future__ import annotations

from itertools import product

import numpy as np
import scipy
from numpy.typing import NDArray

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.networks.checks import check_size
from critflow.networks.network import Array, IntArray
from critflow.networks.periodic_cell import near_images, short_cell
from critflow.result import InputError

# Random sequential addition saturates here, for distances ρ in units of 1/n_points^(1/d): at coverages of 0.547 in the
# plane and 0.384 in space.
_SATURATED = {2: 0.834, 3: 0.902}
# No packing at all is denser than the hexagonal one of discs and the face-centred one of spheres.
_DENSEST = {2: np.sqrt(2 / np.sqrt(3)), 3: 2 ** (1 / 6)}
_MAX_RESTARTS = 1000


@running("random_sequential_addition")
def random_sequential_addition(
    n_points: int, distance: float, rng: np.random.Generator, dimension: int = 2, max_restarts: int = _MAX_RESTARTS
) -> Array:
    """Points (n_points, d) in the periodic unit cube, placed one by one and no two closer than `distance`.

    Trials are drawn only from voxels that the points so far leave uncovered, which changes nothing of the
    distribution and makes the cost linear.  A packing that saturates early starts again.  The points are returned
    sorted by grid cell, so that neighbours lie near each other in memory.

    >>> from critflow.generators.random_points import random_sequential_addition
    >>> import numpy as np
    >>> random_sequential_addition(10, 0.1, np.random.default_rng(0)).shape
    (10, 2)
    """
    n_points, dimension, max_restarts = of_kind(int, n_points=n_points, dimension=dimension, max_restarts=max_restarts)
    of_kind(float, distance=distance)
    rng = of_kind(np.random.Generator, rng=rng)
    check_addition(n_points, distance, dimension)
    for _ in range(max_restarts):
        points = _add_until_saturated(n_points, distance, rng, dimension)
        if len(points) == n_points:
            cell = np.floor(points * n_points ** (1 / dimension)).astype(int)
            return points[np.lexsort(cell.T)]
    raise _no_space(n_points, distance, max_restarts, dimension)


def check_addition(n_points: int, distance: float, dimension: int) -> None:
    """Raise `InputError` for points that cannot be placed, without placing any."""
    if n_points < 1 or not distance > 0:
        raise InputError(
            f"random sequential addition needs points and a positive distance, not {n_points} and {distance}"
        )
    if dimension < 1:
        raise InputError(f"points need a dimension of at least 1, not {dimension}")
    check_size(n_points)
    if distance * n_points ** (1 / dimension) > _DENSEST.get(dimension, np.inf):
        raise _no_space(n_points, distance, "any number of", dimension)


def _no_space(n_points: int, distance: float, tries: int | str, dimension: int) -> InputError:
    return InputError(
        f"{n_points} points never fitted at a distance of {distance:.4g} in {tries} tries: lower the hard core "
        f"(ρ = {_SATURATED.get(dimension, 0.9)} is the limit in {dimension} dimensions)"
    )


def _add_until_saturated(n_points: int, distance: float, rng: np.random.Generator, dimension: int) -> Array:
    # Grid cells of diagonal <= distance hold one point at most, so the neighbours of a trial are found by index.
    per_side = int(np.ceil(np.sqrt(dimension) / distance))
    grid = np.full((per_side,) * dimension + (dimension,), _NOWHERE)
    points = np.empty((n_points, dimension))
    n_placed = 0

    voxels = np.indices(grid.shape[:-1]).reshape(dimension, -1).T / per_side
    side = 1.0 / per_side
    uncovered = _Uncovered(grid, distance)
    while n_placed < n_points and len(voxels):
        # As many trials as uncovered voxels is cheap and rarely places two in reach of each other.
        trials = voxels.take(rng.integers(len(voxels), size=len(voxels)), 0)
        trials += side * rng.random((len(voxels), dimension))
        trials -= trials >= 1.0
        placed_before = n_placed
        # The pairs of all first trials are many more than those of each eighth that earlier ones leave uncovered.
        for part in [trials] if n_placed or len(trials) < _MANY_TRIALS else np.array_split(trials, 8):
            if n_placed:
                part = part.take(uncovered(part, 0.0), 0)
            placed = part.take(_first_come(part, distance)[: n_points - n_placed], 0)
            points[n_placed : n_placed + len(placed)] = placed
            n_placed += len(placed)
            if n_placed == n_points:
                return points
            grid[tuple(np.floor(placed * per_side).astype(int).T)] = placed
            uncovered = _Uncovered(grid, distance)

        voxels = voxels.take(uncovered(voxels + side / 2, side / 2), 0)
        # Halving the voxels follows the shrinking holes; while holes are large it would only cost.
        if n_placed - placed_before < 0.2 * max(len(voxels), 1):
            side /= 2
            voxels = (voxels[:, None, :] + side * np.array(list(product((0, 1), repeat=dimension)))).reshape(
                -1, dimension
            )
    return points[:n_placed]


class _Uncovered:
    """Which places keep their distance to all points of a grid (…, d) of cells with one point each at most."""

    def __init__(self, grid: Array, distance: float):
        dimension, self._per_side, self._distance = grid.shape[-1], len(grid), distance
        self._padded = _periodic_padding(grid)
        self._strides = (len(grid) + 4) ** np.arange(dimension - 1, -1, -1)
        # The nearest cells first, which settles most places at once; but the cell of a place itself is mostly empty.
        steps = np.array(list(product(range(-2, 3), repeat=dimension)))
        order = np.argsort(np.sum(steps**2, axis=1), kind="stable")
        self._steps = steps[np.roll(order, -1)]

    def _reach(self, half_width: float) -> NDArray[np.int64]:
        """Steps in the padded grid to the cells from which a point can cover a cube that lies in one cell."""
        away = np.abs(self._steps)
        gap = np.maximum(away - 1, 0) / self._per_side + np.where(away, 2, 1) * half_width
        able = np.sum(gap**2, axis=1) < (1 + 1e-9) * self._distance**2
        return np.asarray((self._steps[able] + 2) @ self._strides)

    def __call__(self, places: Array, half_width: float) -> IntArray:
        """The points, or cubes of that half width, around places (n, d) whose even farthest corner is clear."""
        clear, reach = [np.zeros(0, int)], self._reach(half_width)
        # Blocks stay in the cache of the processor, and shrink as their places are found to be covered.
        for start in range(0, len(places), _BLOCK):
            at = places[start : start + _BLOCK]
            cell = np.floor(at * self._per_side).astype(int) @ self._strides
            left = np.arange(start, start + len(at))
            for step in reach:
                away = self._padded.take(cell + step, axis=0)
                np.subtract(at, away, out=away)
                np.abs(away, out=away)
                away += half_width
                away *= away
                far = np.flatnonzero(sum(away.T) >= self._distance**2)
                if len(far) < len(left):
                    left, cell, at = left.take(far), cell.take(far), at.take(far, axis=0)
            clear.append(left)
        return np.concatenate(clear)


# Number of voxels in one vectorised step, and of trials from which they are tested in parts.
_BLOCK, _MANY_TRIALS = 1 << 16, 1 << 12


# Coordinate of the point of an empty grid cell: farther away than any hard core.
_NOWHERE = 1e3


def _periodic_padding(grid: Array) -> Array:
    """The points (n, d) in a grid of cells with two layers of periodic images around it."""
    dimension = grid.shape[-1]
    padded = np.pad(grid, [(2, 2)] * dimension + [(0, 0)], mode="wrap")
    for axis in range(dimension):
        ends = np.moveaxis(padded[..., axis], axis, 0)
        ends[:2] -= 1.0
        ends[-2:] += 1.0
    return padded.reshape(-1, dimension)


def _first_come(trials: Array, distance: float) -> IntArray:
    """The trials that remain when each, in order, must keep its distance to all that remain before it."""
    if len(trials) == 0:
        return np.zeros(0, int)
    # A simple tree with small leaves is the fastest for one query.
    tree = scipy.spatial.cKDTree(trials, leafsize=8, boxsize=1.0, balanced_tree=False, compact_nodes=False)
    return np.flatnonzero(_accepted(len(trials), tree.query_pairs(distance, output_type="ndarray")))


def _accepted(n_trials: int, pairs: NDArray[np.int64]) -> NDArray[np.bool_]:
    """The trials that remain when each, in order, excludes the later ones that it forms a pair with."""
    earlier, later = np.ascontiguousarray(pairs.T)
    taken = np.zeros(n_trials, bool)
    refused = np.zeros(n_trials, bool)
    while len(earlier):
        # A trial that waits for no earlier one is taken, and refuses the later ones in its reach.
        waiting = np.zeros(n_trials, bool)
        waiting[later] = True
        taken |= ~waiting & ~refused
        refused[later[taken[earlier]]] = True
        open_ = ~refused[earlier] & ~refused[later] & ~taken[earlier]
        earlier, later = earlier[open_], later[open_]
    return ~refused


def points_in_cell(n_points: int, hard_core: float, rng: np.random.Generator, cell: Array | None = None) -> Array:
    """Random points (n_points, d) in units of the vectors of a cell (d, d), by default a square.

    hard_core  least distance of two points in units of (V/n_points)^(1/d); zero for independent points
    """
    dimension = 2 if cell is None else len(cell)
    check_size(n_points)
    if hard_core == 0:
        return rng.random((n_points, dimension))
    distance = hard_core / n_points ** (1 / dimension)
    if cell is None or np.array_equal(cell, cell[0, 0] * np.eye(dimension)):
        return random_sequential_addition(n_points, distance, rng, dimension)
    if not distance > 0:
        raise InputError(f"the hard core must be positive, or zero for independent points, not {hard_core}")
    short, rows = short_cell(cell)
    shape = short / abs(np.linalg.det(short)) ** (1 / dimension)
    if np.linalg.norm(shape, axis=1).min() < 2 * distance:
        raise InputError(f"{n_points} points are too few for so thin a cell: use more points, or a shorter cell")
    crowded = hard_core > _DENSEST.get(dimension, np.inf)
    for _ in range(0 if crowded else _MAX_RESTARTS):
        points = _add_in_cell(n_points, distance, rng, shape)
        if len(points) == n_points:
            grid = np.floor(points * np.linalg.norm(shape, axis=1) * n_points ** (1 / dimension)).astype(int)
            return (points[np.lexsort(grid.T)] @ rows) % 1.0
    raise _no_space(n_points, distance, _MAX_RESTARTS, dimension)


def _add_in_cell(n_points: int, distance: float, rng: np.random.Generator, shape: Array) -> Array:
    """Random sequential addition in units of short cell vectors (d, d); fewer points if they saturate before."""
    dimension = len(shape)
    per_side = np.ceil(2 * np.sqrt(dimension) * np.linalg.norm(shape, axis=1) / distance).astype(int)
    voxels, side = np.indices(per_side).reshape(dimension, -1).T / per_side, 1 / per_side
    corners = np.array(list(product((0, 1), repeat=dimension)))
    placed = np.empty((0, dimension))
    while len(placed) < n_points and len(voxels):
        trials = voxels[rng.integers(len(voxels), size=len(voxels))] + side * rng.random((len(voxels), dimension))
        trials = trials[_gap(placed, trials, shape, distance) >= distance]
        ids, images = near_images(trials, shape, distance)
        pairs = scipy.spatial.cKDTree((trials[ids] + images) @ shape).query_pairs(distance, output_type="ndarray")
        added = trials[_accepted(len(trials), np.sort(ids[pairs], axis=1))]
        placed = np.concatenate([placed, added])[:n_points]
        radius = np.linalg.norm((corners - 0.5) * side @ shape, axis=1).max()
        voxels = voxels[_gap(placed, voxels + side / 2, shape, distance) > distance - radius]
        if len(added) < 0.2 * max(len(voxels), 1):
            side = side / 2
            voxels = (voxels[:, None] + side * corners).reshape(-1, dimension)
    return placed


def _gap(points: Array, places: Array, shape: Array, limit: float) -> Array:
    """Distance of each place from the nearest periodic image of the points, or infinity beyond the limit."""
    if len(points) == 0:
        return np.full(len(places), np.inf)
    ids, images = near_images(points, shape, limit)
    tree = scipy.spatial.cKDTree((points[ids] + images) @ shape)
    return np.asarray(tree.query(places @ shape, distance_upper_bound=limit)[0])
