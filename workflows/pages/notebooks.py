"""The tutorial and the research question as notebooks, made from their pages.

    python -m workflows.pages.notebooks

Code becomes cells of code, the output shown on the page is left out, since the cells print it, and pictures go with
the text that shows them.
"""

import base64
import json
import re
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parents[2] / "docs"
FOLDER = DOCS / "notebooks"
PAGES = ("tutorial", "question")
FENCED = re.compile(r"^```(\w+)\n(.*?)^```\n", flags=re.M | re.S)
PICTURE = re.compile(r"!\[([^\]]*)\]\(pictures/(\w+)\.\w+\)")


def code_cell(text: str, number: int) -> dict[str, Any]:
    cell = {"cell_type": "code", "execution_count": None, "id": f"cell-{number}", "metadata": {}, "outputs": []}
    return cell | {"source": text.strip().splitlines(keepends=True)}


def text_cell(text: str, number: int) -> dict[str, Any]:
    """A cell of Markdown: pictures, of movies one image, become attachments, links lead to pages of the documents."""
    names = [found[2] for found in PICTURE.finditer(text)]
    text = PICTURE.sub(r"![\1](attachment:\2.png)", text)
    text = re.sub(r"\]\((?!https?:|#|attachment:)([^)]+)\)", r"](../\1)", text)
    cell: dict[str, Any] = {"cell_type": "markdown", "id": f"cell-{number}", "metadata": {}}
    if names:
        files = {f"{name}.png": (DOCS / "pictures" / f"{name}.png").read_bytes() for name in names}
        cell["attachments"] = {name: {"image/png": base64.b64encode(of).decode()} for name, of in files.items()}
    return cell | {"source": text.strip().splitlines(keepends=True)}


def notebook(cells: list[dict[str, Any]]) -> str:
    """A notebook of Jupyter's format 4.5 with these cells, as Jupyter writes it."""
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    whole = {"cells": cells, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(whole, indent=1, ensure_ascii=False, sort_keys=True) + "\n"


def notebook_of(page: Path) -> str:
    """The notebook of a page of Markdown, without outputs."""
    cells: list[dict[str, Any]] = []
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"^\[Download as a notebook\].*\n\n", "", text, flags=re.M)
    parts = FENCED.split(text)  # text, then kind, block, text of each block
    for place in range(0, len(parts), 3):
        if place and parts[place - 2] == "python":
            cells.append(code_cell(parts[place - 1], len(cells)))
        elif place and parts[place - 2] != "output":
            raise ValueError(f"{page.name} has a block {parts[place - 2]}, which has no form in a notebook")
        if parts[place].strip():
            cells.append(text_cell(parts[place], len(cells)))
    return notebook(cells)


if __name__ == "__main__":
    for name in PAGES:
        (FOLDER / f"{name}.ipynb").write_text(notebook_of(DOCS / f"{name}.md"), encoding="utf-8")
