"""The commands on a user's own network: arguments and messages only.

A command imports inside its function what it computes with, as in `critflow.command.main`.
"""

from __future__ import annotations

import inspect
import math
import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from critflow.progress import running
from critflow.result import InputError, Solution

if TYPE_CHECKING:
    from critflow.critical.manifold import CriticalConfiguration
    from critflow.extras.files.repair import ImportedNetwork
    from critflow.extras.targets.targets import Design
    from critflow.networks.network import Network

FilesArgument = Annotated[
    list[Path], typer.Argument(metavar="FILE", help="A network, its ending names the format; or two tables.")
]


def _value(text: str) -> Any:
    """A number, a pair of limits, either of which may be empty, or a word."""
    from critflow.extras.files.data import number

    first, colon, last = text.partition(":")
    try:
        return (number(first or "-inf"), number(last or "inf")) if colon else number(first)
    except ValueError:
        return text


def _numbers(option: str, example: str, text: str) -> Any:
    """One number, or several, whole ones as integers."""
    from critflow.extras.files.data import number

    try:
        numbers = [number(word) for word in text.replace(",", " ").split()]
    except ValueError:
        raise InputError(f"--{option} must be numbers, such as {example}, not {text!r}") from None
    values = [int(value) if value.is_integer() else value for value in numbers]
    return values[0] if len(values) == 1 else values


def _cell(text: str) -> Any:
    """Side lengths (d,), or vectors (d, d) row by row."""
    numbers = _numbers("cell", "'10 10' or '10 0 2 8'", text)
    return np.reshape(numbers, (math.isqrt(np.size(numbers)), -1)).tolist() if np.size(numbers) in (4, 9) else numbers


def _pins(text: str) -> Any:
    """A rule, or vertices, as numbers where all are numbers."""
    names = [name.strip() for name in text.split(",")]
    if all(name.lstrip("-").isdigit() for name in names):
        return [int(name) for name in names]
    return names if len(names) > 1 else text


# Options of the command line on how a file is read, keywords of `network_from`: value in the help, meaning, parser.
_HINTS: dict[str, tuple[str | None, str, Callable[[Any], Any]]] = {
    "cell": ("NUMBERS", "Cell of a file without one: side lengths, or vectors row by row.", _cell),
    "pins": (
        "RULE|LIST",
        "Fixed vertices: hull, outer_face, two_edges, degree, box, border, or names with commas.",
        _pins,
    ),
    "volume": ("V", "Volume to which moduli refer without a cell: a number, or hull.", _value),
    "pixel": (
        "SIZE",
        "Size of a pixel of a picture; three numbers for a stack, pages first.",
        partial(_numbers, "pixel", "'0.5' or '2 0.5 0.5'"),
    ),
    "labels": (None, "The values of a picture number the cells of a tissue; else it is fibres.", bool),
    "nearest": (None, "Accept nearest images of long edges.", bool),
    "strict": (None, "Refuse a file that needs a repair.", bool),
    "contract": (None, "Join the edges of vertices of two edges in series.", bool),
    "join_crossings": (None, "Put a vertex where two edges cross in the plane.", bool),
}
_Case = Annotated[
    list[str], typer.Option("--set", metavar="AXIS=VALUE", help="The case of a critflow dataset; may be repeated.")
]


@dataclass(frozen=True)
class Hints:
    """The options that are given on how a file is read, by name, and the words for the case of a dataset."""

    values: dict[str, Any]
    case: list[str]

    @property
    def keywords(self) -> dict[str, Any]:
        """The options as keywords of `network_from`."""
        return {name: _HINTS[name][2](value) for name, value in self.values.items()}

    @property
    def words(self) -> list[str]:
        """The options as words of the command."""
        words = [word for value in self.case for word in ("--set", value)]
        for name, value in self.values.items():
            words += [_spelled(name), *([] if value is True else [value])]
        return words


