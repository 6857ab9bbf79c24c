"""The onset of rigidity: the strain at which a floppy network of given rest lengths becomes rigid on a path.

For boundaries b → F b and rest lengths ℓ let t(F) = min_x max_α |F b_α + (g x)_α| / ℓ_α, which is convex in F.  Cables
are floppy where t < 1 and rigid where t > 1.  The onset is the largest strain with t(F(γ)) ≤ 1:

1. Coordinates with all |L| < ℓ show that the network is floppy at γ = 0 (`search.floppy_start`).
2. The iteration of `length_iteration` finds γ_c roughly where all edges are taut, which Newton's method confirms; else
   cone programs on linearised boundaries find it to 1e-10 and a guess of the taut edges (`search.search_onset`).
3. Newton's method on the taut edges gives the critical configuration to rounding: forces f_α = σ_α L_α in balance,
   |L_α| = ℓ_α where σ_α > 0 (`taut_set.polish_taut`).
4. Where tensions are too weak to be told from slack, the central path separates them, and step 3 starts from its end;
   if that fails too, its end without the stresses of slack edges is the answer (`taut_set.follow_central_path`).
5. A floppy configuration below γ_c and balanced forces above it are bounds (`bounds.onset_bounds`).

With Σ |f_α| ℓ_α = 1 the derivatives of t are the macroscopic stress, ∂t/∂F_ij = Σ f_αi b_αj, and ∂t/∂ℓ_α = −|f_α|.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from critflow.arguments import checked
from critflow.certificates.counts import rigidity
from critflow.critical.backbone import Backbone, backbone
from critflow.critical.manifold import CriticalConfiguration, CriticalManifold, critical_configuration
from critflow.extras.cables.bounds import StrainBounds, onset_bounds
from critflow.extras.cables.search import (
    ONSET_CONE,
    SIDES_MEET,
    Interior,
    NotFloppy,
    Search,
    floppy_start,
    search_onset,
)
from critflow.lengths.boundary_path import BoundaryPath
from critflow.lengths.length_iteration import NEAR, iterate_lengths, mean_strain
from critflow.lengths.taut_edges import FITTED, OnsetState, newton_taut, unknown_configuration
from critflow.lengths.taut_set import (
    follow_central_path,
    polish_taut,
    resolved,
    settled,
    stressed,
    without_slack_stress,
)
from critflow.networks.checks import edge_values
from critflow.networks.deformation import Deformable, deformation_of
from critflow.networks.network import Array, Network
from critflow.result import InputError, Record, Solution, Stats, Status

ONSET_GAP = 1e-9  # largest gap of the bounds on a strain with status `ok`, relative to 1 + |γ|
# det F of a cell with free sides at which an onset without bounds is that of a flat cell: the program with ROUGH_CONE
# leaves a tilt of about its root.
NARROW = 0.02
UNRESOLVED = "the bounds on the strain hold, but the weakest stresses were not separated from slack edges"
ESTIMATED = "a bound on the strain is only an estimate: see `proven`"


@dataclass(frozen=True, eq=False, repr=False)
class CriticalStrain(Record):
    """The onset of rigidity on a path of deformations.

    strain                γ_c; NaN without an onset
    lower, upper          bounds on γ_c: floppy on one side, rigid on the other
    proven                whether the bounds (lower, upper) are proofs; else they are estimates
    configuration         critical configuration of cables on the deformed network, σ = 0 on slack edges
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

    @cached_property
    def backbone(self) -> Backbone:
        """The taut edges as networks of their own."""
        return backbone(self.configuration)

    def tolerance(self, error: float) -> float:
        """Standard deviation of γ_c for independent errors of the rest lengths, s|dγ_c/dℓ|."""
        return error * float(np.linalg.norm(self.gradient))

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


