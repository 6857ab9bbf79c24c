"""What one tab shows: messages in, a reply with numbers and drawings out.  The server only carries both.

A reply comes in three stages: `handle` returns the picture and the numbers that follow the hand; `refine` then returns
moduli and coefficients with their error bounds, and last the counts of self-stresses and zero modes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from critflow.design.isogonal import face_modes
from critflow.explore import numbers
from critflow.explore.cloud import cloud, cloud_series
from critflow.explore.datasets import Case, Dataset, Filter
from critflow.explore.model import OPTIMA, POPULATIONS
from critflow.explore.picture import PALETTE, Drawing, face_outline, force_drawing, network_drawing
from critflow.explore.script import from_link, link_text, script
from critflow.explore.session import LARGEST_STRAIN, STEEPEST, Session, State
from critflow.explore.source import File, Random, Source
from critflow.result import CritflowError, InputError

# Vertices beyond which a change takes longer than the eye, and sessions that undo returns to.
_LIVE, _SESSIONS = 3000, 6
# Points of the trail in the (B_0, C_B) plane, and of the curve past the transition.
_TRAIL = 60
# Part of the amplitude at which an edge loses its length that a slider reaches.
_REACH = 0.95


@dataclass
class Reply:
    """What the page shows next: a header of plain values, and drawings by panel."""

    header: dict[str, Any]
    drawings: dict[str, Drawing] = field(default_factory=dict)


class Page:
    """One tab: a session, what is picked in it, and a dataset if one is open.

    progress  called by long computations with a sentence
    """

    def __init__(self, source: Source | Dataset, progress: Callable[[str], None] = lambda sentence: None):
        self.progress, self.stopping = progress, False
        self.dataset: Dataset | None = source if isinstance(source, Dataset) else None
        self.filter = Filter()
        self.drawings: dict[str, Drawing] = {}
        # Files that the tab may open, by name.
        self.inbox: dict[str, Path] = {}
        self.edge: int | None = None
        self.face: int | None = None
        self._stages: list[Callable[[], Reply]] = []
        self._sessions: list[Session] = []
        self._trail: list[tuple[float, float]] = []
        self._curve: list[tuple[float, float]] = []
        self._curve_of: Any = None
        self._limits: tuple[Any, tuple[float, float]] = (None, (0.0, 0.0))
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
            self.edge = self.face = None
        if before.strain and not state.strain and state.change[0] != "strain":
            return "γ is 0 again: stresses are changed at the transition"
        if state.change[0] == "population":
            return state.model.remarks.get(state.change[1], "")
        return ""

    def _undo(self, message: dict[str, Any]) -> str:
        """Undo a change, or the opening of another network."""
        if self.session.can_undo or not self._sessions:
            self._forget_picked_after(self.session.undo)
            return ""
        self.session = self._sessions.pop()
        self.edge = self.face = None
        return f"{self.session.source.title} is open again"

    def _redo(self, message: dict[str, Any]) -> None:
        self._forget_picked_after(self.session.redo)

    def _forget_picked_after(self, step: Callable[[], None]) -> None:
        """Edges and faces have other numbers in another network."""
        model = self.session.state.model
        step()
        if self.session.state.model is not model:
            self.edge = self.face = None

    def _pick(self, message: dict[str, Any]) -> str:
        """Pick the edge, or the face, at a point of a panel."""
        drawing = self.drawings[message["panel"]]
        point = np.array([float(message["x"]), float(message["y"])])
        segment = drawing.nearest(point)
        if message.get("tool") == "cut":
            edge = int(drawing.edges[segment])
            return self._change({"change": ("cut", edge)}) or f"edge {edge} is cut"
        if message.get("tool") == "face" and message["panel"] == "network":
            dual = self._dual()
            self.face = int(dual.ends[int(drawing.edges[segment]), drawing.side(segment, point)])
            return f"face {self.face} is picked"
        self.edge = int(drawing.edges[segment])
        return f"edge {self.edge} is picked"

    def _select(self, message: dict[str, Any]) -> None:
        """Pick an edge or a face by its number, modulo their count, so that arrow keys can go round."""
        network = self.session.state.model.network
        if "edge" in message:
            self.edge = int(message["edge"]) % network.n_edges
        else:
            self.face = int(message["face"]) % self._dual().faces.n_faces

    def _dual(self) -> Any:
        dual = self.session.state.model.dual
        if dual is None:
            raise InputError("this network has no known faces: faces need a periodic planar network without crossings")
        return dual

    def _open(self, message: dict[str, Any]) -> str:
        """Open a random network, and one of its populations if it is named."""
        self._start(Random(message["n_vertices"], message["seed"]))
        if "population" in message:
            self.session.apply(("population", message["population"]))
        return f"{self.session.source.title} is open"

    def _file(self, message: dict[str, Any]) -> str:
        """Open a network or a dataset that was sent to the server before."""
        path = self.inbox[message["name"]]
        if path.suffix == ".nc":
            dataset = Dataset(path)
            self._start(self._first(dataset))
            self.dataset, self.filter = dataset, Filter()
        else:
            self._start(File(path))
            self.dataset = None
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
        self.session, self.edge, self.face = session, None, None
        self._trail.clear()

    def _look(self, message: dict[str, Any]) -> None:
        """Nothing changes: a tab that was reloaded."""

    # Replies

    def show(self) -> Reply:
        """The picture of the state with the numbers that follow the hand; what `refine` adds is marked as due."""
        session, state = self.session, self.session.state
        network, x, sigma = state.shown
        L = network.bond_vectors(x)
        tensions = sigma * np.linalg.norm(L, axis=1)
        self.drawings = {"network": network_drawing(network, x, tensions)}
        dual = state.model.dual
        if dual is not None:
            y, periods, offsets = dual.diagram(network, sigma, L)
            self.drawings["forces"] = force_drawing(y, periods, offsets, dual.ends, tensions)
        self._stages = [self._precise, self._counts]
        change = state.change
        header = {
            "title": session.source.title,
            "sizes": self._sizes(state),
            "slow": state.model.network.n_vertices > _LIVE,
            "numbers": [number.shown() for number in numbers.quick(state.critical)],
            "due": ["B_0", "G_0", "C_B", "C_G", "C_G_stress_corrected", "self-stresses", "zero modes"],
            "undo": session.can_undo or bool(self._sessions),
            "redo": session.can_redo,
            "link": link_text(session),
            "edge": self._edge_slider(),
            "face": self._face_slider(),
            "marks": self._marks(network, x, L),
            "weights": list(change[1:]) if change[0] == "blend" else [0.0] * len(POPULATIONS),
            "strain": list(state.strain) if state.strain else ["", 0.0],
            "plane": self._plane(),
            "bound": _bound(state),
        }
        return Reply(header, self.drawings)

    def refine(self) -> Reply | None:
        """The next stage, or None when everything is shown."""
        return self._stages.pop(0)() if self._stages else None

    @property
    def due(self) -> int:
        """Number of stages that are not shown yet."""
        return len(self._stages)

    def _precise(self) -> Reply:
        state = self.session.state
        found = numbers.precise(state.model.manifold, state.critical)
        values = {number.key: number.value for number in found}
        point = (values["B_0"], values["C_B"])
        if np.isfinite(point).all() and (not self._trail or self._trail[-1] != point):
            self._trail = [*self._trail, point][-_TRAIL:]
        strained = self._strained(state)
        return Reply(
            {
                "numbers": [number.shown() for number in [*found, *strained]],
                "point": point if np.isfinite(point).all() else None,
                "trail": self._trail,
                "curve": self._curves(values),
            }
        )

    def _counts(self) -> Reply:
        return Reply({"numbers": [number.shown() for number in numbers.counts(self.session.state.critical)]})

    def _strained(self, state: State) -> list[numbers.Number]:
        """Moduli past the transition."""
        path = state.path(moduli=True)
        if path is None:
            return []
        reached, found = path.value, []
        for key, name in (("B(γ)", "bulk_modulus"), ("G(γ)", "shear_modulus"), ("M(γ)", "modulus")):
            value, bound = float(getattr(reached, name)[0]), float(getattr(reached, f"{name}_error")[0])
            found.append(numbers.Number(key, value, bound, numbers.ESTIMATE, "" if path.ok else path.reason))
        found.append(numbers.Number("force(γ)", float(reached.max_force[0])))
        assert state.strain is not None
        if self._curve_of != (state.critical, state.strain[0]):
            self._curve, self._curve_of = [], (state.critical, state.strain[0])
        along = found[0] if state.strain[0] == "dilation" else found[2]
        if np.isfinite(along.value):
            self._curve = sorted({*self._curve, (state.strain[1], along.value)})
        return found

    def _curves(self, values: dict[str, float]) -> dict[str, Any] | None:
        """Moduli past the transition: those visited, with the line B_0 + C_B γ; or a stored curve of the dataset."""
        state, source = self.session.state, self.session.source
        if state.strain is not None and self._curve:
            x, y = zip(*self._curve, strict=True)
            far = max(map(abs, x)) * np.sign(state.strain[1])
            dilates = state.strain[0] == "dilation"
            line = [values["B_0"], values["B_0"] + values["C_B"] * far] if dilates else None
            name = "B" if dilates else "modulus along the strain"
            return {"name": name, "along": "γ", "x": x, "y": y, "line": line and [[0.0, far], line]}
        if isinstance(source, Case) and state.change[0] == "start":
            return source.dataset.case_curves(source.number)
        return None

    def _sizes(self, state: State) -> str:
        network, dual = state.model.network, state.model.dual
        faces = f", {dual.faces.n_faces:,} faces" if dual else ""
        return f"{network.n_vertices:,} vertices, {network.n_edges:,} edges{faces}"

    def _edge_slider(self) -> dict[str, Any] | None:
        state, edge = self.session.state, self.edge
        if edge is None:
            return None
        value = state.change[2] if state.change[:2] == ("edge", edge) else 0.0
        tension = float(state.critical.tensions[edge] / np.abs(state.critical.tensions).mean())
        length = float(state.critical.lengths[edge])
        return {"number": edge, "value": value, "reach": STEEPEST / 2, "text": f"τ/⟨τ⟩ {tension:.4g}, |L| {length:.4g}"}

    def _face_slider(self) -> dict[str, Any] | None:
        state, face = self.session.state, self.face
        if face is None:
            return None
        continued = state.change[:2] == ("face", face)
        base = self.session.before if continued else state
        if self._limits[0] != (base, face):
            try:
                modes = face_modes(base.critical)
                one = np.eye(1, modes.elongations.shape[0], face)[0]
                far = float(np.sqrt(base.model.network.n_vertices))
                limits = (-_REACH * min(modes.limit(-one), far), _REACH * min(modes.limit(one), far))
            except CritflowError as error:
                return {"number": face, "value": 0.0, "low": 0.0, "high": 0.0, "text": str(error)}
            self._limits = ((base, face), limits)
        low, high = self._limits[1]
        value = state.change[2] if continued else 0.0
        sides = int(state.model.dual.faces.sizes[face]) if state.model.dual else 0
        return {"number": face, "value": value, "low": low, "high": high, "text": f"{sides} sides"}

    def _marks(self, network: Any, x: Any, L: Any) -> dict[str, Any]:
        """Outlines of the picked face, and the picked edge."""
        dual = self.session.state.model.dual
        marks: dict[str, Any] = {"edge": self.edge, "face": []}
        if self.face is not None and dual is not None:
            marks["face"] = [outline.tolist() for outline in face_outline(dual.faces, self.face, network, x, L)]
        return marks

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
        """What does not change while a source is open."""
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


def _bound(state: State) -> str:
    """The closed-form bound of B_0, to as many digits as its rounding leaves."""
    bound = state.model.bulk_bound
    return f"{bound:.14f}" if np.isfinite(bound) else "—"


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
