"""Whether a picture or another file can be written to a path."""

from __future__ import annotations

from pathlib import Path

from matplotlib.backend_bases import FigureCanvasBase

from critflow.result import InputError


def require_picture(path: Path) -> None:
    """Raise `InputError` where a figure cannot be saved to a path."""
    endings = FigureCanvasBase.get_supported_filetypes()
    if path.suffix[1:].lower() not in endings:
        raise InputError(f"a picture cannot have the ending {path.suffix!r}: choose .png, .pdf or .svg")
    require_folder(path)


def require_folder(path: Path) -> None:
    """Raise `InputError` where a file cannot be written for want of its folder, or is a folder itself."""
    if not path.parent.is_dir():
        raise InputError(f"there is no folder {path.parent} for {path.name}: make it, or choose another")
    if path.is_dir():
        raise InputError(f"{path} is a folder: give the name of a file in it")
