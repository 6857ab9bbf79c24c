"""The onset of rigidity: the strain at which a floppy network of given rest lengths becomes rigid on a path.

For boundaries b → F b and rest lengths ℓ let t(F) = min_x max_α |F b_α + (g x)_α| / ℓ_α, which is convex in F.  Cables
are floppy where t < 1 and rigid where t > 1.  The onset is the largest strain with t(F(γ)) ≤ 1, one cone program for
paths that are linear in γ, and a few linearised ones for others.  Newton's method on the taut edges then gives the
critical configuration to rounding: forces f_α = σ_α L_α in balance, |L_α| = ℓ_α where σ_α > 0.

With Σ |f_α| ℓ_α = 1 the derivatives of t are the macroscopic stress, ∂t/∂F_ij = Σ f_αi b_αj, and ∂t/∂ℓ_α = −|f_α|.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import checked
from critflow.critical.backbone import Backbone, backbone
from critflow.critical.manifold import CriticalConfiguration, critical_configuration
from critflow.networks.checks import edge_values
from critflow.networks.deformation import Deformable, deformation_of
from critflow.networks.network import Array, Network
from critflow.onset.boundary_path import BoundaryPath
from critflow.onset.bounds import StrainBounds, onset_bounds
from critflow.onset.central_path import follow_central_path
from critflow.onset.search import SIDES_MEET, Interior, Search, floppy_start, search_onset
from critflow.onset.stressed_part import unknown_configuration
from critflow.onset.taut_edges import OnsetState, polish_taut, resolved, settled, without_slack_stress
from critflow.onset.tolerances import FITTED
from critflow.result import InputError, Record, Solution, Stats, Status

ONSET_GAP = 1e-9  # largest gap of the bounds on a strain with status `ok`, relative to 1 + |γ|
# det F of a cell with free sides at which an onset without bounds is that of a flat cell: the program with ROUGH_CONE
# leaves a tilt of about its root.
NARROW = 0.02


@dataclass(frozen=True, eq=False)
class CriticalStrain(Record):
    """The onset of rigidity on a path of deformations.

    strain                γ_c
    lower, upper          bounds on γ_c: floppy on one side, rigid on the other
    proven                whether the bounds (lower, upper) are proofs; else they are estimates
    configuration         critical configuration on the deformed network, σ = 0 on slack edges
    deformation_gradient  F at the onset, free components included, (d, d)
    free                  q of the free components of the cell, (m,)
    taut                  (N_b,) edges under tension at the onset
    stress                macroscopic stress Σσ L⊗L over its trace Σσ|L|², (d, d)
    normal                ∂t/∂F, (d, d): normal of the rigidity surface in the space of F
    gradient              dγ_c/dℓ, (N_b,)
    """

    strain: float
    lower: float
    upper: float
    proven: tuple[bool, bool]
    configuration: CriticalConfiguration
    deformation_gradient: Array
    free: Array
    taut: NDArray[np.bool_]
    stress: Array
    normal: Array
    gradient: Array

    @property
    def network(self) -> Network:
        """The network with its boundary deformed to the onset."""
        return self.configuration.network

    @property
    def taut_edges(self) -> NDArray[np.intp]:
        """The edges that are taut first, those of the largest tension before others."""
        edges = np.flatnonzero(self.taut)
        return edges[np.argsort(-self.configuration.tensions[edges], kind="stable")]

    @property
    def exact_for(self) -> str:
        """ "springs" where every edge is taut, else "cables": springs that resist compression may stiffen earlier."""
        return "springs" if self.taut.all() else "cables"

    @cached_property
    def backbone(self) -> Backbone:
        """The taut edges as networks of their own."""
        return backbone(self.configuration)


@dataclass(frozen=True, eq=False, kw_only=True)
class Onset(Solution[CriticalStrain]):
    """The onset of rigidity on a path; `stats.steps` counts interior-point iterations.

    programs      cone programs
    newton_steps  steps of Newton's method on the taut edges
    """

    programs: int = 0
    newton_steps: int = 0

    @property
    def strain(self) -> float:
        """γ_c; NaN without an onset."""
        return self.value.strain

    @property
    def lower(self) -> float:
        """Lower bound of γ_c."""
        return self.value.lower

    @property
    def upper(self) -> float:
        """Upper bound of γ_c."""
        return self.value.upper

    @property
    def configuration(self) -> CriticalConfiguration:
        """The critical configuration on the deformed network."""
        return self.value.configuration

    @property
    def taut_edges(self) -> NDArray[np.intp]:
        """The edges that are taut first."""
        return self.value.taut_edges

    @property
    def stress(self) -> Array:
        """Macroscopic stress Σσ L⊗L over its trace, (d, d)."""
        return self.value.stress

    @property
    def length_gradient(self) -> Array:
        """dγ_c/dℓ, (N_b,)."""
        return self.value.gradient

    @property
    def exact_for(self) -> str:
        """The springs that share this onset: "springs" of either sign of force, or "cables" only."""
        return self.value.exact_for

    @property
    def backbone(self) -> Backbone:
        """The taut edges as networks of their own."""
        return self.value.backbone


@checked
def critical_strain(
    network: Network,
    rest_lengths: ArrayLike,
    deformation: Deformable = "dilation",
    *,
    direction: int = 1,
    throw: bool = True,
) -> Onset:
    """The strain γ_c at which a floppy network of rest lengths ℓ (N_b,) becomes rigid: t(F(γ_c)) = 1.

    deformation  name, matrix A for F = 1 + γA, function γ → F, or `Deformation`, which may have free components
    direction    1 for γ_c > 0, −1 for γ_c < 0

    Exact for cables, which resist extension only, and for springs where `value.exact_for` is "springs".  On paths
    linear in γ the onset is unique; on others it is the one that Newton's method reaches from γ = 0.
    Error bound (proof): `value.lower` and `value.upper` where `value.proven`; the network is floppy at the one of
    smaller |γ| and rigid at the other, and `stats.error_bound` is their distance.  Error bound (estimate): elsewhere.
    Free normal components of the cell are not unique, since cables resist no compression: the cell changes about as
    little as γ_c permits.

    Raises `InputError` for bad arguments, `SolveError` where no onset exists: `Status.rigid` at γ = 0 already,
    `Status.floppy` on the whole path, or up to a flat cell.  `Status.stalled`: the bounds differ by more than 1e-9,
    one is an estimate, or forces of taut edges balance to less than 1e-9.

    >>> import critflow as cf
    >>> import numpy as np
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> onset = cf.critical_strain(network, 1.1 * cf.optimize(network, 'length_variance').value.lengths)
    >>> round(onset.strain, 6)  # (1.1)² − 1 of the area
    0.21
    """
    lengths = edge_values(rest_lengths, network.n_edges, "rest_lengths")
    if direction not in (1, -1):
        raise InputError(f"the direction of the strain is 1 or -1, not {direction!r}")
    path = BoundaryPath(network, deformation_of(deformation, network.dimension), direction)
    interior = floppy_start(path, lengths)
    if interior is None:
        found = Search(None, Status.rigid, "the network is rigid at strain zero already: lengthen its rest lengths")
    else:
        found = search_onset(path, lengths)
    if interior is None or found.state is None:
        onset = _without_onset(path, found)
    else:
        onset = _polished(path, lengths, found, found.state, interior)
    return onset.or_raise(f"no onset of rigidity under {path.deformation.name}") if throw else onset


def _polished(path: BoundaryPath, lengths: Array, found: Search, start: OnsetState, interior: Interior) -> Onset:
    state = settled(path, lengths, polish_taut(path, lengths, start))
    if not resolved(path, lengths, state) and (central := follow_central_path(path, lengths, start)) is not None:
        state, start = settled(path, lengths, polish_taut(path, lengths, central)), central
        if not resolved(path, lengths, state):
            state = without_slack_stress(path, lengths, central)
    bounds = onset_bounds(path, lengths, state, start, interior)
    gap = bounds.upper - bounds.lower
    status, note = Status.ok, ""
    if not gap <= ONSET_GAP * (1 + state.strain):
        if path.has_free_sides and np.linalg.det(path.gradient(state.strain, state.free)) < NARROW:
            # The taut chain winds around the free side as well, and is straight only where that has no length.
            return _without_onset(path, replace(found, status=Status.floppy, note=SIDES_MEET))
        status, note = Status.stalled, f"the bounds on the strain differ by {gap:.1g}: see `lower` and `upper`"
    elif not state.error < FITTED:
        status = Status.stalled
        note = "the bounds on the strain hold, but the weakest stresses were not separated from slack edges"
    elif not all(bounds.proven):
        status, note = (
            Status.stalled,
            "a bound on the strain is only an estimate: see `value.proven`",
        )
    return Onset(
        value=_value(path, lengths, state, bounds),
        status=status,
        stats=Stats("conic", found.steps, residual=state.error, error_bound=gap),
        note=note,
        programs=found.programs,
        newton_steps=state.steps,
    )


def _value(path: BoundaryPath, lengths: Array, state: OnsetState, bounds: StrainBounds) -> CriticalStrain:
    network, sign = path.network, path.direction
    F = path.gradient(state.strain, state.free)
    deformed = network.deformed(F)
    configuration = critical_configuration(deformed, state.sigma, deformed.all_coordinates(state.coordinates))
    sigma, L = configuration.sigma, configuration.bond_vectors
    virial = float(np.sum(configuration.tensions * configuration.lengths))
    normal = np.einsum("a,ai,aj->ij", sigma, L, network.boundary_vectors) / virial
    rate = float(np.sum(normal * path.rates(state.strain, state.free)[-1]))
    low, high = (bounds.lower, bounds.upper) if sign > 0 else (-bounds.upper, -bounds.lower)
    sure = bounds.proven if sign > 0 else (bounds.proven[1], bounds.proven[0])
    return CriticalStrain(
        strain=sign * state.strain,
        lower=low,
        upper=high,
        proven=sure,
        configuration=configuration,
        deformation_gradient=F,
        free=state.free,
        taut=sigma > 0,
        stress=np.einsum("a,ai,aj->ij", sigma, L, L) / virial,
        normal=normal,
        gradient=sign * configuration.tensions / (virial * rate),
    )


def _without_onset(path: BoundaryPath, found: Search) -> Onset:
    network, nothing = path.network, np.full((path.network.dimension,) * 2, np.nan)
    value = CriticalStrain(
        strain=np.nan,
        lower=np.nan,
        upper=np.nan,
        proven=(False, False),
        configuration=unknown_configuration(network),
        deformation_gradient=nothing,
        free=np.full(path.n_free, np.nan),
        taut=np.zeros(network.n_edges, bool),
        stress=nothing,
        normal=nothing,
        gradient=np.full(network.n_edges, np.nan),
    )
    return Onset(
        value=value, status=found.status, stats=Stats("conic", found.steps), note=found.note, programs=found.programs
    )
