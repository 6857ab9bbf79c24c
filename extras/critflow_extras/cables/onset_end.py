"""How the search for an onset of rigidity ends: its status, the condition, and what is returned.

    status     condition                                                           value
    ---------  ------------------------------------------------------------------  ---------------------------------
    ok         bounds within ONSET_GAP (1 + |γ_c|), both proofs, forces balanced   γ_c, its bounds and configuration
    stalled    the bounds are farther apart: WIDE                                  the same
    stalled    the weakest stresses were not separated from slack: UNRESOLVED      the same
    stalled    a bound is only an estimate: ESTIMATED                              the same
    floppy     no strain makes an edge taut: NO_RESISTANCE                         NaN
    floppy     up to a flat cell, FLAT_CELL, or until free sides meet, SIDES_MEET  NaN
    floppy     no onset after MOST_PROGRAMS programs: NO_ONSET                     NaN
    stalled    the first cone program fails: NOT_CONVERGED                         NaN
    rigid      balanced forces prove the network rigid at γ = 0: RIGID             NaN
    undecided  at γ = 0 rounding decides: AT_TRANSITION, or HIDDEN                 NaN

The names in capitals are the sentences of the notes.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.optimize import linprog

from critflow.deformation import Deformation
from critflow.manifold import CriticalConfiguration, critical_configuration
from critflow.networks import Array, Network
from critflow.result import Record, Solution, Stats, Status
from critflow.self_stress import count_self_stresses
from critflow.taut_edges import FITTED, OnsetState, unknown_configuration
from critflow.taut_part import Backbone, backbone, connected_parts
from critflow_extras.cables.boundary_path import BoundaryPath
from critflow_extras.cables.bounds import StrainBounds
from critflow_extras.certificates.counts import rigidity

DEPENDENT = 1e-9  # singular values of balance, relative to the largest, that are zero up to rounding
KINK = 1e-6  # difference of one-sided derivatives, relative to the largest, that rounding and linear programs leave
ONSET_GAP = 1e-9  # largest gap of the bounds on a strain with status `ok`, relative to 1 + |γ|

WIDE = "it lies between {0:.12g} and {1:.12g}, which differ by {2:.1g}"
UNRESOLVED = "the bounds on the strain hold, but the weakest stresses were not separated from slack edges"
ESTIMATED = "a bound on the strain is only an estimate: see `proven`"
NO_RESISTANCE = "no strain makes an edge taut, because the edges do not span the cell: choose another deformation"
FLAT_CELL = "the network stays floppy until the cell is flat, at strain {:.3g}: choose a deformation that extends it"
SIDES_MEET = "cables stay floppy until the free sides of the cell meet: fix a side"
NO_ONSET = "no onset was found up to strain {:.3g}: follow the path in another direction"
NOT_CONVERGED = "the cone program did not converge"
SEVERAL = "several sets of edges become taut together: `one_sided` has the derivatives of both sides by rest lengths"
RIGID = "the network is rigid at strain zero already: lengthen its rest lengths"
HIDDEN = "rounding hides whether the network is floppy or rigid at strain zero: change its rest lengths"
AT_TRANSITION = (
    "the network is at its transition at strain zero, where rounding decides: with rest lengths longer by {0:.0e} it "
    "is floppy, with shorter ones rigid"
)


@dataclass(frozen=True, eq=False, repr=False)
class CriticalStrain(Record):
    """The onset of rigidity on a path of deformations.

    strain                γ_c; NaN without an onset
    lower, upper          bounds on γ_c: floppy on one side, rigid on the other
    deformation           the path of the boundary
    proven                whether the bounds (lower, upper) are proofs; else they are estimates
    configuration         critical configuration of cables on the deformed network, σ = 0 on slack edges
    deformation_gradient  F at the onset, free components included, (d, d)
    free                  q of the free components of the cell, (m,)
    taut                  (N_b,) edges under tension at the onset
    stress                macroscopic stress Σσ L⊗L over its trace Σσ|L|², (d, d)
    normal                ∂t/∂F, (d, d): normal of the rigidity surface in the space of F
    gradient              dγ_c/dℓ, (N_b,); where several sets of edges become taut together γ_c has a kink, and this
                          lies between the derivatives of both sides, `one_sided`
    """

    strain: float
    lower: float
    upper: float
    deformation: Deformation
    proven: tuple[bool, bool]
    configuration: CriticalConfiguration
    deformation_gradient: Array
    free: Array
    taut: NDArray[np.bool_]
    stress: Array
    normal: Array
    gradient: Array
    _works: Array = field(repr=False)  # of unit stresses on the strain, last, and on determined free components

    @property
    def network(self) -> Network:
        """The network with its boundary deformed to the onset."""
        return self.configuration.network

    @property
    def taut_edges(self) -> NDArray[np.intp]:
        """The edges that are taut first, those of the largest tension before others."""
        edges = np.flatnonzero(self.taut)
        return edges[np.argsort(-self.configuration.tensions[edges], kind="stable")]

    @cached_property
    def backbone(self) -> Backbone:
        """The taut edges as networks of their own."""
        return backbone(self.configuration)

    @cached_property
    def one_sided(self) -> Array:
        """dγ_c/dℓ, (2, N_b), for shorter and for longer rest lengths; both are `gradient` where one stress balances.

        Tensions τ ≥ 0 of the taut edges in balance that do unit work on the strain, Σ τ L·L̇/|L| = 1, prove the network
        rigid: |dγ_c| is the least Στ dℓ of them all, so that each edge has its smallest and its largest tension.
        """
        parts = self.backbone.components if np.isfinite(self.strain) else ()
        if not parts or (len(parts) == 1 and count_self_stresses(parts[0]) == 1):
            return np.array([self.gradient, self.gradient])
        network, taut, length = self.network, np.flatnonzero(self.taut), self.configuration.lengths[self.taut]
        units = self.configuration.bond_vectors[taut] / length[:, None]
        forces = np.einsum("an,ai->nia", network.free_incidence.toarray()[taut], units).reshape(-1, len(taut))
        basis = scipy.linalg.null_space(forces, rcond=DEPENDENT)
        works, target = (self._works[:, taut] / length) @ basis, np.eye(len(self._works))[-1]
        sides = np.zeros((2, network.n_edges))
        for edge, row in zip(taut, basis, strict=True):
            for side, sign in ((0, -1.0), (1, 1.0)):
                found = linprog(sign * row, -basis, np.zeros(len(taut)), works, target, (None, None))
                sides[side, edge] = sign * found.fun if found.success else np.nan
        return np.copysign(1.0, self.strain) * sides

    def tolerance(self, error: float) -> float:
        """Standard deviation of γ_c for independent errors of the rest lengths, s|dγ_c/dℓ|; NaN at a kink of γ_c."""
        shorter, longer = self.one_sided
        smooth = np.abs(shorter - longer).max() <= KINK * np.abs(self.gradient).max()
        return error * float(np.linalg.norm(self.gradient)) if smooth else np.nan

    @cached_property
    def valid_for_springs(self) -> bool:
        """Whether springs that resist compression as well share this onset; False where that is not certain.

        Below γ_c they must be able to keep all rest lengths.  With one self-stress, of all edges, and a flex u that
        keeps lengths to first order, ½ uᵀP u = (γ_c − γ) Σ σ ḣ has such a motion, since σ > 0 makes P positive
        definite.  Slack edges would be compressed; without a flex, or with several self-stresses, so are taut ones
        below γ_c.
        """
        network, x = self.network, self.configuration.coordinates
        if not self.taut.all() or (network.edges[:, 0] == network.edges[:, 1]).any():
            return False
        counted = rigidity(network, x, vectors=False)
        counts = counted.value
        return counted.ok and counts.n_self_stresses == 1 and not counts.first_order_rigid


def wide(bounds: StrainBounds, state: OnsetState) -> bool:
    """Whether the bounds do not determine the strain of a state."""
    return not bounds.upper - bounds.lower <= ONSET_GAP * (1 + state.strain)


def _reason(bounds: StrainBounds, state: OnsetState) -> str:
    """Why an onset is not known to the last digits; an empty string where it is."""
    if wide(bounds, state):
        return WIDE.format(bounds.lower, bounds.upper, bounds.upper - bounds.lower)
    if not state.error < FITTED:
        return UNRESOLVED
    return "" if all(bounds.proven) else ESTIMATED


def onset_at(
    path: BoundaryPath, lengths: Array, state: OnsetState, bounds: StrainBounds, steps: int
) -> Solution[CriticalStrain]:
    """The onset at a state, with the stress and the derivatives of its strain.

    steps  interior-point iterations of its search
    """
    network, sign = path.network, path.direction
    F = path.gradient(state.strain, state.free)
    deformed = network.deformed(F)
    value = critical_configuration(deformed, state.sigma, deformed.all_coordinates(state.coordinates))
    sigma, L, taut = value.sigma, value.bond_vectors, value.sigma > 0
    virial = float(np.sum(value.tensions * value.lengths))
    normal = np.einsum("a,ai,aj->ij", sigma, L, network.boundary_vectors) / virial
    # Forces of collapsed edges alone do no work: derivatives are then unknown.
    rates = path.rates(state.strain, state.free)[[*path.determined, -1]]
    rate = float(np.sum(normal * rates[-1])) or np.nan
    lower, upper = (bounds.lower, bounds.upper) if sign > 0 else (-bounds.upper, -bounds.lower)
    onset = CriticalStrain(
        strain=sign * state.strain,
        lower=lower,
        upper=upper,
        deformation=path.deformation,
        proven=bounds.proven if sign > 0 else (bounds.proven[1], bounds.proven[0]),
        configuration=replace(value, rest_lengths=np.where(taut, value.lengths, lengths)),
        deformation_gradient=F,
        free=state.free,
        taut=taut,
        stress=np.einsum("a,ai,aj->ij", sigma, L, L) / virial,
        normal=normal,
        gradient=sign * value.tensions / (virial * rate),
        _works=np.einsum("ai,kij,aj->ka", L, rates, network.boundary_vectors),
    )
    stats = Stats("conic", steps, residual=state.error, error_bound=upper - lower)
    if note := _reason(bounds, state):
        return Solution(onset, Status.stalled, stats, note)
    parts = connected_parts(deformed, taut)
    several = len(parts) > 1 or deformed.part(parts[0])[0].least_self_stresses > 1
    return Solution(onset, Status.ok, stats, SEVERAL if several else "")


def without_onset(path: BoundaryPath, status: Status, note: str, steps: int = 0) -> Solution[CriticalStrain]:
    """The end of a search that finds no onset."""
    network, unknown = path.network, np.full((path.network.dimension,) * 2, np.nan)
    onset = CriticalStrain(
        strain=np.nan,
        lower=np.nan,
        upper=np.nan,
        deformation=path.deformation,
        proven=(False, False),
        configuration=unknown_configuration(network),
        deformation_gradient=unknown,
        free=np.full(path.n_free, np.nan),
        taut=np.zeros(network.n_edges, bool),
        stress=unknown,
        normal=unknown,
        gradient=np.full(network.n_edges, np.nan),
        _works=np.full((1, network.n_edges), np.nan),
    )
    return Solution(onset, status, Stats("conic", steps), note)
