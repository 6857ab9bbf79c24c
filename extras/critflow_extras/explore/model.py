"""A network on the page: its matrices, its populations of stresses, and its reciprocal force diagram."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import minimum_spanning_tree

from critflow import upper_bound
from critflow.engine import stable_rng
from critflow.faces import Faces, planar_faces
from critflow.lengths import critical_from_lengths
from critflow.manifold import CriticalManifold
from critflow.networks import Array, IntArray, Network
from critflow.optima import optimize
from critflow.result import CritflowError, InputError

OPTIMA = {"min_V_L": "V_L", "min_V_tau": "V_tau", "max_B_0": "B_0", "max_G_0": "G_0"}
"""The quantity of each population that is an optimum."""
POPULATIONS = {
    "min_V_L": "min V_L",
    "min_V_tau": "min V_τ",
    "max_B_0": "max B₀",
    "max_G_0": "max G₀",
    "random_lengths": "random ℓ",
    "random_stress": "random σ",
}
"""Populations of the paper, by their names in datasets, with their labels."""

# Standard deviation of the random rest lengths, the largest that leaves every edge stressed.
SPREAD = 0.1
_QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])

Observer = Callable[[int], bool]
"""Called with the step of a descent; a true value ends it."""


class Model:
    """A planar network with its matrices, faces and populations, computed at first use.

    seed     of the random populations
    remarks  by population: a sentence where its optimum is not attained
    """

    def __init__(self, network: Network, seed: int = 0):
        if network.dimension != 2:
            raise InputError(
                f"the page shows planar networks, and this one has {network.dimension} dimensions: "
                "ce.draw(network) makes its picture"
            )
        self.network, self.seed = network, seed
        self.manifold = CriticalManifold(network)
        self.remarks: dict[str, str] = {}
        self._stresses: dict[str, Array] = {}

    @cached_property
    def bulk_bound(self) -> float:
        """The largest B_0 over all stresses, or NaN where it is not defined."""
        try:
            return upper_bound(self.manifold, "B_0")
        except CritflowError:
            return np.nan

    @cached_property
    def dual(self) -> Dual | None:
        """The graph of the reciprocal force diagram, for periodic networks whose faces are known."""
        network = self.network
        if network.cell is None or network.pins:
            return None
        try:
            L = self.manifold.configuration(network.stiffness).bond_vectors
            return Dual(network, network.faces or planar_faces(network.edges, L, network.n_vertices))
        except CritflowError:
            return None

    def population(self, name: str, observe: Observer) -> Array:
        """The stress σ (N_b,) of a population, computed once; `InputError` if `observe` stops its computation."""
        if name not in POPULATIONS:
            raise InputError(f"no population is called {name!r}: choose one of {', '.join(POPULATIONS)}")
        if name not in self._stresses:
            self._stresses[name] = self._optimum(name, observe) if name in OPTIMA else self._random(name)
        return self._stresses[name]

    def _optimum(self, name: str, observe: Observer) -> Array:
        stopped = False

        def watch(step: int, *_: object) -> bool:
            nonlocal stopped
            stopped = observe(step)
            return stopped

        optimum = optimize(self.manifold, OPTIMA[name], observe=watch, throw=False)
        if stopped:
            raise InputError(f"{POPULATIONS[name]} was stopped: choose it again to compute it")
        if not optimum.ok:
            self.remarks[name] = f"{POPULATIONS[name]}: {optimum.reason}"
        return optimum.value.sigma

    def _random(self, name: str) -> Array:
        noise = stable_rng(self.seed, name).standard_normal(self.network.n_edges)
        if name == "random_stress":
            return self.manifold.solve(np.abs(noise)).value.sigma
        return critical_from_lengths(self.manifold, 1 + SPREAD * noise, throw=False).value.sigma


class Dual:
    """The reciprocal force diagram: a vertex y_f for each face, an edge J T_α between the faces of each edge.

    With T = σL and J a quarter turn, y_left − y_right = J T_α; force balance closes the polygon around each vertex.
    On a torus y has the periods p_i = J S J c_i/V, S = Σσ L⊗L, for the cell vectors c_i.

    ends  (N_b, 2) the faces to the right and to the left of each edge
    """

    def __init__(self, network: Network, faces: Faces):
        n_faces = faces.n_faces
        face, left = np.repeat(np.arange(n_faces), faces.sizes), faces.signs > 0
        self.faces = faces
        self.ends: IntArray = np.zeros((network.n_edges, 2), np.int64)
        self.ends[faces.edges[~left], 0] = face[~left]
        self.ends[faces.edges[left], 1] = face[left]
        # A tree of edges, whose numbers count from 1 because zeros are no entries; it fixes y up to y_0 = 0.
        pairs, edges = np.unique(np.sort(self.ends, axis=1), axis=0, return_index=True)
        pairs = pairs.astype(np.int32)  # the only indices of trees in SciPy 1.15
        tree = minimum_spanning_tree(sp.coo_array((edges + 1.0, pairs.T), shape=(n_faces, n_faces)))
        self._edges = tree.data.astype(np.int64) - 1
        n = n_faces - 1
        if len(self._edges) < n:
            raise InputError("the faces are not connected")
        rows, columns = np.repeat(np.arange(n), 2), self.ends[self._edges].ravel()
        steps = sp.csc_array((np.tile([-1.0, 1.0], n), (rows, columns)), shape=(n, n_faces))
        self._steps = sp.linalg.splu(steps[:, 1:])
        self._offsets: IntArray | None = None

    def diagram(self, network: Network, sigma: Array, L: Array) -> tuple[Array, Array, IntArray]:
        """Positions y (n_faces, 2), periods (2, 2) as rows, and image offsets (N_b, 2) of the edges (right, left)."""
        assert network.cell is not None
        forces = (sigma[:, None] * L) @ _QUARTER_TURN.T
        y = np.concatenate([np.zeros((1, 2)), self._steps.solve(forces[self._edges])])
        stress = (sigma[:, None] * L).T @ L / network.volume
        periods = network.cell @ (_QUARTER_TURN @ stress @ _QUARTER_TURN).T
        if self._offsets is None:
            gap = forces - (y[self.ends[:, 1]] - y[self.ends[:, 0]])
            self._offsets = np.round(gap @ np.linalg.inv(periods)).astype(np.int64)
        return y, periods, self._offsets