def _spelled(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def reading(command: Callable[..., int]) -> Callable[..., int]:
    """The command with the options of `Hints` in place of its parameter `hints`; its refusals spell them as options."""
    signature, keyword = inspect.signature(command, eval_str=True), inspect.Parameter.KEYWORD_ONLY
    parameters = [p.replace(kind=keyword) for name, p in signature.parameters.items() if name != "hints"]
    for name, (value, meaning, _) in _HINTS.items():
        kind = str if value else bool
        option = Annotated[kind, typer.Option(_spelled(name), metavar=value, help=meaning)]  # type: ignore[valid-type]
        parameters.append(inspect.Parameter(name, keyword, default=kind(), annotation=option))
    parameters.append(inspect.Parameter("case", keyword, default=[], annotation=_Case))

    @wraps(command)
    def call(**values: Any) -> int:
        given = {name: value for name in _HINTS if (value := values.pop(name))}
        try:
            return command(hints=Hints(given, values.pop("case")), **values)
        except InputError as error:
            raise InputError(in_shell(str(error))) from None

    call.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    call.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return call


def read(files: Sequence[Path], hints: Hints) -> ImportedNetwork:
    """The network of a file, or of two tables, with the hints of the command line."""
    from critflow.extras.files.convert import network_from
    from critflow.extras.files.data import require_regular

    keywords = hints.keywords
    file, labels = files[0], keywords.pop("labels", False)
    if len(files) > 2 or (len(files) == 2 and (labels or file.suffix == ".nc")):
        raise InputError(f"a network is one file, or a table of edges and one of vertices, not {len(files)} files")
    require_regular(file)
    if labels:
        return network_from(labels=file, **keywords)
    if file.suffix != ".nc":
        return network_from(file if len(files) == 1 else files, **keywords)
    from critflow.extras.examine.show import choose_case
    from critflow.workflow.dataset import opened_dataset

    with opened_dataset(file) as dataset:
        return network_from(choose_case(dataset, hints.case).load(), **keywords)


# A keyword of `network_from` or `write_network` in a sentence, such as pins='hull' or nearest=True.
_KEYWORD = re.compile(rf"\b({'|'.join((*_HINTS, 'copies', 'size', 'radius', 'by_stiffness'))})=('?)([\w.]*)\2")
# What sentences of the library call functions, in the words of the command.
_IN_SHELL = {
    "examine(FILE)": "critflow examine FILE",
    "nearest_critical(network, coordinates) restores": "critflow make FILE --objective nearest restores",
    "nearest_critical restores": "critflow make FILE --objective nearest restores",
    "prune_towards(": "in Python, prune_towards(",
}


def in_shell(sentences: str) -> str:
    """Sentences of the library with options of the command in place of keywords: --pins hull for pins='hull'."""

    def option(keyword: re.Match[str]) -> str:
        name, _, value = keyword.groups()
        return f"{_spelled(name)} {'' if value == 'True' else value}".strip()

    for function, words in _IN_SHELL.items():
        sentences = sentences.replace(function, words)
    return _KEYWORD.sub(option, sentences)


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
        bool, typer.Option("--by-stiffness", help="Cross sections of drawn or solid struts by their stiffness.")
    ] = False,
    copies: Annotated[
        str, typer.Option(metavar="NUMBERS", help="Copies of a periodic cell along each cell vector, such as '2 3'.")
    ] = "1",
) -> int:
    """Read a network, report each repair, and write it in another format."""
    from critflow.extras.files.convert import write_network
    from critflow.extras.files.formats import writable_format

    if len(files) < 2:
        raise InputError("convert needs a file to read and one to write: critflow convert FILE OUT")
    *files, out = files
    given = {"size": size, "radius": radius, "by_stiffness": by_stiffness or None}
    options: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    writable_format(out, options=options)
    imported = read(files, hints)
    print(in_shell(str(imported)))
    write_network(imported, out, copies=_numbers("copies", "'2' or '2 3'", copies.replace("x", " ")), **options)
    print(f"  written to {out}")
    return 0


@reading
def examine_file(
    files: FilesArgument,
    hints: Hints,
    out: Annotated[
        Path | None, typer.Option(metavar="PAGE", help="Also write a page with pictures, .html or .md.")
    ] = None,
) -> int:
    """Read a network and print whether and why it is rigid, its critical strains and moduli, and what to do next."""
    from critflow.extras.examine.examine import examine, read_held
    from critflow.extras.examine.report import report_lines

    if out is not None:
        from critflow.extras.examine.page import require_page, write_page

        require_page(out)
    names = " and ".join(file.name for file in files)
    with running(f"examining {names}") as tell:

        def progress(part: str) -> None:
            tell(in_shell(part))

        imported = read_held(lambda **pins: read(files, replace(hints, values=hints.values | pins)), progress)
        examination = examine(imported, progress=progress)
    words = shlex.join([*map(str, files), *hints.words])
    print(in_shell("\n".join(report_lines(examination, words))))
    if out is not None:
        write_page(examination, out, words)
        print(f"\nwritten to {out}")
    return 0


