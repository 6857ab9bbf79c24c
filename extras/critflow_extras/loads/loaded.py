"""Networks under loads: the configuration in which given force densities balance forces on the vertices.

Forces f on the vertices enter the balance of the critical manifold as one more right-hand side,

    P(σ) x = −gᵀ(σ ∘ b) + f,

with the same factor and the same pull-back.  A loaded network has no self-stress, and the scale of σ counts: twice the
force density halves the sag.  An edge of weight w per length, a vector, adds ½ w|L| to both of its ends.  Where |L| is
the length under the load, balance is no longer linear: F(x) = P x + gᵀ(σ ∘ b) − f − ½|g|ᵀ(w|L|) = 0 is solved by
Newton's method from the configuration without weights; its matrix, transposed, also gives the gradients.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.linalg import LinearOperator, SuperLU, onenormest, splu

from critflow.arguments import edge_values, finite_rows, floats, of_kind
from critflow.calls import running
from critflow.double_double import Extended, add, extended
from critflow.manifold import Balance, CriticalManifold, ForceBalance
from critflow.networks import Array, Network
from critflow.numerics import norms, set_read_only
from critflow.refinement import SAFETY, ExtendedGeometry
from critflow.result import InputError, Record, Stats, Status
from critflow.sparse import Factor

# Newton's method: most steps, of which it needs three to six where the weights of the edges have a balance; change of
# the bond vectors, relative to the largest, at which it ends; and below which steps that do not shrink are rounding.
MOST_STEPS, UNCHANGED, ROUNDED = 40, 1e-13, 1e-9
# Sum of all forces on a network without pins, relative to their sizes, that rounding explains.
BALANCED = 1e-12

NO_BALANCE = (
    "no balance was found with edges that weigh more as they sag: raise sigma, or give lengths to weigh edges of these "
    "lengths"
)


@dataclass(frozen=True, eq=False, repr=False)
class LoadedConfiguration(Record):
    """A network in balance under σ (N_b,) and loads: coordinates x (N_v, d) and bond vectors L (N_b, d).

    forces       on the vertices as given, with the weights of edges of given lengths, (N_v, d)
    weight       of the edges for each unit of their length |L|, (N_b, d); None without
    error_bound  estimate of the largest error of a coordinate, against the exact configuration of σ and the loads
    bond_errors  estimates of |δL_α|, (N_b,)
    """

    network: Network
    sigma: Array
    forces: Array
    weight: Array | None
    coordinates: Array
    bond_vectors: Array
    error_bound: float
    bond_errors: Array
    network_refusal: ClassVar[str] = (
        "it carries loads, so it has no self-stress, which this call needs: design(..., change='force_densities') "
        "changes it"
    )

    def __post_init__(self) -> None:
        set_read_only(self, "sigma", "forces", "weight", "coordinates", "bond_vectors", "bond_errors")

    @cached_property
    def lengths(self) -> Array:
        """|L_α|, (N_b,)."""
        return norms(self.bond_vectors)

    @property
    def tensions(self) -> Array:
        """τ_α = σ_α |L_α|, (N_b,)."""
        return self.sigma * self.lengths

    @cached_property
    def loads(self) -> Array:
        """All loads on the vertices, with the weights of the edges, (N_v, d)."""
        return loads_on(self.network, self.forces, self.weight, self.bond_vectors)

    @cached_property
    def reactions(self) -> Array:
        """Forces of the supports on the pins, gᵀ(σ ∘ L) − loads, (N_v, d); zero elsewhere.  Their sum is −Σ loads."""
        reactions, pins = np.zeros_like(self.coordinates), list(self.network.pins)
        reactions[pins] = self._unsupported[pins]
        return reactions

    @cached_property
    def residual(self) -> float:
        """Largest unbalanced force |gᵀ(σ ∘ L) − loads| of a vertex without support, over the mean tension."""
        force = np.abs(self._unsupported - self.reactions).max()
        return float(force / np.abs(self.tensions).mean())

    @property
    def _unsupported(self) -> Array:
        return np.asarray(self.network.incidence.T @ (self.sigma[:, None] * self.bond_vectors) - self.loads)


def loads_on(network: Network, forces: Array, weight: Array | None, bond_vectors: Array) -> Array:
    """Forces on the vertices with the weights of the edges, half at each end, (N_v, d)."""
    return forces if weight is None else forces + halves(network) @ (weight * norms(bond_vectors)[:, None])


def halves(network: Network) -> sp.csr_array:
    """½ at both ends of each edge, (N_v, N_b); 1 for an edge from a vertex to an image of itself."""
    edges = np.repeat(np.arange(network.n_edges), 2)
    return sp.csr_array(
        (np.full(len(edges), 0.5), (network.edges.ravel(), edges)), (network.n_vertices, len(edges) // 2)
    )


class LoadedManifold(CriticalManifold):
    """The map σ → configuration of one network under loads, with its scale, and its pull-back.

    forces  on the vertices, (N_v, d)
    weight  of the edges for each unit of length, (N_b, d), or None
    """

    def __init__(self, manifold: CriticalManifold, forces: Array, weight: Array | None = None):
        self.__dict__.update(manifold.__dict__)
        self.forces, self.weight = forces, weight
        self.geometry = LoadedGeometry(manifold.geometry, forces[self.network.free])

    def balance(self, sigma: Array, factor: Factor | None = None) -> Balance:
        """The configuration of σ under the loads with the factor for its derivatives; NaN where none is found.

        Under weights of the edges the factor solves with the transposed matrix of Newton's method.
        """
        network = self.network
        unloaded = super().balance(sigma, factor)
        x = unloaded.coordinates + unloaded.factor.solve(self.forces[network.free])
        tangent, L = unloaded.factor, network.free_incidence @ x + network.boundary_vectors
        if self.weight is not None:
            x, L, tangent = self._weighed(sigma, x, L)
        return Balance(self, sigma, L, x, tangent)

    def solve(self, stress: ArrayLike, throw: bool = False, *_: Any) -> ForceBalance[LoadedConfiguration]:  # type: ignore[override]
        """The configuration under σ (N_b,) of any sign, in its scale, refined, with an estimate of its error.

        Error bound (estimate): that of `Refinement`, whose proof leaves out the rounding of loads in extended
        precision.  With weights of the edges also the force that the last step leaves, times the norm of the inverse
        matrix of Newton's method.
        """
        sigma = edge_values(stress, self.network.n_edges, "sigma", positive=False)
        held, note, rough = self, "", None
        if self.weight is not None:
            # The loads at the end of Newton's method are held, so that the rest is linear.
            rough = self.balance(sigma)
            found = bool(np.isfinite(rough.coordinates).all())
            loads = loads_on(self.network, self.forces, self.weight, rough.bond_vectors) if found else self.forces
            held = LoadedManifold(self, loads)
        solved = CriticalManifold.solve(held, sigma, squares=float(np.sum(sigma**2)))
        one, error = solved.value, solved.value.error_bound
        x, L, errors = one.coordinates, one.bond_vectors, one.bond_errors
        if rough is not None and solved.ok and not found:
            note, error, errors = NO_BALANCE, np.nan, np.full_like(errors, np.nan)
            x, L = np.full_like(x, np.nan), np.full_like(L, np.nan)
        elif rough is not None and solved.ok:
            extra = self._left(rough, L, error)
            error, errors = error + extra, errors + 2 * np.sqrt(L.shape[1]) * extra
        value = LoadedConfiguration(self.network, sigma, self.forces, self.weight, x, L, error, errors)
        stats = Stats("force density", solved.stats.steps, value.residual, solved.stats.condition, error)
        solution = ForceBalance(
            value, Status.not_reached if note else solved.status, stats, note, negative_pivots=solved.negative_pivots
        )
        return solution.or_raise("no configuration for this stress and these loads") if throw else solution

    def _weighed(self, sigma: Array, x: Array, L: Array) -> tuple[Array, Array, Any]:
        """Coordinates (n_free, d) in balance with the weights of the edges, bond vectors, and what solves there."""
        assert self.weight is not None
        network = self.network
        g, b = network.free_incidence, network.boundary_vectors
        m, d = b.shape
        # Over the components of the free coordinates: g, and the loads that a unit of length of an edge adds.
        by_x = sp.kron(g, sp.eye_array(d), format="csr")
        pull = by_x.T @ sp.diags_array(np.repeat(sigma, d))
        ends = sp.kron(halves(network)[network.free], np.ones((d, 1)), format="csr")
        of_row = np.repeat(np.arange(len(x) * d) % d, np.diff(ends.indptr))
        weigh = sp.csr_array((ends.data * self.weight[ends.indices, of_row], ends.indices, ends.indptr), ends.shape)
        rows, columns, moved = np.arange(0, m * d + 1, d), np.arange(m * d), np.inf
        for _ in range(MOST_STEPS):
            if not np.isfinite(L).all():
                break
            direction = L / np.maximum(norms(L), np.finfo(float).tiny)[:, None]
            stretch = sp.csr_array((direction.ravel(), columns, rows), (m, m * d))
            try:
                tangent = _Tangent(splu(sp.csc_array((pull - weigh @ stretch) @ by_x)))
            except RuntimeError:  # a singular matrix
                break
            force = pull @ L.ravel() - loads_on(network, self.forces, self.weight, L)[network.free].ravel()
            x = x - tangent.factor.solve(force).reshape(x.shape)
            last, before, L = moved, L, g @ x + b
            moved, size = float(np.abs(L - before).max()), float(np.abs(L).max())
            # Rounding ends it where the steps no longer shrink.
            if moved <= UNCHANGED * size or (moved < ROUNDED * size and moved > 0.5 * last):
                return x, L, tangent
        return np.full_like(x, np.nan), np.full_like(L, np.nan), None

    def _left(self, rough: Balance, L: Array, error: float) -> float:
        """Bound (estimate) on the change of a coordinate by the weights at L, beyond those held and rounded."""
        assert self.weight is not None
        lengths, d = norms(L), L.shape[1]
        change = np.abs(norms(rough.bond_vectors) - lengths) + 2 * np.sqrt(d) * error
        all_loads = loads_on(self.network, np.abs(self.forces), np.abs(self.weight), L)
        force = halves(self.network) @ (np.abs(self.weight) * change[:, None]) + self.geometry.roundings * all_loads
        force = force[self.network.free].ravel()
        lu: SuperLU = rough.factor.factor  # type: ignore[attr-defined]
        # ‖A⁻¹ diag(r)‖∞ is the largest column sum of its transpose.
        scaled = LinearOperator(
            (len(force), len(force)),
            matvec=lambda v: force * lu.solve(np.ravel(v), "T"),
            rmatvec=lambda v: lu.solve(force * np.ravel(v)),
            dtype=float,
        )
        return SAFETY * float(onenormest(scaled))


class LoadedGeometry(ExtendedGeometry):
    """As `ExtendedGeometry`, with the forces on the free vertices (n_free, d) subtracted from those of the edges."""

    def __init__(self, geometry: ExtendedGeometry, forces: Array):
        self.__dict__.update(geometry.__dict__)
        self._forces = extended(-forces)

    def tension_forces(self, sigma: Extended, L: Extended) -> Extended:
        return add(super().tension_forces(sigma, L), self._forces)


@dataclass(frozen=True, eq=False)
class _Tangent:
    """The matrix A of Newton's method, over the free coordinates (d n_free)², as the factor of a balance."""

    factor: SuperLU

    def solve(self, right: Array) -> Array:
        """A⁻ᵀ r for columns r (n_free, n d), in groups of d."""
        n, d = len(right), self.factor.shape[0] // len(right)
        stacked = right.reshape(n, -1, d).swapaxes(1, 2).reshape(n * d, -1)
        return self.factor.solve(stacked, "T").reshape(n, d, -1).swapaxes(1, 2).reshape(n, -1)


