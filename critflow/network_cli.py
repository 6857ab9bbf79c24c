"""The commands on a user's own network: arguments and messages only.

A command imports inside its function the modules that draw, as in `critflow.cli`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from critflow.critical.manifold import CriticalConfiguration
from critflow.critical.objectives import OBJECTIVES
from critflow.design.optimize import optimize
from critflow.examination.examine import examine
from critflow.exchange.convert import network_from, write_network
from critflow.exchange.formats import format_of
from critflow.exchange.repair import ImportedNetwork
from critflow.result import InputError
from critflow.rigidity.counts import certify

FileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="A network; its ending names the format.")]
CellOption = Annotated[
    str, typer.Option(metavar="NUMBERS", help="Cell of a file without one: side lengths, or vectors row by row.")
]
PinsOption = Annotated[
    str, typer.Option(metavar="RULE|LIST", help="Fixed vertices: hull, degree, box, or names with commas.")
]
NearestOption = Annotated[bool, typer.Option("--nearest", help="Accept nearest images of long edges.")]
StrictOption = Annotated[bool, typer.Option("--strict", help="Refuse a file that needs a repair.")]
ContractOption = Annotated[bool, typer.Option("--contract", help="Join the edges of vertices of two edges in series.")]
CaseOption = Annotated[
    list[str],
    typer.Option("--set", metavar="AXIS=VALUE", help="The case of a critflow dataset; may be repeated."),
]


@dataclass(frozen=True)
class Hints:
    """Options of the command line on how a file is read."""

    cell: str
    pins: str
    nearest: bool
    strict: bool
    contract: bool
    case: Sequence[str]


def read(file: Path, hints: Hints) -> ImportedNetwork:
    """The network of a file with the hints of the command line, and its report on the screen."""
    chosen: Any = hints.pins.split(",") if "," in hints.pins else hints.pins or None
    source: Any = file
    if file.suffix == ".nc":
        from critflow.workflow.dataset import opened_dataset
        from critflow.workflow.show import choose_case

        with opened_dataset(file) as dataset:
            source = choose_case(dataset, hints.case).load()
    imported = network_from(
        source,
        cell=_cell(hints.cell),
        pins=_counted(chosen),
        nearest=hints.nearest,
        strict=hints.strict,
        contract=hints.contract,
    )
    print(imported)
    return imported


def convert(
    file: FileArgument,
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The file to write; its ending names the format.")],
    cell: CellOption = "",
    pins: PinsOption = "",
    nearest: NearestOption = False,
    strict: StrictOption = False,
    contract: ContractOption = False,
    case: CaseOption = [],  # noqa: B006 (typer reads the default and copies it)
    size: Annotated[float, typer.Option(metavar="MM", help="Largest extent of a drawing or solid.")] = 100.0,
    radius: Annotated[float, typer.Option(metavar="MM", help="Radius of the struts of a solid.")] = 1.0,
) -> int:
    """Read a network, report each repair, and write it in another format.

    Many parameters: each is an option of the command.
    """
    imported = read(file, Hints(cell, pins, nearest, strict, contract, case))
    options: dict[str, Any] = {}
    if out.suffix.lower() in (".svg", ".dxf", ".stl", ".3mf"):
        options["size"] = size
    if out.suffix.lower() in (".stl", ".3mf"):
        options["radius"] = radius
    write_network(
        imported.network,
        out,
        imported.positions,
        rest_lengths=imported.rest_lengths,
        force_densities=imported.force_densities,
        **options,
    )
    print(f"  written to {out}")
    return 0


def examine_file(
    file: FileArgument,
    out: Annotated[
        Path | None, typer.Option(metavar="PAGE", help="Also write a page with pictures, .html or .md.")
    ] = None,
    cell: CellOption = "",
    pins: PinsOption = "",
    nearest: NearestOption = False,
    strict: StrictOption = False,
    contract: ContractOption = False,
    case: CaseOption = [],  # noqa: B006 (typer reads the default and copies it)
) -> int:
    """Read a network and print whether and why it is rigid, its critical strains and moduli, and what to do next."""
    found = examine(read(file, Hints(cell, pins, nearest, strict, contract, case)))
    print("\n" + str(found))
    if out is not None:
        from critflow.examination.page import write_page

        write_page(found, out)
        print(f"\nwritten to {out}")
    return 0


def make(
    file: FileArgument,
    out: Annotated[Path, typer.Option(metavar="OUT", help="The file to write; its ending names the format.")],
    objective: Annotated[str, typer.Option(metavar="NAME", help=f"One of {', '.join(OBJECTIVES)}.")] = "bulk_modulus",
    picture: Annotated[Path | None, typer.Option(metavar="PNG", help="Also draw the configuration.")] = None,
    cell: CellOption = "",
    pins: PinsOption = "",
    nearest: NearestOption = False,
    strict: StrictOption = False,
    contract: ContractOption = False,
    case: CaseOption = [],  # noqa: B006 (typer reads the default and copies it)
) -> int:
    """Read a network, find its best critical configuration, certify it and write it.

    Many parameters: each is an option of the command.
    """
    imported = read(file, Hints(cell, pins, nearest, strict, contract, case))
    write = writer(out)
    optimum = optimize(imported.network, objective, throw=False)
    found = optimum.value
    certificate = certify(found)
    print(f"  {objective} {optimum.objective:.10g} ({optimum.status.name}: {optimum.reason})")
    rigid = "rigid to second order" if certificate.rigid else "not certified as rigid"
    print(
        f"  certificate: {rigid}, {certificate.n_self_stresses} self-stresses, unbalanced force "
        f"{certificate.residual:.1e} of the mean tension, least tension {certificate.least_tension:.2g} of it"
    )
    if not np.isfinite(found.coordinates).all():
        return 3
    write(found)
    print(f"  written to {out}")
    if picture is not None:
        from critflow.drawing import draw, saved

        saved(draw(found, title=f"{objective} {optimum.objective:.6g}").figure, picture)
        print(f"  drawn in {picture}")
    return 0 if optimum.ok else 3


def writer(out: Path) -> Callable[[CriticalConfiguration], None]:
    """A function that writes a configuration to a file, whose ending is checked now."""
    if format_of(out).write is None:
        raise InputError(f"{out.name} cannot be written: choose another ending")

    def write(found: CriticalConfiguration) -> None:
        write_network(found.network, out, found.coordinates, rest_lengths=found.lengths, force_densities=found.sigma)

    return write


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


def _counted(pins: Any) -> Any:
    """Vertices of a list as numbers where all are numbers."""
    if isinstance(pins, list) and all(name.strip().lstrip("-").isdigit() for name in pins):
        return [int(name) for name in pins]
    return pins
