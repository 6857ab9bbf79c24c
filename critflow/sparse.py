"""Sparse symmetric matrices with a fixed pattern and variable values, and their factors.

The pattern and its symbolic analysis are made once, the values follow from their sources by one precomputed sparse
product, and each factorisation A = L D Lᵀ is numeric only.  Solvers eliminate along the diagonal, so that the signs of
D are the inertia of A, which separates rigid from unstable configurations.

A `Factor` owns its numbers: a solver serves one factor, and another one when that factor is gone.  Threads may share a
pattern.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from copy import copy
from itertools import combinations_with_replacement
from typing import Any, TypeAlias

import numpy as np
import qdldl
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import depth_first_order
from scipy.sparse.linalg import SuperLU, splu

from critflow.extensions import from_extras, has_extras
from critflow.networks import Array, IntArray, Network
from critflow.numerics import EPS, product, symmetric_product
from critflow.result import InputError

# The sparse solvers by name, and the choice between them by size:
#
# qdldl    row by row on a minimum-degree ordering; always installed, and the fastest for small matrices
# superlu  SciPy's SuperLU on a minimum-degree ordering; always installed
#
# critflow-extras has others for large networks (`installed_solvers`): eliminating ones, and iterative ones for
# Laplacians of positive stresses, without inertia, each as a kind of `Factor`.

# Entries of the upper triangle up to which qdldl is faster, of networks in the plane and in space.  Measured for one
# numeric factorisation and four solves: on Voronoi networks of 300 to 10⁵ vertices the crossovers of the Laplacian, the
# elastic Hessian and the saddle matrix are 180,000, 100,000 and 170,000 entries; they have 2.5, 9 and 12.5 a vertex.
# In space factors fill in faster, as N^(4/3): on foams of 60 to 8,000 vertices the crossovers are 6,000, 11,000 and
# 10,000 entries, of 3, 24 and 23 a vertex.
CROSSOVER = (150_000, 9_000)


Backend: TypeAlias = Any
"""A solver factorises matrices of one pattern, each given by its upper triangle in columns, diagonal included:

