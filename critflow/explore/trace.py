"""The trace of a session: its points in the (B_0, C_B) plane, and the moduli visited past the transition."""

from __future__ import annotations

from typing import Any

import numpy as np

from critflow.explore import numbers
from critflow.explore.datasets import Case
from critflow.explore.session import Session, State

# Points that are kept.
_LENGTH = 60


class Trace:
    """Points (B_0, C_B) of the last states, and points (γ, modulus) of the last strained configuration."""

    def __init__(self) -> None:
        self.points: list[tuple[float, float]] = []
        self._curve: list[tuple[float, float]] = []
        self._curve_of: Any = None

    def add(self, B_0: float, C_B: float) -> dict[str, Any]:
        """Add a point and return the point, None if it is not finite, with the points before it."""
        point = (B_0, C_B)
        finite = bool(np.isfinite(point).all())
        if finite and (not self.points or self.points[-1] != point):
            self.points = [*self.points, point][-_LENGTH:]
        return {"point": point if finite else None, "trail": self.points}

    def strained(self, state: State) -> list[numbers.Number]:
        """Moduli past the transition, which the curve then contains; nothing at the transition."""
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

    def curve(self, session: Session, B_0: float, C_B: float) -> dict[str, Any] | None:
        """Moduli past the transition: those visited, with the line B_0 + C_B γ; or a stored curve of the dataset."""
        state, source = session.state, session.source
        if state.strain is not None and self._curve:
            x, y = zip(*self._curve, strict=True)
            far = max(map(abs, x)) * np.sign(state.strain[1])
            dilates = state.strain[0] == "dilation"
            line = [[0.0, far], [B_0, B_0 + C_B * far]] if dilates else None
            return {"name": "B" if dilates else "modulus along the strain", "along": "γ", "x": x, "y": y, "line": line}
        if isinstance(source, Case) and state.change[0] == "start":
            return source.dataset.case_curves(source.number)
        return None
