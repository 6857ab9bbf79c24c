"""The command `critflow examine`, whose function imports what computes: the help of `critflow` needs none of it."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click

from critflow.calls import running
from critflow_extras.files.hints import Hints, files_argument, in_shell, read, reading


@click.command()
@files_argument
@reading
def examine_file(files: Sequence[Path], hints: Hints) -> int:
    """Print whether and why a network is rigid, and what to do next.

    With its critical strains and moduli."""
    from critflow_extras.examine.examine import examine, read_held
    from critflow_extras.examine.report import report_lines

    names = " and ".join(file.name for file in files)
    with running(f"examining {names}") as tell:

        def progress(part: str) -> None:
            tell(in_shell(part))

        imported = read_held(lambda **pins: read(files, replace(hints, values=hints.values | pins)), progress)
        examination = examine(imported, progress=progress)
    print(in_shell("\n".join(report_lines(examination, shlex.join([*map(str, files), *hints.words])))))
    return 0
