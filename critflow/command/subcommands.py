"""The subcommands, each imported when it is used: `critflow --help` prints their declarations."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from critflow.extensions import Command, extras, missing, named
from critflow.result import InputError

# Those of critflow itself; the files of extras declare theirs.
COMMANDS = {
    "run": Command(
        "critflow.command.run:run",
        "Compute the missing cases of a study, then write its dataset, figures and claims.",
    ),
    "list": Command(
        "critflow.command.read:list_studies",
        "Name the studies that can be run, or print the settings of one.",
    ),
    "status": Command(
        "critflow.command.read:status",
        "Count the cases of a folder that are done, failed and missing, from the names of its files.",
    ),
    "verify": Command(
        "critflow.command.read:verify",
        "Read every byte of a folder, recompute the physics from the stored arrays, and a sample of the cases.",
    ),
    "figures": Command(
        "critflow.command.read:figures",
        "Draw the figures and write the claims again from the dataset of a folder, or from what a stopped run stored.",
    ),
    "show": Command(
        "critflow.command.read:show",
        "Print what a dataset is, or draw one configuration of it, chosen by --set, and print its certificate.",
    ),
}


class Subcommands(TyperGroup):
    """The subcommands of critflow and of all extras that are installed."""

    def __init__(self, **options: Any):
        super().__init__(**options)
        for name, command in COMMANDS.items():
            self.commands[name] = _Declared(name, command, partial(named, command.place))
        for extra in extras().values():
            for name, command in extra.commands.items():
                self.commands[name] = _Declared(name, command, partial(extra.named, command.place))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The subcommand of the first word; `InputError` for one of an extra that is not installed."""
        if args[0] not in self.commands and (extra := missing(args[0])):
            raise InputError(
                f"{args[0]} belongs to the extra {extra!r} of critflow, which is not installed: install critflow again"
            )
        return super().resolve_command(ctx, args)


class _Declared(TyperCommand):
    """A subcommand known by its declaration until it is used; `function` imports it."""

    def __init__(self, name: str, command: Command, function: Callable[[], Any]):
        super().__init__(name, help=command.help)
        self._function = function

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **more: Any) -> Any:
        """The context of the function itself, with its options."""
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        alone.command(self.name)(self._function())
        return typer.main.get_command(alone).make_context(info_name, args, parent, **more)