@checked
def critical_strain(
    network: Network | CriticalManifold,
    rest_lengths: ArrayLike,
    deformation: Deformable = "dilation",
    *,
    direction: int = 1,
    throw: bool = True,
) -> Solution[CriticalStrain]:
    """The strain γ_c at which a floppy network of rest lengths ℓ (N_b,) becomes rigid: t(F(γ_c)) = 1.

    deformation  name, matrix A for F = 1 + γA, function γ → F, or `Deformation`, which may have free components
    direction    1 for γ_c > 0, −1 for γ_c < 0

    Exact for cables, which resist extension only, and for springs where `valid_for_springs`.  On paths linear in γ the
    onset is unique; on others it is the one that Newton's method reaches from γ = 0.  `stats.steps` counts
    interior-point iterations.
    Error bound (proof): `lower` and `upper` where `proven`; the network is floppy at the one of smaller |γ| and rigid
    at the other, and `stats.error_bound` is their distance.  Error bound (estimate): elsewhere.
    Free normal components of the cell are not unique, since cables resist no compression: the cell changes about as
    little as γ_c permits.

    Raises `InputError` for bad arguments, `SolveError` where no onset exists: `Status.rigid` at γ = 0 already (proof),
    `Status.undecided` there within rounding, with the relative change of the rest lengths that decides (proof) where
    the network is at its transition, `Status.floppy` on the whole path, or up to a flat cell.
    `Status.stalled`: the bounds differ by more than 1e-9, one is an estimate, or forces of taut edges balance to less
    than 1e-9; the strain and its bounds are given.

    >>> import critflow as cf
    >>> import numpy as np
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> onset = cf.critical_strain(network, 1.1 * cf.optimize(network, 'length_variance').value.lengths)
    >>> round(onset.strain, 6)  # (1.1)² − 1 of the area
    0.21
    """
    manifold = CriticalManifold.of(network)
    network = manifold.network
    lengths = edge_values(rest_lengths, network.n_edges, "rest_lengths")
    if direction not in (1, -1):
        raise InputError(f"the direction of the strain is 1 or -1, not {direction!r}")
    path = BoundaryPath(manifold, deformation_of(deformation, network.dimension), direction)
    interior = floppy_start(path, lengths)
    if isinstance(interior, NotFloppy):
        nothing = Search(0.0, np.zeros(path.n_free), ONSET_CONE, path.linear)
        onset = _without_onset(path, nothing.without_onset(*interior))
    else:
        onset = _onset(path, lengths, interior)
    known = "an onset known to the bounds alone" if np.isfinite(onset.value.strain) else "no onset of rigidity"
    return onset.or_raise(f"{known} under {path.deformation.name}") if throw else onset


def _onset(path: BoundaryPath, lengths: Array, interior: Interior) -> Solution[CriticalStrain]:
    """The onset of a network that is floppy at strain zero, with bounds on its strain and its status."""
    found = _from_iteration(path, lengths)
    search = found[0] if found else search_onset(path, lengths)
    if search.state is None:
        return _without_onset(path, search)
    state, bounds = _bounded(path, lengths, interior, search, found[1] if found else None)
    if _wide(bounds, state) and path.has_free_shears:
        there = replace(path, sheared=True)
        other, narrower = _bounded(there, lengths, interior, search)
        state, bounds = (state, bounds) if _wide(narrower, other) else (other, narrower)
    gap, wide = bounds.upper - bounds.lower, _wide(bounds, state)
    unproven = wide or not all(bounds.proven)
    if unproven and path.has_free_sides and np.linalg.det(path.gradient(state.strain, state.free)) < NARROW:
        # The taut chain winds around the free side as well, and is straight only where that has no length.
        return _without_onset(path, search.without_onset(Status.floppy, SIDES_MEET))
    reasons = {
        f"it lies between {bounds.lower:.12g} and {bounds.upper:.12g}, which differ by {gap:.1g}": wide,
        UNRESOLVED: not state.error < FITTED,
        ESTIMATED: not all(bounds.proven),
    }
    note = next((reason for reason, holds in reasons.items() if holds), "")
    status = Status.stalled if note else Status.ok
    return _measured(path, lengths, state, bounds, replace(search, status=status, note=note))


def _bounded(
    path: BoundaryPath, lengths: Array, interior: Interior, search: Search, state: OnsetState | None = None
) -> tuple[OnsetState, StrainBounds]:
    """The state at the end of a search, resolved unless it is given, and bounds on its strain."""
    assert search.state is not None
    state, origin = (state, search.state) if state else _resolved(path, lengths, search.state)
    return state, onset_bounds(path, lengths, state, origin, interior)


