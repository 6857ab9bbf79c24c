"""Files made of the state of a session: its picture, and its network in any format."""

from __future__ import annotations

import tempfile
import threading
import zipfile
from io import BytesIO
from pathlib import Path

from critflow.exchange.convert import write_network
from critflow.explore.session import Session
from critflow.figures.drawing import draw, saved
from critflow.result import InputError

# matplotlib keeps the current figure in one place.
_DRAWING = threading.Lock()


def picture_file(session: Session, suffix: str) -> tuple[str, bytes]:
    """The picture of the state."""
    if suffix not in (".png", ".svg", ".pdf"):
        raise InputError("a picture is .png, .svg or .pdf")
    state = session.state
    with _DRAWING, tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"critflow{suffix}"
        saved(draw(state.springs or state.critical, title=session.source.title).figure, path)
        return path.name, path.read_bytes()


def network_file(session: Session, suffix: str) -> tuple[str, bytes]:
    """The network in the format of an ending, in an archive where the format has several files."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"critflow{suffix}"
        write_network(session.state.critical, path)
        written = sorted(Path(folder).iterdir())
        if len(written) == 1:
            return written[0].name, written[0].read_bytes()
        archive = BytesIO()
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
            for file in written:
                packed.write(file, file.name)
        return "critflow.zip", archive.getvalue()
