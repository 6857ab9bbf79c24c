"""The page of an examination, to paste into a lab book: Markdown or HTML with pictures."""

from __future__ import annotations

import base64
import html
import io
from dataclasses import replace
from os import PathLike
from pathlib import Path

import matplotlib.pyplot as plt
from markdown_it import MarkdownIt
from matplotlib.figure import Figure

from critflow.arguments import checked
from critflow.extras.examine.report import AT_REST, Examination, report_lines
from critflow.extras.files.formats import require_folder
from critflow.figures.drawing import draw, saved
from critflow.result import InputError

_STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:52em;margin:2em auto;padding:0 1em;color:#222}"
    "h1{font-size:1.5em}ul{padding-left:1.2em}"
    "table{border-collapse:collapse}td,th{border:1px solid #bbb;padding:.2em .6em}img{max-width:100%}"
)


@checked
def write_page(examination: Examination, path: str | PathLike[str], file: str = "") -> None:
    """Write a page with pictures; the ending is .html, or .md with a PNG file next to it.

    file  name of the file that was examined, for advice that names commands in place of functions

    >>> import critflow as cf
    >>> from critflow.extras.examine.page import write_page
    >>> import tempfile
    >>> page = tempfile.mkdtemp() + '/page.md'
    >>> write_page(cf.examine(cf.lattice("honeycomb", 2, 2), deformations=()), page)
    """
    target = Path(path)
    require_page(target)
    lines, image = report_lines(examination, file), io.BytesIO()
    saved(pictures(examination), image)
    if target.suffix == ".md":
        picture = target.with_suffix(".png")
        picture.write_bytes(image.getvalue())
        source = picture.name
    else:
        source = f"data:image/png;base64,{base64.b64encode(image.getvalue()).decode()}"
    # The picture follows the answer.
    first = lines.index("## As read")
    text = "\n".join([*lines[:first], f"![The network]({source})", "", *lines[first:], ""])
    if target.suffix != ".md":
        title = html.escape(lines[0].removeprefix("# "))
        head = f'<meta charset="utf-8"><title>{title}</title><style>{_STYLE}</style>'
        # Names of vertices are text, and no tags.
        body = MarkdownIt("commonmark", {"html": False}).enable("table").render(text)
        text = f'<!doctype html><html lang="en">{head}<body>{body}</body></html>\n'
    target.write_text(text, encoding="utf-8")


def require_page(path: Path) -> None:
    """Raise `InputError` where a page cannot be written to a path."""
    if path.suffix not in (".md", ".html", ".htm"):
        raise InputError(f"a page has the ending .html or .md, not {path.suffix!r}")
    require_folder(path)


def pictures(examination: Examination) -> Figure:
    """The network with its floppy motions, and the nearest critical configuration with its tensions."""
    near, moving, name = examination.nearest, examination.participation, "as given"
    panels = 1 + (near is not None)
    figure = plt.figure(figsize=(5.4 * panels, 5.0), layout="constrained")
    axes = figure.subplots(1, panels, squeeze=False)[0]
    # Discs are drawn in the plane only.
    if moving is None or examination.network.dimension != 2 or moving.max(initial=0.0) <= AT_REST:
        moving = None
    else:
        name += " (discs: floppy motions)"
    network = replace(examination.network, positions=examination.coordinates)
    draw(network, axes[0], vertices=moving, title=f"{name}: {examination.title}")
    if near is not None:
        # In the frame of the observed positions.
        moved = replace(near.value, coordinates=near.value.coordinates + near.translation)
        draw(moved, axes[1], title="nearest critical configuration (dark: large tension)")
    return figure