@running("loaded")
def loaded(
    manifold: Network | CriticalManifold,
    sigma: ArrayLike,
    forces: ArrayLike | None = None,
    weight: ArrayLike | None = None,
    lengths: ArrayLike | None = None,
    throw: bool = True,
) -> ForceBalance[LoadedConfiguration]:
    """The configuration in which force densities σ (N_b,) balance loads: P(σ) x = −gᵀ(σ ∘ b) + f, in the scale of σ.

    forces   f on the vertices, (N_v, d), or one vector (d,) for each vertex
    weight   of each edge for a unit of its length, a vector for each (N_b, d) or one (d,) for all; half at each end
    lengths  ℓ (N_b,) for which edges are weighed; by default |L| under the load, found by iteration

    σ has the unit of f over a length.  The value has coordinates, reactions at the pins, residual and error bound;
    `negative_pivots` is zero where P is positive definite, as for σ > 0: the configuration is then stable, without
    weights that grow.  `Status.singular` and `Status.ill_conditioned` as for `CriticalManifold.solve`;
    `Status.not_reached` where no balance with growing weights is found.
    Raises `InputError` for values of wrong shapes, and for loads on a network without pins that do not sum to zero;
    `SolveError` with `throw`.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> rope = cf.Network([[0, 1], [1, 2], [2, 3]], pins={0: (0.0, 0.0), 3: (3.0, 0.0)})
    >>> roof = ce.loaded(rope, [1.0, 1.0, 1.0], forces=(0.0, -1.0)).value
    >>> roof.coordinates[:, 1], roof.reactions[0]
    (array([ 0., -1., -1.,  0.]), array([-1.,  2.]))
    """
    of_kind(np.ndarray, sigma=sigma)
    of_kind(np.ndarray, None, forces=forces, weight=weight, lengths=lengths)
    of_kind(bool, throw=throw)
    plain = CriticalManifold.of(of_kind(Network, CriticalManifold, manifold=manifold))
    network = plain.network
    if forces is None and weight is None:
        raise InputError("there is no load: give forces on the vertices or the weight of the edges")
    f = (
        np.zeros((network.n_vertices, network.dimension))
        if forces is None
        else _rows("forces", forces, network.n_vertices, network)
    )
    w = None if weight is None else _rows("weight", weight, network.n_edges, network)
    if lengths is not None:
        if w is None:
            raise InputError("lengths are those for which edges are weighed: give weight as well")
        f, w = f + halves(network) @ (w * edge_values(lengths, network.n_edges, "lengths")[:, None]), None
    if not network.pins:
        total = np.abs(f.sum(axis=0)).max()
        if w is not None or total > BALANCED * np.abs(f).sum():
            raise InputError(
                "loads on a network without pins must sum to zero, since nothing holds it: add pins, or subtract the "
                "mean of the forces"
            )
    return LoadedManifold(plain, f, w).solve(sigma, throw)


def _rows(name: str, vectors: ArrayLike, n: int, network: Network) -> Array:
    """Vectors (n, d) from these or from one (d,) for all."""
    rows = floats(vectors, name)
    rows = np.tile(rows, (n, 1)) if rows.ndim == 1 else rows
    return finite_rows(rows, name, (n, network.dimension))
