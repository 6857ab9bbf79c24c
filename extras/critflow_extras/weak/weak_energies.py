"""Weak energies U(x, F) that add to springs: angles between edges, soft springs, loads, functions of a user's own.

A function of the coordinates x (N_v, d), in the cell deformed by F (d, d), gives U, ∂U/∂x (N_v, d) and ∂²U/∂x∂x, sparse
(d·N_v)² in the order (vertex, axis).  Energies of this module are sums of terms over the bond vectors of a graph,
L = g x + F b: a spring couples an edge to itself, an angle two edges that meet.  With ∂U/∂L (n, d) and the sparse
M = ∂²U/∂L∂L their derivatives are gᵀ ∂U/∂L and (g ⊗ 1)ᵀ M (g ⊗ 1).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from critflow.arguments import edge_values, floats, integers
from critflow.networks import Array, IntArray, Network
from critflow.numerics import norms
from critflow.result import InputError, Record

# Largest angle from a straight line, in radians, of two edges of one fibre.
STRAIGHT = 1e-6
# Below this angle from a straight line functions of the cosine are series, whose next terms are 1e-12; beyond it the
# functions themselves lose six digits or fewer.
_NEARLY_STRAIGHT = 1e-2
# Forces of a load in a periodic cell balance to this part of their sizes.
_BALANCED_LOAD = 1e-12

# Smallest angle of two edges from a line at which the direction of the force is known to half of the digits.
_CERTAIN_DIRECTION = 1e-8

WeakFunction = Callable[[Array, Array], tuple[float, Array, sp.sparray]]
"""x (N_v, d), F (d, d) → U, ∂U/∂x (N_v, d), ∂²U/∂x∂x sparse (d·N_v)²."""


@dataclass(frozen=True, eq=False, repr=False)
class AngleSprings(Record):
    """Springs that resist changes of the angle between two edges at a vertex: U = ½ Σ_p k_p (θ_p − θ0_p)².

    Angles are those between the directions away from the vertex, from 0 to π, in any dimension.

    rest_angles  θ0 (n_pairs,) in the order of `pairs_of`, or one number; None: those of the positions of the network,
                 and π for fibres
    pairs        "all" pairs of edges at a vertex, or "fibres": those that are straight in the positions
    stiffness    k (n_pairs,), or one number
    """

    rest_angles: ArrayLike | None = None
    pairs: str = "all"
    stiffness: ArrayLike = 1.0

    def pairs_of(self, network: Network) -> tuple[IntArray, Array]:
        """Edges (n_pairs, 2) that meet, and ±1 (n_pairs, 2) where their tail or their head is the common vertex."""
        if self.pairs not in ("all", "fibres"):
            raise InputError(f"the pairs of angle springs are 'all' or 'fibres', not {self.pairs!r:.40}")
        edges, signs = _meeting_edges(network)
        if self.pairs == "fibres":
            straight = _angles(_positions_bonds(network), edges, signs) > np.pi - STRAIGHT
            edges, signs = edges[straight], signs[straight]
        if not len(edges):
            raise InputError("no two edges form a fibre, straight through a vertex: choose pairs='all'")
        return edges, signs

    def angles_of(self, network: Network) -> Array:
        """θ (n_pairs,) in the positions of a network, in the order of `pairs_of`, for other states of it."""
        return _angles(_positions_bonds(network), *self.pairs_of(network))

    def on(self, network: Network) -> WeakFunction:
        """The energy of a network."""
        edges, signs = self.pairs_of(network)
        if self.rest_angles is None:
            rest = np.full(len(edges), np.pi) if self.pairs == "fibres" else self.angles_of(network)
        else:
            rest = _per_term(self.rest_angles, len(edges), "rest_angles", "pair of edges", positive=False)
        if not ((rest >= 0) & (rest <= np.pi)).all():
            raise InputError("rest angles lie between 0 and π, in radians: correct the first that does not")
        stiffness = _per_term(self.stiffness, len(edges), "stiffness", "pair of edges")
        rest = np.where(np.pi - rest < _CERTAIN_DIRECTION, np.pi, rest)  # straight up to rounding
        terms = partial(_angle_terms, edges=edges, signs=signs, rest=rest, k=stiffness)
        rows, cols = (edges.T[ends].ravel() for ends in ([0, 1, 0, 1], [0, 1, 1, 0]))
        return _bond_energy(network, network.edges, network.offsets, (rows, cols), terms)


@dataclass(frozen=True, eq=False, repr=False)
class SoftSprings(Record):
    """Hookean springs between any vertices: U = ½ Σ k(|L| − ℓ)².

    edges         (n, 2) tails and heads
    stiffness     k (n,), or one number
    rest_lengths  ℓ (n,), or one number; zero is allowed
    offsets       (n, d) image offsets of the heads; None: none
    """

    edges: ArrayLike
    stiffness: ArrayLike = 1.0
    rest_lengths: ArrayLike = 0.0
    offsets: ArrayLike | None = None

    def on(self, network: Network) -> WeakFunction:
        """The energy of these springs between vertices of a network."""
        edges = integers(self.edges, "edges")
        if edges.ndim != 2 or edges.shape[1] != 2 or not len(edges) or edges.min() < 0:
            raise InputError(f"edges of soft springs have shape (n, 2), tail and head, not {edges.shape}")
        if edges.max() >= network.n_vertices:
            raise InputError(f"there is no vertex {edges.max()}: vertices run from 0 to {network.n_vertices - 1}")
        shape = (len(edges), network.dimension)
        offsets = np.zeros(shape, int) if self.offsets is None else integers(self.offsets, "offsets")
        if offsets.shape != shape or (offsets.any() and network.cell is None):
            raise InputError(f"offsets of soft springs have shape {shape}, and need a cell: one row a spring")
        k = _per_term(self.stiffness, len(edges), "stiffness", "soft spring")
        rest = _per_term(self.rest_lengths, len(edges), "rest_lengths", "soft spring", positive=False)
        if not (rest >= 0).all():
            raise InputError("rest lengths of soft springs are not negative: correct the first that is")
        each = np.arange(len(edges))
        return _bond_energy(network, edges, offsets, (each, each), partial(_spring_terms, k=k, rest=rest))


@dataclass(frozen=True, eq=False, repr=False)
class PointForces(Record):
    """Constant forces on the vertices, U = −Σ f·x; force dipoles are opposite forces on two vertices.

    forces  f (N_v, d); on a network without pins they sum to zero
    """

    forces: ArrayLike

    def on(self, network: Network) -> WeakFunction:
        """The energy of these forces on the vertices of a network."""
        forces = floats(self.forces, "forces")
        shape = (network.n_vertices, network.dimension)
        if forces.shape != shape or not np.isfinite(forces).all():
            raise InputError(f"forces must be finite and of shape {shape}, not {forces.shape}: one row a vertex")
        if not network.pins and (np.abs(forces.sum(axis=0)) > _BALANCED_LOAD * np.abs(forces).sum(axis=0)).any():
            raise InputError("forces on a network without pins must sum to zero: subtract the mean")
        nothing = sp.csr_array((forces.size, forces.size))
        return lambda x, F: (-float(np.vdot(forces, x)), -forces, nothing)


@dataclass(frozen=True, eq=False, repr=False)
class Temperature(Record):
    """Thermal motion, for `weak_forces` alone, whose κ is then k_B T in units of energy: no function of positions."""


def no_energy(x: Array, F: Array) -> tuple[float, Array, sp.sparray]:
    """U = 0."""
    return 0.0, np.zeros_like(x), sp.csr_array((x.size, x.size))


WeakEnergy = AngleSprings | SoftSprings | PointForces | Temperature | WeakFunction | Sequence[Any]
"""What `weak_function` accepts."""
ENERGIES = (AngleSprings, SoftSprings, PointForces, Temperature, Callable, Sequence)
"""The kinds of these."""


def weak_function(energy: WeakEnergy, network: Network) -> WeakFunction:
    """The function of an energy on a network: one of this module, a callable, or a sequence of them, which add up."""
    if isinstance(energy, AngleSprings | SoftSprings | PointForces):
        return energy.on(network)
    if isinstance(energy, Temperature):
        raise InputError("temperature acts alone, in weak_forces: leave out the other energies, or the temperature")
    if callable(energy):
        return partial(_checked, function=energy)
    if isinstance(energy, Sequence) and len(energy) and not isinstance(energy, str):
        return partial(_sum, parts=[weak_function(one, network) for one in energy])
    raise InputError(
        "a weak energy is AngleSprings, SoftSprings, PointForces, a function of x and F that returns energy, gradient "
        f"and sparse Hessian, or a list of these, not {energy!r:.40}"
    )


def _checked(x: Array, F: Array, *, function: Callable[[Array, Array], Any]) -> tuple[float, Array, sp.sparray]:
    """A user's own function, whose results have the expected shapes."""
    result, size = function(x, F), x.size
    if not isinstance(result, tuple) or len(result) != 3:
        raise InputError("a weak energy returns three things: energy, gradient and sparse Hessian")
    value, gradient, hessian = float(result[0]), np.asarray(result[1], float), sp.csr_array(result[2])
    if gradient.shape != x.shape or hessian.shape != (size, size):
        raise InputError(
            f"a weak energy returns a gradient of shape {x.shape} and a Hessian of shape {(size, size)}, not "
            f"{gradient.shape} and {hessian.shape}"
        )
    finite = {"energy": -np.inf < value < np.inf, "gradient": np.isfinite(gradient).all(), "Hessian": _finite(hessian)}
    if wrong := next((name for name, good in finite.items() if not good), None):
        called = getattr(function, "__name__", type(function).__name__)
        raise InputError(
            f"the {wrong} of the weak energy {called} is not finite at some positions: correct its function"
        )
    return value, gradient, hessian


