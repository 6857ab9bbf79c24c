"""The picked edge and face, their sliders, and their marks in the picture."""

from __future__ import annotations

from typing import Any

import numpy as np

from critflow.explore.picture import face_outline
from critflow.explore.session import STEEPEST, Session, State
from critflow.networks.network import Array, Network
from critflow.result import CritflowError, InputError

# Part of the amplitude at which an edge loses its length that a slider reaches.
_REACH = 0.95


class Picked:
    """The picked edge and face by number, None without.

    The limits of a face follow from all isogonal modes: `sliders` returns the last ones unless `exact` is set, so that
    another slider that moves does not wait for them.
    """

    def __init__(self) -> None:
        self.edge: int | None = None
        self.face: int | None = None
        self._limits: tuple[State | None, int | None, tuple[float, float], str] = (None, None, (0.0, 0.0), "")

    def clear(self) -> None:
        """Pick nothing: edges and faces have other numbers in another network."""
        self.edge = self.face = None

    def select(self, session: Session, message: dict[str, Any]) -> None:
        """Pick an edge or a face by its number, modulo their count, so that arrow keys can go round."""
        model = session.state.model
        if "edge" in message:
            self.edge = int(message["edge"]) % model.network.n_edges
        else:
            self.face = int(message["face"]) % known_dual(session).faces.n_faces

    def sliders(self, session: Session, exact: bool) -> dict[str, Any]:
        """Values, limits and texts of both sliders."""
        return {"edge": self._edge_slider(session.state), "face": self._face_slider(session, exact)}

    def _edge_slider(self, state: State) -> dict[str, Any] | None:
        edge = self.edge
        if edge is None:
            return None
        value = state.change[2] if state.change[:2] == ("edge", edge) else 0.0
        tension = float(state.critical.tensions[edge] / np.abs(state.critical.tensions).mean())
        length = float(state.critical.lengths[edge])
        return {"number": edge, "value": value, "reach": STEEPEST / 2, "text": f"τ/⟨τ⟩ {tension:.4g}, |L| {length:.4g}"}

    def _face_slider(self, session: Session, exact: bool) -> dict[str, Any] | None:
        state, face = session.state, self.face
        if face is None:
            return None
        continued = state.change[:2] == ("face", face)
        base = session.before if continued else state
        if self._limits[1] != face or (exact and self._limits[0] is not base):
            self._limits = (base, face, *_limits(session, base, face))
        low, high = self._limits[2]
        sides = int(state.model.dual.faces.sizes[face]) if state.model.dual else 0
        return {
            "number": face,
            "value": state.change[2] if continued else 0.0,
            "low": low,
            "high": high,
            "text": self._limits[3] or f"{sides} sides",
        }

    def marks(self, state: State, network: Network, coordinates: Array, L: Array) -> dict[str, Any]:
        """The picked edge, and outlines of the picked face in all images."""
        dual, outlines = state.model.dual, []
        if self.face is not None and dual is not None:
            outlines = [line.tolist() for line in face_outline(dual.faces, self.face, network, coordinates, L)]
        return {"edge": self.edge, "face": outlines}


def known_dual(session: Session) -> Any:
    """The dual graph of the network; raises `InputError` where its faces are not known."""
    dual = session.state.model.dual
    if dual is None:
        raise InputError("this network has no known faces: faces need a periodic planar network without crossings")
    return dual


def _limits(session: Session, base: State, face: int) -> tuple[tuple[float, float], str]:
    """Lowest and highest amplitude of a face from a state, and the reason where the face cannot change."""
    try:
        modes = session.modes(base)
        one = np.eye(1, modes.elongations.shape[0], face)[0]
        far = float(np.sqrt(base.model.network.n_vertices))
        return (-_REACH * min(modes.limit(-one), far), _REACH * min(modes.limit(one), far)), ""
    except CritflowError as error:
        return (0.0, 0.0), str(error)
