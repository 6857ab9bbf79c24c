"""Rest lengths for a prescribed onset of rigidity, by the exact gradient dγ_c/dℓ of the cone program.

With λ = log ℓ and g = dγ_c/dλ the nearest rest lengths satisfy λ − λ_0 ∝ g.  A step towards them at the linearised
onset is λ ← λ_0 + g (γ* − γ_c + g·(λ − λ_0))/|g|²; where the set of taut edges changes at every step it need not
converge, and shortest steps λ ← λ + g (γ* − γ_c)/|g|² follow.  Rest lengths in given ratios need no iteration: t ℓ has
the onset γ*, with t of the cone program at F(γ*).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from critflow.arguments import checked
from critflow.networks.checks import edge_values
from critflow.networks.deformation import Deformable, Deformation, deformation_of
from critflow.networks.network import Array, Network
from critflow.onset.critical_strain import Onset, critical_strain
from critflow.onset.from_lengths import critical_from_lengths
from critflow.result import InputError, Solution, Stats, Status

ONSET_REACHED = 1e-10  # error of the strain of a designed onset

# Steps towards the nearest lengths and steps in all; largest change of log ℓ in one.
_NEAREST, _MOST_STEPS, _LONGEST = 20, 40, 0.2
# Change of log ℓ below which lengths are the nearest.
_SETTLED = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class OnsetDesign(Solution[Onset]):
    """Rest lengths with a prescribed onset, and the onset itself.

    rest_lengths  ℓ (N_b,)
    strain        γ_c, with its bounds in `value.lower` and `value.upper`
    distance      root mean square of log ℓ − log ℓ_0
    nearest       whether λ − λ_0 ∝ dγ_c/dλ: the first-order condition of the least distance
    multiplier    cost of the target: derivative of ½|λ − λ_0|² by γ*, or the same at constant ratios
    """

    rest_lengths: Array = field(repr=False)
    strain: float
    distance: float
    nearest: bool
    multiplier: float


@checked
def design_onset(
    network: Network,
    rest_lengths: ArrayLike,
    strain: float,
    deformation: Deformable = "simple_shear",
    *,
    prefer: str = "least_change",
    throw: bool = True,
) -> OnsetDesign:
    """Rest lengths whose onset of rigidity on a path of deformations is a given strain γ*.

    rest_lengths  ℓ_0 (N_b,) to begin with
    strain        γ* of either sign, not zero
    prefer        "least_change" of log ℓ, or "ratios": all rest lengths times one factor

    `stats.residual` is |γ_c − γ*|.  The least change is local.  Exact for cables, and for springs where
    `value.valid_for_springs`.  Error bound (proof): `value.lower` and `value.upper` where `value.proven`.
    `Status.infeasible` where no rest lengths in the ratios of ℓ_0 are floppy at strain zero and rigid at γ*, with their
    onset as the best compromise.  Raises `InputError` for bad arguments, `SolveError` with `throw`.
    """
    start = edge_values(rest_lengths, network.n_edges, "rest_lengths")
    if not (np.isfinite(strain) and strain != 0):
        raise InputError(f"the strain of the onset must be a number other than zero, not {strain}")
    if prefer not in ("least_change", "ratios"):
        raise InputError(f"no preference is called {prefer!r:.40}: choose 'least_change' or 'ratios'")
    search = _Search(network, deformation_of(deformation, network.dimension), float(strain), np.log(start))
    found = search.nearest() if prefer == "least_change" else None
    if found is None:
        found = search.scaled()
    return found.or_raise("no rest lengths with this onset were found") if throw else found


class _Search:
    """The onset as a function of λ = log ℓ."""

    def __init__(self, network: Network, path: Deformation, strain: float, origin: Array):
        self.network, self.path, self.strain, self.origin = network, path, strain, origin
        self.steps = 0

    def onset(self, log_lengths: Array) -> Onset:
        self.steps += 1
        direction = 1 if self.strain > 0 else -1
        return critical_strain(self.network, np.exp(log_lengths), self.path, direction=direction, throw=False)

    def nearest(self) -> OnsetDesign | None:
        """The design nearest to the origin; None where steps do not converge."""
        here, last = self.origin, np.inf
        onset = self.onset(here)
        if not np.isfinite(onset.strain):
            here = self._ratio() + self.origin
            onset = self.onset(here)
        part = 1.0
        while np.isfinite(onset.strain) and self.steps < _MOST_STEPS:
            error = self.strain - onset.strain
            g = np.exp(here) * onset.length_gradient
            restoring = g * (error / float(g @ g))
            change = here - self.origin
            tangent = g * (float(g @ change) / float(g @ g)) - change
            size = float(np.abs(tangent).max())
            if abs(error) <= ONSET_REACHED and (size < _SETTLED or self.steps > _NEAREST):
                return self._design(here, onset, g, size < _SETTLED)
            # Tangents that grow show curvature, or a set of taut edges that changes.
            part = 0.5 * part if size > last else part
            step = restoring + (part * tangent if self.steps <= _NEAREST else 0)
            step *= min(1.0, _LONGEST / max(float(np.abs(step).max()), 1e-300))
            onset, last = self.onset(here + step), size
            while not np.isfinite(onset.strain) and self.steps < _MOST_STEPS:
                step *= 0.3
                onset = self.onset(here + step)
            here = here + step
        return None

    def scaled(self) -> OnsetDesign:
        """The design in the ratios of the origin."""
        here = self.origin + self._ratio()
        onset = self.onset(here)
        for _ in range(3):
            error = self.strain - onset.strain
            if not abs(error) > ONSET_REACHED or not np.isfinite(onset.strain):
                break
            here = here + error / float(np.exp(here) @ onset.length_gradient)
            onset = self.onset(here)
        return self._design(here, onset, np.ones_like(here), False)

    def _ratio(self) -> float:
        """log t at F(γ*)."""
        deformed = self.network.deformed(self.path.gradient(self.strain))
        return float(np.log(critical_from_lengths(deformed, np.exp(self.origin), throw=False).ratio))

    def _design(self, here: Array, onset: Onset, direction: Array, nearest: bool) -> OnsetDesign:
        error = abs(onset.strain - self.strain)
        status, note = onset.status, onset.note
        if not error <= ONSET_REACHED:
            status = Status.infeasible
            note = "no rest lengths in these ratios are floppy at strain zero and become rigid at this strain"
        g = np.exp(here) * onset.length_gradient
        return OnsetDesign(
            value=onset,
            status=status,
            stats=Stats("newton", self.steps, error, error_bound=onset.upper - onset.lower),
            note=note,
            rest_lengths=np.exp(here),
            strain=onset.strain,
            distance=float(np.sqrt(np.mean((here - self.origin) ** 2))),
            nearest=nearest,
            multiplier=float(direction @ (here - self.origin)) / float(g @ direction),
        )
