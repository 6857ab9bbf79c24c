"""The command `critflow examine`."""

from __future__ import annotations

import shlex
from dataclasses import replace

from critflow.calls import running
from critflow.extras.examine.examine import examine, read_held
from critflow.extras.examine.report import report_lines
from critflow.extras.files.hints import FilesArgument, Hints, in_shell, read, reading


@reading
def examine_file(files: FilesArgument, hints: Hints) -> int:
    """Read a network and print whether and why it is rigid, its critical strains and moduli, and what to do next."""
    names = " and ".join(file.name for file in files)
    with running(f"examining {names}") as tell:

        def progress(part: str) -> None:
            tell(in_shell(part))

        imported = read_held(lambda **pins: read(files, replace(hints, values=hints.values | pins)), progress)
        examination = examine(imported, progress=progress)
    print(in_shell("\n".join(report_lines(examination, shlex.join([*map(str, files), *hints.words])))))
    return 0
