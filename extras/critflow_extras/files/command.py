"""The command `critflow convert`, whose function imports what computes: the help of `critflow` needs none of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from critflow.result import InputError
from critflow_extras.files.hints import Hints, in_shell, numbers_of, read, reading, require_other


@click.command()
@click.argument(
    "files",
    nargs=-1,
    required=True,
    type=Path,
    metavar="FILE [TABLE] OUT",
    help="A network, or two tables; then the file to write.",
)
@click.option("--size", type=float, metavar="MM", help="Largest extent of a drawing or solid; 100 by default.")
@click.option("--radius", type=float, metavar="MM", help="Radius of the struts of a solid; 1 by default.")
@click.option(
    "--by-stiffness/--one-width",
    default=None,
    help="Widths of drawn or solid struts by their stiffness; by default where it varies, drawings in colour.",
)
@click.option(
    "--copies",
    default="1",
    show_default=True,
    metavar="NUMBERS",
    help="Copies of a periodic cell along each cell vector, such as '2 3'.",
)
@reading
def convert(
    files: Sequence[Path],
    hints: Hints,
    size: float | None,
    radius: float | None,
    by_stiffness: bool | None,
    copies: str,
) -> int:
    """Write a network in another format, and report each repair."""
    from critflow_extras.files.convert import write_network
    from critflow_extras.files.formats import writable_format

    if len(files) < 2:
        raise InputError("convert needs a file to read and one to write: critflow convert FILE OUT")
    *files, out = files
    given = {"size": size, "radius": radius, "by_stiffness": by_stiffness}
    options: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    writable_format(out, options=options)
    require_other(out, files)
    imported = read(files, hints)
    print(in_shell(str(imported)))
    write_network(imported, out, copies=numbers_of("copies", "'2' or '2 3'", copies.replace("x", " ")), **options)
    print(f"  written to {out}")
    return 0