def _finite(hessian: sp.csr_array) -> bool:
    return bool(np.isfinite(hessian.data).all())


def _sum(x: Array, F: Array, *, parts: list[WeakFunction]) -> tuple[float, Array, sp.sparray]:
    """A sum of weak energies."""
    values, gradients, hessians = zip(*(part(x, F) for part in parts), strict=True)
    # Sums of sparse matrices drop entries that cancel: as a list of entries the sum keeps its pattern.
    listed = [sp.coo_array(each) for each in hessians]
    data, rows, cols = (np.concatenate([getattr(each, part) for each in listed]) for part in ("data", "row", "col"))
    return sum(values), np.sum(gradients, axis=0), sp.csr_array((data, (rows, cols)), shape=hessians[0].shape)


_Terms = Callable[[Array], tuple[float, Array, Array]]
"""L (n, d) → U, ∂U/∂L (n, d), and the blocks (m, d, d) of ∂²U/∂L∂L."""


def _bond_energy(
    network: Network, edges: IntArray, offsets: IntArray, pairs: tuple[IntArray, IntArray], terms: _Terms
) -> WeakFunction:
    """The energy of terms over the bond vectors L = g x + F b of a graph; pairs: edges of each block, (m,) twice."""
    n, d = offsets.shape
    where = np.repeat(np.arange(n), 2), edges.ravel()
    g = sp.csr_array((np.tile([-1.0, 1.0], n), where), shape=(n, network.n_vertices))
    b = np.zeros((n, d)) if network.cell is None else offsets @ network.cell
    return partial(_of_bonds, g=g, b=b, hessian=_HessianOfBlocks(edges, pairs, network.n_vertices, d), terms=terms)


