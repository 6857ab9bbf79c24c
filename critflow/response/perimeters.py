"""Cells with perimeter springs, a vertex model without area term: K couples all edges of a cell.

E = ½ Σ_c κ_c (p_c − p0_c)² with perimeters p = A|L|, A (N_c, N_b) being 1 where an edge is a side of a cell.  Tensions
of the cells T = κ(p − p0) add up on their sides, τ = Aᵀ T, σ = τ/|L|, and
    K_{αβ} = Σ_c κ_c A_cα A_cβ/(|L_α||L_β|) − δ_{αβ} σ_α/|L_α|²      (`ModifiedStiffness`)
has entries off its diagonal exactly where two edges share a cell.  With A = 1 these are Hookean springs.
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
from critflow.critical.transition import dilation, pure_shear
from critflow.linalg.factor import Factor, FixedPattern
from critflow.linalg.matrices import pair_laplacian, rigidity_matrix
from critflow.linalg.tolerances import EPS
from critflow.networks.network import Array, Network
from critflow.precision.double_double import Extended, lengths
from critflow.precision.geometry import exact_sums
from critflow.response.elasticity import FLOPPY, Moduli
from critflow.response.moduli import SelfStressModuli, self_stress_moduli
from critflow.response.response import linear_response
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.solvers.cone import fit_perimeters
from critflow.springs.equilibrium import equilibrium
from critflow.springs.state import ElasticState, edge_directions

# Edges below this part of the mean length are collapsed: ten times the accuracy of the cone program, about 1e-6.
COLLAPSED_EDGE = 1e-5
FITTED_PERIMETERS = 1e-11  # relative error of perimeters and forces after polishing; rounding leaves 1e-13
CELL_STRESS_RANK = 1e-6  # singular values of the rigidity matrix of cells below this part of the largest count as zero

# Polishing: penalty stiffness in units of the mean tension over the mean perimeter, most iterations, and the factor by
# which the error must decrease in each.
_PENALTY, _MOST_ITERATIONS, _DECREASE = 100.0, 40, 0.7


@dataclass(frozen=True, eq=False)
class Cells(Record):
    """Cells of a network: sides A (N_c, N_b) sparse, A ≥ 0, and the stiffness κ (N_c,) of their perimeters."""

    network: Network
    sides: sp.csr_array
    stiffness: Array

    @cached_property
    def overlap(self) -> sp.coo_array:
        """Aᵀ diag(κ) A, (N_b, N_b): which edges share a cell, and how stiffly."""
        return sp.coo_array(self.sides.T @ sp.diags_array(self.stiffness) @ self.sides)


@checked
def cells_of(network: Network, stiffness: ArrayLike = 1.0, sides: sp.sparray | ArrayLike | None = None) -> Cells:
    """The faces of a network as cells, or cells of given sides A (N_c, N_b), with stiffness κ (N_c,) or one for all.

    Raises `InputError` where faces are unknown, a side is negative, or an edge belongs to no cell.

    >>> import critflow as cf
    >>> cf.cells_of(cf.honeycomb_network(2, 2)).sides.shape  # cells, edges
    (4, 12)
    """
    if sides is None:
        faces = network.faces
        if faces is None:
            raise InputError("the faces of this network are not known: give `faces`, for example from `planar_faces`")
        owner = np.repeat(np.arange(faces.n_faces), faces.sizes)
        sides = sp.csr_array((np.ones(len(owner)), (owner, faces.edges)), shape=(faces.n_faces, network.n_edges))
    if not sp.issparse(sides) and np.ndim(sides) != 2:
        raise InputError(f"sides must have shape (N_c, {network.n_edges}), not {np.shape(sides)}: one row a cell")
    A = sp.csr_array(sides, dtype=float)
    if A.ndim != 2 or A.shape[1] != network.n_edges:
        raise InputError(f"sides must have shape (N_c, {network.n_edges}), not {A.shape}: one row a cell")
    A.sum_duplicates()
    A.eliminate_zeros()
    if not (np.isfinite(A.data) & (A.data > 0)).all():
        raise InputError("sides must not be negative: an entry is the multiplicity of an edge in a perimeter")
    bare = np.flatnonzero(np.asarray(A.sum(axis=0)) == 0)
    if len(bare):
        raise InputError(f"edge {bare[0]} belongs to no cell, so nothing resists its extension: make it a side of one")
    return Cells(
        network, A, _positive(stiffness if np.ndim(stiffness) else np.full(A.shape[0], stiffness), A, "stiffness")
    )


def _positive(values: ArrayLike, sides: sp.csr_array, name: str) -> Array:
    """Values per cell (N_c,), finite and positive, else an `InputError`."""
    array = np.array(values, dtype=float)
    if array.shape != sides.shape[:1]:
        raise InputError(f"{name} must have one value per cell, shape {sides.shape[:1]}, not {array.shape}")
    bad = np.flatnonzero(~(np.isfinite(array) & (array > 0)))
    if len(bad):
        raise InputError(f"{name} must be positive and finite in every cell, but {name}[{bad[0]}] = {array[bad[0]]}")
    return array


@dataclass(frozen=True, eq=False)
class PerimeterState(ElasticState):
    """Cells in a configuration: target perimeters p0 (N_c,), coordinates x (N_v, d) and bond vectors L (N_b, d)."""

    network: Network
    cells: Cells
    targets: Array
    coordinates: Array
    bond_vectors: Array
    edges_may_collapse: ClassVar[bool] = True

    @cached_property
    def perimeters(self) -> Array:
        """p = A|L|, (N_c,)."""
        return self.cells.sides @ self.lengths

    @property
    def cell_tensions(self) -> Array:
        """T = κ(p − p0), (N_c,)."""
        return self.cells.stiffness * (self.perimeters - self.targets)

    @property
    def energy(self) -> float:
        return float(0.5 * np.sum(self.cells.stiffness * (self.perimeters - self.targets) ** 2))

    @cached_property
    def sigma(self) -> Array:
        """Geometric stress σ = Aᵀ T/|L|, (N_b,), not normalised."""
        return (self.cells.sides.T @ self.cell_tensions) / self.lengths

    @property
    def edge_stiffness(self) -> Array:
        # A matrix without negative entries is at most the diagonal of its row sums.
        return np.asarray(self.cells.overlap.sum(axis=1))

    @property
    def stiffness_scale(self) -> float:
        return float(self.cells.stiffness.mean())

    @property
    def length_scale(self) -> float:
        return float(self.targets.mean())

    @property
    def stress_rounding(self) -> Array:
        A = self.cells.sides
        return EPS * (A.T @ (self.cells.stiffness * self.perimeters)) / self.lengths

    def exact_stress(self, bond_vectors: Extended) -> Array:
        A, length = self.cells.sides, lengths(bond_vectors)
        return (A.T @ (self.cells.stiffness * exact_sums(A, length, self.targets))) / length.high

    @property
    def modified_stiffness(self) -> sp.coo_array:
        """K = ∂²E/∂h∂h, (N_b, N_b) sparse."""
        return self._couplings(self.sigma)

    def _couplings(self, sigma: Array) -> sp.coo_array:
        """K with stresses σ in its diagonal, in the order of the overlaps."""
        pairs, length = self.cells.overlap, self.lengths
        values = pairs.data / (length[pairs.row] * length[pairs.col])
        same = pairs.row == pairs.col
        values[same] -= (sigma / length**2)[pairs.row[same]]
        return sp.coo_array((values, (pairs.row, pairs.col)), shape=pairs.shape)

    def resistance(self, hdot: Array) -> Array:
        return np.asarray((self.modified_stiffness @ hdot.T).T)

    def pattern(self) -> FixedPattern:
        return pair_laplacian(self.network, (self.cells.overlap.row, self.cells.overlap.col))

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

    def affine_rates(self) -> list[Array]:
        """ṗ = A (L·AL/|L|), (N_c,), under dilation and under pure shear."""
        L, d = self.bond_vectors, self.network.dimension
        return [self.cells.sides @ (np.sum(L * (L @ A), axis=1) / self.lengths) for A in (dilation(d), pure_shear(d))]


@checked
def perimeter_state(cells: Cells, targets: ArrayLike, coordinates: ArrayLike) -> PerimeterState:
    """Cells of target perimeters p0 (N_c,) at coordinates (N_v, d)."""
    p0 = _positive(targets, cells.sides, "targets")
    return PerimeterState(cells.network, cells, p0, *edge_directions(cells.network, coordinates))


@dataclass(frozen=True, eq=False)
class CriticalPerimeters(Record):
    """A critical configuration whose edge tensions come from cells: σ|L| ∝ Aᵀ T, cell tensions T (N_c,) of mean 1."""

    configuration: CriticalConfiguration
    cells: Cells
    cell_tensions: Array

    def at_rest(self) -> PerimeterState:
        """The cells with their perimeters as targets, p0 = p."""
        critical = self.configuration
        p0 = self.cells.sides @ critical.lengths
        return PerimeterState(critical.network, self.cells, p0, critical.coordinates, critical.bond_vectors)

    @property
    def shape_index(self) -> Array:
        """p/√⟨a⟩, (N_c,), with the mean area ⟨a⟩ = V/N_c of cells that tile the plane."""
        return self.at_rest().perimeters / np.sqrt(self.configuration.network.volume / len(self.cell_tensions))

    def moduli(self) -> Moduli:
        """B_0 and G_0 by μ_A = (1/V) (Σ_c T_c ṗ_c)²/Σ_c T_c²/κ_c (`GenericModulus` with this K)."""
        volume, rates = self.configuration.network.volume, self.at_rest().affine_rates()
        return self_stress_moduli(self.cell_tensions[None], 1 / self.cells.stiffness, rates, volume)


@dataclass(frozen=True, kw_only=True)
class PerimeterFit(Solution[CriticalPerimeters]):
    """A critical configuration of given perimeter ratios.

    ratio            p/p0, the same for all cells in tension
    slack_cells      indices of cells without tension
    collapsed_edges  indices of edges of zero length
    """

    ratio: float
    slack_cells: NDArray[np.intp]
    collapsed_edges: NDArray[np.intp]


@checked
def critical_from_perimeters(cells: Cells, targets: ArrayLike, throw: bool = True) -> PerimeterFit:
    """The all-tension critical configuration with perimeters proportional to p0 (N_c,), the limit of shrinking p0.

    A cone program finds it.  Where cells stay slack (`Status.slack_edges`) or edges shrink to zero length, since no
    perimeter fixes the length of a single edge (`Status.edge_collapse`), the ratio and the cell tensions are valid,
    and the coordinates have the accuracy of the program, about 1e-6; where cells are slack they are not unique.
    `stats.residual` is the relative error of perimeters and forces.

    >>> import critflow as cf
    >>> import numpy as np
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> found = cf.critical_from_perimeters(cf.cells_of(network), np.ones(10))
    >>> round(float(found.value.shape_index.mean()), 2)
    3.82
    """
    network, p0 = cells.network, _positive(targets, cells.sides, "targets")
    cone = fit_perimeters(network.free_incidence, network.boundary_vectors, cells.sides, p0, 1e-12)
    x, T, error, status = network.all_coordinates(cone.coordinates), cone.multipliers, np.nan, Status.ok
    length = np.linalg.norm(network.bond_vectors(x), axis=1)
    slack, collapsed = np.flatnonzero(~cone.stressed), np.flatnonzero(length < COLLAPSED_EDGE * length.mean())
    note = ""
    if not cone.solved:
        status, x, T = Status.stalled, np.full_like(x, np.nan), np.full_like(T, np.nan)
    elif len(slack):
        status = Status.slack_edges
        note = f"cells {', '.join(map(str, slack))} are slack: narrow the spread of the perimeters"
    elif len(collapsed):
        status = Status.edge_collapse
        note = f"edges {', '.join(map(str, collapsed))} shrink to zero length: increase the perimeters of their cells"
    else:
        x, T, error = _polish(cells, p0, x, T)
        status = Status.ok if error < FITTED_PERIMETERS else Status.stalled
    length = np.linalg.norm(network.bond_vectors(x), axis=1)
    # An edge without length has a tension but no finite σ.
    sigma = (cells.sides.T @ T) / np.maximum(length, EPS * length.mean())
    value = CriticalPerimeters(critical_configuration(network, sigma, x), cells, T / T.mean())
    stats = Stats("conic", cone.steps, residual=error)
    solution = PerimeterFit(value, status, stats, note, ratio=cone.ratio, slack_cells=slack, collapsed_edges=collapsed)
    return solution.or_raise("these perimeters have no all-tension critical configuration") if throw else solution


def _polish(cells: Cells, p0: Array, x: Array, T: Array) -> tuple[Array, Array, float]:
    """From solver accuracy to rounding by the method of multipliers: perimeters relax to λ p0 − T/ρ, which updates T.

    Returns coordinates, cell tensions of mean 1, and the largest relative error of perimeters and forces.
    """
    penalty = Cells(cells.network, cells.sides, np.full(len(p0), _PENALTY / float(np.mean(p0))))
    state = perimeter_state(penalty, p0, x)
    pattern, best = state.pattern(), (x, T, np.inf)
    for _ in range(_MOST_ITERATIONS):
        T = T / T.mean()
        ratio = float(T @ state.perimeters / (T @ p0))
        force = cells.network.divergence @ (((cells.sides.T @ T) / state.lengths)[:, None] * state.bond_vectors)
        error = max(float(np.abs(state.perimeters / (ratio * p0) - 1).max()), float(np.abs(force).max()))
        if not error < _DECREASE * best[2]:
            break
        best = (state.coordinates, T, error)
        state = replace(state, targets=ratio * p0 - T / penalty.stiffness)
        state = equilibrium(state, tolerance=1e-17, max_steps=10, pattern=pattern, throw=False).value
        T = state.cell_tensions
    return best


@checked
def perimeter_moduli(state: PerimeterState, tolerance: float = 1e-9) -> Solution[Moduli]:
    """Relaxed B and G of cells in equilibrium, on either side of the transition, as `elastic_moduli` for springs.

    Under tension they follow by linear response (`LinearResponse`), at rest from the self-stresses of the cells, found
    by dense algebra (`SelfStressModuli`); without any the cells are floppy: moduli exactly 0 and `Status.floppy`.
    Raises `InputError` when the forces do not balance.
    """
    scale = state.stiffness_scale * state.length_scale
    if state.max_force > tolerance * scale:
        raise InputError(
            f"the cells are not in equilibrium, a force of {state.max_force:.2g} is left: call equilibrium() first"
        )
    if np.abs(state.cell_tensions).max() > tolerance * scale:
        return linear_response(state)
    left, values, _ = np.linalg.svd((state.cells.sides @ rigidity_matrix(state.network, state.coordinates)).toarray())
    rank = int(np.count_nonzero(values > CELL_STRESS_RANK * values[0]))
    n_stresses, stats = len(left) - rank, Stats("self-stress", 1)
    if n_stresses == 0:
        return SelfStressModuli(FLOPPY, Status.floppy, stats, n_self_stresses=0)
    stresses, flexibility = left[:, rank:].T, 1 / state.cells.stiffness
    value = self_stress_moduli(stresses, flexibility, state.affine_rates(), state.network.volume)
    return SelfStressModuli(value, Status.ok, stats, n_self_stresses=n_stresses)
