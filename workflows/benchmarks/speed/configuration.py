"""Task σ → configuration: one factorisation and two right sides.

The hot path of every optimisation: the graph is known, so that ordering and symbolic factorisation are not timed; the
stress is new in every run, so that assembly and numerical factorisation are timed.  Multigrid cannot keep its
hierarchy, and SuperLU its ordering, from one matrix to the next: they are timed whole.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from critflow import CriticalManifold, Network, voronoi_network
from critflow.linalg.backends import available_backends
from critflow.precision.double_double import Extended
from critflow.workflow import stable_rng

from ..timing import Answer, Method, Task, installed, peer
from . import references

# From the largest size on only backends and peers that take no more than some seconds.
HUGE, _AT_HUGE = 1_000_000, ("superlu", "metis", "pardiso")
SIZES = (100, 1_000, 10_000, 100_000, HUGE)
# Dense matrices beyond are out of the question.
DENSE = 2_000
# Backends that require another package.
FAST = {"metis": "pymetis", "pardiso": "pypardiso", "pyamg": "pyamg"}
TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
# Where every run of an iterative method takes seconds it has one level, at which its answer is worth something.
LARGE, _GOOD = 100_000, (1e-10,)

Solve = Callable[[np.ndarray], np.ndarray]


class _Laplacian:
    """P(σ) over the free vertices in CSC form, both triangles, on a fixed pattern."""

    def __init__(self, network: Network):
        n, index = len(network.free), np.full(network.n_vertices, -1)
        index[network.free] = np.arange(n)
        tail, head = index[network.edges].T
        rows, cols = np.concatenate([tail, head, tail, head]), np.concatenate([tail, head, head, tail])
        signs, edges = np.repeat([1.0, -1.0], 2 * len(tail)), np.tile(np.arange(len(tail)), 4)
        kept = (rows >= 0) & (cols >= 0)
        places, place = np.unique(cols[kept] * n + rows[kept], return_inverse=True)
        self._gather = sp.csr_array((signs[kept], (place, edges[kept])), shape=(len(places), len(tail)))
        ends = np.searchsorted(places // n, np.arange(n + 1)).astype(np.int32)
        self._pattern = (places % n).astype(np.int32), ends
        self._shape = n, n

    def at(self, sigma: np.ndarray) -> sp.csc_matrix:
        return sp.csc_matrix((self._gather @ sigma, *self._pattern), shape=self._shape)


# Solvers of P y = r: (…, σ, level) -> a function of right sides (n, d)


def _dense_cholesky(laplacian: _Laplacian, sigma: np.ndarray, level: float) -> Solve:
    factor = scipy.linalg.cho_factor(laplacian.at(sigma).toarray(), overwrite_a=True, check_finite=False)
    return partial(scipy.linalg.cho_solve, factor, check_finite=False)


def _pseudo_inverse(network: Network, sigma: np.ndarray, level: float) -> Solve:
    """The paper's formula: the inverse of P of all vertices on all but its null space, moved to the grounded vertex."""
    g, free = network.incidence, network.free
    ground = np.setdiff1d(np.arange(network.n_vertices), free)
    inverse = np.linalg.pinv((g.T @ sp.diags_array(sigma) @ g).toarray())

    def solve(right: np.ndarray) -> np.ndarray:
        full = np.zeros((network.n_vertices, right.shape[1]))
        full[free], full[ground] = right, -right.sum(axis=0)
        y = inverse @ full
        return y[free] - y[ground]

    return solve


def _multigrid(laplacian: _Laplacian, sigma: np.ndarray, level: float) -> Solve:
    """Levels are the part of the residual that conjugate gradients leave."""
    hierarchy = peer("pyamg").smoothed_aggregation_solver(laplacian.at(sigma).tocsr())
    solve = partial(hierarchy.solve, tol=level, accel="cg", maxiter=300)
    return lambda right: np.stack([solve(column) for column in right.T], axis=1)


def _error(exact: Extended, L: np.ndarray) -> float:
    """Largest relative error of a bond vector."""
    length = np.linalg.norm(exact.high, axis=1)
    return float((np.linalg.norm((L - exact.high) - exact.low, axis=1) / length).max())


def _methods(n_vertices: int, seed: int) -> list[Method]:
    manifold, huge = CriticalManifold(voronoi_network(n_vertices, seed)), n_vertices >= HUGE
    network = manifold.network
    sigma = np.abs(stable_rng(seed, "contest", "stress").standard_normal(network.n_edges))
    sigma *= np.sqrt(len(sigma) / (sigma @ sigma))
    error = partial(_error, references.configuration(manifold, sigma)[1])
    divergence, g, b = network.divergence, network.free_incidence, network.boundary_vectors

    def by_solver(factorise: Callable[[np.ndarray, float], Solve], level: float) -> Answer:
        solve = factorise(sigma, level)
        return Answer(b - g @ solve(divergence @ (sigma[:, None] * b)))

    def by_manifold(manifold: CriticalManifold, level: float) -> Answer:
        return Answer(manifold.balance(sigma).bond_vectors)

    def method(name: str, run: Callable, *arguments: object, **options: object) -> Method:
        return Method(name, partial(run, *arguments), error, **options)

    methods = [method("auto", by_manifold, manifold)]
    for backend in (name for name in available_backends() if name in _AT_HUGE or not huge):
        methods.append(method(backend, by_manifold, CriticalManifold(network, backend=backend), backend=backend))
    for backend, package in FAST.items():
        if not installed(package):
            methods.append(method(backend, by_manifold, manifold, package=package))
    methods.append(method("solve", lambda level: Answer(manifold.solve(sigma).value.bond_vectors)))
    laplacian = _Laplacian(network)
    if n_vertices <= DENSE:
        methods += [
            method("dense Cholesky", by_solver, partial(_dense_cholesky, laplacian), package="scipy"),
            method("pseudo-inverse", by_solver, partial(_pseudo_inverse, network), package="numpy"),
        ]
    levels = TOLERANCES if n_vertices < LARGE else _GOOD
    return [*methods, method("pyamg CG", by_solver, partial(_multigrid, laplacian), levels=levels, package="pyamg")]


_BACKENDS = ("qdldl", "superlu", *FAST)
_PEERS = ("dense Cholesky", "pseudo-inverse", "pyamg CG")

TASKS = (
    Task(
        "configuration",
        "σ → configuration",
        "largest relative error of a bond vector",
        SIZES,
        ("auto", "solve", *_BACKENDS, *_PEERS),
        "auto",
        _methods,
    ),
)
