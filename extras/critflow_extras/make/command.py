"""The command `critflow make`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from critflow.calls import running
from critflow.manifold import CriticalConfiguration
from critflow.networks import Network
from critflow.optima import optimize
from critflow.result import InputError, Solution
from critflow.springs import SpringState, spring_state
from critflow_extras.certificates.certify import certificate_text
from critflow_extras.files.convert import write_network
from critflow_extras.files.formats import writable_format
from critflow_extras.files.hints import Hints, files_argument, in_shell, read, reading, value_of
from critflow_extras.files.repair import ImportedNetwork
from critflow_extras.inference.nearest import nearest_critical
from critflow_extras.targets.targets import Design, change_of, design


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
    if objective == "":
        raise InputError("--objective needs a name, such as B_0, G_0, V_tau or nearest: give one, or leave it out")
    if objective and target:
        raise InputError("--objective is for networks without --target: give NAME=largest or NAME=smallest as a target")
    objective = objective or "B_0"
    # Before a long computation, whose result could not be written.
    writable_format(out)
    if picture is not None:
        # matplotlib takes a third of the time of a small network.
        from critflow.command.cases import require_picture
        from critflow_extras.drawing.draw import draw, saved

        require_picture(picture)
    imported = read(files, hints)
    print(in_shell(str(imported)))
    writable_format(out, imported.network.dimension)
    with running(f"making {out.name}"):
        solution, title, lines = _made(imported, objective, target, change)
    made = solution.value
    print("\n".join(f"  {line}" for line in lines))
    if not np.isfinite(made.coordinates).all():
        return 3
    if isinstance(solution, Design) and not solution.reached:
        print("  nothing is written, since the targets are not reached: change them, or give limits LOW:HIGH")
        return 3
    if isinstance(made, CriticalConfiguration):
        print(f"  {certificate_text(made, title, solution.status)}")
    write_network(made, out)
    print(f"  written to {out}")
    if picture is not None:
        saved(draw(made, title=title).figure, picture)
        print(f"  drawn in {picture}")
    return 0 if solution.ok else 3


def _made(
    imported: ImportedNetwork, objective: str, target: Sequence[str], change: str | None
) -> tuple[Solution[Any], str, list[str]]:
    """The configuration with the targets, nearest to the positions or best, a title of it, and lines that report it."""
    if target:
        return _designed(imported, target, change)
    if change is not None:
        raise InputError("--change says what reaches targets: give --target NAME=VALUE, or leave it out")
    if objective == "nearest":
        fit = nearest_critical(imported.network, imported.positions, throw=False)
        line = f"root mean square distance {fit.distance:.6g} ({fit.status.name}: {fit.reason})"
        return fit, f"{fit.distance:.3g} from the positions", [line]
    optimum = optimize(imported.network, objective, throw=False)
    line = f"{objective} {optimum.objective:.10g} ({optimum.status.name}: {optimum.reason})"
    return optimum, f"{objective} {optimum.objective:.6g}", [line]


def _designed(imported: ImportedNetwork, words: Sequence[str], change: str | None) -> tuple[Design, str, list[str]]:
    """The design for targets of the command line, a title of it, and lines that report it.

    change  of what; None: of stress, unless one of the targets is that of another change
    """
    network = imported.network
    targets = dict[str, Any]()
    for word in words:
        name, equals, value = word.partition("=")
        if not (name and equals and value):
            raise InputError(f"--target must be NAME=VALUE or NAME=LOW:HIGH, such as B_0=0.25, not {word!r}")
        if name in targets:
            raise InputError(f"--target {name} is given twice: give one value, or limits LOW:HIGH")
        targets[name] = value_of(value)
    change = change or change_of(targets)
    if change not in ("stress", "stiffness"):
        raise InputError(f"--change is stress or stiffness, not {change!r:.40}: other changes need Python, design(...)")
    start: Network | SpringState = network
    if change == "stiffness":
        lengths = np.linalg.norm(network.bond_vectors(imported.positions), axis=1)
        start = spring_state(network, lengths, imported.positions)
    solution = design(start, targets, change=change, throw=False)
    lines = [f"{solution.status.name}: {solution.reason}"] + [
        f"{name} {one.value:.12g} ± {one.error:.1e}, requested {targets.get(name, 0)}, "
        f"cost {one.multiplier + 0.0:.3g}, independence {one.independence:.3g}"
        for name, one in solution.targets.items()
    ]
    if change == "stiffness":
        k = solution.value.network.stiffness
        lines.append(f"springs at rest at the positions of the file, stiffness from {k.min():.6g} to {k.max():.6g}")
    return (
        solution,
        ", ".join(f"{name} {one.value:.4g}" for name, one in solution.targets.items() if name in targets),
        lines,
    )
