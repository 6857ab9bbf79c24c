"""The notebooks of the documents, executed and written with what they print and draw.

    CRITFLOW_ENSEMBLE=FILE python -m workflows.pages.notebooks [NOTEBOOK ...]

FILE is a dataset of `critflow run ensemble`.  The notebooks of the tutorial and of the research question are made from
their pages: code becomes cells of code, and the output shown on the page is left out, since the cells print it.
"""

import ast
import base64
import hashlib
import io
import json
import re
import sys
import tempfile
from contextlib import chdir, redirect_stdout
from pathlib import Path
from typing import Any
from unittest.mock import patch

import matplotlib
import matplotlib.pyplot as plt
from matplotlib.figure import Figure
from PIL import Image

DOCS = Path(__file__).parents[2] / "docs"
FOLDER, EXTRAS = DOCS / "notebooks", DOCS.parent / "extras" / "docs" / "notebooks"
PAGES = ("tutorial", "question")
FENCED = re.compile(r"^```(\w+)\n(.*?)^```\n", flags=re.M | re.S)
SHARPNESS = 72  # dots per inch of a picture
LONGEST_TABLE = 10_000  # characters of HTML: a table of pandas, not the view of a dataset

Cell = dict[str, Any]


def lines(text: str) -> list[str]:
    return text.strip("\n").splitlines(keepends=True)


def code_cell(text: str) -> Cell:
    return {"cell_type": "code", "execution_count": None, "metadata": {}, "outputs": [], "source": lines(text)}


def text_cell(text: str) -> Cell:
    """A cell of Markdown, with links to pages and pictures of the documents."""
    text = re.sub(r"\]\((?!https?:|#)([^)]+)\)", r"](../\1)", text)
    return {"cell_type": "markdown", "metadata": {}, "source": lines(text.strip())}


def cells_of_page(page: Path) -> list[Cell]:
    """The cells of a page of Markdown, without outputs."""
    cells: list[Cell] = []
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"^\[Download as a notebook\].*\n\n", "", text, flags=re.M)
    parts = FENCED.split(text)  # text, then kind, block, text of each block
    for place in range(0, len(parts), 3):
        if place and parts[place - 2] == "python":
            cells.append(code_cell(parts[place - 1]))
        elif place and parts[place - 2] != "output":
            raise ValueError(f"{page.name} has a block {parts[place - 2]}, which has no form in a notebook")
        if parts[place].strip():
            cells.append(text_cell(parts[place]))
    return cells


def cells_of(notebook: Path) -> list[Cell]:
    """The cells of a notebook of Jupyter."""
    return list(json.loads(notebook.read_text(encoding="utf-8"))["cells"])


def source(cell: Cell) -> str:
    return "".join(cell["source"])


def digest(cells: list[Cell]) -> str:
    """Of the code, which tells whether outputs belong to it."""
    return hashlib.sha256("\n".join(source(cell) for cell in cells if cell["cell_type"] == "code").encode()).hexdigest()


def _value(text: str, file: str, names: dict[str, Any]) -> Any:
    """Execute a cell as Jupyter does: the value of a last expression is shown."""
    program = ast.parse(text)
    last = program.body.pop() if program.body and isinstance(program.body[-1], ast.Expr) else None
    exec(compile(program, file, "exec"), names)
    return eval(compile(ast.Expression(last.value), file, "eval"), names) if isinstance(last, ast.Expr) else None


def _drawn() -> list[Cell]:
    """Outputs with the open figures."""
    outputs = []
    for number in plt.get_fignums():
        drawn, small = io.BytesIO(), io.BytesIO()
        plt.figure(number).savefig(drawn, format="png", dpi=SHARPNESS)
        # In 256 colours, chosen by octrees: medians of the colours would change rare ones.
        image = Image.open(drawn).convert("RGB").quantize(method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
        image.save(small, format="png", optimize=True)
        data = {"image/png": base64.b64encode(small.getvalue()).decode()}
        outputs.append({"output_type": "display_data", "data": data, "metadata": {}})
    plt.close("all")
    return outputs


def _shown(value: Any, count: int) -> Cell:
    """The output with the value of a cell: text, and the HTML of a table."""
    data: dict[str, Any] = {"text/plain": repr(value).splitlines(keepends=True)}
    html = value._repr_html_() if hasattr(value, "_repr_html_") else ""
    if 0 < len(html) <= LONGEST_TABLE:
        data["text/html"] = html.splitlines(keepends=True)
    return {"output_type": "execute_result", "execution_count": count, "data": data, "metadata": {}}


def execute(cells: list[Cell], name: str, folder: Path) -> tuple[list[Cell], dict[str, Any]]:
    """Execute cells in a folder: the same with their outputs, and the names that they define.

    Figures are drawn where they are shown; those of the ensemble that a notebook computes stay empty.
    """
    matplotlib.use("Agg")
    plt.close("all")
    names: dict[str, Any] = {"__name__": "__main__"}
    made: list[Cell] = []
    pictures: list[Cell] = []
    count, draw = 0, Figure.draw

    def show() -> None:
        with patch.object(Figure, "draw", draw):
            pictures.extend(_drawn())

    empty = patch.object(Figure, "draw", lambda figure, renderer: None)
    with chdir(folder), matplotlib.rc_context(matplotlib.rcParamsDefault), patch.object(plt, "show", show), empty:
        for place, cell in enumerate(cells):
            cell = {"id": f"cell-{place}", **cell}
            if cell["cell_type"] == "code":
                count += 1
                with redirect_stdout(io.StringIO()) as stream:
                    value = _value(source(cell), name, names)
                printed = {"name": "stdout", "output_type": "stream", "text": stream.getvalue().splitlines(True)}
                outputs = [printed] * bool(printed["text"])
                outputs += [] if value is None else [_shown(value, count)]
                cell |= {"execution_count": count, "outputs": outputs + pictures}
                pictures.clear()
            made.append(cell)
    plt.close("all")
    return made, names


def written(cells: list[Cell]) -> str:
    """The text of a notebook of Jupyter's format 4.5, as Jupyter writes it."""
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    metadata = {"code": digest(cells), "kernelspec": kernel, "language_info": {"name": "python"}}
    whole = {"cells": cells, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(whole, indent=1, ensure_ascii=False, sort_keys=True) + "\n"


def main(notebooks: list[Path]) -> None:
    of_pages = [FOLDER / f"{name}.ipynb" for name in PAGES]
    for path in notebooks or [*of_pages, *sorted(FOLDER.glob("0*.ipynb")), *sorted(EXTRAS.glob("*.ipynb"))]:
        made = path.absolute() in of_pages
        cells = cells_of_page(DOCS / f"{path.stem}.md") if made else cells_of(path)
        with tempfile.TemporaryDirectory() as folder:
            path.write_text(written(execute(cells, path.name, Path(folder))[0]), encoding="utf-8")


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
