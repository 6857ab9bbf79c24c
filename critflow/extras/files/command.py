"""The command `critflow convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from critflow.extras.files.convert import write_network
from critflow.extras.files.formats import writable_format
from critflow.extras.files.hints import Hints, in_shell, numbers_of, read, reading
from critflow.result import InputError


@reading
def convert(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE OUT", help="A network, or two tables; then the file to write.")
    ],
    hints: Hints,
    size: Annotated[
        float | None, typer.Option(metavar="MM", help="Largest extent of a drawing or solid; 100 by default.")
    ] = None,
    radius: Annotated[
        float | None, typer.Option(metavar="MM", help="Radius of the struts of a solid; 1 by default.")
    ] = None,
    by_stiffness: Annotated[
        bool | None,
        typer.Option(
            "--by-stiffness/--one-width",
            help="Widths of drawn or solid struts by their stiffness; by default where it varies, drawings in colour.",
        ),
    ] = None,
    copies: Annotated[
        str, typer.Option(metavar="NUMBERS", help="Copies of a periodic cell along each cell vector, such as '2 3'.")
    ] = "1",
) -> int:
    """Read a network, report each repair, and write it in another format."""
    if len(files) < 2:
        raise InputError("convert needs a file to read and one to write: critflow convert FILE OUT")
    *files, out = files
    given = {"size": size, "radius": radius, "by_stiffness": by_stiffness}
    options: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    writable_format(out, options=options)
    imported = read(files, hints)
    print(in_shell(str(imported)))
    write_network(imported, out, copies=numbers_of("copies", "'2' or '2 3'", copies.replace("x", " ")), **options)
    print(f"  written to {out}")
    return 0
