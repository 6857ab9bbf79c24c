"""The network of one case, its matrices as dense arrays, and a critical configuration of random stress."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

import critflow as cf
from critflow.engine import stable_rng

# Singular values below this part of the largest count as zero: rounding leaves 1e-13 of them.
ZERO = 1e-9


@dataclass(frozen=True)
class Sample:
    """One Voronoi network: incidence g (N_b, N_v), boundary b (N_b, 2), and configurations of random stress."""

    n_vertices: int
    seed: int

    @cached_property
    def network(self):
        return cf.voronoi_network(self.n_vertices, self.seed)

    @cached_property
    def manifold(self):
        return cf.CriticalManifold(self.network)

    @cached_property
    def g(self):
        return self.network.incidence.toarray()

    @cached_property
    def critical(self):
        """The configuration of a random positive stress."""
        return self.manifold.configuration(np.abs(self.rng("stress").standard_normal(self.network.n_edges)))

    @cached_property
    def stiffest(self):
        """The configuration of the largest B_0."""
        return cf.optimize(self.manifold, "B_0").value

    @cached_property
    def equal_lengths(self):
        """The configuration of the least V_L."""
        return cf.optimize(self.manifold, "V_L", throw=False).value

    def rng(self, purpose):
        """A generator that depends on the seed of the case and the purpose."""
        return stable_rng(self.seed, "statements", purpose)

    def bond_vectors(self, x):
        """L = g x + b, (N_b, 2)."""
        return self.g @ x + self.network.boundary_vectors

    def generic(self):
        """Coordinates of the network as made, displaced at random by a tenth of an edge."""
        return self.network.positions + 0.1 * self.rng("generic").standard_normal((self.n_vertices, 2))

    def response(self, L):
        """R^h = ∂h/∂x, (N_b, 2 N_v), columns by vertex and component."""
        return (self.g[:, :, None] * L[:, None, :]).reshape(len(L), -1)

    def laplacian(self, sigma):
        """P ⊗ 1, (2 N_v, 2 N_v)."""
        return np.kron(self.g.T @ (sigma[:, None] * self.g), np.eye(2))


def differences(function, x, steps):
    """∂f/∂x (m, n) of f(x) (m,) at x of n numbers, by central differences with a step (n,) of each."""
    columns = []
    for size, step in zip(steps, np.diag(steps), strict=True):
        step = step.reshape(x.shape)
        columns.append((function(x + step) - function(x - step)) / (2 * size))
    return np.stack(columns, axis=1)


def rank(matrix):
    """Number of singular values that are not zero."""
    values = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(values > ZERO * values[0]))


def null_space(matrix):
    """Orthonormal columns that the matrix maps to zero."""
    _, values, right = np.linalg.svd(matrix)
    return right[int(np.sum(values > ZERO * values[0])) :].T


def floppy_motions(sample, L):
    """The zero modes besides translations, orthonormal columns (2 N_v, n)."""
    translations = np.kron(np.ones((sample.n_vertices, 1)), np.eye(2)).T
    return null_space(np.vstack([sample.response(L), translations]))
