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

from critflow import CriticalConfiguration, CriticalManifold, Network, voronoi_network
from critflow.critical.transition import dilation, transition_modulus
from critflow.linalg.backends import available_backends
from critflow.precision.double_double import Extended
from critflow.workflow import stable_rng

from ..timing import Answer, Method, Task, installed, peer
from . import references

SIZES = (100, 1_000, 10_000, 100_000)
# From here on only backends and peers that take no more than some seconds.
HUGE, _AT_HUGE = 1_000_000, ("superlu", "pardiso")
# Dense matrices beyond are out of the question.
DENSE = 2_000
# Backends that require another package.
FAST = {"pardiso": "pypardiso", "pyamg": "pyamg"}
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


@dataclass(frozen=True, eq=False)
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

    def error(self, L: np.ndarray) -> float:
        """Largest relative error of a bond vector."""
        length = np.linalg.norm(self.L.high, axis=1)
        return float((np.linalg.norm((L - self.L.high) - self.L.low, axis=1) / length).max())

    def gradient_error(self, gradient: np.ndarray) -> float:
        """Largest error of a component over the largest component."""
        wrong = np.abs((gradient - self.gradient.high) - self.gradient.low)
        return float(wrong.max() / np.abs(self.gradient.high).max())


def _methods(n_vertices: int, seed: int, gradient: bool) -> list[Method]:
    problem = _Problem.of(n_vertices, seed)
    manifold, sigma, huge = problem.manifold, problem.sigma, n_vertices >= HUGE
    network = manifold.network
    divergence, g, b = network.divergence, network.free_incidence, network.boundary_vectors
    goal = transition_modulus(network, dilation(network.dimension))
    error = problem.gradient_error if gradient else problem.error

    def by_solver(factorise: Callable[[np.ndarray, float], Solve], level: float) -> Answer:
        solve = factorise(sigma, level)
        x = -solve(divergence @ (sigma[:, None] * b))
        L = b + g @ x
        if not gradient:
            return Answer(L)
        _, (by_sigma, by_L) = goal.evaluate(CriticalConfiguration(network, sigma, network.all_coordinates(x), L))
        return Answer(by_sigma - np.einsum("ad,ad->a", L, g @ solve(divergence @ by_L)))

    def by_manifold(manifold: CriticalManifold, level: float) -> Answer:
        balance = manifold.balance(sigma)
        return Answer(balance.pull_back(*goal.evaluate(balance)[1])[0] if gradient else balance.bond_vectors)

    def method(name: str, run: Callable, *arguments: object, **options: object) -> Method:
        return Method(name, partial(run, *arguments), error, **options)

    methods = [method("auto", by_manifold, manifold)]
    for backend in (name for name in available_backends() if name in _AT_HUGE or not huge):
        methods.append(method(backend, by_manifold, CriticalManifold(network, backend=backend), backend=backend))
    for backend, package in FAST.items():
        if not installed(package):
            methods.append(method(backend, by_manifold, manifold, package=package))
    if not gradient:
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
