"""The state of a page: a critical configuration, the changes that led to it, undo and redo; no web.

A change is a tuple of a name and plain numbers, so that the list of changes is a recipe: `replay` and the lines of
Python of `script` repeat it to the last digit.  The stress is always the state: each change makes a new σ, and the
configuration is the solve of that σ with its error bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from critflow.critical.isogonal import IsogonalModes, face_modes
from critflow.critical.manifold import CriticalConfiguration
from critflow.explore.model import POPULATIONS, Model, Observer
from critflow.explore.source import Source
from critflow.networks.pruning import prune
from critflow.paths.strain_path import StrainPath, strain_path
from critflow.result import InputError, Solution
from critflow.springs.state import SpringState

Change = tuple[Any, ...]
# Largest |change of log σ| of an edge, and largest |γ|.
STEEPEST, LARGEST_STRAIN = 12.0, {"dilation": 0.5, "simple_shear": 1.0, "pure_shear": 1.0}
# Oldest states are forgotten beyond this number.
_MEMORY = 200


def _start_change() -> Change:
    return ("start",)


@dataclass(frozen=True, eq=False)
class State:
    """One state of the page.

    change  the change that led to it from the state before
    strain  deformation and γ past the transition, and the springs there; None at the transition
    """

    model: Model
    critical: CriticalConfiguration
    change: Change = field(default_factory=_start_change)
    strain: tuple[str, float] | None = None
    springs: SpringState | None = None

    @property
    def shown(self) -> tuple[Any, Any, Any]:
        """Network, coordinates and σ of the picture."""
        if self.springs is not None:
            return self.springs.network, self.springs.coordinates, self.springs.sigma
        return self.critical.network, self.critical.coordinates, self.critical.sigma

    def path(self, moduli: bool) -> Solution[StrainPath] | None:
        """The path from the transition to the strain, or None at the transition."""
        if self.strain is None:
            return None
        deformation, gamma = self.strain
        return strain_path(
            self.critical,
            [gamma],
            deformation=deformation,
            moduli=moduli,
            tensors=False,
            pattern=self.model.pattern,
            throw=False,
        )


class Session:
    """A history of states of one source; `state` is the current one.

    observe  called by long computations with the number of the step; a true value stops them
    """

    def __init__(self, source: Source, observe: Observer = lambda step: False):
        self.source, self.observe = source, observe
        model, critical = source.open()
        self._states, self._now = [State(model, critical)], 0
        self._modes: tuple[CriticalConfiguration, IsogonalModes] | None = None

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
        """Make a change, or alter the last one if it has the same target: a slider that moves on.

        Raises `InputError` or `SolveError` where the change has no configuration; the state is then as before.
        """
        change = _checked(change)
        continued = self.can_undo and _target(change) == _target(self.state.change)
        base = self._states[self._now - 1] if continued else self.state
        made = replace(_CHANGES[change[0]](self, base, *change[1:]), change=change)
        keep = self._now if continued else self._now + 1
        self._states = [*self._states[:keep], made]
        if len(self._states) > _MEMORY:
            del self._states[1:2]
        self._now = len(self._states) - 1
        return made

    def modes(self, base: State) -> IsogonalModes:
        """The isogonal modes of a state, computed once while a face moves on from it."""
        if self._modes is None or self._modes[0] is not base.critical:
            self._modes = base.critical, face_modes(base.critical)
        return self._modes[1]

    def recipe(self) -> list[Change]:
        """The changes that lead from the source to the state, without those that later ones overrule."""
        changes = [state.change for state in self._states[1 : self._now + 1]]
        settings = [n for n, change in enumerate(changes) if change[0] in ("population", "blend")]
        first = settings[-1] if settings else 0
        last = len(changes) - 1
        return [
            change
            for n, change in enumerate(changes)
            if (n >= first or change[0] == "cut") and (change[0] != "strain" or n == last)
        ]

    def replay(self, changes: Iterable[Sequence[Any]]) -> None:
        """Make the changes of a recipe."""
        for change in changes:
            self.apply(change)

    def _population(self, base: State, name: str) -> State:
        stress = base.model.population(name, self.observe)
        if not base.model.has_population(name):
            raise InputError(f"{POPULATIONS[name]} was stopped: choose it again to compute it")
        return self._solved(base, stress)

    def _blend(self, base: State, *weights: float) -> State:
        names = [name for name, weight in zip(POPULATIONS, weights, strict=True) if weight]
        if not names:
            raise InputError("a blend needs a weight above zero: raise one of its sliders")
        for name in names:
            self._population(base, name)
        total = sum(
            weight * base.model.population(name) for name, weight in zip(POPULATIONS, weights, strict=True) if weight
        )
        return self._solved(base, total)

    def _edge(self, base: State, edge: int, change: float) -> State:
        _check_index("edge", edge, base.critical.network.n_edges)
        raised = np.exp(change * (np.arange(base.critical.network.n_edges) == edge))
        return self._solved(base, base.critical.sigma * raised)

    def _face(self, base: State, face: int, amplitude: float) -> State:
        modes = self.modes(base)
        n_faces = modes.elongations.shape[0]
        _check_index("face", face, n_faces)
        return self._solved(base, modes.walk(amplitude * (np.arange(n_faces) == face)).sigma)

    def _cut(self, base: State, edge: int) -> State:
        network = base.critical.network
        _check_index("edge", edge, network.n_edges)
        pruned = prune(network, np.arange(network.n_edges) != edge)
        model = Model(pruned.network, base.model.seed)
        return self._solved(State(model, base.critical), base.critical.sigma[pruned.edges])

    def _strain(self, base: State, deformation: str, gamma: float) -> State:
        if gamma == 0:
            return replace(base, strain=None, springs=None)
        strained = replace(base, strain=(deformation, gamma), springs=None)
        path = strained.path(moduli=False)
        assert path is not None
        path.or_raise("the strain path stopped")
        return replace(strained, springs=path.value.states[-1])

    @staticmethod
    def _solved(base: State, stress: Any) -> State:
        return State(base.model, base.model.manifold.configuration(stress))


_CHANGES: dict[str, Callable[..., State]] = {
    "population": Session._population,
    "blend": Session._blend,
    "edge": Session._edge,
    "face": Session._face,
    "cut": Session._cut,
    "strain": Session._strain,
}


def _target(change: Change) -> Change:
    """The object of a change: a slider that moves on has the same target."""
    return change[:2] if change[0] in ("edge", "face") else change[:1] if change[0] in ("blend", "strain") else (None,)


def _checked(change: Sequence[Any]) -> Change:
    """A change from a message or a link, its values checked."""
    try:
        name, *values = change
        if name == "population":
            (word,) = values
            return name, str(word)
        if name == "cut":
            (edge,) = values
            return name, int(edge)
        if name == "strain":
            deformation, gamma = str(values[0]), float(values[1])
            return name, deformation, _within(gamma, LARGEST_STRAIN[deformation], "the strain")
        if name == "blend":
            return name, *(abs(_within(float(weight), 1.0, "a weight")) for weight in values[: len(POPULATIONS)])
        if name == "edge":
            return name, int(values[0]), _within(float(values[1]), STEEPEST, "the change of log σ")
        if name == "face":
            return name, int(values[0]), _within(float(values[1]), np.inf, "the amplitude")
    except (TypeError, ValueError, KeyError, IndexError) as error:
        if isinstance(error, InputError):
            raise
    raise InputError(f"{change!r:.80} is no change that this page knows: it may come from another version")


def _within(value: float, limit: float, what: str) -> float:
    if not abs(value) <= limit or not np.isfinite(value):
        raise InputError(f"{what} must be a number between {-limit:g} and {limit:g}, not {value:g}")
    return value


def _check_index(what: str, number: int, count: int) -> None:
    if not 0 <= number < count:
        raise InputError(f"there is no {what} {number}: choose one from 0 to {count - 1}")
