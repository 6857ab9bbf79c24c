"""Pages made from programs: the directive `gallery`, and a page for each notebook."""

import ast
import base64
import json
import os
from html import escape
from pathlib import Path

from docutils import nodes
from docutils.parsers.rst import Directive
from place import DOCS
from programs import BUILT, picture_of
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers.python import PythonLexer


class Gallery(Directive):
    """`gallery`: for each script that is named the picture, the title, the text and the code."""

    has_content = True

    def run(self):
        grid = nodes.container(classes=["gallery"])
        for name in " ".join(self.content).split():
            grid += self.item(DOCS / "gallery" / f"{name}.py")
        return [grid]

    def item(self, script: Path):
        self.state.document.settings.env.note_dependency(str(script))
        code = script.read_text(encoding="utf-8")
        title, _, text = ast.get_docstring(ast.parse(code)).partition("\n")
        picture = os.path.relpath(picture_of(script), DOCS / "gallery")
        item = nodes.container(classes=["picture"], ids=[script.stem])
        item += nodes.image(uri=Path(picture).as_posix(), alt=title)
        item += nodes.paragraph("", "", nodes.strong("", title.rstrip(".")))
        if text.strip():
            item += nodes.paragraph("", " ".join(text.split()))
        coloured = highlight(code, PythonLexer(), HtmlFormatter())
        lines = len(code.splitlines())
        summary = f"<summary>{escape(script.name)}, {lines} lines</summary>"
        item += nodes.raw("", f"<details>{summary}{coloured}</details>", format="html")
        return item


def page_of(notebook: Path) -> str:
    """The Markdown of a notebook with the outputs that it keeps."""
    parts = []
    pictures = 0
    for number, cell in enumerate(json.loads(notebook.read_text(encoding="utf-8"))["cells"]):
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            if number == 0:
                parts.append(f"Download: [{notebook.name}]({notebook.name})")
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            data = output.get("data", {})
            if output["output_type"] == "stream":
                parts.append(f"```output\n{''.join(output['text']).rstrip()}\n```")
            elif "text/html" in data:
                parts.append(f'````{{raw}} html\n<div class="value">{"".join(data["text/html"])}</div>\n````')
            elif "text/plain" in data and "image/png" not in data:
                parts.append(f"```output\n{''.join(data['text/plain'])}\n```")
            else:
                pictures += 1
                file = BUILT / "notebooks" / f"{notebook.stem}_{pictures}.png"
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(base64.b64decode("".join(data["image/png"])))
                parts.append(f"![](../_build/programs/notebooks/{file.name})")
    return "\n\n".join(parts) + "\n"


def make_notebooks(app):
    """A page for each notebook on the dataset; those that are made from a page have no number."""
    for notebook in sorted((DOCS / "notebooks").glob("0*.ipynb")):
        page, text = notebook.with_suffix(".md"), page_of(notebook)
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")


def setup(app):
    app.add_directive("gallery", Gallery)
    make_notebooks(app)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
