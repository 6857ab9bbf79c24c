"""One tab: messages in, replies out.  The server only carries both.

`handle` returns the picture; `refine` then returns the numbers stage by stage, as `view` describes.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from critflow.result import CritflowError, InputError
from critflow_extras.drawing.scales import varied
from critflow_extras.explore.datasets import Case, Dataset, Filter
from critflow_extras.explore.model import POPULATIONS
from critflow_extras.explore.picture import PALETTES, QUANTITIES
from critflow_extras.explore.script import script
from critflow_extras.explore.session import LARGEST_STRAIN, Session
from critflow_extras.explore.sliders import known_dual
from critflow_extras.explore.source import File, Random, Source
from critflow_extras.explore.view import Reply, View
from critflow_extras.files.hints import Hints, in_shell

# Sessions that undo returns to.
_SESSIONS = 6


class Page:
    """One tab: a session, its picked edge and face, and a dataset if one is open.

    progress  called by long computations with a sentence
    name      of the tab, by which a reload finds its page
    uploads   paths of the files that the tab may open, by name, in `folder`
    colour    the one of `QUANTITIES` that colours the edges; empty until one is chosen
    """

    def __init__(self, source: Source | Dataset, progress: Callable[[str], None] = lambda sentence: None):
        self.progress, self.stopping, self.name, self.colour = progress, False, "", ""
        self.uploads: dict[str, Path] = {}
        self.folder: Path | None = None
        self._sessions: list[Session] = []
        self.dataset = source if isinstance(source, Dataset) else None
        self.filter, self.view = Filter(), View()
        self.session = self._session(source)

    def _session(self, source: Source | Dataset) -> Session:
        return Session(source.first_case() if isinstance(source, Dataset) else source, self._observe)

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
        if message.get("do") in ("look", "file"):
            reply.header["welcome"] = self._welcome()
        if message.get("series") != reply.header["plane"]["key"]:
            reply.header["plane"]["series"] = [] if self.dataset is None else self.dataset.points(self.filter)
        return reply

    def _change(self, message: dict[str, Any]) -> str:
        """Change the configuration."""
        before = self.session.state
        state = self.session.apply(message["change"])
        name, *values = state.change
        sentences = []
        if name == "cut":
            self.view.picked.clear()
            sentences.append(f"edge {values[0]} is cut")
        if before.given is not None:
            sentences.append("the vertices are no longer those of the file: Undo shows it as given")
        if before.strain and not state.strain and name != "strain":
            sentences.append("γ is 0 again: stresses are changed at the transition")
        if name == "population":
            sentences.append(state.model.remarks.get(values[0], ""))
        return "; ".join(filter(None, sentences))

    def _undo(self, message: dict[str, Any]) -> str:
        """Undo a change, or the opening of another network."""
        if self.session.can_undo or not self._sessions:
            self._step(self.session.undo)
            return ""
        self.session = self._sessions.pop()
        self.view.picked.clear()
        return f"{self.session.source.title} is open again"

    def _redo(self, message: dict[str, Any]) -> None:
        self._step(self.session.redo)

    def _step(self, step: Callable[[], None]) -> None:
        """Undo or redo; in another network nothing is picked."""
        model = self.session.state.model
        step()
        if self.session.state.model is not model:
            self.view.picked.clear()

    def _pick(self, message: dict[str, Any]) -> str:
        """Pick the edge, or the face, at a point of a panel; or cut the edge there."""
        drawing = self.view.drawings[message["panel"]]
        point = np.array([float(message["x"]), float(message["y"])])
        segment = drawing.nearest(point)
        kind, number = "edge", int(drawing.edges[segment])
        if message.get("tool") == "cut":
            return self._change({"change": ("cut", number)})
        model = self.session.state.model
        if message.get("tool") == "face" and message["panel"] == "network":
            kind, number = "face", int(known_dual(model).ends[number, drawing.side(segment, point)])
        self.view.picked.pick(model, kind, number)
        return f"{kind} {number} is picked"

    def _select(self, message: dict[str, Any]) -> None:
        """Pick an edge or a face by its number."""
        kind = "edge" if "edge" in message else "face"
        self.view.picked.pick(self.session.state.model, kind, int(message[kind]))

    def _open(self, message: dict[str, Any]) -> str:
        """Open a random network."""
        return self._start(Random(message["n_vertices"], message["seed"]))

    def _file(self, message: dict[str, Any]) -> str:
        """Open a network or a dataset that was sent to the server before."""
        path = self.uploads[message["name"]]
        try:
            words = {name: str(message[name]) for name in _FIELDS if message.get(name)}
            hints = Hints(words, []).keywords
            if path.suffix != ".nc":
                sentence, self.dataset = self._start(File(path, hints=hints)), None
            else:
                dataset = Dataset(path)
                sentence, self.dataset, self.filter = self._start(dataset), dataset, Filter()
        except CritflowError as error:
            # The folder is that of the server.
            raise InputError(_in_fields(str(error)).replace(f"{path.parent}/", "")) from None
        return sentence

    def _case(self, message: dict[str, Any]) -> str:
        """Open a case of the dataset."""
        if self.dataset is None:
            raise InputError("no dataset is open: start critflow explore NAME.nc")
        return self._start(Case(self.dataset, int(message["case"])))

    def _filter(self, message: dict[str, Any]) -> None:
        """Choose the variables on the axes of the plane, or a status."""
        names = ("x", "y", "status")
        self.filter = replace(self.filter, **{name: str(message[name]) for name in names if name in message})

    def _colour(self, message: dict[str, Any]) -> None:
        """Choose what colours the edges."""
        if message["by"] not in QUANTITIES:
            raise InputError(f"edges are coloured by one of {', '.join(QUANTITIES)}, not by {message['by']!r:.40}")
        self.colour = message["by"]

    def _start(self, source: Source | Dataset) -> str:
        """Begin another session; `undo` returns to this one."""
        session = self._session(source)
        self._sessions = [*self._sessions, self.session][-_SESSIONS:]
        self.session, self.view = session, View()
        return self._opened()

    def _opened(self) -> str:
        """The name of the source, and what it says about the positions of its file."""
        return ". ".join(filter(None, (f"{self.session.source.title} is open", self.session.remark)))

    def _look(self, message: dict[str, Any]) -> str:
        """Nothing changes: a new tab, or one that was reloaded."""
        return self._opened() if self.session.remark and not self.session.can_undo else ""

    # Replies

    def show(self) -> Reply:
        """The picture of the state with what belongs to the tab; `refine` returns the numbers."""
        reply = self.view.show(self.session, self.shown_colour)
        undo = self.session.can_undo or bool(self._sessions)
        source = self.session.source
        random = [source.n_vertices, source.seed] if isinstance(source, Random) else None
        case = source.number if isinstance(source, Case) else None
        reply.header.update(undo=undo, redo=self.session.can_redo, plane=self._plane(), random=random, case=case)
        return reply

    @property
    def shown_colour(self) -> str:
        """What colours the edges: as chosen, else the stiffnesses of springs at rest where they vary, or tensions."""
        state = self.session.state
        by_stiffness = state.given is not None and varied(state.model.network.stiffness)
        return self.colour or ("stiffness" if by_stiffness else "tension")

    def refine(self) -> Reply | None:
        """The next stage, or None when everything is shown."""
        return self.view.refine()

    @property
    def wait(self) -> float | None:
        """Seconds without a message until `refine` is due, or None when everything is shown."""
        return self.view.wait

    def _plane(self) -> dict[str, Any]:
        """The axes of the plane, and a key that changes with the points of the dataset."""
        if self.dataset is None:
            return {"x": "B₀", "y": "C_B", "key": "", "own": True}
        x, y = self.dataset.variables(self.filter)
        own = x == "B_0" and y == "C_B"
        return {"x": x, "y": y, "key": f"{self.dataset.path.name} {self.filter}", "own": own}

    def _welcome(self) -> dict[str, Any]:
        """The values that stay the same while a source is open."""
        return {
            "tab": self.name,
            "palettes": PALETTES,
            "quantities": QUANTITIES,
            "populations": POPULATIONS,
            "strains": LARGEST_STRAIN,
            "dataset": None if self.dataset is None else self.dataset.description(),
        }

    def script(self) -> str:
        """The lines of Python that make the state again."""
        return script(self.session)


# Fields of the page on how a file is read, keywords of `network_from`, with their names on the page.
_FIELDS = {"cell": "cell", "pins": "fixed vertices", "volume": "volume", "voronoi": "centres of cells"}
# Options that the page lacks.
_OTHERS = re.compile(r"--(nearest|strict|contract|labels|pixel)\b")
# Keywords in sentences of the library, such as pins='hull', and options of the command, such as --cell.
_KEYWORD = re.compile(rf"\b({'|'.join(_FIELDS)})=('?)([\w.]*)\2")
_OPTION = re.compile(rf"--({'|'.join(_FIELDS)})\b")


def _in_fields(sentences: str) -> str:
    """Sentences of the library in the words of the page: "hull" in the field "fixed vertices" for pins='hull'."""
    sentences = sentences.replace("voronoi=True", "--voronoi").replace("give the other one after it", "choose both")
    sentences = _KEYWORD.sub(lambda found: f'"{found[3]}" in the field "{_FIELDS[found[1]]}"', sentences)
    sentences = in_shell(_OPTION.sub(lambda found: f'the field "{_FIELDS[found[1]]}"', sentences))
    return f"{sentences}; such options are those of critflow explore FILE" if _OTHERS.search(sentences) else sentences


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
    "colour": Page._colour,
    "look": Page._look,
}
