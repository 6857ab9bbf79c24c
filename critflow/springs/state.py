"""Springs past the transition: their energy, forces and Hessian in a configuration.

Any energy E of the lengths has σ = ∂E/∂h, K = ∂²E/∂h² with h = |L|²/2, and the Hessian R^hᵀ K R^h + P(σ) ⊗ 1
(`GenericHessian`).  Springs of one law each have a diagonal K: σ_α = E'/|L| and K_α = (E'' − σ_α)/|L_α|²
(`ForceDensity`, `ModifiedStiffness`); Hookean ones E = ½ Σ k(|L| − ℓ)² (`HookeanEnergy`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from functools import cache, cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import checked
from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.matrices import block_laplacian, edge_blocks
from critflow.linalg.products import product
from critflow.linalg.tolerances import EPS
from critflow.linalg.vectors import norms
from critflow.networks.checks import edge_values
from critflow.networks.network import Array, Network, validated_coordinates
from critflow.precision.double_double import Extended, difference_of_squares
from critflow.precision.residual import Displacement, exact_displacement
from critflow.result import InputError, Record
from critflow.springs.laws import HOOKEAN, SpringLaw, checked_law

# Where every stress σ is larger, in units of k, the Hessian is at least that multiple of the Laplacian of the network,
# and its pivots are not examined.
TAUT = 1e-7
# Cached values that do not depend on the configuration.
_MEANS = ("length_scale", "mean_stiffness")


class ElasticState(Record, ABC):
    """A configuration with an energy that depends on lengths alone: coordinates x (N_v, d), bond vectors L (N_b, d).

    L is stored in addition to x: it has a relative rounding, while differences of coordinates have the rounding of the
    box size, which near the transition exceeds the extensions that cause the forces.
    """

    network: Network
    coordinates: Array
    bond_vectors: Array
    # Whether an edge may shrink to zero length, because no energy resists a change of its length alone.
    edges_may_collapse: ClassVar[bool] = False

    @property
    @abstractmethod
    def energy(self) -> float:
        """E; infinite where an edge is longer than it can be."""

    @property
    @abstractmethod
    def sigma(self) -> Array:
        """Geometric stress σ = ∂E/∂h, (N_b,), not normalised."""

    @property
    @abstractmethod
    def edge_stiffness(self) -> Array:
        """Stiffnesses (N_b,) that bound the resistance of the edges to a change of |L|."""

    @property
    @abstractmethod
    def stiffness_scale(self) -> float:
        """Mean stiffness times the largest factor of stiffening of an edge; times a length, the unit of force."""

    @property
    @abstractmethod
    def length_scale(self) -> float:
        """Mean length at rest."""

    @property
    @abstractmethod
    def stress_rounding(self) -> Array:
        """Rounding error of σ, (N_b,), a difference of lengths and bond vectors that are rounded."""

    @abstractmethod
    def exact_stress(self, bond_vectors: Extended) -> Array:
        """σ (N_b,) of other bond vectors (N_b, d), accurate to the rounding of σ itself."""

    @abstractmethod
    def resistance(self, hdot: Array) -> Array:
        """K ḣ for changes ḣ of h, both (m, N_b)."""

    @abstractmethod
    def pattern(self) -> FixedPattern:
        """The pattern of the Hessian, of this state and all others of the same graph."""

    @abstractmethod
    def factorize(self, pattern: FixedPattern, shift: float = 0.0) -> Factor:
        """Factorise H + shift·1."""

    @abstractmethod
    def factorize_convex(self, pattern: FixedPattern, shift: float) -> Factor:
        """Factorise the convex part of H, without the geometric softening of compressed edges, plus shift·1."""

    @cached_property
    def lengths(self) -> Array:
        """|L|, (N_b,)."""
        return norms(self.bond_vectors)

    @cached_property
    def forces(self) -> Array:
        """Unbalanced forces −∂E/∂x on the free vertices, (n_free, d) (`Equilibrium`, `ForceBalance`)."""
        return -product(self.network.divergence, self.sigma[:, None] * self.bond_vectors)

    @property
    def max_force(self) -> float:
        """Largest component of the unbalanced forces, in units of k times length."""
        return float(np.abs(self.forces).max(initial=0.0))

    @property
    def largest_stiffness(self) -> float:
        """A bound on the largest eigenvalue of the Hessian where edges are not much compressed."""
        at_vertex = np.bincount(self.network.edges.ravel(), np.repeat(self.edge_stiffness, 2))
        return 2 * float(at_vertex.max())

    @property
    def taut(self) -> bool:
        """Whether the Hessian is certainly positive definite: it is not less than P(σ), of a connected network."""
        return bool(self.sigma.min() > TAUT * self.stiffness_scale and self.edge_stiffness.min() >= 0)

    def edge_rates(self, motion: Array) -> Array:
        """Changes (N_b, d) of the bond vectors by a motion, of as many components as `forces`."""
        return product(self.network.free_incidence, motion.reshape(-1, self.network.dimension))

    def force_rates(self, rates: Array) -> Array:
        """−gᵀ(K ḣ L + σ L̇), (n_free, d): changes of the forces by changes L̇ (N_b, d) of the bond vectors."""
        L = self.bond_vectors
        tension = self.resistance(np.einsum("ad,ad->a", L, rates))
        return -product(self.network.divergence, tension[:, None] * L + self.sigma[:, None] * rates)

    def exact_displacement(self, factor: Factor, regularised: bool = False) -> Displacement:
        """The displacement to the exact equilibrium, by a factor of the Hessian at or near this state.

        regularised  whether the factor has a shift that resists floppy modes
        """

        def solve(forces: Array) -> Array:
            return factor.solve(forces.ravel()).reshape(forces.shape)

        return exact_displacement(self.network, self.coordinates, self.exact_stress, solve, regularised)

    def moved(self: State, displacement: Array) -> State:
        """The state after displacing the free vertices by u (n_free, d)."""
        x = self.coordinates.copy()
        x[self.network.free_rows] += displacement
        return self.placed(x, self.bond_vectors + product(self.network.free_incidence, displacement))

    def deformed(self: State, gradient: Array) -> State:
        """The state after the affine deformation F of boundary and vertices, with the same springs."""
        return self.deformed_to(self.network.deformed(gradient), gradient)

    def deformed_to(self: State, network: Network, gradient: Array) -> State:
        """As `deformed`, in a network that has the deformed boundary: many steps accumulate rounding in the cell."""
        return self.placed(self.coordinates @ gradient.T, self.bond_vectors @ gradient.T, network)

    def placed(self: State, coordinates: Array, bond_vectors: Array, network: Network | None = None) -> State:
        """The same springs elsewhere: as `replace`, which takes longer, with the cached means of the springs."""
        there, here = object.__new__(type(self)), self.__dict__
        there.__dict__.update((name, here[name]) for name in (*_names(type(self)), *_MEANS) if name in here)
        there.__dict__.update(coordinates=coordinates, bond_vectors=bond_vectors, network=network or self.network)
        return there


State = TypeVar("State", bound=ElasticState)


@cache
def _names(kind: type[Any]) -> tuple[str, ...]:
    """Names of the fields of a class of states."""
    return tuple(field.name for field in fields(kind))


@dataclass(frozen=True, eq=False)
class SpringState(ElasticState):
    """Springs in a configuration: rest lengths ℓ (N_b,), coordinates x (N_v, d), bond vectors L (N_b, d), their law."""

    network: Network
    rest_lengths: Array
    coordinates: Array
    bond_vectors: Array
    law: SpringLaw = HOOKEAN

    @cached_property
    def extension(self) -> Array:
        """|L| − ℓ, (N_b,)."""
        return self.lengths - self.rest_lengths

    @cached_property
    def energy(self) -> float:
        """E, the sum over the springs (`EnergyConstraints`), in units of k times length squared."""
        return float(np.sum(self.law.energy(self.extension, self.rest_lengths, self.network.stiffness)))

    @cached_property
    def sigma(self) -> Array:
        """Geometric stress σ = ∂E/∂h = E'/|L|, (N_b,), not normalised."""
        return self.law.tension(self.extension, self.rest_lengths, self.network.stiffness) / self.lengths

    @property
    def edge_stiffness(self) -> Array:
        """E'', (N_b,)."""
        return self.law.stiffness(self.extension, self.rest_lengths, self.network.stiffness)

    @cached_property
    def modified_stiffness(self) -> Array:
        """K = ∂²E/∂h² = (E'' − σ)/|L|², (N_b,)."""
        return (self.edge_stiffness - self.sigma) / self.lengths**2

    @property
    def stiffness_scale(self) -> float:
        k, now = self.network.stiffness, self.edge_stiffness
        # The forces of stiffened edges have larger rounding errors.
        return self.mean_stiffness * (1.0 if now is k else max(1.0, float(np.max(now / k))))

    @cached_property
    def mean_stiffness(self) -> float:
        """⟨k⟩."""
        return float(self.network.stiffness.mean())

    @cached_property
    def length_scale(self) -> float:
        return float(self.rest_lengths.mean())

    @property
    def stress_rounding(self) -> Array:
        return EPS * self.edge_stiffness

    def exact_stress(self, bond_vectors: Extended) -> Array:
        rest = self.rest_lengths
        length = norms(bond_vectors.high)
        extension = difference_of_squares(bond_vectors, rest) / (length + rest)
        return self.law.tension(extension, rest, self.network.stiffness) / length

    def resistance(self, hdot: Array) -> Array:
        return self.modified_stiffness * hdot

    def pattern(self) -> FixedPattern:
        return block_laplacian(self.network)

    def factorize(self, pattern: FixedPattern, shift: float = 0.0) -> Factor:
        return pattern.factorize(edge_blocks(self.modified_stiffness, self.bond_vectors, self.sigma), shift)

    def factorize_convex(self, pattern: FixedPattern, shift: float) -> Factor:
        axial, isotropic = self.convex_parts()
        return pattern.factorize(edge_blocks(axial, self.bond_vectors, isotropic), shift)

    def convex_parts(self) -> tuple[Array, Array]:
        """(N_b,) each: c and t of the convex part c L Lᵀ + t 1 = E'' n nᵀ + max(σ, 0)(1 − n nᵀ) of every edge.

        The softening by compressed edges, σ < 0, is left out.
        """
        tension = np.maximum(self.sigma, 0.0)
        return (np.maximum(self.edge_stiffness, 0.0) - tension) / self.lengths**2, tension


