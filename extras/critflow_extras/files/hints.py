"""What the commands on a user's own network share: the options on how its file is read, and the words of refusals.

What reads is imported inside the functions: the help of `critflow` needs none of it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from critflow.result import InputError

if TYPE_CHECKING:
    from critflow_extras.files.repair import ImportedNetwork

files_argument = click.argument(
    "files",
    nargs=-1,
    required=True,
    type=Path,
    metavar="FILE [TABLE]",
    help="A network, its ending names the format; or two tables.",
)


def value_of(text: str) -> Any:
    """A number, a pair of limits, either of which may be empty, or a word."""
    from critflow_extras.files.data import number

    first, colon, last = text.partition(":")
    try:
        return (number(first or "-inf"), number(last or "inf")) if colon else number(first)
    except ValueError:
        return text


def numbers_of(option: str, example: str, text: str) -> Any:
    """One number, or several, whole ones as integers."""
    from critflow_extras.files.data import number

    try:
        numbers = [number(word) for word in text.replace(",", " ").split()]
    except ValueError:
        raise InputError(f"--{option} must be numbers, such as {example}, not {text!r}") from None
    values = [int(value) if value.is_integer() else value for value in numbers]
    return values[0] if len(values) == 1 else values


def _cell(text: str) -> Any:
    """Side lengths (d,), or vectors (d, d) row by row."""
    numbers = numbers_of("cell", "'10 10' or '10 0 2 8'", text)
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
    "volume": ("V", "Volume to which moduli refer without a cell: a number, or hull.", value_of),
    "pixel": (
        "SIZE",
        "Size of a pixel of a label mask; two numbers for rows and columns.",
        partial(numbers_of, "pixel", "'0.5' or '0.5 0.4'"),
    ),
    "traced": (
        "NUMBER",
        "Vertices on each border of a label mask, which follow its curvature.",
        partial(numbers_of, "traced", "2"),
    ),
    "weld": ("DISTANCE", "Join corners of polygons within this distance.", value_of),
    "labels": (None, "The file is a picture whose values number the cells of a tissue.", bool),
    "voronoi": (None, "The file has centres of cells: take their periodic Voronoi network; needs --cell.", bool),
    "nearest": (None, "Accept nearest images of long edges.", bool),
    "strict": (None, "Refuse a file that needs a repair.", bool),
    "contract": (None, "Join the edges of vertices of two edges in series.", bool),
}


@dataclass(frozen=True)
class Hints:
    """The options that are given on how a file is read, by name, and the words for the case of a dataset."""

    values: dict[str, Any]
    case: Sequence[str]

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
    """The function of a command with the options of `Hints` as its argument `hints`; its refusals spell them so."""

    @wraps(command)
    def call(**values: Any) -> int:
        given = {name: value for name in _HINTS if (value := values.pop(name))}
        try:
            return command(hints=Hints(given, values.pop("case")), **values)
        except InputError as error:
            raise InputError(in_shell(str(error))) from None

    case = "The case of a critflow dataset; may be repeated."
    options = [
        # An option declared as no flag, is_flag=False, may stand without its value, and takes none that begins with -.
        *(
            click.option(_spelled(k), is_flag=v is None or None, metavar=v, help=text)
            for k, (v, text, _) in _HINTS.items()
        ),
        click.option("--set", "case", multiple=True, metavar="AXIS=VALUE", help=case),
    ]
    for option in reversed(options):
        call = option(call)
    return call


def read(files: Sequence[Path], hints: Hints) -> ImportedNetwork:
    """The network of a file, or of two tables, with the hints of the command line."""
    from critflow_extras.files.convert import network_from
    from critflow_extras.files.data import require_regular

    keywords = hints.keywords
    file, labels = files[0], keywords.pop("labels", False)
    if hints.case and file.suffix != ".nc":
        raise InputError(f"--set chooses a case of a dataset NAME.nc, and {file.name} is none: leave it out")
    if len(files) > 2 or (len(files) == 2 and (labels or file.suffix == ".nc")):
        raise InputError(f"a network is one file, or a table of edges and one of vertices, not {len(files)} files")
    require_regular(file)
    if labels:
        return network_from(labels=file, **keywords)
    if file.suffix != ".nc":
        return network_from(file if len(files) == 1 else files, **keywords)
    from critflow.command.cases import choose_case
    from critflow.engine.dataset import opened_dataset  # its xarray and dask would delay all other files

    with opened_dataset(file) as dataset:
        return network_from(choose_case(dataset, hints.case).load(), **keywords)


def require_other(out: Path, files: Sequence[Path]) -> None:
    """Raise `InputError` where a file to write is one of those that are read."""
    from critflow.network_files import is_tabular, table_paths

    written = table_paths(out) if is_tabular(out) else (out,)
    for path in (one for file in files for one in (file, *(table_paths(file) if is_tabular(file) else ()))):
        if path.exists() and any(one.exists() and one.samefile(path) for one in written):
            raise InputError(f"{out} would overwrite {path}, which is read: give another name to write to")


_NAMES = "|".join((*_HINTS, "copies", "size", "radius", "by_stiffness", "change"))
# A keyword of `network_from` or `write_network` in a sentence, such as pins='hull' or nearest=True, or what it must be.
_KEYWORD = re.compile(rf"\b({_NAMES})=('?)([\w.+-]*)\2|^({_NAMES})(?= must be )")
# What sentences of the library call functions, in the words of the command.
_IN_SHELL = {
    "examine(FILE)": "critflow examine FILE",
    "nearest_critical(network, coordinates) restores": "critflow make FILE --objective nearest restores",
    "nearest_critical restores": "critflow make FILE --objective nearest restores",
    "prune_towards(": "in Python, prune_towards(",
    "design(..., change='stiffness') changes": "--change stiffness changes",
}


def in_shell(sentences: str) -> str:
    """Sentences of the library with options of the command in place of keywords: --pins hull for pins='hull'."""

    def option(keyword: re.Match[str]) -> str:
        name, _, value, first = keyword.groups(default="")
        return f"{_spelled(name or first)} {'' if value == 'True' else value}".strip()

    for function, words in _IN_SHELL.items():
        sentences = sentences.replace(function, words)
    return _KEYWORD.sub(option, sentences)
