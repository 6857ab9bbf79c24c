"""The state of a page: a critical configuration, the changes that led to it, undo and redo; no web.

A change is a tuple of a name and plain numbers, so that the list of changes is a recipe: the lines of Python of
`script` repeat it to the last digit.  The stress is always the state: each change makes a new σ, and the configuration
is the solve of that σ with its error bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from critflow.isogonal import IsogonalModes, face_modes
from critflow.manifold import CriticalConfiguration
from critflow.networks import Array
from critflow.paths import StrainPath, strain_path
from critflow.result import InputError, Solution
from critflow.springs import SpringState
from critflow_extras.explore.model import POPULATIONS, Model, Observer
from critflow_extras.explore.source import Source
from critflow_extras.pruning.pruning import pruned

Change = tuple[Any, ...]
# Largest |change of log σ| of an edge, and largest |γ|.
STEEPEST, LARGEST_STRAIN = 12.0, {"dilation": 0.5, "simple_shear": 1.0, "pure_shear": 1.0}
# Oldest states are forgotten beyond this number.
_MEMORY = 200
# Vertices of all strained states that are kept, about 200 MB: 400 states of 1,000 vertices, 20 of the largest network.
_STRAINED = 400_000


@dataclass(frozen=True, eq=False)
class State:
    """One state of the page.

    change  the change that led to it from the state before
    strain  deformation and γ past the transition, and the springs there; None at the transition
    given   coordinates (N_v, d) of a file that is not critical, shown with springs at rest until the first change
    """

    model: Model
    critical: CriticalConfiguration
    change: Change = ("start",)
    strain: tuple[str, float] | None = None
    springs: SpringState | None = None
    given: Array | None = None

    def path(self, moduli: bool) -> Solution[StrainPath] | None:
        """The path from the transition to the strain, or None at the transition."""
        if self.strain is None:
            return None
        deformation, gamma = self.strain
        return strain_path(
            self.critical,
            [gamma],
            deformation=deformation,
            measure="moduli" if moduli else "energy",
            throw=False,
        )


class Session:
    """A history of states of one source; `state` is the current one.

    remark   what the source says about the positions of its file
    observe  called by long computations with the number of the step; a true value stops them
    """

    def __init__(self, source: Source, observe: Observer = lambda step: False):
        self.source, self.observe = source, observe
        opening = source.open()
        self.remark = opening.remark
        self._states, self._now = [State(opening.model, opening.critical, given=opening.given)], 0
        self._modes: tuple[CriticalConfiguration, IsogonalModes] | None = None
        self._strained: tuple[CriticalConfiguration, dict[tuple[str, float], SpringState]] | None = None

    @property
    def start(self) -> State:
        return self._states[0]

    @property
    def state(self) -> State:
        return self._states[self._now]

    @property
    def before(self) -> State:
        """The state before the last change, or the first one."""
        return self._states[max(self._now - 1, 0)]

    @property
    def can_undo(self) -> bool:
        return self._now > 0

    @property
    def can_redo(self) -> bool:
        return self._now + 1 < len(self._states)

    def undo(self) -> None:
        self._now -= self.can_undo

    def redo(self) -> None:
        self._now += self.can_redo

    def apply(self, change: Sequence[Any]) -> State:
        """Make a change, or move the last one on if both are positions of one slider.

        Raises `InputError` or `SolveError` where the change has no configuration; the state is then as before.
        """
        change = _typed(change)
        slider = _slider(change)
        moves_on = slider is not None and slider == _slider(self.state.change)
        base = self.before if moves_on else self.state
        method, _ = _CHANGES[change[0]]
        state = replace(method(self, base, *change[1:]), change=change)
        self._states = [*self._states[: self._now + (not moves_on)], state]
        if len(self._states) > _MEMORY:
            del self._states[1]
        self._now = len(self._states) - 1
        return state

    def modes(self, base: State) -> IsogonalModes:
        """The isogonal modes of a state, computed once while a face moves on from it."""
        if self._modes is None or self._modes[0] is not base.critical:
            self._modes = base.critical, face_modes(base.critical)
        return self._modes[1]

    def recipe(self) -> list[Change]:
        """The changes that lead from the source to the state, without those that later ones overrule."""
        changes = [state.change for state in self._states[1 : self._now + 1]]
        first = max((n for n, change in enumerate(changes) if change[0] in _NEW_STRESS), default=0)
        last = len(changes) - 1
        return [
            change
            for n, change in enumerate(changes)
            if (n >= first or change[0] == "cut") and (change[0] != "strain" or n == last)
        ]

    def _population(self, base: State, name: str) -> State:
        return _solved(base.model, base.model.population(name, self.observe))

    def _equal_stress(self, base: State) -> State:
        return _solved(base.model, base.model.network.stiffness)

    def _blend(self, base: State, *weights: float) -> State:
        parts = {
            name: _within("a weight", weight, 0, 1) for name, weight in zip(POPULATIONS, weights, strict=True) if weight
        }
        if not parts:
            raise InputError("a blend needs a weight above zero: raise one of its sliders")
        stresses = (part * base.model.population(name, self.observe) for name, part in parts.items())
        return _solved(base.model, sum(stresses))

    def _edge(self, base: State, edge: int, change: float) -> State:
        n_edges = base.critical.network.n_edges
        check_index("edge", edge, n_edges)
        _within("the change of log σ", change, -STEEPEST, STEEPEST)
        return _solved(base.model, base.critical.sigma * np.exp(change * (np.arange(n_edges) == edge)))

    def _face(self, base: State, face: int, amplitude: float) -> State:
        modes = self.modes(base)
        n_faces = modes.elongations.shape[0]
        check_index("face", face, n_faces)
        _within("the amplitude", amplitude, -np.inf, np.inf)
        return _solved(base.model, modes.walk(amplitude * (np.arange(n_faces) == face)).sigma)

    def _cut(self, base: State, edge: int) -> State:
        network = base.critical.network
        check_index("edge", edge, network.n_edges)
        part = pruned(network, np.arange(network.n_edges) != edge)
        return _solved(Model(part.network, base.model.seed), base.critical.sigma[part.edges])

    def _strain(self, base: State, deformation: str, gamma: float) -> State:
        if deformation not in LARGEST_STRAIN:
            raise InputError(f"the page knows no strain {deformation!r:.40}: choose from {', '.join(LARGEST_STRAIN)}")
        _within("the strain", gamma, -LARGEST_STRAIN[deformation], LARGEST_STRAIN[deformation])
        if gamma == 0:
            return replace(base, strain=None, springs=None, given=None)
        strained = replace(base, strain=(deformation, gamma), springs=None, given=None)
        return replace(strained, springs=self._springs(strained))

    def _springs(self, strained: State) -> SpringState:
        """The springs past the transition, computed once for each strain of a configuration: a path is played often."""
        if self._strained is None or self._strained[0] is not strained.critical:
            self._strained = strained.critical, {}
        known, strain = self._strained[1], strained.strain
        assert strain is not None
        if strain not in known:
            path = strained.path(moduli=False)
            assert path is not None
            path.or_raise("the strain path stopped")
            if len(known) * strained.model.network.n_vertices > _STRAINED:
                del known[next(iter(known))]
            known[strain] = path.value.states[-1]
        return known[strain]


# Changes that overrule all stresses before them.
_NEW_STRESS = ("population", "blend", "equal_stress")
# The method of each change, with the types of its values.
_CHANGES: dict[str, tuple[Callable[..., State], tuple[type, ...]]] = {
    "population": (Session._population, (str,)),
    "equal_stress": (Session._equal_stress, ()),
    "blend": (Session._blend, (float,) * len(POPULATIONS)),
    "edge": (Session._edge, (int, float)),
    "face": (Session._face, (int, float)),
    "cut": (Session._cut, (int,)),
    "strain": (Session._strain, (str, float)),
}


def _solved(model: Model, stress: Any) -> State:
    return State(model, model.manifold.configuration(stress))


def _slider(change: Change) -> Change | None:
    """The slider that a change belongs to, or None for a button."""
    return {"edge": change[:2], "face": change[:2], "blend": change[:1], "strain": change[:1]}.get(change[0])


def _typed(change: Sequence[Any]) -> Change:
    """A change from a message, its values as numbers and words."""
    try:
        name, *values = change
        return name, *(kind(value) for kind, value in zip(_CHANGES[name][1], values, strict=True))
    except (TypeError, ValueError, KeyError, OverflowError):
        raise InputError(f"{change!r:.80} is no change that this page knows: reload the page") from None


def _within(what: str, value: float, low: float, high: float) -> float:
    if not (low <= value <= high and np.isfinite(value)):
        raise InputError(f"{what} must be a number between {low:g} and {high:g}, not {value:g}")
    return value


def check_index(what: str, number: int, count: int) -> None:
    """Raise `InputError` where there is no edge or face of a number."""
    if not 0 <= number < count:
        raise InputError(f"there is no {what} {number}: choose one from 0 to {count - 1}")
