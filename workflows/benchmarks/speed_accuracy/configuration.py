"""Tasks σ → configuration, and with the gradient of B_0: one factorisation and two, or four, right sides.

The hot path of every optimisation: the graph is known, so that ordering and symbolic factorisation are not timed; the
stress is new in every run, so that assembly and numerical factorisation are timed.  Multigrid cannot keep its
hierarchy, and SuperLU its ordering, from one matrix to the next: they are timed whole.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from critflow import CriticalManifold, Network, voronoi_network
from critflow.critical.quantity import dilation, transition_modulus
from critflow.linalg.backends import available_backends
from critflow.precision.double_double import Extended
from critflow.workflow import stable_rng

from ..timing import Accuracy, Method, Task, installed, peer
from . import references

SIZES = (100, 1_000, 10_000, 100_000)
# From here on only backends and peers that take no more than some seconds.
HUGE, _AT_HUGE = 1_000_000, ("superlu", "metis", "pardiso")
# Dense matrices beyond are out of the question.
DENSE = 2_000
# Backends that require another package.
FAST = {"metis": "pymetis", "pardiso": "pypardiso"}
TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
# Where every run of an iterative method takes seconds it has one level, at which its answer is worth something.
LARGE, _GOOD = 100_000, (1e-10,)

Solve = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class _LinearSolver:
    """A solver of P y = r: (σ, level) -> a function of right sides (n, d)."""

    name: str
    package: str
    factorise: Callable[[np.ndarray, float], Solve]
    levels: tuple[float, ...] = (0.0,)
    backend: str = ""


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


def _dense_cholesky(laplacian: _Laplacian):
    def factorise(sigma, level):
        factor = scipy.linalg.cho_factor(laplacian.at(sigma).toarray(), overwrite_a=True, check_finite=False)
        return lambda right: scipy.linalg.cho_solve(factor, right, check_finite=False)

    return factorise


def _pseudo_inverse(network: Network):
    """The paper's formula: the inverse of P of all vertices on all but its null space, moved to the grounded vertex."""
    g, free = network.incidence, network.free
    ground = np.setdiff1d(np.arange(network.n_vertices), free)

    def factorise(sigma, level):
        inverse = np.linalg.pinv((g.T @ sp.diags_array(sigma) @ g).toarray())

        def solve(right):
            full = np.zeros((network.n_vertices, right.shape[1]))
            full[free], full[ground] = right, -right.sum(axis=0)
            y = inverse @ full
            return y[free] - y[ground]

        return solve

    return factorise


def _superlu(laplacian: _Laplacian):
    return lambda sigma, level: splu(laplacian.at(sigma)).solve


def _single_precision(laplacian: _Laplacian):
    """Levels are steps of refinement with residuals in double precision."""

    def factorise(sigma, level):
        P = laplacian.at(sigma)
        factor = splu(P.astype(np.float32))

        def solve(right):
            y = np.zeros_like(right)
            for _ in range(int(level) + 1):
                y += factor.solve((right - P @ y).astype(np.float32))
            return y

        return solve

    return factorise


def _multigrid(laplacian: _Laplacian):
    """Levels are the part of the residual that conjugate gradients leave."""

    def factorise(sigma, level):
        hierarchy = peer("pyamg").smoothed_aggregation_solver(laplacian.at(sigma).tocsr())

        def solve(right):
            columns = [hierarchy.solve(column, tol=level, accel="cg", maxiter=300) for column in right.T]
            return np.stack(columns, axis=1)

        return solve

    return factorise


def _peer_solvers(network: Network) -> list[_LinearSolver]:
    laplacian, small = _Laplacian(network), network.n_vertices <= DENSE
    dense = (
        _LinearSolver("dense Cholesky", "scipy", _dense_cholesky(laplacian)),
        _LinearSolver("pseudo-inverse", "numpy", _pseudo_inverse(network)),
    )
    direct = (
        _LinearSolver("splu", "scipy", _superlu(laplacian)),
        _LinearSolver("splu float32", "scipy", _single_precision(laplacian), (0.0, 1.0, 2.0, 3.0, 4.0)),
    )
    levels = TOLERANCES if network.n_vertices < LARGE else _GOOD
    multigrid = _LinearSolver("pyamg CG", "pyamg", _multigrid(laplacian), levels)
    return [*(dense if small else ()), *(direct if network.n_vertices < HUGE else ()), multigrid]


