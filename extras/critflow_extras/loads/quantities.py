"""Quantities of a loaded network, by name: positions of vertices, reactions of pins, tensions and lengths at rest.

They depend on the scale of σ, and so are targets of designs under loads alone.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order

from critflow.arguments import edge_values
from critflow.networks import Array, IntArray, Network
from critflow.quantities import Balanced, Partials, Quantity, divisors
from critflow.result import InputError
from critflow_extras.design_names.lengths_and_areas import EdgeLength, OfEdge
from critflow_extras.loads.loaded import LoadedConfiguration, loads_on

AXES = "xyz"


@dataclass(frozen=True, repr=False)
class Tension(OfEdge):
    """The tension τ_α = σ_α|L_α| of one edge."""

    word: ClassVar[str] = "tension"

    def at(self, sigma: Any, length: Any, stiffness: float) -> tuple[Any, Any, Any]:
        return sigma * length, length, sigma


@dataclass(frozen=True, repr=False)
class RestLength(OfEdge):
    """The length ℓ_α = |L_α|(1 − σ_α/k_α) without tension of one edge, as a spring of the stiffness of the network."""

    word: ClassVar[str] = "rest_length"

    def unit(self, network: Network) -> float:
        return network.spacing

    def at(self, sigma: Any, length: Any, stiffness: float) -> tuple[Any, Any, Any]:
        part = 1 - sigma / stiffness
        return length * part, -length / stiffness, part


@dataclass(frozen=True, eq=False, repr=False)
class Position(Quantity):
    """One coordinate of a vertex, a sum of bond vectors along a path from a pin.

    edges, signs  of the path, and +1 where an edge is walked from tail to head
    origin        the coordinate of the pin, less the offsets of the edges of the path
    """

    vertex: int
    axis: int
    edges: IntArray
    signs: Array
    origin: float

    @property
    def name(self) -> str:
        return f"position[{self.vertex},{AXES[self.axis]}]"

    def unit(self, network: Network) -> float:
        return network.spacing

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        by_L = np.zeros_like(balance.bond_vectors)
        by_L[self.edges, self.axis] = self.signs
        value = self.origin + np.sum(self.signs * balance.bond_vectors[self.edges, self.axis])
        return value.item(), (np.zeros_like(balance.sigma), by_L)


@dataclass(frozen=True, repr=False)
class Reaction(Quantity):
    """One component of the force of the support on a pin, Σ ± σ L − loads on the pin."""

    vertex: int
    axis: int

    @property
    def name(self) -> str:
        return f"reaction[{self.vertex},{AXES[self.axis]}]"

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        under: Any = balance if isinstance(balance, LoadedConfiguration) else balance.manifold
        network, sigma, L, axis = balance.network, balance.sigma, balance.bond_vectors, self.axis
        ends = network.edges == self.vertex
        at_end = ends[:, 1].astype(float) - ends[:, 0]
        load = loads_on(network, under.forces, under.weight, L)[self.vertex, axis]
        by_L = np.zeros_like(L)
        by_L[:, axis] = at_end * sigma
        if under.weight is not None:
            half = 0.5 * ends.sum(axis=1) * under.weight[:, axis]
            by_L -= (half / divisors(np.sqrt(np.sum(L * L, axis=1))))[:, None] * L
        return (at_end @ (sigma * L[:, axis]) - load).item(), (at_end * L[:, axis], by_L)


def _position(network: Network, vertex: int, axis: int) -> Position:
    """The coordinate of a free vertex by the shortest path to it from a pin."""
    if vertex in network.pins:
        raise InputError(f"vertex {vertex} is a pin, whose position is given: name a free vertex")
    n = network.n_vertices
    # The vertex after the last one joins all pins, by edges after the last one.
    pins = np.array(list(network.pins))
    ends = np.concatenate([network.edges, np.column_stack([np.full(len(pins), n), pins])])
    between = {(int(a), int(b)): e for e, (a, b) in enumerate(ends)}
    graph = sp.coo_array((np.ones(len(ends)), ends.T), (n + 1, n + 1)).tocsr()
    before = breadth_first_order(graph, n, directed=False)[1]
    edges, signs, at = [], [], vertex
    while before[at] != n:
        forward = (int(before[at]), at) in between
        edges.append(between[(int(before[at]), at) if forward else (at, int(before[at]))])
        signs.append(1.0 if forward else -1.0)
        at = int(before[at])
    used, sign = np.array(edges, np.int64), np.array(signs)
    origin = float(network.pins[at][axis])
    if network.cell is not None:
        origin -= float(sign @ (network.offsets[used] @ network.cell)[:, axis])
    return Position(vertex, axis, used, sign, origin)


# Quantities of every edge, from one value for each, or one for all.
OF_EDGES: dict[str, Callable[[int], Quantity]] = {
    "lengths": EdgeLength,
    "tensions": Tension,
    "rest_lengths": RestLength,
}
_OF_EDGE = re.compile(r"(tension|rest_length)\[(\d+)\]")
_OF_VERTEX = re.compile(r"(position|reaction)\[(\d+),([xyz012])\]")


def with_loads(network: Network, targets: Mapping[Any, Any]) -> dict[Any, Any]:
    """The targets with quantities in place of the names of this module."""
    made = dict[Any, Any]()
    for key, value in targets.items():
        if isinstance(key, str) and key in OF_EDGES:
            values = edge_values(value, network.n_edges, key, positive=False, equal=True)
            made |= {OF_EDGES[key](edge): value for edge, value in enumerate(values.tolist())}
        else:
            made[_named(network, key)] = value
    return made


def _named(network: Network, key: Any) -> Any:
    """The quantity of a name, or the name itself where it is another's."""
    if not isinstance(key, str):
        return key
    if match := _OF_EDGE.fullmatch(key):
        edge = _below(network.n_edges, key, "edges", match[2])
        return Tension(edge) if match[1] == "tension" else RestLength(edge)
    if match := _OF_VERTEX.fullmatch(key):
        vertex, axis = _below(network.n_vertices, key, "vertices", match[2]), "xyz012".index(match[3]) % 3
        if axis >= network.dimension:
            raise InputError(f"{key} does not exist: the network has {network.dimension} dimensions")
        if match[1] == "position" and network.pins:
            return _position(network, vertex, axis)
        if vertex not in network.pins:
            raise InputError(f"{key} does not exist: {_WITHOUT[match[1]]}")
        return Reaction(vertex, axis)
    return key


_WITHOUT = {
    "position": "a network without pins may lie anywhere",
    "reaction": "only pins have reactions, so name one of network.pins",
}


def _below(count: int, name: str, noun: str, number: str) -> int:
    """A number below a count."""
    if int(number) >= count:
        raise InputError(f"{name} does not exist: the network has {count} {noun}, counted from 0")
    return int(number)
