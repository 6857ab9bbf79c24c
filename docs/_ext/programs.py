"""The programs of the documents, executed: scripts of the gallery, and notebooks with their outputs.

Their output is kept in _build/programs of the documents until a program or the package changes.  The tests execute
the programs by the functions below, so that a site built after the tests executes nothing.
"""

from __future__ import annotations

import ast
import base64
import hashlib
import io
import json
import os
import runpy
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import matplotlib
import matplotlib.pyplot as plt
from matplotlib.figure import Figure
from place import DOCS, PACKAGE, ROOT

BUILT = DOCS / "_build" / "programs"
SOURCES = ("critflow/**/*.py", "workflows/ensemble.py", "workflows/shared/*.py")
SOURCES += ("extras/critflow_extras/**/*.py",) if PACKAGE == "critflow_extras" else ()
SHARPNESS = 80  # dots per inch of the pictures of a notebook


def gallery_scripts() -> list[Path]:
    return sorted((DOCS / "gallery").glob("*.py"))


def notebooks() -> list[Path]:
    """The notebooks on the dataset; those that are made from a page of the documents have no number."""
    return sorted((DOCS / "notebooks").glob("0*.ipynb"))


@cache
def _package_digest() -> str:
    digest = hashlib.sha256(matplotlib.__version__.encode())
    for pattern in SOURCES:
        for module in sorted(ROOT.glob(pattern)):
            digest.update(module.read_bytes())
    return digest.hexdigest()


def _digest(program: Path) -> str:
    return hashlib.sha256(_package_digest().encode() + program.read_bytes()).hexdigest()


@contextmanager
def _inside(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)
        plt.close("all")


def _replace(file: Path, content: bytes) -> None:
    """Write a file in one step: a site and a test may execute a program at the same time."""
    beside = file.with_name(f"{file.name}.{os.getpid()}")
    beside.write_bytes(content)
    os.replace(beside, file)


def execute_script(script: Path) -> Path:
    """Execute a script of the gallery in an empty folder and keep the picture NAME.png that it writes."""
    matplotlib.use("Agg")
    kept = BUILT / "gallery"
    kept.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        with _inside(Path(name)), matplotlib.rc_context(matplotlib.rcParamsDefault | {"backend": "Agg"}):
            runpy.run_path(str(script), run_name="__main__")
        _replace(kept / f"{script.stem}.png", (Path(name) / f"{script.stem}.png").read_bytes())
    _replace(kept / f"{script.stem}.digest", _digest(script).encode())
    return kept / f"{script.stem}.png"


def picture_of(script: Path) -> Path:
    """The picture of a script, executed if it or the package has changed."""
    kept = BUILT / "gallery" / f"{script.stem}.digest"
    if kept.exists() and kept.read_text(encoding="utf-8") == _digest(script):
        return kept.with_suffix(".png")
    return execute_script(script)


class Cell(NamedTuple):
    """A cell of a notebook: its text, whether it is code, what it prints, its value as text and HTML, its pictures."""

    text: str
    code: bool
    printed: str = ""
    value: tuple[str, str] = ("", "")
    pictures: tuple[bytes, ...] = ()


def cells_of(notebook: Path) -> list[Cell]:
    """The cells of a notebook, without outputs."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return [Cell("".join(cell["source"]), cell["cell_type"] == "code") for cell in cells]


def _run(text: str, file: str, names: dict[str, Any]) -> tuple[str, str]:
    """Execute a cell as Jupyter does: the value of a last expression is shown, as text and, where it has one, HTML."""
    program = ast.parse(text)
    last = program.body.pop() if program.body and isinstance(program.body[-1], ast.Expr) else None
    exec(compile(program, file, "exec"), names)
    value = eval(compile(ast.Expression(last.value), file, "eval"), names) if isinstance(last, ast.Expr) else None
    if value is None:
        return "", ""
    return repr(value), value._repr_html_() if hasattr(value, "_repr_html_") else ""


def execute_notebook(notebook: Path, folder: Path) -> tuple[list[Cell], dict[str, Any]]:
    """Execute a notebook in a folder: its cells with their outputs, and the names that it defines.

    Figures are drawn where they are shown; those of the ensemble that a notebook computes stay empty.
    """
    matplotlib.use("Agg")
    plt.close("all")
    names: dict[str, Any] = {"__name__": "__main__"}
    draw, cells = Figure.draw, []
    pictures: list[bytes] = []

    def show() -> None:
        with patch.object(Figure, "draw", draw):
            pictures.extend(_drawn())

    empty = patch.object(Figure, "draw", lambda figure, renderer: None)
    with _inside(folder), patch.object(plt, "show", show), empty:
        for cell in cells_of(notebook):
            with redirect_stdout(io.StringIO()) as stream:
                value = _run(cell.text, notebook.name, names) if cell.code else ("", "")
            cells.append(cell._replace(printed=stream.getvalue(), value=value, pictures=tuple(pictures)))
            pictures.clear()
    _keep(notebook, cells)
    return cells, names


def _drawn() -> Iterator[bytes]:
    for number in plt.get_fignums():
        stream = io.BytesIO()
        plt.figure(number).savefig(stream, format="png", dpi=SHARPNESS)
        yield stream.getvalue()
    plt.close("all")


def _keep(notebook: Path, cells: list[Cell]) -> None:
    kept = BUILT / "notebooks"
    kept.mkdir(parents=True, exist_ok=True)
    _replace(kept / f"{notebook.stem}.ipynb", json.dumps(_ipynb(cells), indent=1, ensure_ascii=False).encode())
    _replace(kept / f"{notebook.stem}.digest", _digest(notebook).encode())


def _ipynb(cells: list[Cell]) -> dict[str, Any]:
    """The notebook in Jupyter's format, version 4.5."""
    made = []
    count = 0
    for number, cell in enumerate(cells):
        entry: dict[str, Any] = {"id": f"cell-{number}", "metadata": {}, "source": cell.text}
        if cell.code:
            count += 1
            outputs: list[dict[str, Any]] = []
            if cell.printed:
                outputs.append({"output_type": "stream", "name": "stdout", "text": cell.printed})
            if any(cell.value):
                data = dict(zip(("text/plain", "text/html"), filter(None, cell.value), strict=False))
                shown = {"output_type": "execute_result", "execution_count": count, "data": data, "metadata": {}}
                outputs.append(shown)
            for picture in cell.pictures:
                data = {"image/png": base64.b64encode(picture).decode()}
                outputs.append({"output_type": "display_data", "data": data, "metadata": {}})
            entry |= {"cell_type": "code", "execution_count": count, "outputs": outputs}
        else:
            entry |= {"cell_type": "markdown"}
        made.append(entry)
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return {"cells": made, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}


@cache
def _folder_without_ensemble() -> tempfile.TemporaryDirectory:
    return tempfile.TemporaryDirectory()


def ipynb_of(notebook: Path) -> Path:
    """The executed notebook, executed again if it or the package has changed."""
    kept = BUILT / "notebooks" / f"{notebook.stem}.digest"
    if not kept.exists() or kept.read_text(encoding="utf-8") != _digest(notebook):
        execute_notebook(notebook, Path(_folder_without_ensemble().name))
    return kept.with_suffix(".ipynb")