def _of_bonds(
    x: Array, F: Array, *, g: sp.csr_array, b: Array, hessian: _HessianOfBlocks, terms: _Terms
) -> tuple[float, Array, sp.sparray]:
    """U and its derivatives by x."""
    value, gradient, blocks = terms(g @ x + b @ F.T)
    return value, g.T @ gradient, hessian.of(blocks)


class _HessianOfBlocks:
    """(g ⊗ 1)ᵀ M (g ⊗ 1) from the blocks of M, (m, d, d), for pairs of edges: all have one pattern, zeros included."""

    def __init__(self, edges: IntArray, pairs: tuple[IntArray, IntArray], n_vertices: int, d: int):
        m, axes = len(pairs[0]), np.arange(d)
        rows = d * edges[pairs[0]][:, :, None, None, None] + axes[:, None]
        cols = d * edges[pairs[1]][:, None, :, None, None] + axes
        shape = (m, 2, 2, d, d)
        signs = np.array([[1.0, -1.0], [-1.0, 1.0]])[:, :, None, None]
        sources = np.arange(m * d * d).reshape(m, 1, 1, d, d)
        rows, cols, signs, sources = (np.broadcast_to(part, shape).ravel() for part in (rows, cols, signs, sources))
        size = d * n_vertices
        places, slot = np.unique(rows.astype(np.int64) * size + cols, return_inverse=True)
        self._gather = sp.csr_array((signs, (slot.ravel(), sources)), shape=(len(places), m * d * d))
        self._starts = np.searchsorted(places, size * np.arange(size + 1, dtype=np.int64))
        self._columns, self._shape = places % size, (size, size)

    def of(self, blocks: Array) -> sp.csr_array:
        """The Hessian, (d·N_v)²."""
        return sp.csr_array((self._gather @ blocks.ravel(), self._columns.copy(), self._starts.copy()), self._shape)


