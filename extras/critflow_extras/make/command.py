"""The command `critflow make`, whose function imports what computes: the help of `critflow` needs none of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from critflow.calls import running
from critflow.result import InputError
from critflow_extras.files.hints import Hints, files_argument, in_shell, read, reading, require_other


@click.command()
@files_argument
@click.option("--out", required=True, type=Path, metavar="OUT", help="The file to write; its ending names the format.")
@click.option(
    "--objective",
    metavar="NAME",
    help="A quantity, such as B_0, G_0 or V_tau, or nearest to the positions; B_0 unless there are targets.",
)
@click.option("--picture", type=Path, metavar="PNG", help="Also draw the configuration.")
@click.option(
    "--target", multiple=True, metavar="NAME=VALUE", help="A property to reach, a value or LOW:HIGH; may be repeated."
)
@click.option("--change", metavar="KIND", help="What reaches the targets: stress, or the stiffness of springs at rest.")
@reading
def make(
    files: Sequence[Path],
    hints: Hints,
    out: Path,
    objective: str | None,
    picture: Path | None,
    target: Sequence[str],
    change: str | None,
) -> int:
    """Make a network critical, with the best or requested properties.

    The configuration is certified and written."""
    import numpy as np

    from critflow.manifold import CriticalConfiguration
    from critflow_extras.certificates.certify import certificate_text
    from critflow_extras.files.convert import write_network
    from critflow_extras.files.formats import writable_format
    from critflow_extras.inference.nearest import Nearest
    from critflow_extras.make.making import made
    from critflow_extras.targets.targets import Design

    if objective == "":
        raise InputError("--objective needs a name, such as B_0, G_0, V_tau or nearest: give one, or leave it out")
    if objective and target:
        raise InputError("--objective is for networks without --target: give NAME=largest or NAME=smallest as a target")
    objective = objective or "B_0"
    # Before a long computation, whose result could not be written.
    writable_format(out)
    require_other(out, files)
    if picture is not None:
        # matplotlib takes a third of the time of a small network.
        from critflow.command.cases import require_picture
        from critflow_extras.drawing.draw import draw, saved

        require_picture(picture)
        require_other(picture, files)
    imported = read(files, hints)
    print(in_shell(str(imported)))
    writable_format(out, imported.network.dimension)
    with running(f"making {out.name}"):
        solution, title, lines = made(imported, objective, target, change)
    configuration = solution.value
    print("\n".join(f"  {line}" for line in lines))
    if not np.isfinite(configuration.coordinates).all():
        return 3
    if isinstance(solution, Design) and not solution.reached:
        print("  nothing is written, since the targets are not reached: change them, or give limits LOW:HIGH")
        return 3
    if isinstance(configuration, CriticalConfiguration):
        print(f"  {certificate_text(configuration, title, solution.status)}")
    # A solution begins at the origin: the nearest one is written where the file has its vertices.
    at_file = configuration.coordinates + solution.translation if isinstance(solution, Nearest) else None
    write_network(configuration, out, at_file)
    print(f"  written to {out}")
    if picture is not None:
        saved(draw(configuration, title=title).figure, picture)
        print(f"  drawn in {picture}")
    return 0 if solution.ok else 3
