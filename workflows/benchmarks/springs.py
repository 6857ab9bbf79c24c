"""The critical configuration of a random stress, and its springs past the transition with their exact equilibrium."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from critflow import CriticalManifold, equilibrium, spring_state, voronoi_network
from critflow.double_double import extended
from critflow.engine import stable_rng
from critflow.sparse import Factor, block_laplacian
from critflow.springs import SpringState

from . import references


@dataclass(frozen=True, eq=False)
class StrainedSprings:
    """Springs strained affinely from their critical configuration, and their equilibrium.

    gamma    the strain, V = V(0)(1 + γ)
    start    the affinely strained state
    relaxed  its equilibrium in working precision
    exact    the equilibrium in double-double arithmetic, and the factor of its Hessian
    """

    gamma: float
    start: SpringState
    relaxed: SpringState
    exact: tuple[references.Springs, Factor]

    @classmethod
    def of(cls, n_vertices: int, seed: int, gamma: float) -> StrainedSprings:
        manifold = CriticalManifold(voronoi_network(n_vertices, seed))
        rng = stable_rng(seed, "contest", "stress")
        critical = manifold.configuration(np.abs(rng.standard_normal(manifold.network.n_edges)))
        F = np.sqrt(1 + gamma) * np.eye(2)
        start = spring_state(manifold.network.deformed(F), critical.lengths, critical.coordinates @ F.T)
        relaxed = equilibrium(start).value
        near = relaxed.coordinates[start.network.free]
        exact = references.equilibrium(start.network, extended(critical.lengths), near, start.pattern)
        return cls(gamma, start, relaxed, exact)

    @property
    def unit(self) -> float:
        """Mean length of the edges at the start."""
        return self.start.length_scale

    @property
    def softest(self) -> float:
        """Force that moves a mode of the stiffness γk, along which lengths stay, by γ times the mean length."""
        return self.gamma**2 * self.start.stiffness_scale * self.unit


def prepared(state: SpringState) -> SpringState:
    """A state with nothing computed from it or its network but the pattern of its Hessian."""
    network = replace(state.network)
    network.matrices["auto"] = block_laplacian(network)
    return replace(state, network=network)
