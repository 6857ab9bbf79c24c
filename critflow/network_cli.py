"""The commands on a user's own network: arguments and messages only.

A command imports inside its function the modules that draw, as in `critflow.cli`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import numpy as np
import typer

from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.objectives import OBJECTIVES
from critflow.design.designed import Design
from critflow.design.optimize import optimize
from critflow.design.targets import design
from critflow.examination.examine import examine
from critflow.exchange.convert import network_from, write_network, writer_to
from critflow.exchange.data import counted
from critflow.exchange.formats import writable_format
from critflow.exchange.repair import ImportedNetwork
from critflow.networks.network import Network
from critflow.result import InputError, Solution
from critflow.rigidity.counts import certify

FileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="A network; its ending names the format.")]


@dataclass(frozen=True)
class Hints:
    """Options of the command line on how a file is read."""

    cell: Annotated[
        str, typer.Option(metavar="NUMBERS", help="Cell of a file without one: side lengths, or vectors row by row.")
    ] = ""
    pins: Annotated[
        str, typer.Option(metavar="RULE|LIST", help="Fixed vertices: hull, degree, box, or names with commas.")
    ] = ""
    volume: Annotated[
        str, typer.Option(metavar="V", help="Volume to which moduli refer without a cell: a number, or hull.")
    ] = ""
    nearest: Annotated[bool, typer.Option("--nearest", help="Accept nearest images of long edges.")] = False
    strict: Annotated[bool, typer.Option("--strict", help="Refuse a file that needs a repair.")] = False
    contract: Annotated[bool, typer.Option("--contract", help="Join the edges of vertices of two edges in series.")] = (
        False
    )
    join_crossings: Annotated[
        bool, typer.Option("--join-crossings", help="Put a vertex where two edges cross in the plane.")
    ] = False
    case: Annotated[
        list[str],
        typer.Option("--set", metavar="AXIS=VALUE", help="The case of a critflow dataset; may be repeated."),
    ] = field(default_factory=list)


def reading(command: Callable[..., int]) -> Callable[..., int]:
    """The command with the options of `Hints` after the others, in place of its parameter `hints`."""
    options = {
        option.name: inspect.Parameter(
            option.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=[] if option.default is MISSING else option.default,
            annotation=kind,
        )
        for option, kind in zip(fields(Hints), get_type_hints(Hints, include_extras=True).values(), strict=True)
    }
    signature = inspect.signature(command, eval_str=True)
    own = [
        parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        for name, parameter in signature.parameters.items()
        if name != "hints"
    ]

    def call(**given: Any) -> int:
        hints = Hints(**{name: given.pop(name) for name in options})
        return command(hints=hints, **given)

    call.__doc__, call.__name__ = command.__doc__, command.__name__
    parameters = [*own, *options.values()]
    call.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    call.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return call


def read(file: Path, hints: Hints) -> ImportedNetwork:
    """The network of a file with the hints of the command line."""
    source: Any = file
    if file.suffix == ".nc":
        from critflow.examination.show import choose_case
        from critflow.workflow.dataset import opened_dataset

        with opened_dataset(file) as dataset:
            source = choose_case(dataset, hints.case).load()
    return network_from(
        source,
        cell=_cell(hints.cell),
        pins=_pins(hints.pins),
        volume=_volume(hints.volume),
        nearest=hints.nearest,
        strict=hints.strict,
        contract=hints.contract,
        join_crossings=hints.join_crossings,
    )


@reading
def convert(
    file: FileArgument,
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The file to write; its ending names the format.")],
    hints: Hints,
    size: Annotated[float, typer.Option(metavar="MM", help="Largest extent of a drawing or solid.")] = 100.0,
    radius: Annotated[float, typer.Option(metavar="MM", help="Radius of the struts of a solid.")] = 1.0,
    copies: Annotated[
        str, typer.Option(metavar="NUMBERS", help="Copies of a periodic cell along each cell vector, such as '2 3'.")
    ] = "1",
) -> int:
    """Read a network, report each repair, and write it in another format."""
    writable_format(out)
    imported = read(file, hints)
    print(imported)
    options: dict[str, Any] = {"copies": _copies(copies)}
    if out.suffix.lower() in (".svg", ".dxf", ".stl", ".3mf"):
        options["size"] = size
    if out.suffix.lower() in (".stl", ".3mf"):
        options["radius"] = radius
    write_network(imported, out, **options)
    print(f"  written to {out}")
    return 0


@reading
def examine_file(
    file: FileArgument,
    hints: Hints,
    out: Annotated[
        Path | None, typer.Option(metavar="PAGE", help="Also write a page with pictures, .html or .md.")
    ] = None,
) -> int:
    """Read a network and print whether and why it is rigid, its critical strains and moduli, and what to do next."""
    if out is not None:
        from critflow.examination.page import require_page, write_page

        require_page(out)
    found = examine(read(file, hints))
    print(found)
    if out is not None:
        write_page(found, out)
        print(f"\nwritten to {out}")
    return 0


@reading
def make(
    file: FileArgument,
    out: Annotated[Path, typer.Option(metavar="OUT", help="The file to write; its ending names the format.")],
    hints: Hints,
    objective: Annotated[
        str,
        typer.Option(metavar="NAME", help=f"One of {', '.join(OBJECTIVES)}; bulk_modulus unless there are targets."),
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
    if objective and target:
        raise InputError("--objective is for networks without --target: give NAME=largest or NAME=smallest as a target")
    objective = objective or "bulk_modulus"
    # Before a long computation, whose result could not be written.
    writable_format(out)
    if picture is not None:
        from critflow.drawing import draw, require_picture, saved

        require_picture(picture)
    imported = read(file, hints)
    print(imported)
    writer_to(out, imported)
    solution: Solution[CriticalConfiguration]
    if target:
        solution, title = _designed(imported.network, target)
    else:
        optimum = optimize(imported.network, objective, throw=False)
        solution, title = optimum, f"{objective} {optimum.objective:.6g}"
        print(f"  {objective} {optimum.objective:.10g} ({optimum.status.name}: {optimum.reason})")
    found = solution.value
    certificate = certify(found)
    rigid = "rigid to second order" if certificate.rigid else "not certified as rigid"
    print(
        f"  certificate: {rigid}, {counted(certificate.n_self_stresses, 'self-stress')}, unbalanced force "
        f"{certificate.residual:.1e} of the mean tension, least tension {certificate.least_tension:.2g} of it"
    )
    if not np.isfinite(found.coordinates).all():
        return 3
    write_network(found, out)
    print(f"  written to {out}")
    if picture is not None:
        saved(draw(found, title=title).figure, picture)
        print(f"  drawn in {picture}")
    return 0 if solution.ok else 3


def _designed(network: Network, words: Sequence[str]) -> tuple[Design, str]:
    """The design for targets of the command line, reported, and a title of it."""
    targets = dict[str, Any]()
    for word in words:
        name, equals, value = word.partition("=")
        if not (name and equals and value):
            raise InputError(f"--target must be NAME=VALUE or NAME=LOW:HIGH, such as B_0=0.25, not {word!r}")
        if name in targets:
            raise InputError(f"--target {name} is given twice: give one value, or limits LOW:HIGH")
        targets[name] = _target(value)
    made = design(network, targets, throw=False)
    print(f"  {made.status.name}: {made.reason}")
    for name, reached in made.achieved.items():
        print(
            f"  {name} {reached:.12g} ± {made.error_bounds[name]:.1e}, requested {targets[name]}, "
            f"cost {made.multipliers[name] + 0.0:.3g}, independence {made.independence[name]:.3g}"
        )
    return made, ", ".join(f"{name} {reached:.4g}" for name, reached in made.achieved.items())


def _target(text: str) -> Any:
    """A number, a pair of limits, either of which may be empty, or a word."""
    first, colon, last = text.partition(":")
    try:
        return (float(first or "-inf"), float(last or "inf")) if colon else float(first)
    except ValueError:
        return text


def _cell(text: str) -> Any:
    """Side lengths (d,), or vectors (d, d) row by row."""
    if not text:
        return None
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        raise InputError(f"--cell must be numbers, such as '10 10' or '10 0 2 8', not {text!r}") from None
    if len(numbers) in (4, 9):
        d = 2 if len(numbers) == 4 else 3
        return [numbers[i * d : (i + 1) * d] for i in range(d)]
    return numbers[0] if len(numbers) == 1 else numbers


def _copies(text: str) -> list[int]:
    """One number, or one for each cell vector."""
    words = text.replace(",", " ").replace("x", " ").split()
    if not words or not all(word.isdigit() for word in words):
        raise InputError(f"--copies must be whole numbers, such as '2' or '2 3', not {text!r}")
    return [int(word) for word in words]


def _pins(text: str) -> Any:
    """A rule, or vertices, as numbers where all are numbers."""
    if not text:
        return None
    names = [name.strip() for name in text.split(",")]
    if all(name.lstrip("-").isdigit() for name in names):
        return [int(name) for name in names]
    return names if len(names) > 1 else text


def _volume(text: str) -> Any:
    """A number, or the rule that is named."""
    try:
        return float(text) if text else None
    except ValueError:
        return text
