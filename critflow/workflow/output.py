"""Where a file can be written, checked before anything is computed for it."""

from __future__ import annotations

from pathlib import Path

from critflow.result import InputError


def require_folder(path: Path) -> None:
    """Raise `InputError` where a file cannot be written for want of its folder, or is a folder itself."""
    if not path.parent.is_dir():
        raise InputError(f"there is no folder {path.parent} for {path.name}: make it, or choose another")
    if path.is_dir():
        raise InputError(f"{path} is a folder: give the name of a file in it")