@reading
def make(
    files: FilesArgument,
    out: Annotated[Path, typer.Option(metavar="OUT", help="The file to write; its ending names the format.")],
    hints: Hints,
    objective: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="A quantity, such as B_0, G_0 or V_tau, or nearest to the positions; B_0 unless there are targets.",
        ),
    ] = "",
    picture: Annotated[Path | None, typer.Option(metavar="PNG", help="Also draw the configuration.")] = None,
    target: Annotated[
        list[str],
        typer.Option(metavar="NAME=VALUE", help="A property to reach, a value or LOW:HIGH; may be repeated."),
    ] = [],  # noqa: B006 (typer reads the default and copies it)
) -> int:
    """Read a network, find its best critical configuration or one with requested properties, certify it and write it.

    Many parameters: each is an option of the command.
    """
    from critflow.extras.examine.report import certificate_text
    from critflow.extras.files.convert import write_network
    from critflow.extras.files.formats import writable_format

    if objective and target:
        raise InputError("--objective is for networks without --target: give NAME=largest or NAME=smallest as a target")
    objective = objective or "B_0"
    # Before a long computation, whose result could not be written.
    writable_format(out)
    if picture is not None:
        from critflow.figures.drawing import draw, require_picture, saved

        require_picture(picture)
    imported = read(files, hints)
    print(in_shell(str(imported)))
    writable_format(out, imported.network.dimension)
    with running(f"making {out.name}"):
        solution, title, lines = _made(imported, objective, target)
    critical = solution.value
    print("\n".join(f"  {line}" for line in lines))
    if not np.isfinite(critical.coordinates).all():
        return 3
    print(f"  {certificate_text(critical, title, solution.status)}")
    write_network(critical, out)
    print(f"  written to {out}")
    if picture is not None:
        saved(draw(critical, title=title).figure, picture)
        print(f"  drawn in {picture}")
    return 0 if solution.ok else 3


def _made(
    imported: ImportedNetwork, objective: str, target: Sequence[str]
) -> tuple[Solution[CriticalConfiguration], str, list[str]]:
    """The configuration with the targets, nearest to the positions or best, a title of it, and lines that report it."""
    from critflow.extras.inference.nearest import nearest_critical
    from critflow.optimisation.optimize import optimize

    if target:
        return _designed(imported.network, target)
    if objective == "nearest":
        fit = nearest_critical(imported.network, imported.positions, throw=False)
        line = f"root mean square distance {fit.distance:.6g} ({fit.status.name}: {fit.reason})"
        return fit, f"{fit.distance:.3g} from the positions", [line]
    optimum = optimize(imported.network, objective, throw=False)
    line = f"{objective} {optimum.objective:.10g} ({optimum.status.name}: {optimum.reason})"
    return optimum, f"{objective} {optimum.objective:.6g}", [line]


def _designed(network: Network, words: Sequence[str]) -> tuple[Design, str, list[str]]:
    """The design for targets of the command line, a title of it, and lines that report it."""
    from critflow.extras.targets.targets import design

    targets = dict[str, Any]()
    for word in words:
        name, equals, value = word.partition("=")
        if not (name and equals and value):
            raise InputError(f"--target must be NAME=VALUE or NAME=LOW:HIGH, such as B_0=0.25, not {word!r}")
        if name in targets:
            raise InputError(f"--target {name} is given twice: give one value, or limits LOW:HIGH")
        targets[name] = _value(value)
    solution = design(network, targets, throw=False)
    lines = [f"{solution.status.name}: {solution.reason}"] + [
        f"{name} {one.value:.12g} ± {one.error:.1e}, requested {targets[name]}, cost {one.multiplier + 0.0:.3g}, "
        f"independence {one.independence:.3g}"
        for name, one in solution.targets.items()
    ]
    return solution, ", ".join(f"{name} {one.value:.4g}" for name, one in solution.targets.items()), lines
