"""Files made of the state of a session: its picture, and its network in any format."""

from __future__ import annotations

import tempfile
import threading
import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from critflow.networks import Array
from critflow.result import InputError
from critflow_extras.drawing.draw import draw, saved
from critflow_extras.explore.picture import QUANTITIES, edge_values
from critflow_extras.explore.session import Session
from critflow_extras.files.convert import write_network

# matplotlib keeps the current figure in one place.
_DRAWING = threading.Lock()


def picture_file(session: Session, suffix: str, colour: str = "tension") -> tuple[str, bytes]:
    """The picture of the state, coloured by one of `QUANTITIES`."""
    if suffix not in (".png", ".svg", ".pdf"):
        raise InputError("a picture is .png, .svg or .pdf")
    state = session.state
    shown = state.springs or state.critical
    thing: Any = shown
    words, network = QUANTITIES[colour], state.model.network
    values: Array | None = edge_values(colour, shown.sigma, shown.lengths, network.stiffness)
    if state.given is not None:
        # A file as given is the network at its own positions, without tensions: `draw` shows its stiffnesses.
        thing = network
        values = np.linalg.norm(network.bond_vectors(state.given), axis=1) if colour == "length" else None
        words = words if colour == "length" else "springs at rest"
    with _DRAWING, tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"critflow{suffix}"
        saved(draw(thing, color=values, title=f"{session.source.title}: {words}").figure, path)
        return path.name, path.read_bytes()


def network_file(session: Session, suffix: str) -> tuple[str, bytes]:
    """The network in the format of an ending, in an archive where the format has several files."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"critflow{suffix}"
        state = session.state
        if state.given is None:
            write_network(state.critical, path)
        else:
            write_network(state.model.network, path, state.given)
        written = sorted(Path(folder).iterdir())
        if len(written) == 1:
            return written[0].name, written[0].read_bytes()
        archive = BytesIO()
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
            for file in written:
                packed.write(file, file.name)
        return "critflow.zip", archive.getvalue()
