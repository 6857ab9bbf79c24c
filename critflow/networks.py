"""Networks: edges, boundary, stiffnesses and pins, as one frozen and validated value.

The bond vector of edge α is L_α = Σ_i g_{αi} x_i + b_α with the signed incidence g (+1 at the head, −1 at the tail).
The constant b_α carries the boundary: the image offset of the edge times the cell, plus the pinned positions.  No
minimum-image rule is ever applied, so any shear and edges longer than half the cell are exact (`BondVectors`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import Array, IntArray, edge_values, finite_rows, floats, integers, of_kind, shown
from critflow.checks import check_ends, check_positions, check_support, checked_cell, checked_pins
from critflow.faces import Faces, PlanarFaces
from critflow.numerics import restore_read_only
from critflow.result import NetworkError


@dataclass(frozen=True, eq=False, repr=False)
class Network:
    """A spring network in a periodic cell, or hung on pins, or both.

    edges      (N_b, 2) tail and head of each edge
    offsets    (N_b, d) integer image offset of the head; None: no edge crosses the boundary
    cell       (d, d) rows are the cell vectors; None: not periodic
    stiffness  (N_b,) k_α, or one number for all
    pins       vertex -> fixed position (d,); the pins leave the unknowns
    positions  (N_v, d) any embedding, to draw or to start from; not part of the physics
    faces      the polygons of a planar network, if known
    note       a sentence about its making, such as the edges that were removed
    reference_volume  V of a network without a cell, to which its moduli refer (`with_volume`)

    Raises `NetworkError` when no positive stress can give every edge a length (but without a cell accepts pieces of
    several edges on one vertex, which stresses of both signs may open), and when the positions contradict the offsets:
    edges span the cell although their ends are close to each other in another image.
    """

    # The types are those after construction, which accepts anything that converts to them.
    edges: IntArray
    offsets: IntArray = None  # type: ignore[assignment]
    cell: Array | None = None
    stiffness: Array = 1.0  # type: ignore[assignment]
    pins: Mapping[int, Array] = field(default_factory=dict)
    n_vertices: int = 0
    positions: Array | None = None
    faces: Faces | None = None
    note: str = ""
    reference_volume: float | None = None
    # Patterns of matrices of the graph, by name: a network shares them with all of its copies.
    matrices: dict[str, Any] = field(default_factory=dict, init=False, repr=False, compare=False)
    # Whether every edge must have a length under positive stresses.
    _supported: ClassVar[bool] = True

    def __post_init__(self) -> None:
        edges = integers(self.edges, "edges")
        if edges.ndim != 2 or edges.shape[1] != 2 or len(edges) == 0:
            raise NetworkError(f"edges must have shape (N_b, 2) with N_b >= 1, not {edges.shape}: give tail and head")
        if not isinstance(self.n_vertices, int | np.integer) or self.n_vertices < 0:
            raise NetworkError(
                f"n_vertices must be a whole number above zero, not {shown(self.n_vertices)}, or left out"
            )
        n_vertices = int(self.n_vertices) or max(int(edges.max()) + 1, 0)
        pins = checked_pins(self.pins, n_vertices)
        cell = None if self.cell is None else checked_cell(self.cell)
        if cell is None and not pins:
            raise NetworkError("a network needs a periodic cell or pins: without either it collapses to a point")
        sizes = {p.shape for p in pins.values()} | ({cell.shape[:1]} if cell is not None else set())
        if len(sizes) != 1 or any(len(size) != 1 for size in sizes):
            raise NetworkError("the cell vectors and the pinned positions must all have the same dimension")
        dimension = int(sizes.pop()[0])
        offsets = np.zeros((len(edges), dimension), int) if self.offsets is None else integers(self.offsets, "offsets")
        stiffness = edge_values(self.stiffness, len(edges), "stiffness", equal=True)
        positions = None if self.positions is None else floats(self.positions, "positions")

        if offsets.shape != (len(edges), dimension):
            raise NetworkError(f"offsets must have shape {(len(edges), dimension)}, not {offsets.shape}: one per edge")
        if cell is None and offsets.any():
            raise NetworkError("edges with image offsets need a cell: give its vectors as rows")
        check_ends(edges, n_vertices)
        loops = np.flatnonzero((edges[:, 0] == edges[:, 1]) & ~offsets.any(axis=1))
        if len(loops):
            vertex = edges[loops[0], 0]
            raise NetworkError(f"edge {loops[0]} joins vertex {vertex} to itself, which has no length: remove it")
        if self._supported:
            check_support(edges, offsets, cell, pins, n_vertices)
        if positions is not None:
            check_positions(positions, edges, offsets, cell, (n_vertices, dimension))

        arrays = {"edges": edges, "offsets": offsets, "cell": cell, "stiffness": stiffness, "positions": positions}
        self.__setstate__({**arrays, "pins": pins, "n_vertices": n_vertices})

    # Values of fields, whose arrays nobody can then write to; also of a copy.
    __setstate__ = restore_read_only

    def __getstate__(self) -> dict[str, Any]:
        """Without patterns of matrices, which are made again at their first use."""
        return self.__dict__ | {"matrices": {}}

    def __repr__(self) -> str:
        parts = [f"{self.n_vertices:,} vertices", f"{self.n_edges:,} edges", f"{self.dimension} dimensions"]
        if self.cell is not None:
            parts.append("periodic")
        if self.pins:
            parts.append(f"{len(self.pins):,} pins")
        return f"Network({', '.join(parts)}, z = {2 * self.n_edges / self.n_vertices:.4g})"

    # Sizes

    @property
    def n_edges(self) -> int:
        return len(self.edges)

    @property
    def dimension(self) -> int:
        return int(self.offsets.shape[1])

    @cached_property
    def volume(self) -> float:
        """Volume V of the cell (area in two dimensions), or the one named for a network without a cell."""
        if self.cell is None:
            if self.reference_volume is None:
                raise NetworkError(
                    "a network without a cell has no volume and so no modulus: give it a cell, or name the volume to "
                    "which moduli refer, by network.with_volume(V), or --volume in a command"
                )
            return self.reference_volume
        if self.dimension == 2:
            (a, b), (c, d) = self.cell.tolist()
            return float(abs(a * d - b * c))
        # NumPy's determinant is the exponential of a logarithm, which rounds more the farther V is from one.
        return float(abs(scipy.linalg.det(self.cell)))

    @property
    def has_volume(self) -> bool:
        """Whether moduli are defined: a cell, or a named volume."""
        return self.cell is not None or self.reference_volume is not None

    @property
    def least_self_stresses(self) -> int:
        """N_b − d n_free, the fewest self-stresses by the counts; negative for underconstrained networks."""
        return self.n_edges - self.dimension * len(self.free)

    @property
    def spacing(self) -> float:
        """(V/N_v)^(1/d), the unit of length; without a volume, that of the diagonal of the box around the pins."""
        if self.has_volume:
            return float((self.volume / self.n_vertices) ** (1 / self.dimension))
        diagonal = float(np.linalg.norm(np.ptp(list(self.pins.values()), axis=0)))
        return diagonal / self.n_vertices ** (1 / self.dimension) or 1.0

    # Geometry

    @cached_property
    def incidence(self) -> sp.csr_array:
        """Signed incidence g, (N_b, N_v): +1 at the head, −1 at the tail, nothing at both (`incidenceMatrix`)."""
        rows = np.repeat(np.arange(self.n_edges), 2)
        signs = np.tile([-1.0, 1.0], self.n_edges)
        g = sp.csr_array((signs, (rows, self.edges.ravel())), shape=(self.n_edges, self.n_vertices))
        g.eliminate_zeros()
        return g

    @cached_property
    def free(self) -> IntArray:
        """The unknown vertices: all but the pins, or all but vertex 0, the ground of a periodic network."""
        free = np.ones(self.n_vertices, bool)
        free[list(self.pins) if self.pins else 0] = False
        return np.flatnonzero(free)

    @cached_property
    def free_rows(self) -> slice | IntArray:
        """The free vertices as an index of rows: a slice where they are consecutive, which NumPy reads much faster."""
        free = self.free
        consecutive = len(free) > 0 and free[-1] - free[0] == len(free) - 1
        return slice(int(free[0]), int(free[-1]) + 1) if consecutive else free

    @cached_property
    def fixed_positions(self) -> Array:
        """Positions (N_v, d) with zeros at the free vertices: where the pins, or the grounded vertex, are."""
        x = np.zeros((self.n_vertices, self.dimension))
        for vertex, position in self.pins.items():
            x[vertex] = position
        return x

    @cached_property
    def boundary_vectors(self) -> Array:
        """b, (N_b, d): image offset times cell, plus the contribution of the pins (`BondVectors2`, `BoundaryTerm`)."""
        if self.cell is not None and not self.pins:
            return np.asarray(self.offsets @ self.cell)
        b = np.asarray(self.incidence @ self.fixed_positions)
        return b if self.cell is None else b + self.offsets @ self.cell

    @cached_property
    def free_incidence(self) -> sp.csr_array:
        """Columns of g at the free vertices, (N_b, n_free)."""
        return sp.csr_array(self.incidence[:, self.free])

    @cached_property
    def divergence(self) -> sp.csr_array:
        """Transpose of `free_incidence`: sums edge vectors into forces on the free vertices, (n_free, N_b)."""
        return sp.csr_array(self.free_incidence.T)

    def bond_vectors(self, coordinates: Array) -> Array:
        """L = g x + b, (N_b, d), for coordinates (N_v, d); where vertices are pinned, the pins are used."""
        x = np.asarray(coordinates, dtype=float)
        # A periodic network is grounded at vertex 0, which need not lie at the origin here.
        x = x if self.pins else x - x[0]
        return np.asarray(self.free_incidence @ x[self.free]) + self.boundary_vectors

    def all_coordinates(self, free_coordinates: Array) -> Array:
        """Coordinates (N_v, d) from those of the free vertices (n_free, d)."""
        x = self.fixed_positions.copy()
        x[self.free] = free_coordinates
        return x

    # Copies

    def with_stiffness(self, stiffness: ArrayLike) -> Network:
        """The same network with other stiffnesses k, (N_b,) or one number."""
        return self._copied(stiffness=edge_values(stiffness, self.n_edges, "stiffness", equal=True))

    def with_volume(self, volume: float) -> Network:
        """The same network without a cell, with the volume V (area in two dimensions) to which its moduli refer."""
        if self.cell is not None:
            raise NetworkError("the volume of a periodic network is that of its cell: name one only without a cell")
        value = floats(volume, "a volume")
        if value.ndim or not 0 < value < np.inf:
            raise NetworkError(f"a volume must be positive and finite, not {shown(volume)}: give one number")
        return self._copied(reference_volume=float(value))

    def deformed(self, gradient: ArrayLike) -> Network:
        """The network after the affine deformation F of its boundary: b → F b, including pins and positions.

        Faces keep their numbers, also in a mirror, det F < 0.
        """
        F = floats(gradient, "a deformation")
        determinant = np.linalg.det(F) if F.shape == (self.dimension,) * 2 and np.isfinite(F).all() else 0.0
        if not abs(determinant) > 0:
            raise NetworkError(f"a deformation must be an invertible {self.dimension} × {self.dimension} matrix")
        copied = self._copied(
            cell=None if self.cell is None else self.cell @ F.T,
            pins={i: F @ p for i, p in self.pins.items()},
            positions=None if self.positions is None else self.positions @ F.T,
            faces=self.faces if self.faces is None or determinant > 0 else self.faces.mirrored(),
            reference_volume=None if self.reference_volume is None else self.reference_volume * abs(determinant),
        )
        copied.__dict__.pop("boundary_vectors", None)
        copied.__dict__.pop("fixed_positions", None)
        return copied

    def without_edges(self, edges: ArrayLike) -> Network:
        """The network without edges of these indices, one or several; vertices that they leave bare are removed too.

        Raises `NetworkError` where what remains cannot be supported: `pruned` removes more.
        """
        removed = np.atleast_1d(integers(edges, "edges"))
        missing = (removed < 0) | (removed >= self.n_edges)
        if missing.any():
            raise NetworkError(f"there is no edge {removed[missing][0]}: edges run from 0 to {self.n_edges - 1}")
        kept = np.ones(self.n_edges, bool)
        kept[removed] = False
        return self.part(kept)[0]

    def with_edge(self, tail: int, head: int, offset: ArrayLike | None = None, stiffness: float = 1.0) -> Network:
        """The network with one edge more, its last, from a vertex to another one in the cell at `offset` (d,).

        The faces of the network, if it has any, are not kept: the edge may cross others.
        """
        tail, head = of_kind(int, tail=tail, head=head)
        of_kind(float, stiffness=stiffness)
        for vertex in (tail, head):
            if not 0 <= vertex < self.n_vertices:
                raise NetworkError(f"there is no vertex {vertex}: vertices run from 0 to {self.n_vertices - 1}")
        image = np.zeros(self.dimension, int) if offset is None else integers(offset, "the offset")
        if image.shape != (self.dimension,):
            raise NetworkError(f"the offset must be {self.dimension} whole numbers of cells, not {shown(offset)}")
        return Network(
            np.concatenate([self.edges, [[tail, head]]]),
            np.concatenate([self.offsets, [image]]),
            self.cell,
            np.append(self.stiffness, stiffness),
            self.pins,
            positions=self.positions,
            reference_volume=self.reference_volume,
        )

    def _copied(self, **changed: Any) -> Network:
        """A copy with other values of the same graph, whose checks and matrices stay valid."""
        copied = object.__new__(type(self))
        copied.__dict__.update(self.__dict__)
        copied.__setstate__(changed)
        copied.__dict__.pop("volume", None)
        return copied

    def part(self, kept_edges: NDArray[np.bool_], note: str = "") -> tuple[Network, IntArray]:
        """The network of some of the edges, with the faces of its embedding, and the old index of each vertex."""
        edges = self.edges[kept_edges]
        vertices = np.unique(edges)
        index = np.full(self.n_vertices, -1)
        index[vertices] = np.arange(len(vertices))
        part = Network(
            index[edges],
            self.offsets[kept_edges],
            self.cell,
            self.stiffness[kept_edges],
            {int(index[i]): p for i, p in self.pins.items() if index[i] >= 0},
        )
        # Positions are not checked again: a few edges alone may look inconsistent.
        x = None if self.positions is None else self.positions[vertices]
        faces = None
        if self.faces is not None and x is not None and self.cell is not None:
            L = x[part.edges[:, 1]] - x[part.edges[:, 0]] + part.offsets @ self.cell
            faces = PlanarFaces(part.edges, L, len(vertices))
        changed = {"positions": x, "faces": faces, "note": note, "reference_volume": self.reference_volume}
        return part._copied(**changed), vertices


def validated_coordinates(network: Network, coordinates: ArrayLike) -> Array:
    """A copy of vertex coordinates as finite floats (N_v, d), else an `InputError`."""
    return finite_rows(floats(coordinates, "coordinates"), "coordinates", (network.n_vertices, network.dimension))


def periodic_network(edges: IntArray, offsets: IntArray, cell: Array, positions: Array) -> Network:
    """A periodic network of unit stiffness; in the plane with the faces of its embedding, which must not cross."""
    if len(cell) != 2:
        return Network(edges, offsets, cell, positions=positions)
    bond_vectors = positions[edges[:, 1]] - positions[edges[:, 0]] + offsets @ cell
    return Network(edges, offsets, cell, positions=positions, faces=PlanarFaces(edges, bond_vectors, len(positions)))