Solver(model)     analyses a model, any positive definite matrix of the pattern
another(model)    a second solver with the same analysis, so that it gives the same bits
update(matrix)    factorises a matrix; the numbers of the last one are overwritten
solve(right)      x of A x = r, both (n,)
pivots()          D in the order of elimination, (n,); a vanishing pivot is no error, but a zero here
"""


class QDLDL:
    """Without pivoting; stops at an exact zero, and the pivots after it are leftovers."""

    def __init__(self, model: sp.csc_matrix):
        self._solver = qdldl.Solver(model, upper=True)
        self.solve = self._solver.solve

    def another(self, model: sp.csc_matrix) -> QDLDL:
        # The library shares no analysis between solvers, but repeats it alike.
        return QDLDL(model)

    def update(self, matrix: sp.csc_matrix) -> None:
        self._solver.update(matrix, upper=True)

    def pivots(self) -> Array:
        return self._solver.factors()[1].copy()


class MinimumDegree:
    """SuperLU in its symmetric mode, on an ordering that is found once."""

    def __init__(self, model: sp.csc_matrix):
        # The matrix in full, with the place of each entry in the upper triangle, from 1.
        place = sp.csc_matrix((np.arange(1, model.nnz + 1, dtype=np.int32), model.indices, model.indptr), model.shape)
        full = place + sp.triu(place, 1, format="csc").T
        factor = _eliminate(
            sp.csc_matrix((model.data[full.data - 1], full.indices, full.indptr), full.shape), "MMD_AT_PLUS_A"
        )
        # The elimination tree leads from each column to its first row below the diagonal.  In postorder the columns
        # of a subtree are adjacent, which makes wide blocks.
        order, L = np.argsort(factor.perm_c), factor.L
        L.sort_indices()
        n = len(order)
        inner = np.diff(L.indptr) > 1
        parent = np.full(n, n)
        parent[inner] = L.indices[L.indptr[:-1][inner] + 1]
        tree = sp.csr_array((np.ones(n), (parent, np.arange(n))), shape=(n + 1, n + 1))
        self._order = order[depth_first_order(tree, n, return_predecessors=False)[:0:-1]]
        # The same in that order.
        full = full[self._order][:, self._order].tocsc()
        full.sort_indices()
        self._place = full.data - 1
        self._matrix = sp.csc_matrix((np.empty(full.nnz), full.indices, full.indptr), full.shape)
        self._factor: SuperLU | None = None

    def another(self, model: sp.csc_matrix) -> MinimumDegree:
        solver = copy(self)
        solver._factor = None
        return solver

    def update(self, matrix: sp.csc_matrix) -> None:
        full = with_data(self._matrix, matrix.data[self._place])
        self._factor = None
        if np.isfinite(full.data).all():
            try:
                self._factor = _eliminate(full, "NATURAL")
            except RuntimeError:
                # A column without any pivot.
                self._factor = None

    def solve(self, right: Array) -> Array:
        x = np.full(right.shape, np.nan)
        if self._factor is not None:
            x[self._order] = self._factor.solve(right[self._order])
        return x

    def pivots(self) -> Array:
        # Where the diagonal vanished, rows were exchanged, and the pivots are not those of L D Lᵀ.
        if self._factor is None or (self._factor.perm_r != np.arange(len(self._order))).any():
            return np.zeros(len(self._order))
        return self._factor.U.diagonal()


def _eliminate(matrix: sp.csc_matrix, ordering: str) -> SuperLU:
    return splu(matrix, permc_spec=ordering, diag_pivot_thresh=0.0, options={"SymmetricMode": True})


# The solvers of the scene by name, and the entries of the upper triangle, of networks in the plane and in space, from
# which critflow-extras may have a faster one.
BACKENDS: dict[str, Any] = {"qdldl": QDLDL, "superlu": MinimumDegree}
LARGE = (20_000, 3_000)


def with_data(matrix: sp.csc_matrix, data: Array) -> sp.csc_matrix:
    """A matrix of the same pattern with other entries: the constructors of SciPy take longer than a product."""
    other: sp.csc_matrix = object.__new__(sp.csc_matrix)
    other.__dict__.update(matrix.__dict__, data=data)
    return other


def available_backends() -> dict[str, Any]:
    """The sparse solvers that are installed, here and in critflow-extras, by name, each good for `backend=`."""
    if not has_extras():
        return BACKENDS
    return BACKENDS | from_extras("installed_solvers", "solvers of large networks", counts=False)()


def choose_backend(backend: str, n_entries: int, in_space: bool = False, laplacian: bool = False) -> str:
    """The name itself if it is installed, or for "auto" that of the fastest solver for that many entries.

    in_space   whether the network has three dimensions
    laplacian  whether the solver may be one for Laplacians alone

    Raises `InputError` for a name that is unknown or not installed.
    """
    if backend == "auto":
        backend = "superlu" if n_entries > CROSSOVER[in_space] else "qdldl"
        if n_entries > LARGE[in_space] and has_extras():
            fastest = from_extras("fastest_solver", "solvers of large networks", counts=False)
            backend = fastest(backend, n_entries, in_space, laplacian)
    elif backend not in BACKENDS and backend not in (installed := available_backends()):
        raise InputError(
            f"no backend {backend!r} is installed: choose 'auto' or one of {', '.join(installed)}, and pip install "
            "'critflow-extras[fast,multigrid]' for all of them"
        )
    return backend


# Shift δ in units of the mean value.  A matrix with the same inertia at ±δ counts as regular; the shift is far above
# the rounding of pivots.
INERTIA_SHIFT = 1e-9
REDUCED = 1e-12  # reduction of the residual at which an iterative solver ends: rounding is near 1e-14 at 10⁶ vertices
REFINED_SOLVES = 20  # most refinements of a solve with A + δ.  Each reduces the error by δ over the smallest eigenvalue


# Rows, columns, sources and coefficients, (n_entries,) each or one for all: contributions coefficients_e ×
# values[sources_e] to the entries (rows_e, cols_e) of a matrix.  Symmetric contributions may be listed in full: entries
# below the diagonal, and those with a negative index, are ignored.
Entries = tuple[Any, Any, Any, Any]


class FixedPattern:
    """A sparse symmetric matrix A = Σ_s values_s A_s with constant A_s, from the entries of its upper triangle.

    size       number of rows n
    in_space   whether the network has three dimensions
    laplacian  whether it is its Laplacian, for which "auto" may choose an iterative solver in space
    """

    def __init__(
        self,
        size: int,
        n_sources: int,
        entries: Iterable[Entries],
        backend: str = "auto",
        in_space: bool = False,
        laplacian: bool = False,
    ):
        self.size = size
        # The entries of the upper triangle, with short integers: at 10⁶ vertices memory counts.
        parts = []
        for part in entries:
            arrays = np.broadcast_arrays(*part)
            upper = (arrays[0] <= arrays[1]) & (arrays[0] >= 0)
            kinds = (np.int32, np.int32, np.int32, float)
            parts.append([array[upper].astype(kind) for array, kind in zip(arrays, kinds, strict=True)])
        rows, cols, sources, coefficients = (np.concatenate(part) for part in zip(*parts, strict=True))
        # Every diagonal entry is part of the pattern, so that shifts and zero blocks fit.
        diagonal = np.arange(size, dtype=np.int32)
        keys = np.concatenate([cols, diagonal]).astype(np.int64) * size + np.concatenate([rows, diagonal])
        places, slot = np.unique(keys, return_inverse=True)
        slot = slot[: len(rows)].astype(np.int32)
        self._gather = sp.csr_array(sp.coo_array((coefficients, (slot, sources)), shape=(len(places), n_sources)))
        cols, rows = np.divmod(places, size)
        starts = np.searchsorted(cols, np.arange(size + 1)).astype(np.int32)
        self._matrix = sp.csc_matrix((np.zeros(len(rows)), rows.astype(np.int32), starts), shape=(size, size))
        # The diagonal ends each column of an upper triangle.
        self._diagonal = starts[1:] - 1
        self.backend = self.elimination = choose_backend(backend, len(places), in_space, laplacian)
        self._kind, self.may_eliminate = Factor, backend == "auto"
        if self.backend not in BACKENDS and issubclass(iterative := available_backends()[self.backend], Factor):
            # An iterative solver of "auto" leaves what it cannot serve to the fastest elimination.
            self._kind, self.elimination = iterative, choose_backend("auto", len(places), in_space)
        # The first solver has the analysis for all; factors that are gone leave theirs.
        self._first: Backend = None
        self._spare: list[Backend] = []

    def __getstate__(self) -> dict[str, Any]:
        """Without solvers, which a copy makes at its first use."""
        return self.__dict__ | {"_first": None, "_spare": []}

    def analyse(self) -> Backend:
        """Order and analyse the pattern for elimination, as the first elimination does otherwise; its solver."""
        if self._first is None:
            kind = BACKENDS.get(self.elimination) or available_backends()[self.elimination]
            self._first = kind(self._model())
            self._spare.append(self._first)
        return self._first

    def factorize(self, values: Array, shift: float | Array = 0.0) -> Factor:
        """L D Lᵀ of A + shift·1, with values (n_sources,) and a shift for all or for each of the rows (n,)."""
        data = product(self._gather, values)
        if isinstance(shift, np.ndarray) or shift:
            data[self._diagonal] += shift
        factor = self._kind(self, with_data(self._matrix, data))
        factor.prepare()
        return factor

    def factorize_shifted(self, values: Array) -> tuple[Factor, bool, int]:
        """L D Lᵀ of A + δ, whether its inertia is that of A, and the number of negative pivots of A − δ.

        Values of both signs may give a vanishing pivot without a vanishing eigenvalue.  Where the inertias of A + δ
        and A − δ differ, an eigenvalue lies within δ of zero.
        """
        shift = INERTIA_SHIFT * float(np.mean(np.abs(values)))
        below = self.factorize(values, -shift)
        sound, n_negative = below.sound, below.n_negative
        above = self.factorize(values, shift)
        return above, sound and above.sound and above.n_negative == n_negative, n_negative

    def factorize_signed(self, values: Array) -> Factor:
        """As `factorize` for values of both signs: `singular` only where an eigenvalue is as good as zero.

        Where a pivot vanishes, A + δ is factorised instead, and `solve` refines its answers.  Right-hand sides in the
        range of a singular A have answers too: none of the null space enters them.
        """
        factor = self.factorize(values)
        if factor.singular:
            factor, regular, _ = self.factorize_shifted(values)
            factor._shift, factor._singular = INERTIA_SHIFT * float(np.mean(np.abs(values))), not regular
        return factor

    def _model(self) -> sp.csc_matrix:
        """A matrix of this pattern for the analysis, safely positive definite: a Laplacian with a weak ground."""
        indices, indptr = self._matrix.indices, self._matrix.indptr
        data = np.full(len(indices), -1.0)
        data[self._diagonal] = np.diff(indptr) + np.bincount(indices, minlength=self.size) - 2 + 0.01
        return sp.csc_matrix((data, indices, indptr), shape=self._matrix.shape)

    def _solver(self) -> Backend:
        """A solver that serves no factor."""
        first = self._first or self.analyse()
        try:
            return self._spare.pop()
        except IndexError:
            return first.another(self._model())


class Factor:
    """L D Lᵀ of one matrix A, for any number of right-hand sides; no other factorisation changes its answers.

    iterates  whether the time of a solve depends on the reduction of the residual
    """

    iterates = False
    _solver: Backend = None

    def __init__(self, pattern: FixedPattern, matrix: sp.csc_matrix):
        # The upper triangle of A + shift, which stands in for A where the shift is not zero.
        self._pattern, self._matrix, self._shift = pattern, matrix, 0.0
        self._pivots: Array | None = None
        self._singular = False

    def release(self) -> None:
        """Leave the solver and its memory to the next factor; a later solve would eliminate again."""
        if self._solver is not None:
            self._pattern._spare.append(self._solver)
            self._solver = None

    __del__ = release

    def __getstate__(self) -> dict[str, Any]:
        """Without the solver."""
        return self.__dict__ | {"_solver": None}

    def prepare(self) -> None:
        """Eliminate."""
        self._eliminated()

    def _eliminated(self) -> Backend:
        """The solver with the numbers, which a copy lacks before its first use."""
        if self._solver is None:
            self._solver = self._pattern._solver()
            self._solver.update(self._matrix)
        return self._solver

    def solve(self, right_side: Array) -> Array:
        """x of A x = r, for r of shape (n,) or (n, d)."""
        solve = self._eliminated().solve
        x = by_columns(solve, right_side)
        if self._shift:
            # Iterative refinement removes the shift.
            best = np.inf
            for _ in range(REFINED_SOLVES):
                residual = right_side - self.multiply(x)
                size = float(np.abs(residual).max(initial=0.0))
                if not size < 0.5 * best:
                    break
                x, best = x + by_columns(solve, residual), size
        return x

    def solve_roughly(self, right_side: Array, reduction: float) -> Array:
        """As `solve`, with the residual reduced by this factor only, where the solver iterates."""
        return self.solve(right_side)

    def eliminate(self) -> bool:
        """Leave an iterative solver for elimination where it may; whether anything changed."""
        return False

    def multiply(self, x: Array) -> Array:
        """A x, for x of shape (n,) or (n, d)."""
        Ax = symmetric_product(self._matrix, x)
        return Ax - self._shift * x if self._shift else Ax

    @property
    def pivots(self) -> Array:
        """The diagonal D in the order of elimination, (n,); zero where a pivot vanished."""
        if self._pivots is None:
            self._pivots = self._eliminated().pivots()
        return self._pivots

    @property
    def n_negative(self) -> int:
        """Number of negative eigenvalues of A (Sylvester's law of inertia)."""
        return int(np.count_nonzero(self.pivots < 0))

    @property
    def sound(self) -> bool:
        """Whether the elimination is complete: all pivots are finite and not zero, so that their signs count."""
        return bool(np.isfinite(self.pivots).all() and (self.pivots != 0).all())

    @property
    def singular(self) -> bool:
        """Whether a pivot vanishes, is not finite, or is below the rounding of the largest one."""
        if self._shift:
            return self._singular
        size = np.abs(self.pivots)
        return not bool(size.min() > len(size) * EPS * size.max() and np.isfinite(size).all())

    @property
    def indefinite(self) -> bool:
        """Whether A is not safely positive definite."""
        return self.singular or self.n_negative > 0


def by_columns(solve: Callable[[Array], Array], right_side: Array) -> Array:
    """Solutions for one right-hand side (n,) or several (n, d)."""
    if right_side.ndim == 1:
        return solve(right_side)
    x = np.empty(right_side.shape)
    for column in range(right_side.shape[1]):
        x[:, column] = solve(right_side[:, column])
    return x


# Patterns of the matrices of a network: stress-weighted Laplacian and elastic Hessian.
#
# Their patterns stay the same while σ, the lengths or the strain change, so each is a `FixedPattern` made once.

# Shift of the Hessian of unit springs, relative to ⟨|L|²⟩, that removes the zero modes of any geometry.
BALANCE_SHIFT = 1e-13


def laplacian(network: Network, backend: str = "auto") -> FixedPattern:
    """P = gᵀ diag(σ) g over the free vertices, (n_free, n_free), from σ (N_b,) (`PrestressMatrix`)."""
    in_space = network.dimension > 2
    return FixedPattern(len(network.free), network.n_edges, end_pairs(network), backend, in_space, laplacian=True)


def end_pairs(network: Network) -> Iterator[tuple[IntArray, IntArray, IntArray, float]]:
    """All pairs (i, j) of free ends of an edge, with the edges α and the product g_αi g_αj.

    The four of an edge from a vertex to its own image, which moves with it, cancel.
    """
    tail, head = free_ends(network).T
    for i, j, sign in ((tail, tail, 1.0), (head, head, 1.0), (tail, head, -1.0), (head, tail, -1.0)):
        edge = np.flatnonzero((i >= 0) & (j >= 0))
        yield i[edge], j[edge], edge, sign


def block_laplacian(network: Network, backend: str = "auto") -> FixedPattern:
    """Σ_α g_α g_αᵀ ⊗ C_α over the free coordinates, (d·n_free)², from the upper triangles of C_α (`GenericHessian`).

    The values are `edge_blocks(...)`: with C_α = K_α L_α L_αᵀ + σ_α 1 this is the elastic Hessian.
    """
    d = network.dimension
    return FixedPattern(d * len(network.free), n_block_values(network), block_entries(network), backend, d > 2)


def n_block_values(network: Network) -> int:
    """Number of values of `block_laplacian`."""
    return network.n_edges * network.dimension * (network.dimension + 1) // 2


def block_entries(network: Network) -> Iterator[Entries]:
    """The entries of `block_laplacian`, for patterns with further ones."""
    d = network.dimension
    # Number of each pair (row, col) in the upper triangle of a symmetric block.
    number = np.zeros((d, d), int)
    number[np.triu_indices(d)] = np.arange(d * (d + 1) // 2)
    number = np.maximum(number, number.T)
    for i, j, edge, sign in end_pairs(network):
        for row, col in np.ndindex(d, d):
            yield d * i + row, d * j + col, edge + network.n_edges * number[row, col], sign


def edge_blocks(axial: Array, vectors: Array, isotropic: Array) -> Array:
    """Values for `block_laplacian` of C_α = axial_α v_α v_αᵀ + isotropic_α 1: two (N_b,) and v (N_b, d)."""
    d = vectors.shape[1]
    blocks = np.empty((d * (d + 1) // 2, len(vectors)))
    for block, (row, col) in zip(blocks, combinations_with_replacement(range(d), 2), strict=True):
        np.multiply(axial * vectors[:, row], vectors[:, col], out=block)
        if row == col:
            block += isotropic
    return blocks.ravel()


def free_ends(network: Network) -> NDArray[np.int64]:
    """Tail and head of each edge as positions among the free vertices, −1 for fixed ones, (N_b, 2)."""
    index = np.full(network.n_vertices, -1)
    index[network.free] = np.arange(len(network.free))
    return index[network.edges]


def rigidity_matrix(network: Network, coordinates: Array) -> sp.csr_array:
    """R = ∂|L|/∂x over the free coordinates, (N_b, d·n_free): incidence times unit vectors (`RigidityMatrix`)."""
    L = network.bond_vectors(coordinates)
    return spread_columns(network, L / np.linalg.norm(L, axis=1)[:, None])


def spread_columns(network: Network, vectors: Array) -> sp.csr_array:
    """The matrix (N_b, d·n_free) with entries g_{αi} v_{αμ} of edge vectors v (N_b, d)."""
    g, d = network.free_incidence, network.dimension
    columns = [sp.diags_array(vectors[:, axis]) @ g for axis in range(d)]
    order = np.arange(d * g.shape[1]).reshape(d, -1).T.ravel()
    return sp.csr_array(sp.hstack(columns).tocsc()[:, order])


def balanced_part(
    network: Network, L: Array, sigma: Array, pattern: FixedPattern, shift: float = BALANCE_SHIFT
) -> Array:
    """The component of σ in balance at bond vectors L: σ less its projection on the columns of R^h.

    Close to the transition, where extensions have few digits, or where edges are much shorter than the coordinates are
    large, unbalanced forces from rounding are not small compared with the tensions.

    pattern  of the elastic Hessian, whose `shift` removes the zero modes
    """
    ones = np.ones(len(sigma))
    factor = pattern.factorize(edge_blocks(ones, L, 0 * ones), shift)
    for _ in range(3):
        force = network.divergence @ (sigma[:, None] * L)
        u = factor.solve(force.ravel()).reshape(force.shape)
        sigma = sigma - np.einsum("ad,ad->a", L, network.free_incidence @ u)
    return sigma
