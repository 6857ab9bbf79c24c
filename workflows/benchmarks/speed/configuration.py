"""Task σ → configuration: one factorisation and two right sides, the step of every optimisation.

The graph is known, so that patterns, ordering and symbolic factorisation are prepared; the stress is new in every run,
so that assembly and numerical factorisation are timed.  Multigrid cannot keep its hierarchy for another matrix.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from critflow import CriticalManifold, Network, voronoi_network
from critflow.double_double import Extended
from critflow.engine import stable_rng

from .. import references
from ..timing import TALLY, Answer, Method, Run, Task, peer

SIZES = (100, 1_000, 10_000, 100_000, 1_000_000)
# Dense matrices beyond are out of the question.
DENSE = 2_000
TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
# Where every run of an iterative method takes seconds it has one level, at which its answer is worth something.
LARGE, _GOOD = 100_000, (1e-10,)

Solve = Callable[[np.ndarray], np.ndarray]
Factorise = Callable[[np.ndarray, float], Solve]


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


# Solvers of P y = r: a network -> factorisation (σ, level) -> function of right sides (n, d)


def _dense_cholesky(network: Network) -> Factorise:
    laplacian = _Laplacian(network)

    def factorise(sigma: np.ndarray, level: float) -> Solve:
        factor = scipy.linalg.cho_factor(laplacian.at(sigma).toarray(), overwrite_a=True, check_finite=False)
        return partial(scipy.linalg.cho_solve, factor, check_finite=False)

    return factorise


def _multigrid(network: Network) -> Factorise:
    """Levels are the part of the residual that conjugate gradients leave."""
    laplacian = _Laplacian(network)

    def factorise(sigma: np.ndarray, level: float) -> Solve:
        hierarchy = peer("pyamg").smoothed_aggregation_solver(laplacian.at(sigma).tocsr())
        count = lambda _: TALLY.update(evaluations=1)  # noqa: E731
        solve = partial(hierarchy.solve, tol=level, accel="cg", maxiter=300, callback=count)
        return lambda right: np.stack([solve(column) for column in right.T], axis=1)

    return factorise


@dataclass(frozen=True, eq=False)
class _Problem:
    """One network, one stress, and the exact bond vectors."""

    network: Network
    sigma: np.ndarray
    L: Extended

    @classmethod
    def of(cls, n_vertices: int, seed: int) -> _Problem:
        network = voronoi_network(n_vertices, seed)
        sigma = np.abs(stable_rng(seed, "contest", "stress").standard_normal(network.n_edges))
        sigma *= np.sqrt(len(sigma) / (sigma @ sigma))
        return cls(network, sigma, references.configuration(CriticalManifold(network), sigma)[1])

    def error(self, L: np.ndarray) -> float:
        """Largest relative error of a bond vector."""
        length = np.linalg.norm(self.L.high, axis=1)
        return float((np.linalg.norm((L - self.L.high) - self.L.low, axis=1) / length).max())

    def by_manifold(self) -> Run:
        """The balance of critflow."""
        manifold = CriticalManifold(replace(self.network))
        return lambda level: Answer(manifold.balance(self.sigma).bond_vectors)

    def by_solver(self, solver: Callable[[Network], Factorise]) -> Run:
        """The same equations with another linear solver."""
        network, sigma = replace(self.network), self.sigma
        factorise = solver(network)
        divergence, g, b = network.divergence, network.free_incidence, network.boundary_vectors

        def run(level: float) -> Answer:
            TALLY.update(factorisations=1, solves=1)
            return Answer(b - g @ factorise(sigma, level)(divergence @ (sigma[:, None] * b)))

        return run


def _methods(n_vertices: int, seed: int, gamma: float) -> list[Method]:
    problem = _Problem.of(n_vertices, seed)
    methods, other = [Method("auto", problem.by_manifold, problem.error)], problem.by_solver
    if n_vertices <= DENSE:
        methods.append(Method("SciPy dense Cholesky", partial(other, _dense_cholesky), problem.error, package="scipy"))
    levels = TOLERANCES if n_vertices < LARGE else _GOOD
    return [*methods, Method("pyamg CG", partial(other, _multigrid), problem.error, levels, "pyamg")]


TASKS = (
    Task(
        "configuration",
        "σ → configuration",
        "largest relative error of a bond vector",
        SIZES,
        ("auto", "SciPy dense Cholesky", "pyamg CG"),
        "auto",
        _methods,
    ),
)
