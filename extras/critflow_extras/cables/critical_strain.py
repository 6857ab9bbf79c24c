"""The onset of rigidity: the strain at which a floppy network of given rest lengths becomes rigid on a path.

For boundaries b → F b and rest lengths ℓ let t(F) = min_x max_α |F b_α + (g x)_α| / ℓ_α, which is convex in F.  Cables
are floppy where t < 1 and rigid where t > 1.  The onset is the largest strain with t(F(γ)) ≤ 1:

1. Coordinates with all |L| < ℓ show that the network is floppy at γ = 0 (`search.floppy_start`).
2. The iteration of `length_iteration` finds γ_c roughly where all edges are taut, which Newton's method confirms
   (`all_taut`); else cone programs on linearised boundaries find it to 1e-10 and a guess of the taut edges
   (`search.search_onset`).
3. Newton's method on the taut edges gives the critical configuration to rounding: forces f_α = σ_α L_α in balance,
   |L_α| = ℓ_α where σ_α > 0 (`taut_set.polish_taut`).
4. Where tensions are too weak to be told from slack, the central path separates them, and step 3 starts from its end;
   if that fails too, its end without the stresses of slack edges is the answer (`central_path`).
5. A floppy configuration below γ_c and balanced forces above it are bounds (`bounds.onset_bounds`).
6. Status and note say how the search ends (table in `onset_end`).

With Σ |f_α| ℓ_α = 1 the derivatives of t are the macroscopic stress, ∂t/∂F_ij = Σ f_αi b_αj, and ∂t/∂ℓ_α = −|f_α|.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import edge_values, of_kind
from critflow.calls import running
from critflow.deformation import Deformable, deformation_of
from critflow.manifold import CriticalManifold
from critflow.networks import Array, Network
from critflow.result import InputError, Solution, Status
from critflow.taut_edges import OnsetState, polish_taut, resolved, settled
from critflow_extras.cables.all_taut import all_taut_onset
from critflow_extras.cables.boundary_path import BoundaryPath
from critflow_extras.cables.bounds import onset_bounds
from critflow_extras.cables.central_path import follow_central_path, without_slack_stress
from critflow_extras.cables.onset_end import SIDES_MEET, CriticalStrain, onset_at, wide, without_onset
from critflow_extras.cables.search import Interior, NotFloppy, floppy_start, search_onset

# det F of a cell with free sides at which an onset without bounds is that of a flat cell: the program with ROUGH_CONE
# leaves a tilt of about its root.
NARROW = 0.02


@running("critical_strain")
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
    >>> import critflow_extras as ce
    >>> import numpy as np
    >>> network = cf.voronoi_network(n_vertices=20, seed=1)
    >>> onset = ce.critical_strain(network, 1.1 * cf.optimize(network, 'V_L').value.lengths)
    >>> round(onset.value.strain, 6)  # (1.1)² − 1 of the area
    0.21
    """
    network = of_kind(Network, CriticalManifold, network=network)
    of_kind(np.ndarray, rest_lengths=rest_lengths)
    direction = of_kind(int, direction=direction)
    of_kind(bool, throw=throw)
    manifold = CriticalManifold.of(network)
    network = manifold.network
    lengths = edge_values(rest_lengths, network.n_edges, "rest_lengths")
    if direction not in (1, -1):
        raise InputError(f"the direction of the strain is 1 or -1, not {direction!r}")
    path = BoundaryPath(manifold, deformation_of(deformation, network.dimension), direction)
    interior = floppy_start(path, lengths)
    if isinstance(interior, NotFloppy):
        onset = without_onset(path, interior.status, interior.note)
    else:
        onset = _onset(path, lengths, interior)
    known = "an onset known to the bounds alone" if np.isfinite(onset.value.strain) else "no onset of rigidity"
    return onset.or_raise(f"{known} under {path.deformation.name}") if throw else onset


def _onset(path: BoundaryPath, lengths: Array, interior: Interior) -> Solution[CriticalStrain]:
    """The onset of a network that is floppy at strain zero (steps 2 to 5)."""
    onset = all_taut_onset(path, lengths)
    if onset is not None:
        bounds = onset_bounds(path, lengths, onset.state, onset.start, interior)
        return onset_at(path, lengths, onset.state, bounds, steps=0)
    search = search_onset(path, lengths)
    if search.state is None:
        return without_onset(path, search.status, search.note, search.steps)
    state, origin = _resolved(path, lengths, search.state)
    bounds = onset_bounds(path, lengths, state, origin, interior)
    if wide(bounds, state) and path.has_free_shears:
        sheared = replace(path, sheared=True)
        there, origin = _resolved(sheared, lengths, search.state)
        narrower = onset_bounds(sheared, lengths, there, origin, interior)
        if not wide(narrower, there):
            state, bounds = there, narrower
    unproven = wide(bounds, state) or not all(bounds.proven)
    if unproven and path.has_free_sides and np.linalg.det(path.gradient(state.strain, state.free)) < NARROW:
        # The taut chain winds around the free side as well, and is straight only where that has no length.
        return without_onset(path, Status.floppy, SIDES_MEET, search.steps)
    return onset_at(path, lengths, state, bounds, search.steps)


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
