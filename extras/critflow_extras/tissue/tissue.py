"""Tissues: springs on the perimeters of faces, a vertex model without area term, and their critical configurations.

E = ½ Σ_f κ_f (p_f − p0_f)² with perimeters p = A|L|, A (N_f, N_b) being 1 where an edge is a side of a face.  A tissue
is a `SpringState` whose springs are these perimeters (`state`), so that paths, equilibria and elasticity are those of
springs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import of_kind
from critflow.calls import running
from critflow.equilibria import equilibrium
from critflow.manifold import CriticalConfiguration, critical_configuration
from critflow.networks import Array, Network
from critflow.numerics import EPS, power_of_two
from critflow.result import InputError, Record, Solution, Stats, Status
from critflow.springs import edge_directions
from critflow_extras.tissue.face_springs import FaceSprings
from critflow_extras.tissue.perimeter_program import fit_perimeters
from critflow_extras.tissue.state import TissueState

# Edges below this part of the mean length are collapsed: ten times the accuracy of the cone program, about 1e-6.
COLLAPSED_EDGE = 1e-5
FITTED_PERIMETERS = 1e-11  # relative error of perimeters and forces after polishing; rounding leaves 1e-13

# Polishing: penalty stiffness in units of the mean tension over the mean perimeter, most iterations, and the factor by
# which the error must decrease in each.
_PENALTY, _MOST_ITERATIONS, _DECREASE = 100.0, 40, 0.7


def tissue(
    network: Network,
    perimeters: ArrayLike,
    coordinates: ArrayLike | None = None,
    *,
    stiffness: ArrayLike = 1.0,
    sides: sp.sparray | ArrayLike | None = None,
) -> TissueState:
    """Springs on the perimeters of the faces of a network, at coordinates (N_v, d) or its positions.

    perimeters  at rest, p0 (N_f,)
    stiffness   κ (N_f,), or one for all
    sides       A (N_f, N_b), the multiplicity of each edge in each perimeter, in place of the faces of the network

    Raises `InputError` where faces or positions are unknown, a side is negative, or an edge belongs to no face.

    >>> import critflow as cf
    >>> import critflow_extras as ce
    >>> import numpy as np
    >>> network = cf.lattice("honeycomb", 2, 2)
    >>> ce.tissue(network, np.full(4, 5.0)).spring_lengths
    array([6., 6., 6., 6.])
    """
    network = of_kind(Network, network=network)
    of_kind(np.ndarray, perimeters=perimeters, stiffness=stiffness)
    of_kind(np.ndarray, None, coordinates=coordinates)
    sides = of_kind(np.ndarray, sp.sparray, None, sides=sides)
    faces = FaceSprings.of(network, stiffness, sides)
    x = network.positions if coordinates is None else coordinates
    if x is None:
        raise InputError("this network has no positions: give coordinates")
    p0 = faces.perimeters(perimeters)
    return TissueState(network, p0, *edge_directions(network, x), faces=faces)


@dataclass(frozen=True, eq=False, repr=False)
class CriticalTissue(Record):
    """A critical configuration whose edge tensions come from faces: σ|L| ∝ Aᵀ T, face tensions T (N_f,) of mean 1."""

    configuration: CriticalConfiguration
    faces: FaceSprings
    face_tensions: Array
    network_refusal: ClassVar[str] = (
        "springs on perimeters are not springs on edges: choose elasticity(), strain_path() or stiffening(), or take "
        "its .configuration, whose edges are springs of their own"
    )

    @property
    def network(self) -> Network:
        return self.configuration.network

    @property
    def perimeters(self) -> Array:
        """p = A|L|, (N_f,)."""
        return self.faces.sides @ self.configuration.lengths

    def at_rest(self) -> TissueState:
        """The tissue with its perimeters as those at rest, p0 = p."""
        critical = self.configuration
        return TissueState(
            critical.network, self.perimeters, critical.coordinates, critical.bond_vectors, faces=self.faces
        )

    @property
    def shape_index(self) -> Array:
        """p/√⟨a⟩, (N_f,), with the mean area ⟨a⟩ = V/N_f of faces that tile the plane."""
        return self.perimeters / np.sqrt(self.network.volume / len(self.face_tensions))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class PerimeterFit(Solution[CriticalTissue]):
    """A critical configuration of given perimeter ratios.

    ratio            p/p0, the same for all faces in tension
    slack_faces      indices of faces without tension
    collapsed_edges  indices of edges of zero length
    """

    ratio: float
    slack_faces: NDArray[np.intp]
    collapsed_edges: NDArray[np.intp]


@running("critical_from_perimeters")
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
    >>> import critflow_extras as ce
    >>> import numpy as np
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> found = ce.critical_from_perimeters(network, np.ones(10))
    >>> round(float(found.value.shape_index.mean()), 2)
    3.82
    """
    network = of_kind(Network, network=network)
    of_kind(np.ndarray, perimeters=perimeters, stiffness=stiffness)
    sides = of_kind(np.ndarray, sp.sparray, None, sides=sides)
    of_kind(bool, throw=throw)
    faces = FaceSprings.of(network, stiffness, sides)
    A, p0 = faces.sides, faces.perimeters(perimeters)
    # Tolerances of programs and of forces are absolute: lengths and perimeters are in units of their own.
    unit, own = power_of_two(network.spacing), power_of_two(float(p0.mean()))
    given, network, p0 = network, network.deformed(np.eye(network.dimension) / unit), p0 / own
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
    value = CriticalTissue(critical_configuration(given, sigma, unit * x), faces, T / T.mean())
    stats, ratio = Stats("conic", cone.steps, residual=error), unit / own * cone.ratio
    solution = PerimeterFit(value, status, stats, note, ratio=ratio, slack_faces=slack, collapsed_edges=collapsed)
    return solution.or_raise("these perimeters have no all-tension critical configuration") if throw else solution


def _polish(network: Network, A: sp.csr_array, p0: Array, x: Array, T: Array) -> tuple[Array, Array, float]:
    """From solver accuracy to rounding by the method of multipliers: perimeters relax to λ p0 − T/ρ, which updates T.

    Returns coordinates, face tensions of mean 1, and the largest relative error of perimeters and forces.
    """
    penalty = np.full(len(p0), _PENALTY / float(np.mean(p0)))
    state = tissue(network, p0, x, stiffness=penalty, sides=A)
    best = (x, T, np.inf)
    for _ in range(_MOST_ITERATIONS):
        T = T / T.mean()
        ratio = float(T @ state.spring_lengths / (T @ p0))
        force = network.divergence @ (((A.T @ T) / state.lengths)[:, None] * state.bond_vectors)
        error = max(float(np.abs(state.spring_lengths / (ratio * p0) - 1).max()), float(np.abs(force).max()))
        if not error < _DECREASE * best[2]:
            break
        best = (state.coordinates, T, error)
        state = replace(state, rest_lengths=ratio * p0 - T / penalty)
        state = equilibrium(state, tolerance=1e-17, max_steps=10, throw=False).value
        T = state.tension
    return best