@checked
def spring_state(
    network: Network, rest_lengths: ArrayLike, coordinates: ArrayLike, law: SpringLaw = HOOKEAN
) -> SpringState:
    """Springs of positive rest lengths ℓ (N_b,) at coordinates (N_v, d).  Raises `NetworkError` or `InputError`.

    >>> import critflow as cf
    >>> import numpy as np
    >>> network = cf.lattice("honeycomb", 2, 2)
    >>> state = cf.spring_state(network, np.full(12, 0.9), network.positions)
    >>> round(state.energy, 6)
    0.06
    """
    rest = edge_values(rest_lengths, network.n_edges, "rest_lengths")
    x, L = edge_directions(network, coordinates)
    return SpringState(network, rest, x, L, checked_law(law, rest, network.stiffness))


def edge_directions(network: Network, coordinates: ArrayLike) -> tuple[Array, Array]:
    """Validated coordinates (N_v, d) and bond vectors (N_b, d); `InputError` where an edge has no length."""
    x = validated_coordinates(network, coordinates)
    L = network.bond_vectors(x)
    length = np.linalg.norm(L, axis=1)
    if not length.min() > 0:
        edge = int(length.argmin())
        raise InputError(f"edge {edge} has no length, so its spring has no direction: move its ends apart")
    return x, L
