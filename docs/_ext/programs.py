"""The scripts of the gallery, executed.

Their pictures are kept in _build/programs of the documents until a script or the package changes.  The tests execute
them by the functions below, so that a site built after the tests executes nothing.
"""

from __future__ import annotations

import hashlib
import os
import runpy
import tempfile
from contextlib import chdir
from functools import cache
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
from place import DOCS, PACKAGE, ROOT

BUILT = DOCS / "_build" / "programs"
SOURCES = ("critflow/**/*.py",)
SOURCES += ("extras/critflow_extras/**/*.py",) if PACKAGE == "critflow_extras" else ()


def gallery_scripts() -> list[Path]:
    return sorted((DOCS / "gallery").glob("*.py"))


@cache
def _package_digest() -> str:
    digest = hashlib.sha256(matplotlib.__version__.encode())
    for pattern in SOURCES:
        for module in sorted(ROOT.glob(pattern)):
            digest.update(module.read_bytes())
    return digest.hexdigest()


def _digest(program: Path) -> str:
    return hashlib.sha256(_package_digest().encode() + program.read_bytes()).hexdigest()


def _replace(file: Path, content: bytes) -> None:
    """Write a file in one step: a site and a test may execute a program at the same time."""
    other = file.with_name(f"{file.name}.{os.getpid()}")
    other.write_bytes(content)
    os.replace(other, file)


def execute_script(script: Path) -> Path:
    """Execute a script of the gallery in an empty folder and keep the picture NAME.png that it writes."""
    matplotlib.use("Agg")
    kept = BUILT / "gallery"
    kept.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        with chdir(name), matplotlib.rc_context(matplotlib.rcParamsDefault | {"backend": "Agg"}):
            runpy.run_path(str(script), run_name="__main__")
        plt.close("all")
        _replace(kept / f"{script.stem}.png", (Path(name) / f"{script.stem}.png").read_bytes())
    _replace(kept / f"{script.stem}.digest", _digest(script).encode())
    return kept / f"{script.stem}.png"


def picture_of(script: Path) -> Path:
    """The picture of a script, executed if it or the package has changed."""
    kept = BUILT / "gallery" / f"{script.stem}.digest"
    if kept.exists() and kept.read_text(encoding="utf-8") == _digest(script):
        return kept.with_suffix(".png")
    return execute_script(script)
