"""Random regular networks: random points, each with the same number of edges to others nearby."""

from __future__ import annotations

import numpy as np
import scipy

from critflow.arguments import generator, of_kind
from critflow.calls import running
from critflow.networks import Array, IntArray, Network
from critflow.points import near_images, points_in_cell
from critflow.result import InputError
from critflow_extras.pruning.pruning import carrying_part

# Least distance of two vertices, in units of their mean spacing.
_HARD_CORE = 0.7
# Candidates of a vertex for each of its edges: enough to be random, few enough for short edges.
_CANDIDATES = 3
_MOST_COORDINATION = 12
_MOST_REPAIRS = 200
_MOST_MOVES = 2000


@running("regular_network")
def regular_network(
    n_vertices: int = 1000, z: float = 3.0, seed: int | np.random.Generator = 0, dimension: int = 2
) -> Network:
    """Random points with z edges each, or with the whole numbers below and above z in the shares that give z; V = N_v.

    Pairs of points within the distance at which a point has 3 z neighbours are joined in random order as long as both
    have edges left.  Points that remain with too few pass the lack on, by exchanging an edge of a neighbour, until two
    of them can be joined; edges that could not carry tension are exchanged in the same manner.
    z is reached to 1/N_v, and n_vertices exactly.  Raises `InputError` for z < 3, and for too few vertices.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> ce.regular_network(n_vertices=40, z=3.0, seed=1)
    Network(40 vertices, 60 edges, 2 dimensions, periodic, z = 3)
    """
    n_vertices, dimension = of_kind(int, n_vertices=n_vertices, dimension=dimension)
    of_kind(float, z=z)
    seed = of_kind(int, np.random.Generator, seed=seed)
    if dimension not in (2, 3):
        raise InputError(f"the dimension must be 2 or 3, not {dimension}")
    if not 3 <= z <= _MOST_COORDINATION:
        raise InputError(f"z must be between 3 and {_MOST_COORDINATION}, not {z}: use diluted for fewer edges")
    if n_vertices < 8 * z:
        raise InputError(f"a random regular network of z = {z:g} needs at least {int(np.ceil(8 * z))} vertices")
    rng = generator(seed)
    points = points_in_cell(n_vertices, _HARD_CORE, rng, np.eye(dimension))
    n_edges = round(n_vertices * z / 2)
    degrees = np.full(n_vertices, 2 * n_edges // n_vertices)
    degrees[rng.permutation(n_vertices)[: 2 * n_edges - degrees.sum()]] += 1
    graph = _Graph(points, _CANDIDATES * int(np.ceil(z)), rng)
    graph.join_at_random(degrees)
    graph.join_rest(degrees)
    for _ in range(_MOST_REPAIRS):
        edges, offsets = graph.edges()
        part = carrying_part(edges, offsets, {}, n_vertices)
        if len(part.edges) == n_edges and part.n_vertices == n_vertices and part.directions == dimension:
            side = n_vertices ** (1 / dimension)
            return Network(edges, offsets, side * np.eye(dimension), positions=side * points)
        graph.exchange(np.setdiff1d(np.arange(n_edges), part.edges), degrees)
    raise InputError("no regular network of this seed can carry tension on every edge: try another seed")


class _Graph:
    """Candidate pairs of points in the periodic unit cube, and those that are joined."""

    def __init__(self, points: Array, n_candidates: int, rng: np.random.Generator):
        n_points, dimension = points.shape
        unit_ball = np.pi if dimension == 2 else 4 / 3 * np.pi
        self._reach = (n_candidates / (n_points * unit_ball)) ** (1 / dimension)
        ids, images = near_images(points, np.eye(dimension), self._reach)
        near = scipy.spatial.cKDTree(points).sparse_distance_matrix(
            scipy.spatial.cKDTree(points[ids] + images), self._reach, output_type="ndarray"
        )
        first, second, image = near["i"], ids[near["j"]], images[near["j"]]
        once = first < second
        order = rng.permutation(int(once.sum()))
        self._ends = np.column_stack([first, second])[once][order].astype(int)
        self._images = image[once][order].astype(int)
        self._joined = np.zeros(len(self._ends), bool)
        self._points, self._rng = points, rng
        # Candidates at each point.
        at = np.argsort(self._ends.ravel(), kind="stable")
        ends = np.cumsum(np.bincount(self._ends.ravel(), minlength=n_points))
        self._around = np.split(at // 2, ends[:-1])

    def edges(self) -> tuple[IntArray, IntArray]:
        """Edges (n, 2) and offsets (n, d), in the order of the candidates."""
        return self._ends[self._joined], self._images[self._joined]

    def lack(self, degrees: IntArray) -> IntArray:
        """Edges that each point is short of, (n_points,)."""
        return degrees - np.bincount(self._ends[self._joined].ravel(), minlength=len(degrees))

    def join_at_random(self, degrees: IntArray) -> None:
        """Join candidates in their order wherever both points have edges left."""
        open_ = np.arange(len(self._ends))
        left = degrees.copy()
        while len(open_):
            # The first open candidate of both its points is joined before any other that could exclude it.
            earliest = np.full(len(degrees), len(self._ends))
            for end in (0, 1):
                np.minimum.at(earliest, self._ends[open_, end], open_)
            chosen = open_[(earliest[self._ends[open_]] == open_[:, None]).all(axis=1)]
            self._joined[chosen] = True
            left -= np.bincount(self._ends[chosen].ravel(), minlength=len(degrees))
            open_ = open_[~self._joined[open_] & (left[self._ends[open_]] > 0).all(axis=1)]

    def join_rest(self, degrees: IntArray) -> None:
        """Pass on edges until no point is short of one."""
        lack = self.lack(degrees)
        while (short := np.flatnonzero(lack)).size:
            point = int(short[0])
            others = short[1:] if len(short) > 1 else short
            goal = int(others[np.argmin(self._distance(others, point))])
            for _ in range(_MOST_MOVES):
                if self._join(point, goal):
                    lack[[point, goal]] -= 1
                    break
                moved = self._move(point, goal)
                lack[point] -= 1
                lack[moved] += 1
                point = moved
                if point == goal:
                    break
            else:
                raise InputError("no regular network joins these points: try another seed, or more vertices")

    def exchange(self, edges: IntArray, degrees: IntArray) -> None:
        """Replace about a third of these edges by others."""
        chosen = self._rng.permutation(edges)[: 1 + len(edges) // 3]
        for candidate in np.flatnonzero(self._joined)[chosen]:
            if not self._joined[candidate]:
                continue
            self._joined[candidate] = False
            for point in self._ends[candidate]:
                self._move(int(point), int(point))
        self.join_rest(degrees)

    def _join(self, point: int, goal: int) -> bool:
        """Join two points if an open candidate does."""
        around = self._around[point]
        able = around[~self._joined[around] & (self._ends[around].sum(axis=1) == point + goal)]
        self._joined[able[:1]] = True
        return len(able) > 0

    def _move(self, point: int, goal: int) -> int:
        """Join a point to a neighbour that gives up another edge; return the far end of that edge, near the goal."""
        around = self._around[point]
        options = around[~self._joined[around]]
        neighbours = self._ends[options].sum(axis=1) - point
        pairs = [(c, e, int(self._ends[e].sum()) - w)
                 for c, w in zip(options, neighbours, strict=True)
                 for e in self._around[w][self._joined[self._around[w]]]]  # fmt: skip
        if not pairs:
            raise InputError("no regular network joins these points: try another seed, or more vertices")
        joins, leaves, ends = np.array(pairs).T
        cost = self._rng.random(len(ends)) * self._reach
        cost += np.where(ends == point, np.inf, 0.0 if point == goal else self._distance(ends, goal))
        best = int(np.argmin(cost))
        self._joined[joins[best]], self._joined[leaves[best]] = True, False
        return int(ends[best])

    def _distance(self, points: IntArray, goal: int) -> Array:
        apart = self._points[points] - self._points[goal]
        return np.asarray(np.linalg.norm(apart - np.round(apart), axis=1))
