"""The page of an examination, to paste into a lab book: Markdown or HTML with pictures."""

from __future__ import annotations

import base64
import html
import io
import re
from dataclasses import replace
from os import PathLike
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from critflow.arguments import checked
from critflow.examination.report import Examination, report_lines
from critflow.exchange.formats import require_folder
from critflow.figures.drawing import draw, saved
from critflow.result import InputError

_STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:52em;margin:2em auto;padding:0 1em;color:#222}"
    "h1{font-size:1.5em}ul{padding-left:1.2em}"
    "table{border-collapse:collapse}td,th{border:1px solid #bbb;padding:.2em .6em}img{max-width:100%}"
)


# The picture follows the answer.
_AFTER_PICTURE = "## As read"


@checked
def write_page(found: Examination, path: str | PathLike[str]) -> None:
    """Write a page with pictures; the ending is .html, or .md with a PNG file next to it.

    >>> import critflow as cf
    >>> import tempfile
    >>> page = tempfile.mkdtemp() + '/page.md'
    >>> cf.write_page(cf.examine(cf.honeycomb_network(2, 2), deformations=()), page)
    """
    target = Path(path)
    require_page(target)
    if target.suffix == ".md":
        picture = target.with_suffix(".png")
        saved(pictures(found), picture)
        lines = report_lines(found)
        first = lines.index(_AFTER_PICTURE)
        text = "\n".join([*lines[:first], f"![The network]({picture.name})", "", *lines[first:], ""])
    else:
        text = html_page(found)
    target.write_text(text, encoding="utf-8")


def require_page(path: Path) -> None:
    """Raise `InputError` where a page cannot be written to a path."""
    if path.suffix not in (".md", ".html", ".htm"):
        raise InputError(f"a page has the ending .html or .md, not {path.suffix!r}")
    require_folder(path)


def html_page(found: Examination) -> str:
    """The page as HTML with its picture inside."""
    image = io.BytesIO()
    saved(pictures(found), image)
    return _html(report_lines(found), image.getvalue())


def pictures(found: Examination) -> Figure:
    """The network with its floppy motions, and the nearest critical configuration with its tensions."""
    panels = 1 + (found.nearest is not None)
    figure = plt.figure(figsize=(5.4 * panels, 5.0), layout="constrained")
    axes = figure.subplots(1, panels, squeeze=False)[0]
    # Discs are drawn in the plane only.
    floppy = found.network.dimension == 2 and np.nanmax(found.participation, initial=0.0) > 1e-6
    moving = found.participation if floppy else None
    name = "as given" + (" (discs: floppy motions)" if moving is not None else "")
    draw(replace(found.network, positions=found.coordinates), axes[0], vertices=moving, title=f"{name}: {found.title}")
    if found.nearest is not None:
        # In the frame of the observed positions.
        draw(_Shifted(found), axes[1], title="nearest critical configuration (dark: large tension)")
    return figure


class _Shifted:
    """The nearest critical configuration, translated onto the observed positions."""

    def __init__(self, found: Examination):
        assert found.nearest is not None
        critical = found.nearest.value
        self.network, self.sigma, self.lengths = critical.network, critical.sigma, critical.lengths
        self.coordinates = critical.coordinates + found.nearest.translation


def _html(lines: list[str], image: bytes) -> str:
    """The lines of Markdown that the report uses, as HTML."""
    body: list[str] = []
    rows: list[str] = []
    items: list[str] = []
    picture = f'<img alt="The network" src="data:image/png;base64,{base64.b64encode(image).decode()}">'

    def flush() -> None:
        if rows:
            cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows if not row.startswith("|---")]
            head, *rest = cells
            table = ["<table><tr>", *(f"<th>{cell}</th>" for cell in head), "</tr>"]
            for row in rest:
                table += ["<tr>", *(f"<td>{cell}</td>" for cell in row), "</tr>"]
            body.append("".join([*table, "</table>"]))
            rows.clear()
        if items:
            body.append(f"<ul>{''.join(f'<li>{item}</li>' for item in items)}</ul>")
            items.clear()

    for line in lines:
        text = re.sub(r"\*\*(.*?)\*\*", r"<strong>\1</strong>", html.escape(line))
        if line.startswith("|"):
            rows.append(text)
            continue
        if line.startswith("- "):
            items.append(text[2:])
            continue
        flush()
        if line == _AFTER_PICTURE:
            body.append(picture)
        if line.startswith("# "):
            body.append(f"<h1>{text[2:]}</h1>")
        elif line.startswith("## "):
            body.append(f"<h2>{text[3:]}</h2>")
    flush()
    title = html.escape(lines[0][2:])
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><style>{_STYLE}</style>'
        f"<body>{''.join(body)}</body></html>\n"
    )
