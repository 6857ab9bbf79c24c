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
@click.option("--n-vertices", type=int, metavar="N", help="Size of a random network, without FILE; 1000 by default.")
@click.option("--seed", type=int, metavar="S", help="Seed of a random network, without FILE; 0 by default.")
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, metavar="N", help="Port on this machine; a free one by default."
)
@click.option("--browser/--no-browser", default=True, show_default=True, help="Open the page in a browser.")
@reading
def explore(
    hints: Hints,
    file: Path | None,
    second: Path | None,
    n_vertices: int | None,
    seed: int | None,
    port: int,
    browser: bool,
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

    stored = file is not None and file.suffix == ".nc"
    if hints.case and not stored:
        raise InputError("--set chooses a case of a dataset NAME.nc: give one, or leave it out")
    if hints.values and (stored or file is None):
        raise InputError(
            f"--{next(iter(hints.values))} says how a file of a network is read: give one, or leave it out"
        )
    if file is not None and (n_vertices, seed) != (None, None):
        raise InputError("--n-vertices and --seed make a random network: leave them out with a FILE")
    source: Random | File | Dataset = Random(1000 if n_vertices is None else n_vertices, seed or 0)
    if file is not None:
        require_regular(file)
        if stored and second is not None:
            raise InputError("a dataset stands alone: leave the second file out")
        source = Dataset(file, hints.case) if stored else File(file, second, hints.keywords)
    # A file that cannot be shown is refused before the server starts.
    Page(source)
    explorer = Explorer(source)

    def announce(address: str) -> None:
        print(f"{address}\npress Ctrl+C to stop", flush=True)
        if browser:
            webbrowser.open(explorer.redirect_file(address).as_uri())

    serve(explorer, port, announce)
    return 0
