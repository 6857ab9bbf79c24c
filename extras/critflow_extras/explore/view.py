"""What a tab shows of a session, in stages: the picture first, then numbers, then those that take longer."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from critflow.manifold import CriticalConfiguration
from critflow.networks import Array
from critflow_extras.drawing.scales import widely
from critflow_extras.explore import numbers
from critflow_extras.explore.model import POPULATIONS
from critflow_extras.explore.picture import (
    QUANTITIES,
    Drawing,
    edge_values,
    network_drawing,
    periodic_drawing,
    shades_of,
)
from critflow_extras.explore.session import Session, State
from critflow_extras.explore.sliders import Picked

# Vertices beyond which a change takes longer than 50 ms.
_LIVE = 3000
# Seconds without a message after which each stage is computed: the first numbers when no further position of a slider
# waits, so that they delay no picture; errors and coefficients when the user pauses, counts soon after those.
WAITS = (0.02, 0.3, 0.1)
# Numbers that are marked as out of date until their stage comes.
_DUE = ("B_0", "G_0", "C_B", "C_G", "C_G_stress_corrected", *numbers.COUNTS)
# All rows at the transition, what comes with a strain, and all rows of springs at rest, in their order.
_ROWS = ("B_0", "bound", "G_0", "C_B", "C_G", "C_G_stress_corrected", "V_L", "V_tau", "residual", *numbers.COUNTS)
_STRAINED = ("B(γ)", "G(γ)", "M(γ)", "force(γ)")
_AT_REST = ("B", "G", *numbers.COUNTS)
# Points (B_0, C_B) of former states that are kept.
_TRAIL = 60


@dataclass
class Reply:
    """An answer to the page: a header of plain values, drawings by panel, and what colours each edge, (N_b,)."""

    header: dict[str, Any]
    drawings: dict[str, Drawing] = field(default_factory=dict)
    values: Array = field(default_factory=lambda: np.zeros(0))


class View:
    """The picture of a session, its picked edge and face, and the stages that are not shown yet.

    trail  points (B_0, C_B) of the last states
    """

    def __init__(self) -> None:
        self.picked = Picked()
        self.drawings: dict[str, Drawing] = {}
        self.trail: list[tuple[float, float]] = []
        self._stages: list[tuple[float, Callable[[], Reply]]] = []
        self._known: dict[str, tuple[CriticalConfiguration, list[numbers.Number]]] = {}
        # Points (γ, modulus) past the transition, of one configuration and deformation.
        self._curve: list[tuple[float, float]] = []
        self._curve_of: tuple[CriticalConfiguration, str] | None = None

    def show(self, session: Session, colour: str = "tension") -> Reply:
        """The picture of the state, coloured by one of `QUANTITIES`; what `refine` returns is marked as due."""
        state = session.state
        model, network, given = state.model, state.model.network, state.given
        shown = state.springs or state.critical
        x, sigma = (shown.coordinates, shown.sigma) if given is None else (given, np.zeros(network.n_edges))
        L = network.bond_vectors(x)
        values, k = edge_values(colour, sigma, np.linalg.norm(L, axis=1), network.stiffness), network.stiffness
        wide = colour == "stiffness" and widely(np.percentile(k, [1, 99]))
        # Springs at rest have no tension: to call all of them slack would hide what they have.
        told = None if given is not None and colour in ("length", "stiffness") else sigma
        shades, low, high = shades_of(values, told, not (wide or colour == "length"), wide)
        self.drawings = {"network": network_drawing(network, x, shades)}
        if model.dual is not None and given is None:
            y, periods, offsets = model.dual.diagram(network, sigma, L)
            self.drawings["forces"] = periodic_drawing(model.dual.ends, offsets, periods, y, shades)
        self._stages = self._due_stages(session)
        name = QUANTITIES[colour] + ", logarithmic" * wide
        header = {
            "title": session.source.title,
            "sizes": _sizes(state),
            "slow": model.network.n_vertices > _LIVE,
            "due": _AT_REST if given is not None else _DUE,
            "rows": _AT_REST if given is not None else (*_ROWS, *_STRAINED) if state.strain else _ROWS,
            "marks": self.picked.marks(model.dual, network, x, L),
            "weights": list(state.change[1:]) if state.change[0] == "blend" else [0.0] * len(POPULATIONS),
            "strain": list(state.strain) if state.strain else ["", 0.0],
            "scale": {"colour": colour, "name": name, "low": _four(low), "high": _four(high)},
            "bound": _bound(model.bulk_bound) if given is None else None,
            "rest": given is not None,
            **self.picked.sliders(session, exact=False),
        }
        return Reply(header, self.drawings, values)

    def _due_stages(self, session: Session) -> list[tuple[float, Callable[[], Reply]]]:
        """What follows the picture, each with the seconds after which it is computed."""
        given = session.state.given
        if given is not None:
            return [(WAITS[0], lambda: self._at_rest(session, given))]
        stages = (lambda: self._quick(session), lambda: self._precise(session), lambda: self._counts(session))
        return list(zip(WAITS, stages, strict=True))

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
        return Reply({"numbers": _rows(self._once("quick", critical, lambda: numbers.quick(critical))), "due": _DUE})

    def _at_rest(self, session: Session, given: Array) -> Reply:
        """All numbers of springs at rest at the positions of a file, and limits of the sliders."""
        network, critical = session.state.model.network, session.state.critical
        found = [*numbers.moduli_at_rest(network, given), *numbers.counts_at_rest(network, given)]
        header = {"numbers": _rows(self._once("rest", critical, lambda: found)), "point": None, "trail": self.trail}
        return Reply({**header, "curve": None, **self.picked.sliders(session, exact=True)})

    def _precise(self, session: Session) -> Reply:
        """Moduli and coefficients with their errors, moduli past the transition, and limits of the sliders."""
        state = session.state
        at_rest = self._once("precise", state.critical, lambda: numbers.precise(state.model.manifold, state.critical))
        values = {number.key: number.value for number in at_rest}
        point = values["B_0"], values["C_B"]
        finite = bool(np.isfinite(point).all())
        if finite and self.trail[-1:] != [point]:
            self.trail = [*self.trail, point][-_TRAIL:]
        strained = self._strained(state)
        header = {
            "numbers": _rows([*at_rest, *strained]),
            "point": point if finite else None,
            "trail": self.trail,
            "curve": self._visited(state, point if finite else None),
        }
        return Reply({**header, **self.picked.sliders(session, exact=True)})

    def _counts(self, session: Session) -> Reply:
        """Self-stresses and floppy modes."""
        critical = session.state.critical
        return Reply({"numbers": _rows(self._once("counts", critical, lambda: numbers.counts(critical)))})

    def _once(
        self, stage: str, critical: CriticalConfiguration, compute: Callable[[], list[numbers.Number]]
    ) -> list[numbers.Number]:
        """The numbers of a stage, which do not change past the transition."""
        if stage not in self._known or self._known[stage][0] is not critical:
            self._known[stage] = critical, compute()
        return self._known[stage][1]

    def _strained(self, state: State) -> list[numbers.Number]:
        """Moduli past the transition, which the curve then contains; nothing at the transition."""
        path = state.path(moduli=True)
        if path is None or state.strain is None:
            return []
        at, rows = path.value, []
        for key, name in (("B(γ)", "bulk_modulus"), ("G(γ)", "shear_modulus"), ("M(γ)", "modulus")):
            value, error = float(getattr(at, name)[0]), float(getattr(at, f"{name}_error")[0])
            rows.append(numbers.Number(key, value, error, numbers.ESTIMATE, "" if path.ok else path.reason))
        deformation, gamma = state.strain
        if self._curve_of is None or self._curve_of[0] is not state.critical or self._curve_of[1] != deformation:
            self._curve, self._curve_of = [], (state.critical, deformation)
        modulus = rows[0].value if deformation == "dilation" else rows[2].value
        if np.isfinite(modulus):
            self._curve = sorted({*self._curve, (gamma, modulus)})
        return [*rows, numbers.Number("force(γ)", float(at.max_force[0]))]

    def _visited(self, state: State, point: tuple[float, float] | None) -> dict[str, Any] | None:
        """The moduli visited past the transition, for dilation with the line B_0 + C_B γ of a point (B_0, C_B)."""
        if state.strain is None or not self._curve:
            return None
        x, y = zip(*self._curve, strict=True)
        if state.strain[0] != "dilation":
            return {"name": "modulus along the strain", "x": x, "y": y, "line": None}
        far = max(x, key=abs)
        line = point and [[0.0, far], [point[0], point[0] + point[1] * far]]
        return {"name": "B", "x": x, "y": y, "line": line}


def _rows(shown: list[numbers.Number]) -> list[dict[str, str]]:
    return [number.row for number in shown]


def _bound(value: float) -> dict[str, str]:
    """The row of the bound of B_0, whose closed form has 14 digits."""
    number = numbers.Number("bound", value, note="largest B₀ over all stresses (proof)")
    return {**number.row, "text": f"{value:.14f}"} if np.isfinite(value) else number.row


def _four(value: float) -> str:
    return f"{value:#.4g}" if value else "0"


def _sizes(state: State) -> str:
    network, dual = state.model.network, state.model.dual
    faces = f", {dual.faces.n_faces:,} faces" if dual else ""
    return f"{network.n_vertices:,} vertices, {network.n_edges:,} edges{faces}"


def packed(reply: Reply) -> bytes:
    """A reply as bytes: the length of the header, the header, all drawings and values as floats."""
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
    arrays.append(reply.values.astype("<f4").tobytes())
    header = json.dumps({**reply.header, "drawings": drawings, "values": len(reply.values)}, allow_nan=False).encode()
    header += b" " * (-len(header) % 4)
    return len(header).to_bytes(4, "little") + header + b"".join(arrays)
