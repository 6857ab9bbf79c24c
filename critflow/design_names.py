"""Components of the stress S/√D at the transition, which determines all moduli there, and of the elasticity tensor.

S:A/√D = W/√D,   C = S⊗S/(V D),   with W and D of `critflow.quantities`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from critflow.deformation import strain_basis
from critflow.manifold import CriticalManifold
from critflow.networks import Array, IntArray, Network
from critflow.quantities import (
    Balanced,
    Mask,
    OfLengths,
    Partials,
    SpringResponse,
    WorkAndCost,
    divisors,
    largest_value,
)
from critflow.result import InputError


@dataclass(frozen=True, eq=False, repr=False)
class StressComponent(SpringResponse):
    """Component S:A/√D of the stress, S = Σσ L⊗L, D = Σσ²|L|²/k: all that linear elasticity is at the transition.

    strain  (d, d) A, symmetric
    name    in tables, targets and messages
    """

    strain: Array
    name: str = "S"

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        terms = WorkAndCost(balance, self.strain)
        root = np.sqrt(terms.cost).item()
        return terms.work / root, terms.partials(1 / root, -0.5 * terms.work / (terms.cost * root))

    def by_stiffness(self, balance: Balanced) -> Array:
        terms = WorkAndCost(balance, self.strain)
        return 0.5 * terms.work / (terms.cost * np.sqrt(terms.cost).item()) * terms.by_stiffness

    def extreme(self, manifold: CriticalManifold, positive: bool = True) -> tuple[float, float]:
        reach = float(np.sqrt(largest_value(manifold, self.strain) * manifold.network.volume))
        return (0.0 if positive and np.linalg.eigvalsh(self.strain)[0] >= 0 else -reach), reach

    def unit(self, network: Network) -> float:
        return float(np.sqrt(network.stiffness.mean())) * network.spacing


@dataclass(frozen=True, eq=False, repr=False)
class TensorComponent(SpringResponse):
    """Component C_ab of the elasticity tensor; at the transition C_ab = S_a S_b/(V D).

    first, second  `StressComponent`s a and b
    """

    first: StressComponent
    second: StressComponent

    @property
    def name(self) -> str:
        return f"C_{self.first.name[2:]}{self.second.name[2:]}"

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        (a, of_a), (b, of_b) = self.first.evaluate(balance), self.second.evaluate(balance)
        volume = balance.network.volume
        by_sigma, by_L = ((b * one + a * two) / volume for one, two in zip(of_a, of_b, strict=True))
        return a * b / volume, (by_sigma, by_L)

    def by_stiffness(self, balance: Balanced) -> Array:
        a, b = self.first.evaluate(balance)[0], self.second.evaluate(balance)[0]
        return (b * self.first.by_stiffness(balance) + a * self.second.by_stiffness(balance)) / balance.network.volume

    def extreme(self, manifold: CriticalManifold, positive: bool = True) -> tuple[float, float]:
        """Extreme values of s_a s_b/V on the ellipsoid of S/√D."""
        form = modulus_form(manifold, np.array([self.first.strain, self.second.strain]))
        reach = float(np.sqrt(form[0, 0] * form[1, 1]))
        low = 0.5 * (float(form[0, 1]) - reach)
        # S is positive definite under tension: normal components are positive.
        normal = positive and all(np.linalg.eigvalsh(one.strain)[0] >= 0 for one in (self.first, self.second))
        return max(low, 0.0) if normal or self.first is self.second else low, 0.5 * (float(form[0, 1]) + reach)


def tensor_component(network: Network, name: str) -> SpringResponse:
    """The quantity of a name: S_xx, ..., C_xxxx, ..."""
    return _components(network.dimension)[name]


@cache
def _components(d: int) -> dict[str, SpringResponse]:
    """Components of the stress and of the elasticity tensor by name: the same objects at every call."""
    stress = [StressComponent(strain, f"S_{axes}") for axes, strain in zip(*strain_basis(d), strict=True)]
    tensor = [TensorComponent(first, second) for a, first in enumerate(stress) for second in stress[a:]]
    return {one.name: one for one in (*stress, *tensor)}


def modulus_form(manifold: CriticalManifold, strains: Array) -> Array:
    """The largest μ_A as a quadratic form of the strain A in a basis (m, d, d), from sums of two strains: (m, m)."""
    m = len(strains)
    form = np.empty((m, m))
    for a in range(m):
        for b in range(a + 1):
            form[a, b] = form[b, a] = largest_value(manifold, strains[a] + strains[b])
    single = np.diag(form) / 4
    return np.asarray(0.5 * (form - single[:, None] - single[None]))


# The length of an edge and the area of a face.


@dataclass(frozen=True, repr=False)
class EdgeLength(OfLengths):
    """The length |L_α| of one edge."""

    edge: int

    def unit(self, network: Network) -> float:
        return network.spacing

    @property
    def name(self) -> str:
        return f"length[{self.edge}]"

    def evaluate(self, balance: Balanced) -> tuple[float, Partials]:
        by_L = np.zeros_like(balance.bond_vectors)
        L = balance.bond_vectors[self.edge]
        length = np.sqrt(L @ L)
        by_L[self.edge] = L / divisors(length)
        return length.item(), (np.zeros_like(balance.sigma), by_L)

    def in_part(self, network: Network, kept: Mask) -> EdgeLength | None:
        return EdgeLength(int(np.count_nonzero(kept[: self.edge]))) if kept[self.edge] else None


@dataclass(frozen=True, repr=False)
class FaceArea(OfLengths):
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

    def extreme(self, manifold: CriticalManifold, positive: bool = True) -> tuple[float, float]:
        return -np.inf, np.inf

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
