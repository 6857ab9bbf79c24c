"""Springs past the transition: their laws, and their energy, forces and Hessian in a configuration.

Every law has zero tension and E'' = k at |L| = ℓ, so that all laws share the critical configurations and the moduli at
the transition; they differ past it, from C_B and C_G on.  Near the transition the extension e is tiny, so laws are
functions of e itself, without cancellation.

Any energy E of the lengths has σ = ∂E/∂h, K = ∂²E/∂h² with h = |L|²/2, and the Hessian R^hᵀ K R^h + P(σ) ⊗ 1
(`GenericHessian`).  Springs of one law on the edges have a diagonal K: σ_α = E'/|L| and K_α = (E'' − σ_α)/|L_α|²
(`ForceDensity`, `ModifiedStiffness`); Hookean ones E = ½ Σ k(|L| − ℓ)² (`HookeanEnergy`).  Springs on sums of lengths
are a subclass, which overrides the methods of springs and of edges: they are where the two differ.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, TypeAlias, TypeVar

import numpy as np
import scipy
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import edge_values, of_kind, shown
from critflow.double_double import Extended, less_squares, two_square
from critflow.networks import Array, Network, validated_coordinates
from critflow.numerics import EPS, dot, largest, mean, norms, product, read_only, restore_read_only, set_read_only
from critflow.refinement import Displacement, exact_displacement
from critflow.result import InputError, Record
from critflow.sparse import Factor, FixedPattern, block_laplacian, edge_blocks

# Spring laws: the energy of one spring as a function of its extension e = |L| − ℓ

LAW_AT_REST = 1e-12  # energy and tension that a law may have at rest: rounding of its formula
LAW_STIFFNESS_AT_REST = 1e-9  # relative deviation of E'' from k at rest
# Relative deviation of a function of a law from the fourth-order difference of the previous one, with steps of a
# fiftieth of the reach of the law, which is accurate to 1e-7.
LAW_CONSISTENCY = 1e-4


class SpringLaw(ABC):
    """Energy, tension E', stiffness E'' and E''' of springs of extensions e, rest lengths ℓ and stiffnesses k.

    All arguments and results are arrays (N_b,).  Beyond the longest extension of a law the energy is infinite.  A new
    law is a subclass with these four methods.

    convex  E'' ≥ 0 for all e ≥ 0: an equilibrium without compressed springs is then the global minimum of the energy,
            and `strain_path` need not check that it stays on its branch.  False is correct for every law
    """

    convex: ClassVar[bool] = False
    # Whether the energy is zero below the rest length: every equilibrium of a convex law is then the global minimum.
    one_sided: ClassVar[bool] = False

    @abstractmethod
    def energy(self, extension: Array, rest: Array, k: Array) -> Array:
        """E, zero at rest."""

    @abstractmethod
    def tension(self, extension: Array, rest: Array, k: Array) -> Array:
        """E' = dE/d|L|, zero at rest."""

    @abstractmethod
    def stiffness(self, extension: Array, rest: Array, k: Array) -> Array:
        """E'', k at rest."""

    @abstractmethod
    def stiffening(self, extension: Array, rest: Array, k: Array) -> Array:
        """E'''."""


@dataclass(frozen=True)
class Hookean(SpringLaw):
    """E = ½ k e² (`HookeanEnergy`)."""

    convex: ClassVar[bool] = True

    def energy(self, extension: Array, rest: Array, k: Array) -> Array:
        return 0.5 * k * extension**2

    def tension(self, extension: Array, rest: Array, k: Array) -> Array:
        return k * extension

    def stiffness(self, extension: Array, rest: Array, k: Array) -> Array:
        return k

    def stiffening(self, extension: Array, rest: Array, k: Array) -> Array:
        return np.zeros_like(k)


class Cable(Hookean):
    """E = ½ k e² for e > 0, else zero: a cable.  Convex, so every equilibrium is a global minimum; E'' = k at rest."""

    one_sided: ClassVar[bool] = True

    def energy(self, extension: Array, rest: Array, k: Array) -> Array:
        return 0.5 * k * np.maximum(extension, 0.0) ** 2

    def tension(self, extension: Array, rest: Array, k: Array) -> Array:
        return k * np.maximum(extension, 0.0)

    def stiffness(self, extension: Array, rest: Array, k: Array) -> Array:
        return np.where(extension >= 0, k, 0.0)


HOOKEAN = Hookean()

# Extensions, in units of ℓ, at which the derivatives and the convexity of a law are checked.
_REACHES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
_STRETCHES = (1e-3, 1e-2, 0.1, 0.3, 1.0, 3.0)


