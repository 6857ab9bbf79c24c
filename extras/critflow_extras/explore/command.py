"""The command `critflow explore`, whose function imports what computes: the help of `critflow` needs none of it."""

from __future__ import annotations

import webbrowser
from pathlib import Path

import click

from critflow.result import EnvironmentFailure, InputError
from critflow_extras.files.hints import Hints, reading


@click.command()
@click.argument("file", required=False, type=Path, metavar="[FILE]", help="A network, or a dataset of `critflow run`.")
@click.argument(
    "second", required=False, type=Path, metavar="[TABLE]", help="The table of vertices, where FILE is that of edges."
)
@click.option(
    "--n-vertices", default=1000, metavar="N", show_default=True, help="Size of a random network, without FILE."
)
@click.option("--seed", default=0, metavar="S", show_default=True, help="Seed of a random network, without FILE.")
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, metavar="N", help="Port on this machine; a free one by default."
)
@click.option("--browser/--no-browser", default=True, show_default=True, help="Open the page in a browser.")
@reading
def explore(
    hints: Hints, file: Path | None, second: Path | None, n_vertices: int, seed: int, port: int, browser: bool
) -> int:
    """Change critical configurations with the mouse in a browser.

    Only this machine can open the page."""
    try:
        from critflow_extras.explore.page import Page
        from critflow_extras.explore.server import Explorer, serve
    except ModuleNotFoundError as missing:
        if missing.name != "tornado":
            raise
        raise EnvironmentFailure("the page needs the package tornado: install critflow[explore]") from None
    from critflow_extras.explore.datasets import Dataset
    from critflow_extras.explore.source import File, Random
    from critflow_extras.files.data import require_regular

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
