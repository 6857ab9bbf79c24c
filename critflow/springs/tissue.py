"""Tissues: springs on the perimeters of faces, a vertex model without area term, in which K couples edges of one face.

E = ½ Σ_f κ_f (p_f − p0_f)² with perimeters p = A|L|, A (N_f, N_b) being 1 where an edge is a side of a face.  Tensions
of the faces T = κ(p − p0) add up on their sides, τ = Aᵀ T, σ = τ/|L|, and
    K_{αβ} = Σ_f κ_f A_fα A_fβ/(|L_α||L_β|) − δ_{αβ} σ_α/|L_α|²      (`ModifiedStiffness`)
has entries off its diagonal exactly where two edges share a face.  With A = 1 these are Hookean springs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import checked
from critflow.critical.manifold import CriticalConfiguration, critical_configuration
from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.matrices import pair_laplacian
from critflow.linalg.tolerances import EPS
from critflow.networks.checks import edge_values
from critflow.networks.network import Array, Network
from critflow.precision.double_double import Extended, lengths
from critflow.precision.geometry import exact_sums
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.solvers.cone import fit_perimeters
from critflow.springs.equilibrium import equilibrium
from critflow.springs.state import ElasticState, edge_directions

# Edges below this part of the mean length are collapsed: ten times the accuracy of the cone program, about 1e-6.
COLLAPSED_EDGE = 1e-5
FITTED_PERIMETERS = 1e-11  # relative error of perimeters and forces after polishing; rounding leaves 1e-13

# Polishing: penalty stiffness in units of the mean tension over the mean perimeter, most iterations, and the factor by
# which the error must decrease in each.
_PENALTY, _MOST_ITERATIONS, _DECREASE = 100.0, 40, 0.7


@dataclass(frozen=True, eq=False)
class FaceSprings(Record):
    """Springs on the perimeters of faces: sides A (N_f, N_b) sparse, A ≥ 0, and stiffness κ (N_f,).

    Raises `InputError` where a side is negative, or an edge belongs to no face.
    """

    sides: sp.csr_array
    stiffness: Array

    @classmethod
    def of(cls, network: Network, stiffness: ArrayLike, sides: sp.sparray | ArrayLike | None) -> FaceSprings:
        """Those of the faces of a network, or of given sides, with a stiffness (N_f,) or one for all."""
        if sides is None:
            faces = network.faces
            if faces is None:
                raise InputError(
                    "the faces of this network are not known: give `faces`, for example from `planar_faces`"
                )
            owner = np.repeat(np.arange(faces.n_faces), faces.sizes)
            sides = sp.csr_array((np.ones(len(owner)), (owner, faces.edges)), shape=(faces.n_faces, network.n_edges))
        if np.ndim(sides) != 2 and not sp.issparse(sides):
            raise InputError(f"sides must have shape (N_f, {network.n_edges}), not {np.shape(sides)}: one row a face")
        A = sp.csr_array(sides, dtype=float)
        if A.ndim != 2 or A.shape[1] != network.n_edges:
            raise InputError(f"sides must have shape (N_f, {network.n_edges}), not {A.shape}: one row a face")
        A.sum_duplicates()
        A.eliminate_zeros()
        if not (np.isfinite(A.data) & (A.data > 0)).all():
            raise InputError("sides must not be negative: an entry is the multiplicity of an edge in a perimeter")
        bare = np.flatnonzero(np.asarray(A.sum(axis=0)) == 0)
        if len(bare):
            raise InputError(f"edge {bare[0]} belongs to no face, so nothing resists its extension: make it a side")
        values = np.array(stiffness) if np.ndim(stiffness) else np.full(A.shape[0], stiffness)
        return cls(A, edge_values(values, A.shape[0], "stiffness", place="face"))

    def perimeters(self, values: ArrayLike) -> Array:
        """Perimeters at rest (N_f,), else an `InputError`."""
        return edge_values(np.array(values), len(self.stiffness), "perimeters", place="face")

    @cached_property
    def overlap(self) -> sp.coo_array:
        """Aᵀ diag(κ) A, (N_b, N_b): which edges share a face, and how stiffly."""
        return sp.coo_array(self.sides.T @ sp.diags_array(self.stiffness) @ self.sides)


@dataclass(frozen=True, eq=False)
class Tissue(ElasticState):
    """Faces in a configuration: rest perimeters p0 (N_f,), coordinates x (N_v, d) and bond vectors L (N_b, d)."""

    network: Network
    faces: FaceSprings
    rest_perimeters: Array
    coordinates: Array
    bond_vectors: Array
    edges_may_collapse: ClassVar[bool] = True

    @cached_property
    def perimeters(self) -> Array:
        """p = A|L|, (N_f,)."""
        return self.faces.sides @ self.lengths

    @property
    def face_tensions(self) -> Array:
        """T = κ(p − p0), (N_f,)."""
        return self.faces.stiffness * (self.perimeters - self.rest_perimeters)

    @property
    def energy(self) -> float:
        return float(0.5 * np.sum(self.faces.stiffness * (self.perimeters - self.rest_perimeters) ** 2))

    @cached_property
    def sigma(self) -> Array:
        """Geometric stress σ = Aᵀ T/|L|, (N_b,), not normalised."""
        return (self.faces.sides.T @ self.face_tensions) / self.lengths

    @property
    def edge_stiffness(self) -> Array:
        # A matrix without negative entries is at most the diagonal of its row sums.
        return np.asarray(self.faces.overlap.sum(axis=1))

    @property
    def stiffness_scale(self) -> float:
        return float(self.faces.stiffness.mean())

    @property
    def length_scale(self) -> float:
        return float(self.rest_perimeters.mean())

    @property
    def stress_rounding(self) -> Array:
        A = self.faces.sides
        return EPS * (A.T @ (self.faces.stiffness * self.perimeters)) / self.lengths

    def exact_stress(self, bond_vectors: Extended) -> Array:
        A, length = self.faces.sides, lengths(bond_vectors)
        return (A.T @ (self.faces.stiffness * exact_sums(A, length, self.rest_perimeters))) / length.high

    @property
    def modified_stiffness(self) -> sp.coo_array:
        """K = ∂²E/∂h∂h, (N_b, N_b) sparse."""
        return self._couplings(self.sigma)

    def _couplings(self, sigma: Array) -> sp.coo_array:
        """K with stresses σ in its diagonal, in the order of the overlaps."""
        pairs, length = self.faces.overlap, self.lengths
        values = pairs.data / (length[pairs.row] * length[pairs.col])
        same = pairs.row == pairs.col
        values[same] -= (sigma / length**2)[pairs.row[same]]
        return sp.coo_array((values, (pairs.row, pairs.col)), shape=pairs.shape)

    def resistance(self, hdot: Array) -> Array:
        return np.asarray((self.modified_stiffness @ hdot.T).T)

    def pattern(self) -> FixedPattern:
        return pair_laplacian(self.network, (self.faces.overlap.row, self.faces.overlap.col))

    def factorize(self, pattern: FixedPattern, shift: float = 0.0) -> Factor:
        return self._factorize(pattern, self.sigma, shift)

    def factorize_convex(self, pattern: FixedPattern, shift: float) -> Factor:
        return self._factorize(pattern, np.maximum(self.sigma, 0.0), shift)

    def _factorize(self, pattern: FixedPattern, sigma: Array, shift: float) -> Factor:
        """R^hᵀ K R^h + P ⊗ 1 + shift·1 with the stresses σ."""
        K, L = self._couplings(sigma), self.bond_vectors
        blocks = K.data[:, None, None] * L[K.row, :, None] * L[K.col, None, :]
        same = np.flatnonzero(K.row == K.col)
        blocks[same] += sigma[K.row[same], None, None] * np.eye(L.shape[1])
        return pattern.factorize(blocks.ravel(), shift)


@checked
def tissue(
    network: Network,
    perimeters: ArrayLike,
    coordinates: ArrayLike | None = None,
    *,
    stiffness: ArrayLike = 1.0,
    sides: sp.sparray | ArrayLike | None = None,
) -> Tissue:
    """Springs on the perimeters of the faces of a network, at coordinates (N_v, d) or its positions.

    perimeters  at rest, p0 (N_f,)
    stiffness   κ (N_f,), or one for all
    sides       A (N_f, N_b), the multiplicity of each edge in each perimeter, in place of the faces of the network

    Raises `InputError` where faces or positions are unknown, a side is negative, or an edge belongs to no face.

    >>> import critflow as cf
    >>> import numpy as np
    >>> network = cf.lattice("honeycomb", 2, 2)
    >>> cf.tissue(network, np.full(4, 5.0)).perimeters
    array([6., 6., 6., 6.])
    """
    faces = FaceSprings.of(network, stiffness, sides)
    x = network.positions if coordinates is None else coordinates
    if x is None:
        raise InputError("this network has no positions: give coordinates")
    p0 = faces.perimeters(perimeters)
    return Tissue(network, faces, p0, *edge_directions(network, x))


@dataclass(frozen=True, eq=False)
class CriticalTissue(Record):
    """A critical configuration whose edge tensions come from faces: σ|L| ∝ Aᵀ T, face tensions T (N_f,) of mean 1."""

    configuration: CriticalConfiguration
    faces: FaceSprings
    face_tensions: Array

    @property
    def network(self) -> Network:
        return self.configuration.network

    def at_rest(self) -> Tissue:
        """The tissue with its perimeters as those at rest, p0 = p."""
        critical = self.configuration
        p0 = self.faces.sides @ critical.lengths
        return Tissue(critical.network, self.faces, p0, critical.coordinates, critical.bond_vectors)

    @property
    def shape_index(self) -> Array:
        """p/√⟨a⟩, (N_f,), with the mean area ⟨a⟩ = V/N_f of faces that tile the plane."""
        return self.at_rest().perimeters / np.sqrt(self.network.volume / len(self.face_tensions))


@dataclass(frozen=True, kw_only=True)
class PerimeterFit(Solution[CriticalTissue]):
    """A critical configuration of given perimeter ratios.

    ratio            p/p0, the same for all faces in tension
    slack_faces      indices of faces without tension
    collapsed_edges  indices of edges of zero length
    """

    ratio: float
    slack_faces: NDArray[np.intp]
    collapsed_edges: NDArray[np.intp]


@checked
def critical_from_perimeters(
    network: Network,
    perimeters: ArrayLike,
    *,
    stiffness: ArrayLike = 1.0,
    sides: sp.sparray | ArrayLike | None = None,
    throw: bool = True,
) -> PerimeterFit:
    """The all-tension critical configuration with perimeters proportional to p0 (N_f,), the limit of shrinking p0.

    A cone program finds it.  Where faces stay slack (`Status.slack_edges`) or edges shrink to zero length, since no
    perimeter fixes the length of a single edge (`Status.edge_collapse`), the ratio and the face tensions are valid,
    and the coordinates have the accuracy of the program, about 1e-6; where faces are slack they are not unique.
    `stats.residual` is the relative error of perimeters and forces.

    perimeters, stiffness, sides  those of `tissue`

    >>> import critflow as cf
    >>> import numpy as np
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> found = cf.critical_from_perimeters(network, np.ones(10))
    >>> round(float(found.value.shape_index.mean()), 2)
    3.82
    """
    faces = FaceSprings.of(network, stiffness, sides)
    A, p0 = faces.sides, faces.perimeters(perimeters)
    cone = fit_perimeters(network.free_incidence, network.boundary_vectors, A, p0, 1e-12)
    x, T, error, status = network.all_coordinates(cone.coordinates), cone.multipliers, np.nan, Status.ok
    length = np.linalg.norm(network.bond_vectors(x), axis=1)
    slack, collapsed = np.flatnonzero(~cone.stressed), np.flatnonzero(length < COLLAPSED_EDGE * length.mean())
    note = ""
    if not cone.solved:
        status, x, T = Status.stalled, np.full_like(x, np.nan), np.full_like(T, np.nan)
    elif len(slack):
        status = Status.slack_edges
        note = f"faces {', '.join(map(str, slack))} are slack: narrow the spread of the perimeters"
    elif len(collapsed):
        status = Status.edge_collapse
        note = f"edges {', '.join(map(str, collapsed))} shrink to zero length: increase the perimeters of their faces"
    else:
        x, T, error = _polish(network, A, p0, x, T)
        status = Status.ok if error < FITTED_PERIMETERS else Status.stalled
    length = np.linalg.norm(network.bond_vectors(x), axis=1)
    # An edge without length has a tension but no finite σ.
    sigma = (A.T @ T) / np.maximum(length, EPS * length.mean())
    value = CriticalTissue(critical_configuration(network, sigma, x), faces, T / T.mean())
    stats = Stats("conic", cone.steps, residual=error)
    solution = PerimeterFit(value, status, stats, note, ratio=cone.ratio, slack_faces=slack, collapsed_edges=collapsed)
    return solution.or_raise("these perimeters have no all-tension critical configuration") if throw else solution


def _polish(network: Network, A: sp.csr_array, p0: Array, x: Array, T: Array) -> tuple[Array, Array, float]:
    """From solver accuracy to rounding by the method of multipliers: perimeters relax to λ p0 − T/ρ, which updates T.

    Returns coordinates, face tensions of mean 1, and the largest relative error of perimeters and forces.
    """
    penalty = np.full(len(p0), _PENALTY / float(np.mean(p0)))
    state = tissue(network, p0, x, stiffness=penalty, sides=A)
    pattern, best = state.pattern(), (x, T, np.inf)
    for _ in range(_MOST_ITERATIONS):
        T = T / T.mean()
        ratio = float(T @ state.perimeters / (T @ p0))
        force = network.divergence @ (((A.T @ T) / state.lengths)[:, None] * state.bond_vectors)
        error = max(float(np.abs(state.perimeters / (ratio * p0) - 1).max()), float(np.abs(force).max()))
        if not error < _DECREASE * best[2]:
            break
        best = (state.coordinates, T, error)
        state = replace(state, rest_perimeters=ratio * p0 - T / penalty)
        state = equilibrium(state, tolerance=1e-17, max_steps=10, pattern=pattern, throw=False).value
        T = state.face_tensions
    return best