def _spring_terms(L: Array, k: Array, rest: Array) -> tuple[float, Array, Array]:
    """½ k(|L| − ℓ)²."""
    length = norms(L)
    divisor = np.where(rest > 0, length, 1.0)
    if not (divisor > 0).all():
        raise InputError(f"soft spring {int(divisor.argmin())} has no length, so no direction: move its ends apart")
    # k n nᵀ + k(1 − ℓ/|L|)(1 − n nᵀ)
    ratio, n = rest / divisor, L / divisor[:, None]
    blocks = (k * (1 - ratio))[:, None, None] * np.eye(L.shape[1])
    blocks = blocks + (k * ratio)[:, None, None] * n[:, :, None] * n[:, None, :]
    return float(0.5 * np.sum(k * (length - rest) ** 2)), (k * (1 - ratio))[:, None] * L, blocks


def _angle_terms(L: Array, edges: IntArray, signs: Array, rest: Array, k: Array) -> tuple[float, Array, Array]:
    """½ k(θ − θ0)² of pairs of edges, by the cosine c = p·q of the unit vectors p and q away from their vertex."""
    vectors = signs[:, :, None] * L[edges]
    lengths = np.linalg.norm(vectors, axis=2)
    p, q = (vectors / lengths[:, :, None]).transpose(1, 0, 2)
    c = np.einsum("nd,nd->n", p, q)
    angle = _angle(p, q)
    value = float(0.5 * np.sum(k * (angle - rest) ** 2))
    first, second = (k * derivative for derivative in _by_cosine(angle, rest))
    # ∂c/∂P = (q − c p)/|P| of the edge vector P, and its sign on L
    rates = (signs / lengths).T[:, :, None] * np.stack([q - c[:, None] * p, p - c[:, None] * q])
    gradient = np.zeros_like(L)
    np.add.at(gradient, edges.T, first[:, None] * rates)
    one, c_, unit, blocks = np.eye(L.shape[1]), c[:, None, None], (p, q), []
    for i, j in ((0, 0), (1, 1), (0, 1)):
        a, b = unit[i], unit[1 - i]
        if i == j:  # ∂²c/∂P∂P = (3c p pᵀ − p qᵀ − q pᵀ − c)/|P|²
            curvature = 3 * c_ * _outer(a, a) - _outer(a, b) - _outer(b, a) - c_ * one
        else:  # ∂²c/∂P∂Q = (1 − p pᵀ − q qᵀ + c p qᵀ)/|P||Q|
            curvature = one - _outer(p, p) - _outer(q, q) + c_ * _outer(p, q)
        scale = signs[:, i] * signs[:, j] / (lengths[:, i] * lengths[:, j])
        block = (first * scale)[:, None, None] * curvature
        blocks.append(block + second[:, None, None] * _outer(rates[i], rates[j]))
    blocks.append(blocks[2].transpose(0, 2, 1))
    return value, gradient, np.concatenate(blocks)