def _wide(bounds: StrainBounds, state: OnsetState) -> bool:
    return not bounds.upper - bounds.lower <= ONSET_GAP * (1 + state.strain)


def _from_iteration(path: BoundaryPath, lengths: Array) -> tuple[Search, OnsetState] | None:
    """The onset where every edge is taut, from the iteration for lengths; None where Newton's method rejects it.

    At each step the strain is that at which the mean of log(|L|/ℓ) vanishes.
    """
    if path.n_free:
        return None
    strain, q = 0.0, np.zeros(0)

    def deformed(L: Array) -> Array:
        nonlocal strain
        strain = mean_strain(path, lengths, L, strain)
        return L @ path.gradient(strain, q).T if np.isfinite(strain) else np.full_like(L, np.nan)

    for balance, deviation in iterate_lengths(path.manifold, lengths, deformed):
        if deviation < NEAR:
            x = balance.coordinates @ path.gradient(strain, q).T
            start = OnsetState(strain, q, x, balance.sigma, np.ones(len(lengths), bool))
            state = newton_taut(path, lengths, start)
            if state is None or not (state.error < FITTED and state.strain > 0 and stressed(state).all()):
                return None
            return Search(strain, q, ONSET_CONE, accurate=True, ended=True, state=start), state
    return None


def _resolved(path: BoundaryPath, lengths: Array, start: OnsetState) -> tuple[OnsetState, OnsetState]:
    """The state whose weakest tensions are told from slack, and the one from which it was reached (steps 3 and 4)."""
    state = settled(path, lengths, polish_taut(path, lengths, start))
    if resolved(path, lengths, state):
        return state, start
    central = follow_central_path(path, lengths, start)
    if central is None:
        return state, start
    state = settled(path, lengths, polish_taut(path, lengths, central))
    if not resolved(path, lengths, state):
        state = without_slack_stress(path, lengths, central)
    return state, central


def _measured(
    path: BoundaryPath, lengths: Array, state: OnsetState, bounds: StrainBounds, search: Search
) -> Solution[CriticalStrain]:
    """The onset at a state, with the stress and the derivatives of its strain."""
    network, sign = path.network, path.direction
    F = path.gradient(state.strain, state.free)
    deformed = network.deformed(F)
    value = critical_configuration(deformed, state.sigma, deformed.all_coordinates(state.coordinates))
    sigma, L, taut = value.sigma, value.bond_vectors, value.sigma > 0
    virial = float(np.sum(value.tensions * value.lengths))
    normal = np.einsum("a,ai,aj->ij", sigma, L, network.boundary_vectors) / virial
    # Forces of collapsed edges alone do no work: derivatives are then unknown.
    rate = float(np.sum(normal * path.rates(state.strain, state.free)[-1])) or np.nan
    lower, upper = (bounds.lower, bounds.upper) if sign > 0 else (-bounds.upper, -bounds.lower)
    onset = CriticalStrain(
        strain=sign * state.strain,
        lower=lower,
        upper=upper,
        proven=bounds.proven if sign > 0 else (bounds.proven[1], bounds.proven[0]),
        configuration=replace(value, rest_lengths=np.where(taut, value.lengths, lengths)),
        deformation_gradient=F,
        free=state.free,
        taut=taut,
        stress=np.einsum("a,ai,aj->ij", sigma, L, L) / virial,
        normal=normal,
        gradient=sign * value.tensions / (virial * rate),
    )
    stats = Stats("conic", search.steps, residual=state.error, error_bound=upper - lower)
    return Solution(onset, search.status, stats, search.note)


def _without_onset(path: BoundaryPath, search: Search) -> Solution[CriticalStrain]:
    network, nothing = path.network, np.full((path.network.dimension,) * 2, np.nan)
    onset = CriticalStrain(
        *(np.nan, np.nan, np.nan, (False, False)),
        configuration=unknown_configuration(network),
        deformation_gradient=nothing,
        free=np.full(path.n_free, np.nan),
        taut=np.zeros(network.n_edges, bool),
        stress=nothing,
        normal=nothing,
        gradient=np.full(network.n_edges, np.nan),
    )
    return Solution(onset, search.status, Stats("conic", search.steps), search.note)
