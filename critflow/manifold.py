"""The critical manifold: every stress σ has one configuration, and derivatives cost one more solve.

Force balance gᵀ(σ ∘ L) = 0 is linear in the coordinates, P x = −gᵀ(σ ∘ b) with the σ-weighted Laplacian P
(`FDM1`, `PrestressMatrix`), one N_v × N_v matrix for all directions.  σ > 0 makes P positive definite; with mixed
signs its inertia separates the sheets of the manifold, and a singular P has no configuration.

`balance` is the plain solve inside every optimisation.  `solve` refines it and bounds its error; where rounding may
have taken all digits it returns a status in place of numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import LinearOperator

from critflow.arguments import edge_values, of_kind
from critflow.checks import check_opened, components
from critflow.double_double import two_product
from critflow.extensions import from_extras, has_extras
from critflow.networks import Array, Network
from critflow.numerics import dot, norms, product, read_only, restore_read_only, set_read_only
from critflow.refinement import ExtendedGeometry, Refinement
from critflow.result import InputError, NetworkError, Record, Solution, Stats, Status, Value
from critflow.saddles import Saddle, positive
from critflow.sparse import Factor, laplacian

# Edges without length: every limit below which a length counts as zero, in units of the mean length but where stated.
# A descent that makes edges shorter and shorter passes these limits in turn (`critflow.descent`).

# The shortest edge of a configuration that is returned in place of an infimum.  Shorter edges lose digits in the
# rounding of the coordinates.  σ > SOUND² and |L| > SOUND are far from all other limits of a descent, and an edge below
# SOUND² is too short to resolve where a descent stalls.
SOUND = 1e-2
# An edge under tension that becomes this short on a descent, while the value decreases, tends to zero: edges of optima
# that are attained are longer.
COLLAPSING = 1e-4
# An edge without direction: rounding of coordinates, 1e-16, leaves half of the digits of a direction here or fewer.
COLLAPSED = 1e-8
# An edge that vanishes by a formula: solutions of linear systems leave this much.
NO_LENGTH = 1e-10
# In units of the cone program: tension over length would overflow.
NO_DIRECTION = 1e-150

# Edges from which systems of stresses and displacements are cheaper condensed than as saddle matrices, for stresses
# that are all positive.
CONDENSED_EDGES = 100_000
# A stress with Σσ² = N_b to this relative accuracy counts as scaled and keeps its digits: the sum of squares is
# rounded by a few EPS.
SCALED = 4e-15


@dataclass(frozen=True, eq=False, repr=False)
class CriticalConfiguration(Record):
    """A network in balance under a stress: σ (N_b,), coordinates x (N_v, d) and bond vectors L (N_b, d).

    σ is the force density (tension per length) with Σσ² = N_b; it is defined up to that scale.

    error_bound  bound on the error of every coordinate, against the exact configuration of σ as stored and of the
                 stress that was given, before its scaling was rounded, for the boundary vectors b as rounded from the
                 cell; NaN if unknown.  A proof for stresses of one sign, else an estimate (`Refinement`)
    bond_errors  (N_b,) bounds on |δL_α| likewise, relative to the length of the edge and not of the cell
    rest_lengths  ℓ (N_b,) of the cables of which it is the onset: |L| on taut edges and more on slack ones.  None where
                  it is made from a stress, without knowledge of slack edges
    maker         the manifold that made it, if one did
    """

    network: Network
    sigma: Array
    coordinates: Array
    bond_vectors: Array
    error_bound: float = np.nan
    bond_errors: Array = field(default=None, repr=False)  # type: ignore[arg-type]
    rest_lengths: Array | None = field(default=None, repr=False)
    maker: CriticalManifold | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if self.bond_errors is None:
            object.__setattr__(self, "bond_errors", np.full(self.network.n_edges, np.nan))
        set_read_only(self, "sigma", "coordinates", "bond_vectors", "bond_errors", "rest_lengths")

    def __getstate__(self) -> dict[str, Any]:
        """The numbers alone: factors of matrices are in the memory of one process."""
        return {one.name: getattr(self, one.name) for one in fields(self) if one.name != "maker"}

    __setstate__ = restore_read_only

    @cached_property
    def lengths(self) -> Array:
        """|L_α|, (N_b,)."""
        return read_only(norms(self.bond_vectors))

    @property
    def collapsed_edges(self) -> NDArray[np.intp]:
        """Edges whose length vanishes, by rounding or to half of its digits: they have no direction."""
        return np.flatnonzero(~(self.lengths > COLLAPSED * self.lengths.mean()))

    @cached_property
    def manifold(self) -> CriticalManifold:
        """The manifold that made the configuration, or one of its network, made at its first use."""
        if self.maker is not None and self.maker.network is self.network:
            return self.maker
        return CriticalManifold(self.network)

    @property
    def tensions(self) -> Array:
        """τ_α = σ_α |L_α|, (N_b,), up to the scale of σ (`ForceDensity`)."""
        return self.sigma * self.lengths

    @cached_property
    def residual(self) -> float:
        """Largest unbalanced force |gᵀ(σ ∘ L)| over the mean tension, or NaN without any (`ForceBalanceLsqr`)."""
        force = product(self.network.divergence, self.sigma[:, None] * self.bond_vectors)
        mean = float(np.abs(self.tensions).mean())
        return float(np.abs(force).max(initial=0.0)) / mean if mean else np.nan


def critical_configuration(network: Network, sigma: Array, coordinates: Array) -> CriticalConfiguration:
    """Join a stress and coordinates that balance, with the scale set to Σσ² = N_b."""
    sigma = sigma * np.sqrt(network.n_edges / np.sum(sigma**2))
    return CriticalConfiguration(network, sigma, coordinates, network.bond_vectors(coordinates))


def require_one_stress_by_count(network: Network) -> None:
    """Raise `InputError` for networks with several self-stresses by their counts, N_s ≥ N_b − d n_free > 1.

    `require_one_stress_by_rank` also finds those that the counts do not show, and needs a configuration.
    """
    certain = network.least_self_stresses
    if certain > 1:
        raise InputError(
            f"this holds for one self-stress and the network has at least {certain}: prune_towards(network, {{'B_0': "
            "'largest'}, cuts=...) cuts edges at the least loss, and design(..., change='stiffness') changes springs "
            "at rest"
        )


@dataclass(frozen=True, eq=False)
class StressedBonds:
    """A stress σ (N_b,) and bond vectors L (N_b, d) of one network: what a quantity sees."""

    manifold: CriticalManifold
    sigma: NDArray[Any]
    bond_vectors: NDArray[Any]

    @property
    def network(self) -> Network:
        return self.manifold.network


@dataclass(frozen=True, eq=False)
class Balance(StressedBonds):
    """A stress, its configuration and the factor of P(σ): all that derivatives at this stress need.

    coordinates  of the free vertices, (n_free, d)
    factor       of P(σ)
    shared       intermediate results that several quantities use, by name
    """

    coordinates: Array
    factor: Factor
    shared: dict[str, Any] = field(default_factory=dict, repr=False)

    def pull_back(self, dO_dsigma: Array, dO_dL: Array) -> tuple[Array, Array]:
        """Total derivative dO/dσ = ∂O/∂σ − L·(g y), y = P⁻¹ gᵀ ∂O/∂L, and g y for reuse (`TotalDeriv`)."""
        gy = self.response(dO_dL)
        return dO_dsigma - dot(self.bond_vectors, gy), gy

    def tangent(self, dsigma: Array) -> Array:
        """Change of the bond vectors along σ̇: L̇ = −g P⁻¹ gᵀ(σ̇ ∘ L) (`SelfStressParamaterization_BondVectorDeriv`)."""
        return -self.response(dsigma[:, None] * self.bond_vectors)

    def pull_back_tangent(self, dL: Array, gy: Array, dsigma: Array, second: tuple[Array, Array]) -> Array:
        """Derivative of `pull_back` along (σ̇, L̇): the exact Hessian-vector product of an objective.

        second  derivatives along (σ̇, L̇) of (∂O/∂σ, ∂O/∂L)
        """
        ddO_dsigma, ddO_dL = second
        dgy = self.response(ddO_dL - dsigma[:, None] * gy)
        return ddO_dsigma - dot(dL, gy) - dot(self.bond_vectors, dgy)

    def response(self, edge_vectors: Array) -> Array:
        """g P⁻¹ gᵀ v for edge vectors v (N_b, d), or several next to each other (N_b, n·d)."""
        return product(self.network.free_incidence, self.factor.solve(product(self.network.divergence, edge_vectors)))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ForceBalance(Solution[Value]):
    """The configuration of a stress.

    negative_pivots  number of negative eigenvalues of P(σ)
    """

    negative_pivots: int


class CriticalManifold:
    """The map σ → configuration of one network, its pull-back and its tangents.

    It also owns the saddle systems and the refinement of the network, made at their first use.  Functions that accept a
    network or a manifold reuse them, and are faster with the manifold from the second call on.

    prestress  the pattern of P
    backend    sparse solver of all matrices (`critflow.sparse`)
    """

    def __init__(self, network: Network, backend: str = "auto"):
        network = of_kind(Network, network=network)
        of_kind(str, backend=backend)
        if network.cell is None:
            check_opened(network.edges, network.offsets, network.pins, network.n_vertices)
        self.network, self.backend = network, backend
        self.prestress = laplacian(network, backend)
        # −gᵀ(σ ∘ b) is linear in σ and only few edges carry b, so it is one thin product, one direction after another.
        loads = [network.divergence @ sp.diags_array(-b, dtype=float) for b in network.boundary_vectors.T]
        self._load = sp.csr_array(sp.vstack(loads, format="csr"))
        self._load.eliminate_zeros()

    def __repr__(self) -> str:
        return f"CriticalManifold({self.network!r})"

    @classmethod
    def of(cls, network: Network | CriticalManifold) -> CriticalManifold:
        """The manifold itself, or that of a network, else an `InputError`."""
        network = of_kind(Network, cls, network=network)
        return network if isinstance(network, CriticalManifold) else cls(network)

    @cached_property
    def saddle(self) -> Saddle:
        """Systems of stresses and displacements."""
        return Saddle(self.network, self.backend)

    @cached_property
    def condensed(self) -> Any:
        """The same systems for σ > 0 without their multipliers, by critflow-extras."""
        return from_extras("CondensedSaddle", "condensed systems", counts=False)(self.network, self.backend)

    def system(self, sigma: Array) -> Any:
        """Systems of stresses and displacements in the form that is the fastest for σ (N_b,)."""
        large = self.network.n_edges >= CONDENSED_EDGES and has_extras()
        return self.condensed if large and positive(sigma) else self.saddle

    @cached_property
    def geometry(self) -> ExtendedGeometry:
        """Bond vectors and forces of the network to 32 digits."""
        return ExtendedGeometry(self.network)

    def configuration(
        self, sigma: ArrayLike, pressures: ArrayLike | None = None, throw: bool = True
    ) -> CriticalConfiguration | Any:
        """The configuration x(σ) in balance under σ (N_b,) of any sign (`SelfStressParamaterization_coords`).

        pressures  in the faces of a planar network, (N_f,): a `PressurisedConfiguration`, of tissues and foams

        Raises `NetworkError` for a σ that is not finite or of another shape, `SolveError` where P(σ) is singular or so
        nearly singular that no digit is certain.
        """
        if pressures is not None:
            return from_extras("pressurised_configuration", "pressures in faces")(self, sigma, pressures, throw)
        return self.solve(sigma, throw).value

    def solve(
        self, stress: ArrayLike, throw: bool = False, balance: Balance | None = None, squares: float | None = None
    ) -> ForceBalance[CriticalConfiguration]:
        """As `configuration`, with status, number of negative pivots, Skeel's condition and bounds on all errors.

        balance  of this stress, where it is known: spares a factorisation if the stress is scaled
        squares  Σσ² of the stress as stored, N_b by default; of a part, that of the whole

        Coordinates are NaN where P is singular (`Status.singular`), and where rounding may have taken every digit
        because P is nearly singular or its entries span too many decades (`Status.ill_conditioned`).
        """
        given = edge_values(stress, self.network.n_edges, "sigma", positive=False)
        if not given.any():
            raise NetworkError("sigma is zero on every edge: give each edge a force density, positive for tension")
        network, status = self.network, Status.ok
        # 1. The stress in its scale, as it is where it has that scale; a nearly singular P would magnify the rounding
        power = int(np.frexp(np.abs(given).max())[1])
        whole, half = np.ldexp(given, -power), np.ldexp(0.5, power)
        scale = np.sqrt((network.n_edges if squares is None else squares) / np.sum(whole**2))
        exact = two_product(whole, 2 * half if abs(0.5 * scale - half) < SCALED * half else scale)
        sigma = exact.high
        # 2. Its balance, refined; no eigenvalue of P is negative without compression
        if balance is None or not np.array_equal(balance.sigma, sigma):
            balance = self.balance(sigma)
        factor, start = balance.factor, balance.coordinates
        del balance, whole  # with the bond vectors, 60 MB at 10⁶ vertices in space
        n_negative = 0 if (sigma >= 0).all() else factor.n_negative
        refined = Refinement(self.geometry, exact, factor, start)
        if not refined.certain and factor.eliminate():
            refined, n_negative = Refinement(self.geometry, exact, factor, start), factor.n_negative
        if not refined.certain:
            # 3. By a factor of P + δ: with mixed signs a pivot may vanish without a vanishing eigenvalue
            n_negative, regular = 0 if (sigma >= 0).all() else len(network.free), True
            if (sigma > 0).any() and (sigma < 0).any():
                factor, regular, n_negative = self.prestress.factorize_shifted(sigma)
                if regular:
                    refined = Refinement(self.geometry, exact, factor, self.balance(sigma, factor).coordinates)
        x, L, error, errors = network.all_coordinates(refined.x), refined.L, refined.error, refined.L_errors
        if not refined.certain:
            # 4. No digit is certain; P is singular where stressed edges do not connect every vertex to a fixed one
            fixed = np.setdiff1d(np.arange(network.n_vertices), network.free)
            joined = np.concatenate([network.edges[sigma != 0], np.stack([fixed[:-1], fixed[1:]], axis=1)])
            regular = regular and not components(joined, network.n_vertices).any()
            status = Status.ill_conditioned if regular else Status.singular
            x, L, error, errors = np.full_like(x, np.nan), np.full_like(L, np.nan), np.nan, np.full(len(L), np.nan)
        value = CriticalConfiguration(network, sigma, x, L, error, errors, maker=self)
        stats = Stats(
            "force density", refined.steps, residual=value.residual, condition=refined.condition, error_bound=error
        )
        solution = ForceBalance(value, status, stats, negative_pivots=n_negative)
        return solution.or_raise("no configuration for this stress") if throw else solution

    def balance(self, sigma: Array, factor: Factor | None = None) -> Balance:
        """The configuration of a stress with the factor of P, unchecked: the inner step of every optimisation.

        Its bond vectors are L = g x(σ) + b (`SelfStressParamaterization_bondvecs`).

        factor  of P, or of a matrix near it; made here by default
        """
        factor = self.prestress.factorize(sigma) if factor is None else factor
        b = self.network.boundary_vectors
        x = factor.solve(product(self._load, sigma).reshape(b.shape[1], -1).T)
        return Balance(self, sigma, product(self.network.free_incidence, x) + b, x, factor)

    def response(self, configuration: CriticalConfiguration) -> LinearOperator:
        """B = ∂h/∂σ = −R^h P⁻¹ R^hᵀ as an operator (N_b, N_b), h = |L|²/2 (`SelfStressParamaterization_LsqrDeriv`).

        B is symmetric and σᵀ B = 0: the stress is normal to the manifold (`TangentVectors`).
        """
        configuration = of_kind(CriticalConfiguration, configuration=configuration)
        sigma, L = edge_values(configuration.sigma, self.network.n_edges, "sigma", False), configuration.bond_vectors
        free = configuration.coordinates[self.network.free]
        balance = Balance(self, sigma, L, free, self.prestress.factorize_signed(sigma))

        def apply(dsigma: Array) -> Array:
            return dot(L, balance.tangent(np.ravel(dsigma)))

        n = self.network.n_edges
        return LinearOperator((n, n), matvec=apply, rmatvec=apply, dtype=float)
