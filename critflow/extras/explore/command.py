"""The command `critflow explore`."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from critflow.extras.files.hints import Hints, reading
from critflow.result import EnvironmentFailure, InputError


@reading
def explore(
    hints: Hints,
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="A network, or a dataset of `critflow run`.")
    ] = None,
    second: Annotated[
        Path | None, typer.Argument(metavar="[TABLE]", help="The table of vertices, where FILE is that of edges.")
    ] = None,
    n_vertices: Annotated[int, typer.Option(help="Vertices of a random network, without FILE.")] = 1000,
    seed: Annotated[int, typer.Option(help="Seed of a random network, without FILE.")] = 0,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port on this machine; a free one by default.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in a browser.")] = True,
) -> int:
    """Change critical configurations with the mouse on a page that only this machine can open."""
    try:
        from critflow.extras.explore.page import Page
        from critflow.extras.explore.server import Explorer, serve
    except ModuleNotFoundError as missing:
        if missing.name != "tornado":
            raise
        raise EnvironmentFailure("the page needs the package tornado: install critflow[explore]") from None
    from critflow.extras.explore.datasets import Dataset
    from critflow.extras.explore.source import File, Random
    from critflow.extras.files.data import require_regular

    source: Random | File | Dataset = Random(n_vertices, seed)
    if file is not None:
        require_regular(file)
        if file.suffix == ".nc" and second is not None:
            raise InputError("a dataset stands alone: leave the second file out")
        source = Dataset(file) if file.suffix == ".nc" else File(file, second, hints.keywords)
    # A file that cannot be shown is refused before the server starts.
    Page(source)
    explorer = Explorer(source)

    def announce(address: str) -> None:
        print(f"{address}\npress Ctrl+C to stop", flush=True)
        if browser:
            webbrowser.open(explorer.redirect_file(address).as_uri())

    serve(explorer, port, announce)
    return 0
