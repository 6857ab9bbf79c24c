"""Springs past the transition: their energy, forces and Hessian in a configuration.

Any energy E of the lengths has σ = ∂E/∂h, K = ∂²E/∂h² with h = |L|²/2, and the Hessian R^hᵀ K R^h + P(σ) ⊗ 1
(`GenericHessian`).  Springs of one law on the edges have a diagonal K: σ_α = E'/|L| and K_α = (E'' − σ_α)/|L_α|²
(`ForceDensity`, `ModifiedStiffness`); Hookean ones E = ½ Σ k(|L| − ℓ)² (`HookeanEnergy`).  Springs on sums of lengths
are a subclass, which overrides the methods of springs and of edges: they are where the two differ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias, TypeVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from critflow.arguments import of_kind
from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.matrices import block_laplacian, edge_blocks
from critflow.linalg.tolerances import EPS
from critflow.linalg.vectors import dot, largest, mean, norms, product, read_only, restore_read_only, set_read_only
from critflow.networks.checks import edge_values
from critflow.networks.network import Array, Network, validated_coordinates
from critflow.precision.double_double import Extended, less_squares, two_square
from critflow.precision.residual import Displacement, exact_displacement
from critflow.result import InputError, Record
from critflow.springs.laws import HOOKEAN, SpringLaw, checked_law

# Where every stress σ is larger, in units of k, the Hessian is at least that multiple of the Laplacian of the network,
# and its pivots are not examined.
TAUT = 1e-7

EdgeMatrix: TypeAlias = Array | sp.coo_array
"""A symmetric matrix over edges: its diagonal (N_b,), or all of it (N_b, N_b) sparse."""


def times(matrix: EdgeMatrix, values: Array) -> Array:
    """The product of a matrix over edges with values (..., N_b)."""
    return matrix * values if isinstance(matrix, np.ndarray) else np.asarray((matrix @ values.T).T)


@dataclass(frozen=True, eq=False, repr=False)
class SpringState(Record):
    """Springs in a configuration: rest lengths ℓ (N_b,), coordinates x (N_v, d), bond vectors L (N_b, d), their law.

    L is stored in addition to x: it has a relative rounding, while differences of coordinates have the rounding of the
    box size, which near the transition exceeds the extensions that cause the forces.
    """

    network: Network
    rest_lengths: Array
    coordinates: Array
    bond_vectors: Array
    law: SpringLaw = HOOKEAN

    def __post_init__(self) -> None:
        set_read_only(self, "rest_lengths", "coordinates", "bond_vectors")

    def __setstate__(self, state: dict[str, Any]) -> None:
        restore_read_only(self, state)

    # Springs, one for each edge.

    @property
    def stiffness(self) -> Array:
        """k, (N_b,)."""
        return self.network.stiffness

    @cached_property
    def lengths(self) -> Array:
        """|L|, (N_b,)."""
        return read_only(norms(self.bond_vectors))

    @property
    def spring_lengths(self) -> Array:
        """|L|, (N_b,)."""
        return self.lengths

    @cached_property
    def extension(self) -> Array:
        """|L| − ℓ, (N_b,)."""
        return self.spring_lengths - self.rest_lengths

    @property
    def tension(self) -> Array:
        """E', (N_b,)."""
        return self.law.tension(self.extension, self.rest_lengths, self.stiffness)

    @cached_property
    def spring_stiffness(self) -> Array:
        """E'', (N_b,)."""
        return self.law.stiffness(self.extension, self.rest_lengths, self.stiffness)

    @cached_property
    def energy(self) -> float:
        """E, the sum over the springs (`EnergyConstraints`); infinite where one is longer than it can be."""
        return float(np.add.reduce(self.law.energy(self.extension, self.rest_lengths, self.stiffness)))

    # Edges: their stress, and the matrix K that couples them.

    @cached_property
    def sigma(self) -> Array:
        """Geometric stress σ = ∂E/∂h = τ/|L|, (N_b,), not normalised."""
        sigma = self.edge_tension(self.tension) / self.lengths
        sigma.flags.writeable = False
        return sigma

    def edge_tension(self, tension: Array) -> Array:
        """τ (N_b,) of tensions of the springs."""
        return tension

    @property
    def edge_stiffness(self) -> Array:
        """Stiffnesses (N_b,) that limit the resistance of the edges to a change of |L|: E''."""
        return self.spring_stiffness

    @property
    def modified_stiffness(self) -> EdgeMatrix:
        """K = ∂²E/∂h∂h, (E'' − σ)/|L|²."""
        return self.couplings(self.edge_stiffness, self.sigma)

    def convex_parts(self) -> tuple[EdgeMatrix, Array]:
        """K and σ without the geometric softening of compressed edges, σ < 0, and without negative E''."""
        tension = np.maximum(self.sigma, 0.0)
        return self.couplings(np.maximum(self.edge_stiffness, 0.0), tension), tension

    def couplings(self, stiffness: Array, sigma: Array) -> EdgeMatrix:
        """K of E'' (N_b,) and stresses σ (N_b,)."""
        return (stiffness - sigma) / self.lengths**2

    @property
    def axial_stiffness(self) -> EdgeMatrix:
        """∂²E/∂|L|∂|L| = K|L|² + σ, the stiffness of any law."""
        return self.modified_stiffness * self.lengths**2 + self.sigma

    def resistance(self, hdot: Array) -> Array:
        """K ḣ for changes ḣ of h, both (m, N_b)."""
        return times(self.modified_stiffness, hdot)

    def pattern(self) -> FixedPattern:
        """The pattern of the Hessian, of this state and all others of the same graph."""
        return block_laplacian(self.network)

    def factorize(self, pattern: FixedPattern, shift: float = 0.0) -> Factor:
        """Factorise H + shift·1."""
        return pattern.factorize(self.blocks(self.modified_stiffness, self.sigma), shift)

    def factorize_convex(self, pattern: FixedPattern, shift: float) -> Factor:
        """Factorise the convex part of H plus shift·1."""
        return pattern.factorize(self.blocks(*self.convex_parts()), shift)

    def blocks(self, K: EdgeMatrix, sigma: Array) -> Array:
        """Values for the pattern of K L Lᵀ + σ 1."""
        return edge_blocks(K, self.bond_vectors, sigma)

    # Units and roundings.

    @cached_property
    def stiffness_scale(self) -> float:
        """⟨k⟩ times the largest factor of stiffening of a spring; times a length, the unit of force."""
        k, now = self.stiffness, self.spring_stiffness
        # The forces of stiffened springs have larger rounding errors.
        return mean(k) * (1.0 if now is k else max(1.0, float(np.max(now / k))))

    @cached_property
    def length_scale(self) -> float:
        """Mean length at rest."""
        return mean(self.rest_lengths)

    @property
    def stress_rounding(self) -> Array:
        """Rounding error of σ, (N_b,), a difference of lengths and bond vectors that are rounded."""
        return EPS * self.edge_stiffness

    def exact_stress(self, bond_vectors: Extended) -> Array:
        """σ (N_b,) of other bond vectors (N_b, d), accurate to the rounding of σ itself."""
        rest, length = self.rest_lengths, norms(bond_vectors.high)
        extension = less_squares(bond_vectors, two_square(rest)) / (length + rest)
        return self.law.tension(extension, rest, self.stiffness) / length

    @cached_property
    def forces(self) -> Array:
        """Unbalanced forces −∂E/∂x on the free vertices, (n_free, d) (`Equilibrium`, `ForceBalance`)."""
        return -product(self.network.divergence, self.sigma[:, None] * self.bond_vectors)

    @cached_property
    def max_force(self) -> float:
        """Largest component of the unbalanced forces, in units of k times length."""
        return largest(self.forces)

    @cached_property
    def softens(self) -> bool:
        """Whether some σ or E'' is negative, which may make the Hessian indefinite."""
        return not (np.minimum.reduce(self.sigma) >= 0 and np.minimum.reduce(self.edge_stiffness) >= 0)

    @property
    def largest_stiffness(self) -> float:
        """A bound on the largest eigenvalue of the Hessian where edges are not much compressed."""
        at_vertex = np.bincount(self.network.edges.ravel(), np.repeat(self.edge_stiffness, 2))
        return 2 * float(at_vertex.max())

    def taut(self, least: float = TAUT) -> bool:
        """Whether all σ exceed `least` in units of k: the Hessian is then not below P(σ), of a connected network."""
        return not self.softens and bool(np.minimum.reduce(self.sigma) > least * self.stiffness_scale)

    def collapsing_edge(self) -> int | None:
        """An edge that shrinks to zero length in a relaxation that failed: none, since its spring resists that."""
        return None

    @property
    def unique(self) -> bool:
        """Whether an equilibrium is certainly the global minimum, on the branch formed by all states in tension.

        Replace each spring by a cable of the same law with zero energy below ℓ: the energy is then convex, also in the
        components of the cell, and nowhere above that of the springs.  An equilibrium without compressed springs is its
        minimum, where both energies are equal.
        """
        return self.law.convex and (self.law.one_sided or bool(np.minimum.reduce(self.extension) >= 0))

    def edge_rates(self, motion: Array) -> Array:
        """Changes (N_b, d) of the bond vectors by a motion, of as many components as `forces`."""
        return product(self.network.free_incidence, motion.reshape(-1, self.network.dimension))

    def force_rates(self, rates: Array) -> Array:
        """−gᵀ(K ḣ L + σ L̇), (n_free, d): changes of the forces by changes L̇ (N_b, d) of the bond vectors."""
        L = self.bond_vectors
        tension = self.resistance(dot(L, rates))
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
        return self.placed(*self._displaced(displacement))

    def _displaced(self, displacement: Array) -> tuple[Array, Array]:
        """Coordinates and bond vectors after displacing the free vertices by u (n_free, d)."""
        x = self.coordinates.copy()
        x[self.network.free_rows] += displacement
        return x, self.bond_vectors + product(self.network.free_incidence, displacement)

    def deformed(self: State, gradient: Array) -> State:
        """The state after the affine deformation F of boundary and vertices, with the same springs."""
        return self.deformed_to(self.network.deformed(gradient), gradient)

    def deformed_to(self: State, network: Network, gradient: Array, displacement: Array | None = None) -> State:
        """As `deformed`, in a network that has the deformed boundary: many steps accumulate rounding in the cell.

        displacement  of the free vertices before the deformation, u (n_free, d)
        """
        x, L = (self.coordinates, self.bond_vectors) if displacement is None else self._displaced(displacement)
        return self.placed(x @ gradient.T, L @ gradient.T, network)

    def placed(self: State, coordinates: Array, bond_vectors: Array, network: Network | None = None) -> State:
        """The same springs elsewhere."""
        return replace(self, coordinates=coordinates, bond_vectors=bond_vectors, network=network or self.network)


State = TypeVar("State", bound=SpringState)


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
    network = of_kind(Network, network=network)
    of_kind(np.ndarray, rest_lengths=rest_lengths, coordinates=coordinates)
    of_kind(SpringLaw, law=law)
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
