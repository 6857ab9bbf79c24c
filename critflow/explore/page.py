"""One tab: messages in, replies out.  The server only carries both.

`handle` returns the picture; `refine` then returns the numbers stage by stage, as `critflow.explore.view` describes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from critflow.explore.cloud import cloud, cloud_series
from critflow.explore.datasets import Case, Dataset, Filter
from critflow.explore.model import OPTIMA, POPULATIONS
from critflow.explore.picture import PALETTE
from critflow.explore.script import from_link, link_text, script
from critflow.explore.session import LARGEST_STRAIN, Session
from critflow.explore.sliders import known_dual
from critflow.explore.source import File, Random, Source
from critflow.explore.view import Reply, View
from critflow.result import CritflowError, InputError

# Sessions that undo returns to.
_SESSIONS = 6


class Page:
    """One tab: a session, its picked edge and face, and a dataset if one is open.

    progress  called by long computations with a sentence
    """

    def __init__(self, source: Source | Dataset, progress: Callable[[str], None] = lambda sentence: None):
        self.progress, self.stopping = progress, False
        self.dataset: Dataset | None = source if isinstance(source, Dataset) else None
        self.filter = Filter()
        # Files that the tab may open, by name.
        self.inbox: dict[str, Path] = {}
        self.view = View()
        self._sessions: list[Session] = []
        self.session = Session(self._first(source), self._observe)

    def _first(self, source: Source | Dataset) -> Source:
        if not isinstance(source, Dataset):
            return source
        for number in range(source.n_cases):
            if source.status[number] == 0:
                return Case(source, number)
        raise InputError("no case of this dataset has a configuration: see its statuses")

    def _observe(self, step: int) -> bool:
        self.progress(f"step {step} of a descent")
        return self.stopping

    # Messages

    def handle(self, message: dict[str, Any]) -> Reply:
        """Carry out one message and return the new picture, or a sentence that says why nothing changed."""
        self.stopping, sentence, error = False, "", False
        try:
            action = _ACTIONS.get(str(message.get("do")))
            if action is None:
                raise InputError(f"the page does not know {message.get('do')!r:.40}: reload it")
            sentence = action(self, message) or ""
        except (CritflowError, np.linalg.LinAlgError) as problem:
            sentence, error = str(problem), True
        except (KeyError, TypeError, ValueError, IndexError) as problem:
            sentence, error = f"the message was incomplete ({problem}): reload the page", True
        reply = self.show()
        reply.header.update(sentence=sentence, error=error, seq=message.get("seq", 0))
        return reply

    def _change(self, message: dict[str, Any]) -> str:
        before = self.session.state
        state = self.session.apply(message["change"])
        if state.model is not before.model:
            self.view.picked.clear()
        sentences = []
        if state.change[0] == "cut":
            sentences.append(f"edge {state.change[1]} is cut")
        if before.strain and not state.strain and state.change[0] != "strain":
            sentences.append("γ is 0 again: stresses are changed at the transition")
        if state.change[0] == "population":
            sentences.append(state.model.remarks.get(state.change[1], ""))
        return "; ".join(filter(None, sentences))

    def _undo(self, message: dict[str, Any]) -> str:
        """Undo a change, or the opening of another network."""
        if self.session.can_undo or not self._sessions:
            self._forget_picked_after(self.session.undo)
            return ""
        self.session = self._sessions.pop()
        self.view.picked.clear()
        return f"{self.session.source.title} is open again"

    def _redo(self, message: dict[str, Any]) -> None:
        self._forget_picked_after(self.session.redo)

    def _forget_picked_after(self, step: Callable[[], None]) -> None:
        """Edges and faces have other numbers in another network."""
        model = self.session.state.model
        step()
        if self.session.state.model is not model:
            self.view.picked.clear()

    def _pick(self, message: dict[str, Any]) -> str:
        """Pick the edge, or the face, at a point of a panel."""
        drawing = self.view.drawings[message["panel"]]
        point = np.array([float(message["x"]), float(message["y"])])
        segment = drawing.nearest(point)
        if message.get("tool") == "cut":
            return self._change({"change": ("cut", int(drawing.edges[segment]))})
        if message.get("tool") == "face" and message["panel"] == "network":
            dual = known_dual(self.session)
            self.view.picked.face = int(dual.ends[int(drawing.edges[segment]), drawing.side(segment, point)])
            return f"face {self.view.picked.face} is picked"
        self.view.picked.edge = int(drawing.edges[segment])
        return f"edge {self.view.picked.edge} is picked"

    def _select(self, message: dict[str, Any]) -> None:
        self.view.picked.select(self.session, message)

    def _open(self, message: dict[str, Any]) -> str:
        """Open a random network, and one of its populations if it is named."""
        self._start(Random(message["n_vertices"], message["seed"]))
        if "population" in message:
            self.session.apply(("population", message["population"]))
        return f"{self.session.source.title} is open"

    def _file(self, message: dict[str, Any]) -> str:
        """Open a network or a dataset that was sent to the server before."""
        path = self.inbox[message["name"]]
        try:
            if path.suffix == ".nc":
                dataset = Dataset(path)
                self._start(self._first(dataset))
                self.dataset, self.filter = dataset, Filter()
            else:
                self._start(File(path))
                self.dataset = None
        except CritflowError as error:
            # The folder is that of the server.
            raise InputError(str(error).replace(f"{path.parent}/", "")) from None
        return f"{path.name} is open"

    def _case(self, message: dict[str, Any]) -> str:
        if self.dataset is None:
            raise InputError("no dataset is open: start critflow explore NAME.nc")
        self._start(Case(self.dataset, int(message["case"])))
        return f"{self.session.source.title} is open"

    def _filter(self, message: dict[str, Any]) -> None:
        names = ("x", "y", "status", "claim")
        self.filter = replace(self.filter, **{name: str(message[name]) for name in names if name in message})

    def _restore(self, message: dict[str, Any]) -> str:
        """Restore a link; a link of the present state changes nothing."""
        text = str(message["link"])
        if text == link_text(self.session):
            return ""
        source, changes = from_link(text)
        session = Session(self._source_of(source), self._observe)
        session.replay(changes)
        self._replace(session)
        return "the state of the link is restored"

    def _source_of(self, recipe: dict[str, Any]) -> Source:
        if "n_vertices" in recipe:
            return Random(recipe["n_vertices"], recipe["seed"])
        # A link opens only the file that is open already.
        name = str(recipe.get("file"))
        if self.dataset is not None and name == self.dataset.path.name and "case" in recipe:
            return Case(self.dataset, int(recipe["case"]))
        if isinstance(self.session.source, File) and name == self.session.source.path.name:
            return self.session.source
        raise InputError(f"this link belongs to the file {name}: start critflow explore with it, then open the link")

    def _start(self, source: Source) -> None:
        self._replace(Session(source, self._observe))

    def _replace(self, session: Session) -> None:
        self._sessions = [*self._sessions, self.session][-_SESSIONS:]
        self.session, self.view = session, View()

    def _look(self, message: dict[str, Any]) -> None:
        """Nothing changes: a tab that was reloaded."""

    # Replies

    def show(self) -> Reply:
        """The picture of the state with what belongs to the tab; `refine` returns the numbers."""
        reply = self.view.show(self.session)
        reply.header.update(
            undo=self.session.can_undo or bool(self._sessions),
            redo=self.session.can_redo,
            link=link_text(self.session),
            plane=self._plane(),
        )
        return reply

    def refine(self) -> Reply | None:
        """The next stage, or None when everything is shown."""
        return self.view.refine()

    @property
    def wait(self) -> float | None:
        """Seconds without a message until `refine` is due, or None when everything is shown."""
        return self.view.wait

    def _plane(self) -> dict[str, Any]:
        """Points of the plane: the dataset's if one is open, else the stored cloud."""
        if self.dataset is None:
            return {"x": "B₀", "y": "C_B", "key": "cloud", "open": "cloud"}
        x, y = self.dataset.variables(self.filter)
        key = f"{self.dataset.path.name} {self.filter} {x} {y}"
        return {"x": x, "y": y, "key": key, "open": "case", "n_shown": int(self.dataset.mask(self.filter).sum())}

    def series(self) -> list[dict[str, Any]]:
        """Points of the plane by series, which the page requests when the key of the plane changes."""
        return cloud_series() if self.dataset is None else self.dataset.points(self.filter)

    def welcome(self) -> dict[str, Any]:
        """The values that stay the same while a source is open."""
        return {
            "palette": PALETTE,
            "optima": OPTIMA,
            "populations": POPULATIONS,
            "strains": LARGEST_STRAIN,
            "cloud_vertices": cloud()["n_vertices"],
            "dataset": None if self.dataset is None else self.dataset.description(),
        }

    def script(self) -> str:
        """The lines of Python that make the state again."""
        return script(self.session)


_ACTIONS: dict[str, Callable[[Page, dict[str, Any]], str | None]] = {
    "change": Page._change,
    "undo": Page._undo,
    "redo": Page._redo,
    "pick": Page._pick,
    "select": Page._select,
    "open": Page._open,
    "file": Page._file,
    "case": Page._case,
    "filter": Page._filter,
    "restore": Page._restore,
    "look": Page._look,
}
