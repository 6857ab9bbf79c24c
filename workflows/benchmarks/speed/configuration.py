"""Tasks σ → configuration, and with the gradient of B_0: one factorisation and two, or four, right sides.

The step of every optimisation: the graph is known, so that patterns, ordering and symbolic factorisation are prepared;
the stress is new in every run, so that assembly and numerical factorisation are timed.  Multigrid cannot keep its
hierarchy, and SuperLU its ordering, from one matrix to the next.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from critflow import CriticalConfiguration, CriticalManifold, Network, voronoi_network
from critflow.double_double import Extended
from critflow.engine import stable_rng
from critflow.quantities import dilation, transition_modulus
from critflow.sparse import available_backends

from ..timing import Answer, Method, Run, Task, peer
from . import references

SIZES = (100, 1_000, 10_000, 100_000)
# From here on only backends and peers that take no more than some seconds.
HUGE, _AT_HUGE = 1_000_000, ("superlu", "pardiso")
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


def _pseudo_inverse(network: Network) -> Factorise:
    """The paper's formula: the inverse of P of all vertices on all but its null space, moved to the grounded vertex."""
    g, free = network.incidence, network.free
    ground = np.setdiff1d(np.arange(network.n_vertices), free)

    def factorise(sigma: np.ndarray, level: float) -> Solve:
        inverse = np.linalg.pinv((g.T @ sp.diags_array(sigma) @ g).toarray())

        def solve(right: np.ndarray) -> np.ndarray:
            full = np.zeros((network.n_vertices, right.shape[1]))
            full[free], full[ground] = right, -right.sum(axis=0)
            y = inverse @ full
            return y[free] - y[ground]

        return solve

    return factorise


def _multigrid(network: Network) -> Factorise:
    """Levels are the part of the residual that conjugate gradients leave."""
    laplacian = _Laplacian(network)

    def factorise(sigma: np.ndarray, level: float) -> Solve:
        hierarchy = peer("pyamg").smoothed_aggregation_solver(laplacian.at(sigma).tocsr())
        solve = partial(hierarchy.solve, tol=level, accel="cg", maxiter=300)
        return lambda right: np.stack([solve(column) for column in right.T], axis=1)

    return factorise


@dataclass(frozen=True, eq=False)
class _Problem:
    """One network, one stress, and the exact answers."""

    network: Network
    sigma: np.ndarray
    L: Extended
    gradient: Extended

    @classmethod
    def of(cls, n_vertices: int, seed: int) -> _Problem:
        network = voronoi_network(n_vertices, seed)
        sigma = np.abs(stable_rng(seed, "contest", "stress").standard_normal(network.n_edges))
        sigma *= np.sqrt(len(sigma) / (sigma @ sigma))
        return cls(network, sigma, *references.bulk_modulus_gradient(CriticalManifold(network), sigma))

    def error(self, L: np.ndarray) -> float:
        """Largest relative error of a bond vector."""
        length = np.linalg.norm(self.L.high, axis=1)
        return float((np.linalg.norm((L - self.L.high) - self.L.low, axis=1) / length).max())

    def gradient_error(self, gradient: np.ndarray) -> float:
        """Largest error of a component over the largest component."""
        wrong = np.abs((gradient - self.gradient.high) - self.gradient.low)
        return float(wrong.max() / np.abs(self.gradient.high).max())

    def by_manifold(self, gradient: bool, backend: str = "auto") -> Run:
        """The balance of critflow."""
        manifold = CriticalManifold(replace(self.network), backend=backend)
        goal = transition_modulus(manifold.network, dilation(2))

        def run(level: float) -> Answer:
            balance = manifold.balance(self.sigma)
            return Answer(balance.pull_back(*goal.evaluate(balance)[1])[0] if gradient else balance.bond_vectors)

        return run

    def refined(self) -> Run:
        """The configuration with its error bound."""
        manifold = CriticalManifold(replace(self.network))
        return lambda level: Answer(manifold.solve(self.sigma).value.bond_vectors)

    def by_solver(self, gradient: bool, solver: Callable[[Network], Factorise]) -> Run:
        """The same equations with another linear solver."""
        network, sigma = replace(self.network), self.sigma
        factorise, goal = solver(network), transition_modulus(network, dilation(2))
        divergence, g, b = network.divergence, network.free_incidence, network.boundary_vectors

        def run(level: float) -> Answer:
            solve = factorise(sigma, level)
            x = -solve(divergence @ (sigma[:, None] * b))
            L = b + g @ x
            if not gradient:
                return Answer(L)
            _, (by_sigma, by_L) = goal.evaluate(CriticalConfiguration(network, sigma, network.all_coordinates(x), L))
            return Answer(by_sigma - np.einsum("ad,ad->a", L, g @ solve(divergence @ by_L)))

        return run


def _methods(n_vertices: int, seed: int, gradient: bool) -> list[Method]:
    problem, huge = _Problem.of(n_vertices, seed), n_vertices >= HUGE
    error = problem.gradient_error if gradient else problem.error
    own, other = partial(problem.by_manifold, gradient), partial(problem.by_solver, gradient)
    backends = [name for name in available_backends() if name in _BACKENDS and (name in _AT_HUGE or not huge)]
    methods = [Method("auto", own, error)]
    methods += [Method(name, partial(own, name), error, backend=name) for name in backends]
    if not gradient:
        methods.append(Method("solve", problem.refined, error))
    if n_vertices <= DENSE:
        methods += [
            Method("dense Cholesky", partial(other, _dense_cholesky), error, package="scipy"),
            Method("pseudo-inverse", partial(other, _pseudo_inverse), error, package="numpy"),
        ]
    levels = TOLERANCES if n_vertices < LARGE else _GOOD
    return [*methods, Method("pyamg CG", partial(other, _multigrid), error, levels, "pyamg")]


_BACKENDS = ("qdldl", "superlu", "pardiso", "pyamg")
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
