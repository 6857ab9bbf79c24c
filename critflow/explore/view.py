"""The view of a session in one tab, in stages: the picture first, then numbers, then those that take longer."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from critflow.critical.manifold import CriticalConfiguration
from critflow.explore import numbers
from critflow.explore.model import POPULATIONS
from critflow.explore.picture import Drawing, force_drawing, network_drawing
from critflow.explore.session import Session, State
from critflow.explore.sliders import Picked
from critflow.explore.trace import Trace

# Vertices beyond which a change takes longer than the eye.
_LIVE = 3000
# Seconds without a message after which each stage is computed: the first numbers where the next position of the hand
# is not there yet, so that they delay no picture; bounds and coefficients when it rests, counts soon after those.
WAITS = (0.02, 0.3, 0.1)
_DUE = ("B_0", "G_0", "C_B", "C_G", "C_G_stress_corrected", "self-stresses", "zero modes")


@dataclass
class Reply:
    """An answer to the page: a header of plain values, and drawings by panel."""

    header: dict[str, Any]
    drawings: dict[str, Drawing] = field(default_factory=dict)


class View:
    """The picture of a session, its picked edge and face, and the stages that are not shown yet."""

    def __init__(self) -> None:
        self.picked, self.trace = Picked(), Trace()
        self.drawings: dict[str, Drawing] = {}
        self._stages: list[tuple[float, Callable[[], Reply]]] = []
        self._known: dict[str, tuple[CriticalConfiguration, list[numbers.Number]]] = {}

    def show(self, session: Session) -> Reply:
        """The picture of the state; what `refine` returns is marked as due."""
        state = session.state
        network, x, sigma = state.shown
        L = network.bond_vectors(x)
        tensions = sigma * np.linalg.norm(L, axis=1)
        self.drawings = {"network": network_drawing(network, x, tensions)}
        dual = state.model.dual
        if dual is not None:
            y, periods, offsets = dual.diagram(network, sigma, L)
            self.drawings["forces"] = force_drawing(y, periods, offsets, dual.ends, tensions)
        stages = (lambda: self._quick(session), lambda: self._precise(session), lambda: self._counts(session))
        self._stages = list(zip(WAITS, stages, strict=True))
        header = {
            "title": session.source.title,
            "sizes": _sizes(state),
            "slow": state.model.network.n_vertices > _LIVE,
            "due": _DUE,
            "marks": self.picked.marks(state, network, x, L),
            "weights": list(state.change[1:]) if state.change[0] == "blend" else [0.0] * len(POPULATIONS),
            "strain": list(state.strain) if state.strain else ["", 0.0],
            "bound": _bound(state),
            **self.picked.sliders(session, exact=False),
        }
        return Reply(header, self.drawings)

    def refine(self) -> Reply | None:
        """The next stage, or None when everything is shown."""
        return self._stages.pop(0)[1]() if self._stages else None

    @property
    def wait(self) -> float | None:
        """Seconds until the next stage is computed, or None when everything is shown."""
        return self._stages[0][0] if self._stages else None

    def _quick(self, session: Session) -> Reply:
        """Moduli, variances and residual."""
        critical = session.state.critical
        found = self._once("quick", critical, lambda: numbers.quick(critical))
        return Reply({"numbers": _shown(found), "due": _DUE})

    def _precise(self, session: Session) -> Reply:
        """Moduli and coefficients with their error bounds, moduli past the transition, and limits of the sliders."""
        state = session.state
        found = self._once("precise", state.critical, lambda: numbers.precise(state.model.manifold, state.critical))
        values = {number.key: number.value for number in found}
        point = values["B_0"], values["C_B"]
        strained = self.trace.strained(state)
        curve = self.trace.curve(session, *point)
        sliders = self.picked.sliders(session, exact=True)
        return Reply({"numbers": _shown([*found, *strained]), **self.trace.add(*point), "curve": curve, **sliders})

    def _counts(self, session: Session) -> Reply:
        critical = session.state.critical
        return Reply({"numbers": _shown(self._once("counts", critical, lambda: numbers.counts(critical)))})

    def _once(
        self, stage: str, critical: CriticalConfiguration, compute: Callable[[], list[numbers.Number]]
    ) -> list[numbers.Number]:
        """The numbers of a stage, which stand still past the transition."""
        if stage not in self._known or self._known[stage][0] is not critical:
            self._known[stage] = critical, compute()
        return self._known[stage][1]


def _shown(found: list[numbers.Number]) -> list[dict[str, str]]:
    return [number.shown() for number in found]


def _sizes(state: State) -> str:
    network, dual = state.model.network, state.model.dual
    faces = f", {dual.faces.n_faces:,} faces" if dual else ""
    return f"{network.n_vertices:,} vertices, {network.n_edges:,} edges{faces}"


def _bound(state: State) -> str:
    """The closed-form bound of B_0, to as many digits as its rounding leaves."""
    bound = state.model.bulk_bound
    return f"{bound:.14f}" if np.isfinite(bound) else "—"


def packed(reply: Reply) -> bytes:
    """A reply as bytes: the length of the header, the header, and the segments of all drawings as floats."""
    drawings, arrays = {}, []
    for panel, drawing in reply.drawings.items():
        shade, first = np.unique(drawing.shades, return_index=True)
        order = np.argsort(first)
        drawings[panel] = {
            "n": len(drawing.segments),
            "outline": drawing.outline.tolist(),
            "runs": list(zip(shade[order].tolist(), first[order].tolist(), strict=True)),
        }
        arrays.append(drawing.segments.astype("<f4").tobytes())
        arrays.append(drawing.edges.astype("<f4").tobytes())
    header = json.dumps({**reply.header, "drawings": drawings}, allow_nan=False).encode()
    header += b" " * (-len(header) % 4)
    return len(header).to_bytes(4, "little") + header + b"".join(arrays)
