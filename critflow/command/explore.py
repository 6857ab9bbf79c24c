"""The command `critflow explore`: arguments and messages only.

It imports the page and its server inside its function, as in `critflow.command.main`.
"""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated, Any

import typer

from critflow.result import CritflowError, EnvironmentFailure, InputError

_WITHOUT_SERVER = "the page needs the package tornado: install critflow[explore]"


def explore(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="A network, or a dataset of `critflow run`.")
    ] = None,
    n_vertices: Annotated[int, typer.Option(help="Vertices of a random network, without FILE.")] = 1000,
    seed: Annotated[int, typer.Option(help="Seed of a random network, without FILE.")] = 0,
    link: Annotated[str, typer.Option(metavar="LINK", help="Restore the state of a link that the page copied.")] = "",
    port: Annotated[int, typer.Option(help="Port on this machine; a free one by default.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in a browser.")] = True,
) -> int:
    """Change critical configurations by hand on a page that only this machine can open."""
    try:
        from critflow.explore.page import Page
        from critflow.explore.server import Explorer, serve
    except ModuleNotFoundError as missing:
        if missing.name != "tornado":
            raise
        raise EnvironmentFailure(_WITHOUT_SERVER) from None
    from critflow.explore.datasets import Dataset
    from critflow.explore.source import File, Random

    source: Any = Random(n_vertices, seed)
    fallback = source
    sentence = ""
    if file is not None:
        if not file.exists():
            raise InputError(f"there is no file {file}: check its name")
        try:
            opened = Dataset(file) if file.suffix == ".nc" else File(file)
            Page(opened)
            source = opened
        except CritflowError as error:
            sentence = f"{error}. Below is a random network."
            print(sentence)
    if source is fallback:
        Page(source)
    _, _, state = link.partition("#")

    def announce(address: str) -> None:
        address += f"#{state}" if state else ""
        print(f"{address}\npress Ctrl+C to stop", flush=True)
        if browser:
            webbrowser.open(address)

    serve(Explorer(source, sentence), port, announce)
    return 0
