"""The length of an edge and the area of a face as quantities."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from critflow.manifold import CriticalManifold
from critflow.networks import Array, IntArray, Network
from critflow.quantities import Balanced, Partials, Quantity, divisors
from critflow.result import InputError
from critflow.taut_part import Mask


class _Geometric(Quantity):
    """A quantity of bond vectors alone."""

    def by_stiffness(self, balance: Balanced) -> Array:
        return np.zeros_like(balance.sigma)


@dataclass(frozen=True, repr=False)
class OfEdge(Quantity):
    """A quantity q(σ_α, |L_α|) of one edge, called `word`[α]."""

    edge: int
    word: ClassVar[str]

    @property
    def name(self) -> str:
        return f"{self.word}[{self.edge}]"

    @abstractmethod
    def at(self, sigma: Any, length: Any, stiffness: float) -> tuple[Any, Any, Any]:
        """q, ∂q/∂σ_α and ∂q/∂|L_α|."""

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        e, L = self.edge, balance.bond_vectors[self.edge]
        by_sigma, by_L, length = np.zeros_like(balance.sigma), np.zeros_like(balance.bond_vectors), np.sqrt(L @ L)
        value, by_sigma[e], by_length = self.at(balance.sigma[e], length, balance.network.stiffness[e])
        by_L[e] = by_length * L / divisors(length)
        return value.item(), (by_sigma, by_L)


@dataclass(frozen=True, repr=False)
class EdgeLength(OfEdge, _Geometric):
    """The length |L_α| of one edge."""

    word: ClassVar[str] = "length"

    def extreme(self, manifold: CriticalManifold, positive: bool = True) -> tuple[float, float]:
        return 0.0, np.inf

    def unit(self, network: Network) -> float:
        return network.spacing

    def at(self, sigma: Any, length: Any, stiffness: float) -> tuple[Any, Any, Any]:
        return length, 0.0, 1.0

    def in_part(self, network: Network, kept: Mask) -> EdgeLength | None:
        return EdgeLength(int(np.count_nonzero(kept[: self.edge]))) if kept[self.edge] else None


@dataclass(frozen=True, repr=False)
class FaceArea(_Geometric):
    """The area ½ Σ_(i<j) s_i × s_j of one face of a planar network, of its sides s in turn."""

    face: int

    def unit(self, network: Network) -> float:
        return network.spacing * network.spacing

    @property
    def name(self) -> str:
        return f"area[{self.face}]"

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        sides, before, by_L = self._gradient(balance, balance.bond_vectors)
        area = 0.5 * np.sum(before[:, 0] * sides[:, 1] - before[:, 1] * sides[:, 0]).item()
        return area, (np.zeros_like(balance.sigma), by_L)

    def in_part(self, network: Network, kept: Mask) -> FaceArea | None:
        edges, signs = self.walk(network)
        number = np.cumsum(kept) - 1
        return _WalkedArea(self.face, number[edges], signs) if kept[edges].all() else None

    def walk(self, network: Network) -> tuple[IntArray, IntArray]:
        """The edges of the face in turn, and +1 where one is walked from tail to head, else −1."""
        faces = network.faces
        if faces is None or not self.face < faces.n_faces:
            raise InputError(f"{self.name} needs a planar network with known faces: this one has no such face")
        walk = slice(faces.starts[self.face], faces.starts[self.face + 1])
        return faces.edges[walk], faces.signs[walk]

    def _gradient(self, balance: Balanced, vectors: Array) -> tuple[Array, Array, Array]:
        """The sides, the sums of those before each, and ∂/∂L (N_b, 2) of the area with edges of these vectors."""
        edges, directions = self.walk(balance.network)
        signs = directions[:, None]
        sides = signs * vectors[edges]
        before = np.cumsum(sides, axis=0) - sides
        # v × s = (J v)·s
        x, y = (2 * before + sides - sides.sum(axis=0)).T
        by_L = np.zeros_like(vectors)
        np.add.at(by_L, edges, 0.5 * signs * np.stack([-y, x], axis=1))
        return sides, before, by_L


@dataclass(frozen=True, eq=False, repr=False)
class _WalkedArea(FaceArea):
    """The area of a face of a whole network, by the edges of a part and their directions along its walk."""

    edges: IntArray
    directions: IntArray

    def walk(self, network: Network) -> tuple[IntArray, IntArray]:
        return self.edges, self.directions


def edge_length(network: Network, edge: str) -> EdgeLength:
    """The length of an edge by its number."""
    return EdgeLength(_counted(f"length[{edge}]", edge, network.n_edges, "edges"))


def face_area(network: Network, face: str) -> FaceArea:
    """The area of a face by its number."""
    count = 0 if network.faces is None else network.faces.n_faces
    return FaceArea(_counted(f"area[{face}]", face, count, "faces"))


def _counted(name: str, number: str, count: int, noun: str) -> int:
    """A number below a count."""
    if int(number) >= count:
        raise InputError(f"{name} does not exist: the network has {count} {noun}, counted from 0")
    return int(number)