def _outer(a: Array, b: Array) -> Array:
    return a[:, :, None] * b[:, None, :]


def _by_cosine(angle: Array, rest: Array) -> tuple[Array, Array]:
    """First and second derivative of ½(θ − θ0)² by cos θ.

    Both are finite at a straight angle only where it is at rest: φ/sin φ and (sin φ − φ cos φ)/sin³ φ of φ = π − θ.
    """
    bend = np.pi - angle
    straight = (bend < _NEARLY_STRAIGHT) & (rest == np.pi)
    parallel = ~straight & (np.minimum(bend, angle) < _CERTAIN_DIRECTION)
    if parallel.any():
        raise InputError(
            f"the edges of pair {int(parallel.argmax())} are parallel and their rest angle is another, so the force "
            "has no direction: give a rest angle of π, or bend them a little"
        )
    safe = np.where(straight, 0.5 * np.pi, angle)
    sine, cosine, change = np.sin(safe), np.cos(safe), safe - rest
    first, second = -change / sine, (sine - change * cosine) / sine**3
    series = 1 + bend**2 / 6 + 7 * bend**4 / 360, 1 / 3 + 2 * bend**2 / 15 + 2 * bend**4 / 63
    return np.where(straight, series[0], first), np.where(straight, series[1], second)


def _meeting_edges(network: Network) -> tuple[IntArray, Array]:
    """All pairs of edges at a vertex (n, 2), with ±1 (n, 2) for a common tail or head."""
    ends = network.edges.ravel()
    meets = sp.csr_array((np.ones(len(ends)), (np.arange(len(ends)), ends)))
    i, j = sp.triu(meets @ meets.T, 1).nonzero()
    order = np.lexsort((j, i, ends[i]))
    halves = np.stack([i[order], j[order]], axis=1)
    return halves // 2, np.where(halves % 2, -1.0, 1.0)


def _positions_bonds(network: Network) -> Array:
    """Bond vectors (N_b, d) of the positions of a network, else an `InputError`."""
    if network.positions is None:
        raise InputError("the network has no positions, which give its angles at rest: give rest_angles")
    return network.bond_vectors(network.positions)


def _angles(L: Array, edges: IntArray, signs: Array) -> Array:
    """Angles (n,) between the directions of pairs of edges away from their vertex."""
    return _angle(*(signs[:, :, None] * L[edges] / norms(L)[edges][:, :, None]).transpose(1, 0, 2))


def _angle(p: Array, q: Array) -> Array:
    """Angles (n,) of unit vectors: differences have full accuracy for all of them, which the cosine lacks."""
    return np.asarray(2 * np.arctan2(norms(p - q), norms(p + q)))


def _per_term(values: ArrayLike, n: int, name: str, place: str, positive: bool = True) -> Array:
    """One value a term (n,), from as many or from one number."""
    array = np.asarray(values)
    return edge_values(np.full(n, array) if array.ndim == 0 else array, n, name, positive, place)