def checked_law(law: SpringLaw, rest: Array, k: Array) -> SpringLaw:
    """The law itself if it is consistent for springs ℓ, k (N_b,), else an `InputError`.

    At rest it has zero energy, zero tension and the stiffness k; each of its functions is the derivative of the
    previous one at a few extensions; a law with `convex = True` has no negative E'' at a few stretched lengths.
    """
    if not isinstance(law, SpringLaw):
        raise InputError(f"law must be a SpringLaw such as Hookean() or PowerLaw(4), not {shown(law)}")
    # Tests have the formulas of the laws of this package.
    if type(law).__module__.startswith(f"{__package__}."):
        return law
    name, functions = type(law).__name__, (law.energy, law.tension, law.stiffness, law.stiffening)
    nothing = np.zeros_like(rest)
    energy, tension, stiffness = (f(nothing, rest, k) for f in functions[:3])
    if not (np.abs(energy) <= LAW_AT_REST * k * rest**2).all() or not (np.abs(tension) <= LAW_AT_REST * k * rest).all():
        raise InputError(f"the law {name} must have no energy and no tension at rest: subtract its values at e = 0")
    if not (np.abs(stiffness - k) <= LAW_STIFFNESS_AT_REST * k).all():
        found = float(np.ravel(stiffness / k)[0])
        advice = "scale it" if found > 0 else "give an energy with a minimum at rest"
        raise InputError(f"the law {name} has {found:.3g} k as its stiffness at rest where E'' must be k: {advice}")
    # Far inside the largest extension of the law.
    reach = next((r for r in _REACHES if np.isfinite(law.energy(r * rest, rest, k)).all()), _REACHES[-1]) * rest
    for order, (function, derivative) in enumerate(pairwise(functions), 1):
        for e in (-0.2 * reach, nothing, 0.2 * reach):
            value, size = derivative(e, rest, k), k * reach ** (2 - order)
            error = np.abs(value - _difference(function, e, rest, k, 0.02 * reach))
            if not (error <= LAW_CONSISTENCY * np.maximum(size, np.abs(value))).all():
                raise InputError(
                    f"the law {name} is not consistent: its {derivative.__name__} is not the derivative of its "
                    f"{function.__name__} at small extensions"
                )
    for stretch in _STRETCHES if law.convex else ():
        reached = np.isfinite(law.energy(stretch * rest, rest, k))
        if (law.stiffness(stretch * rest, rest, k)[reached] < 0).any():
            raise InputError(
                f"the law {name} has a negative stiffness at an extension of {stretch:g} ℓ, so it is not convex: "
                "remove its `convex = True`"
            )
    return law


def _difference(function: Callable[[Array, Array, Array], Array], e: Array, rest: Array, k: Array, h: Array) -> Array:
    """The derivative by the extension as a central difference of fourth order."""
    ends = [function(e + n * h, rest, k) for n in (-2, -1, 1, 2)]
    return (8 * (ends[2] - ends[1]) - (ends[3] - ends[0])) / (12 * h)


@dataclass(frozen=True)
class PowerLaw(SpringLaw):
    """E'' = k (|L|/ℓ)^{n−2} with the exponent n ≥ 2 of the length in the energy; n = 2 is Hookean."""

    exponent: float
    convex: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not (isinstance(self.exponent, int | float | np.number) and 2 <= self.exponent < np.inf):
            raise InputError(f"the exponent of a power law must be at least 2 and finite, not {shown(self.exponent)}")

    def energy(self, extension: Array, rest: Array, k: Array) -> Array:
        # kℓ²/(n − 1)·((λⁿ − 1)/n − (λ − 1)), λ = |L|/ℓ, without the difference: k e² ∫ (1 − s)(1 + s e/ℓ)^{n−2} ds.
        return 0.5 * k * extension**2 * scipy.special.hyp2f1(2 - self.exponent, 1, 3, -extension / rest)

    def tension(self, extension: Array, rest: Array, k: Array) -> Array:
        power = self.exponent - 1
        return k * rest / power * np.expm1(power * np.log1p(extension / rest))

    def stiffness(self, extension: Array, rest: Array, k: Array) -> Array:
        return k * (1 + extension / rest) ** (self.exponent - 2)

    def stiffening(self, extension: Array, rest: Array, k: Array) -> Array:
        return k / rest * (self.exponent - 2) * (1 + extension / rest) ** (self.exponent - 3)