@dataclass(frozen=True)
class _Problem:
    """One network, one stress, and the exact answers."""

    manifold: CriticalManifold
    sigma: np.ndarray
    L: Extended
    gradient: Extended

    @classmethod
    def of(cls, n_vertices: int, seed: int) -> _Problem:
        manifold = CriticalManifold(voronoi_network(n_vertices, seed))
        sigma = np.abs(stable_rng(seed, "contest", "stress").standard_normal(manifold.network.n_edges))
        sigma *= np.sqrt(len(sigma) / (sigma @ sigma))
        return cls(manifold, sigma, *references.bulk_modulus_gradient(manifold, sigma))

    def accuracy(self, answer) -> Accuracy:
        """Largest relative error of a bond vector; with a gradient, that over its largest component if it is larger."""
        L, gradient, bound = answer
        length = np.linalg.norm(self.L.high, axis=1)
        error = float((np.linalg.norm((L - self.L.high) - self.L.low, axis=1) / length).max())
        if gradient is not None:
            wrong = np.abs((gradient - self.gradient.high) - self.gradient.low)
            error = float(wrong.max() / np.abs(self.gradient.high).max())
        return Accuracy(error, bound=bound)


def _methods(n_vertices: int, seed: int, gradient: bool) -> list[Method]:
    problem = _Problem.of(n_vertices, seed)
    network, sigma = problem.manifold.network, problem.sigma
    divergence, g, b = network.divergence, network.free_incidence, network.boundary_vectors
    goal = transition_modulus(network, dilation(network.dimension))

    def peer_run(solver: _LinearSolver):
        def run(level):
            solve = solver.factorise(sigma, level)
            L = b - g @ solve(divergence @ (sigma[:, None] * b))
            if not gradient:
                return L, None, np.nan
            _, (by_sigma, by_L) = goal.evaluate(sigma, L)
            return L, by_sigma - np.einsum("ad,ad->a", L, g @ solve(divergence @ by_L)), np.nan

        return run

    def own_run(manifold: CriticalManifold):
        def run(level):
            balance = manifold.balance(sigma)
            L = balance.bond_vectors
            if not gradient:
                return L, None, np.nan
            _, partials = goal.evaluate(sigma, L)
            return L, balance.pull_back(*partials)[0], np.nan

        return run

    def solved(level):
        solution = problem.manifold.solve(sigma)
        return solution.value.bond_vectors, None, float("nan")

    own = [Method("auto", own_run(problem.manifold), problem.accuracy)]
    if not gradient:
        own.append(Method("solve", solved, problem.accuracy))
    huge = n_vertices >= HUGE
    for backend in (name for name in available_backends() if name in _AT_HUGE or not huge):
        run = own_run(CriticalManifold(network, backend=backend))
        own.append(Method(backend, run, problem.accuracy, backend=backend))
    for backend, package in FAST.items():
        if not installed(package):
            own.append(Method(backend, own_run(problem.manifold), problem.accuracy, package=package))
    peers = [
        Method(m.name, peer_run(m), problem.accuracy, m.levels, m.package, m.backend) for m in _peer_solvers(network)
    ]
    return [*own, *peers]


_BACKENDS = ("qdldl", "superlu", *FAST)
_PEERS = ("dense Cholesky", "pseudo-inverse", "splu", "splu float32", "pyamg CG")

TASKS = (
    Task(
        "configuration",
        "σ → configuration",
        "largest relative error of a bond vector",
        (*SIZES, HUGE),
        ("auto", "solve", *_BACKENDS, *_PEERS),
        "auto",
        partial(_methods, gradient=False),
    ),
    Task(
        "gradient",
        "σ → configuration with a gradient",
        "largest error of a component of dB₀/dσ over the largest component",
        SIZES,
        ("auto", *_BACKENDS, *_PEERS),
        "auto",
        partial(_methods, gradient=True),
    ),
)
