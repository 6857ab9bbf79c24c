"""The picked edge and face, their sliders, and their marks in the picture."""

from __future__ import annotations

from typing import Any

import numpy as np

from critflow.networks import Array, Network
from critflow.result import CritflowError, InputError
from critflow_extras.explore.model import Dual, Model
from critflow_extras.explore.picture import face_outlines
from critflow_extras.explore.session import STEEPEST, Session, State, check_index

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

    def pick(self, model: Model, kind: str, number: int) -> None:
        """Pick an edge or a face by its number."""
        if kind == "face":
            check_index(kind, number, known_dual(model).faces.n_faces)
            self.face = number
        else:
            check_index(kind, number, model.network.n_edges)
            self.edge = number

    def sliders(self, session: Session, exact: bool) -> dict[str, Any]:
        """Values, limits and texts of both sliders."""
        return {"edge": self._edge_slider(session.state), "face": self._face_slider(session, exact)}

    def _edge_slider(self, state: State) -> dict[str, Any] | None:
        edge = self.edge
        if edge is None:
            return None
        tension = float(state.critical.tensions[edge] / np.abs(state.critical.tensions).mean())
        text = f"τ/⟨τ⟩ {tension:#.4g}, |L| {state.critical.lengths[edge]:#.4g}"
        if state.given is not None:
            text = f"|L| {np.linalg.norm(state.model.network.bond_vectors(state.given)[edge]):#.4g}, as given"
        return {
            "number": edge,
            "count": state.model.network.n_edges,
            "value": state.change[2] if state.change[:2] == ("edge", edge) else 0.0,
            "low": -STEEPEST / 2,
            "high": STEEPEST / 2,
            "text": text,
        }

    def _face_slider(self, session: Session, exact: bool) -> dict[str, Any] | None:
        state, face, dual = session.state, self.face, session.state.model.dual
        if face is None or dual is None:
            return None
        moves_on = state.change[:2] == ("face", face)
        base = session.before if moves_on else state
        if self._limits[1] != face or (exact and self._limits[0] is not base):
            self._limits = (base, face, *_limits(session, base, face))
        low, high = self._limits[2]
        return {
            "number": face,
            "count": dual.faces.n_faces,
            "value": state.change[2] if moves_on else 0.0,
            "low": low,
            "high": high,
            "text": self._limits[3] or f"{int(dual.faces.sizes[face])} sides",
        }

    def marks(self, dual: Dual | None, network: Network, coordinates: Array, L: Array) -> dict[str, Any]:
        """The picked edge, outlines of the picked face in all images, and the places of fixed vertices."""
        outlines: list[Array] = []
        if self.face is not None and dual is not None:
            outlines = face_outlines(dual.faces, self.face, network, coordinates, L)
        pins = coordinates[list(network.pins)].tolist()
        return {"edge": self.edge, "face": [outline.tolist() for outline in outlines], "pins": pins}


def known_dual(model: Model) -> Dual:
    """The dual graph of the network; raises `InputError` where its faces are not known."""
    if model.dual is None:
        raise InputError("this network has no known faces: faces need a periodic planar network without crossings")
    return model.dual


def _limits(session: Session, base: State, face: int) -> tuple[tuple[float, float], str]:
    """Lowest and highest amplitude of a face from a state, and the reason where the face cannot change."""
    try:
        modes = session.modes(base)
        one = np.eye(1, modes.elongations.shape[0], face)[0]
        far = float(np.sqrt(base.model.network.n_vertices))
        return (-_REACH * min(modes.limit(-one), far), _REACH * min(modes.limit(one), far)), ""
    except CritflowError as error:
        return (0.0, 0.0), str(error)