@dataclass(frozen=True)
class WormLike(SpringLaw):
    """The law of Marko and Siggia (1995), E' = ⅔ k m ℓ (¼(1 − u)⁻² − ¼ + u): no spring exceeds (1 + m)ℓ, u = e/(mℓ).

    The slack m > 0 is the largest extension in units of the rest length; the tension diverges there as (1 − u)⁻².
    """

    slack: float
    convex: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not (isinstance(self.slack, int | float | np.number) and 0 < self.slack < np.inf):
            raise InputError(f"the slack of a worm-like law must be positive and finite, not {shown(self.slack)}")

    def energy(self, extension: Array, rest: Array, k: Array) -> Array:
        with np.errstate(divide="ignore"):
            return k * extension**2 * (1 + 0.5 / self._left(extension, rest)) / 3

    def tension(self, extension: Array, rest: Array, k: Array) -> Array:
        left = self._left(extension, rest)
        with np.errstate(divide="ignore"):
            return 2 / 3 * k * extension * (1 + 0.25 * (1 + left) / left**2)

    def stiffness(self, extension: Array, rest: Array, k: Array) -> Array:
        with np.errstate(divide="ignore"):
            return 2 / 3 * k * (1 + 0.5 / self._left(extension, rest) ** 3)

    def stiffening(self, extension: Array, rest: Array, k: Array) -> Array:
        with np.errstate(divide="ignore"):
            return k / (self.slack * rest) / self._left(extension, rest) ** 4

    def _left(self, extension: Array, rest: Array) -> Array:
        """1 − u, the remaining part of the largest extension; zero beyond it."""
        return np.maximum(1 - extension / (self.slack * rest), 0.0)


# Where every stress σ is larger, in units of k, the Hessian is at least that multiple of the Laplacian of the network,
# and its pivots are not examined.
TAUT = 1e-7

EdgeMatrix: TypeAlias = Array | sp.coo_array
"""A symmetric matrix over edges: its diagonal (N_b,), or all of it (N_b, N_b) sparse."""


@dataclass(frozen=True, eq=False, repr=False)
class SpringState(Record):
    """Springs in a configuration: rest lengths ℓ (N_b,), coordinates x (N_v, d), bond vectors L (N_b, d), their law.

    L is stored in addition to x: it has a relative rounding, while differences of coordinates have the rounding of the
    box size, which near the transition exceeds the extensions that cause the forces.

    backend  sparse solver of the Hessian (`critflow.sparse`)
    """

    network: Network
    rest_lengths: Array
    coordinates: Array
    bond_vectors: Array
    law: SpringLaw = HOOKEAN
    backend: str = field(default="auto", kw_only=True, repr=False)

    def __post_init__(self) -> None:
        set_read_only(self, "rest_lengths", "coordinates", "bond_vectors")

    __setstate__ = restore_read_only

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
        return read_only(self.edge_tension(self.tension) / self.lengths)

    def edge_tension(self, tension: Array) -> Array:
        """τ (N_b,) of tensions of the springs."""
        return tension

    @property
    def edge_stiffness(self) -> Array:
        """Stiffnesses (N_b,) that limit the resistance of the edges to a change of |L|: E''."""
        return self.spring_stiffness

    @cached_property
    def modified_stiffness(self) -> EdgeMatrix:
        """K = ∂²E/∂h∂h, (E'' − σ)/|L|²."""
        return read_only((self.edge_stiffness - self.sigma) / self.lengths**2)

    def convex_parts(self) -> tuple[EdgeMatrix, Array]:
        """K and σ without the geometric softening of compressed edges, σ < 0, and without negative E''."""
        tension = np.maximum(self.sigma, 0.0)
        return (np.maximum(self.edge_stiffness, 0.0) - tension) / self.lengths**2, tension

    def resistance(self, hdot: Array) -> Array:
        """K ḣ for changes ḣ of h, both (m, N_b)."""
        return np.asarray(self.modified_stiffness * hdot)

    @property
    def pattern(self) -> FixedPattern:
        """The pattern of the Hessian, of this state and all others of the same graph."""
        patterns = self.network.matrices
        if self.backend not in patterns:
            patterns[self.backend] = block_laplacian(self.network, self.backend)
        return patterns[self.backend]

    def factorize(self, shift: float = 0.0) -> Factor:
        """Factorise H + shift·1."""
        return self.pattern.factorize(self.blocks(self.modified_stiffness, self.sigma), shift)

    def factorize_convex(self, shift: float) -> Factor:
        """Factorise the convex part of H plus shift·1."""
        return self.pattern.factorize(self.blocks(*self.convex_parts()), shift)

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

    def explained(self, failed: Any) -> Any:
        """A relaxation (`Equilibrium`) that failed at this state, with the reason if the state shows one."""
        return failed

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
    require_directions(~(norms(L) > 0), "move its ends apart")
    return x, L


def require_directions(short: NDArray[np.bool_], instead: str) -> None:
    """`InputError` where an edge of these (N_b,) has no length."""
    if short.any():
        raise InputError(f"edge {int(short.argmax())} has no length, so its spring has no direction: {instead}")
