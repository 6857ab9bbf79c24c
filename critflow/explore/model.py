"""A network on the page: its matrices, its faces with the reciprocal force diagram, and its populations."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order

from critflow.critical.manifold import CriticalConfiguration, CriticalManifold
from critflow.design.optimize import optimize
from critflow.linalg.factor import FixedPattern
from critflow.linalg.matrices import block_laplacian
from critflow.networks.faces import Faces, planar_faces
from critflow.networks.network import Array, IntArray, Network
from critflow.onset.from_lengths import critical_from_lengths
from critflow.quantities.largest_modulus import upper_bound
from critflow.result import CritflowError, InputError
from critflow.workflow import stable_rng

OPTIMA = {
    "length_variance": "min V_L",
    "tension_variance": "min V_τ",
    "bulk_modulus": "max B₀",
    "shear_modulus": "max G₀",
}
POPULATIONS = {**OPTIMA, "random_lengths": "random ℓ", "random_stress": "random σ"}
"""Populations of the paper, by name, with their labels."""

# Standard deviation of the random rest lengths, the largest that leaves every edge stressed.
SPREAD = 0.1
_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])

Observer = Callable[[int], bool]
"""Called with the step of a descent; a true value ends it."""


class Model:
    """A planar network with its matrices, faces and populations, computed at first use.

    seed  of the random populations
    """

    def __init__(self, network: Network, seed: int = 0):
        if network.dimension != 2:
            raise InputError(
                f"the page shows planar networks, and this one has {network.dimension} dimensions: "
                "critflow.draw(network) makes its picture"
            )
        self.network, self.seed = network, seed
        self.manifold = CriticalManifold(network)
        self._stresses: dict[str, Array] = {}
        # One sentence on each population whose optimum is not attained.
        self.remarks: dict[str, str] = {}

    @cached_property
    def bulk_bound(self) -> float:
        """The largest B_0 over all stresses, or NaN where it is not defined."""
        try:
            return upper_bound(self.manifold, "B_0")
        except CritflowError:
            return np.nan

    @cached_property
    def pattern(self) -> FixedPattern:
        """The pattern of the Hessian past the transition."""
        return block_laplacian(self.network)

    @cached_property
    def dual(self) -> Dual | None:
        """The graph of the reciprocal force diagram, for periodic networks whose faces are known."""
        network = self.network
        if network.cell is None or network.pins:
            return None
        try:
            faces = network.faces or planar_faces(
                network.edges, self.manifold.configuration(network.stiffness).bond_vectors, network.n_vertices
            )
            return Dual(network, faces)
        except CritflowError:
            return None

    def population(self, name: str, observe: Observer = lambda step: False) -> Array:
        """The stress σ (N_b,) of a population, computed once."""
        if name not in POPULATIONS:
            raise InputError(f"no population is called {name!r}: choose one of {', '.join(POPULATIONS)}")
        if name not in self._stresses:
            stress, complete = self._population(name, observe)
            if not complete:
                return stress
            self._stresses[name] = stress
        return self._stresses[name]

    def _population(self, name: str, observe: Observer) -> tuple[Array, bool]:
        """The stress of a population, and whether its computation was not stopped."""
        if name in OPTIMA:
            stopped = False

            def watch(step: int, *_: object) -> bool:
                nonlocal stopped
                stopped = observe(step)
                return stopped

            optimum = optimize(self.manifold, name, observe=watch, throw=False)
            if not optimum.ok:
                self.remarks[name] = f"{OPTIMA[name]}: {optimum.reason}"
            return optimum.value.sigma, not stopped
        rng = stable_rng(self.seed, name)
        noise = rng.standard_normal(self.network.n_edges)
        if name == "random_stress":
            return self.manifold.solve(np.abs(noise)).value.sigma, True
        return critical_from_lengths(self.manifold, 1 + SPREAD * noise, throw=False).value.sigma, True

    def has_population(self, name: str) -> bool:
        """Whether a population is computed already."""
        return name in self._stresses


class Dual:
    """The reciprocal force diagram: a vertex y_f for each face, an edge J T_α between the faces of each edge.

    With T = σL and J a quarter turn, y_left − y_right = J T_α; force balance closes the polygon around each vertex.
    On a torus y has the periods p_i = J S J c_i/V, S = Σσ L⊗L, for the cell vectors c_i.
    """

    def __init__(self, network: Network, faces: Faces):
        n_faces, n_edges = faces.n_faces, network.n_edges
        face = np.repeat(np.arange(n_faces), faces.sizes)
        self.faces = faces
        self.ends: IntArray = np.zeros((n_edges, 2), np.int64)
        self.ends[faces.edges[faces.signs < 0], 0] = face[faces.signs < 0]
        self.ends[faces.edges[faces.signs > 0], 1] = face[faces.signs > 0]
        right, left = self.ends.T
        number = sp.coo_array((np.arange(1, n_edges + 1), (right, left)), shape=(n_faces, n_faces))
        adjacent = sp.csr_array((np.ones(n_edges), (right, left)), shape=(n_faces, n_faces))
        order, above = breadth_first_order(adjacent, 0, directed=False)
        if len(order) < n_faces:
            raise InputError("the faces are not connected")
        # For each face but the first an edge from its parent in the tree.
        lookup = {(int(r), int(l)): int(n) - 1 for r, l, n in zip(number.row, number.col, number.data, strict=True)}
        self._order, self._above = order[1:], above[order[1:]]
        pairs = list(zip(self._above.tolist(), self._order.tolist(), strict=True))
        forward = np.array([pair in lookup for pair in pairs])
        self._edge = np.array([lookup[pair] if pair in lookup else lookup[pair[::-1]] for pair in pairs], np.int64)
        self._sign = np.where(forward, 1.0, -1.0)
        place = np.empty(n_faces, np.int64)
        place[order] = np.arange(n_faces)
        # y = (1 − A)⁻¹ of the steps from the parents, with A the parent of each face in the order of the visit.
        rows, columns = place[self._order] - 1, place[self._above] - 1
        inner = columns >= 0
        n = n_faces - 1
        parents = sp.csc_array((np.ones(int(inner.sum())), (rows[inner], columns[inner])), shape=(n, n))
        self._tree = sp.linalg.splu(sp.csc_array(sp.eye_array(n) - parents), permc_spec="NATURAL")
        self._offsets: IntArray | None = None

    def diagram(self, network: Network, sigma: Array, L: Array) -> tuple[Array, Array, IntArray]:
        """Positions y (n_faces, 2), periods (2, 2) as rows, and image offsets (N_b, 2) of the edges (right, left)."""
        forces = (sigma[:, None] * L) @ _TURN.T
        y = np.zeros((self.faces.n_faces, 2))
        y[self._order] = self._tree.solve(self._sign[:, None] * forces[self._edge])
        stress = (sigma[:, None] * L).T @ L / network.volume
        assert network.cell is not None
        periods = network.cell @ (_TURN @ stress @ _TURN).T
        if self._offsets is None:
            gap = forces - (y[self.ends[:, 1]] - y[self.ends[:, 0]])
            self._offsets = np.round(gap @ np.linalg.inv(periods)).astype(np.int64)
        return y, periods, self._offsets


def start_of(model: Model, stress: Array | None) -> CriticalConfiguration:
    """The configuration of a stress that a file contains, or of the stiffnesses."""
    if stress is not None and np.isfinite(stress).all() and stress.any():
        found = model.manifold.solve(stress)
        if found.ok:
            return found.value
    return model.manifold.configuration(model.network.stiffness)
