"""The subcommands, each imported when it is used: `critflow --help` prints their declarations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from critflow.extensions import Command, extras, missing, named
from critflow.result import InputError

# Those of critflow itself; the files of extras declare theirs.
COMMANDS = {
    "run": Command("critflow.command.run:run", "Compute a study, and write its dataset, figures and claims."),
    "list": Command(
        "critflow.command.read:list_studies", "Name the studies that can be run, or print the settings of one."
    ),
    "status": Command("critflow.command.read:status", "Count the cases of a folder that are done, failed and missing."),
    "verify": Command("critflow.command.read:verify", "Read every byte of a folder, and recompute its physics."),
    "figures": Command("critflow.command.read:figures", "Draw the figures and write the claims of a folder again."),
    "show": Command("critflow.command.read:show", "Print what a dataset is, or draw one configuration of it."),
}


class Subcommands(click.Group):
    """The subcommands of critflow and of all extras that are installed, in the order of their use."""

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **more: Any) -> click.Context:
        self.commands = _declared()
        return super().make_context(info_name, args, parent, **more)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """The subcommand of the first word; `InputError` for one of an extra that is not installed."""
        if args[0] not in self.commands and (extra := missing(args[0])):
            raise InputError(
                f"{args[0]} belongs to the extra {extra!r} of critflow, which is not installed: install critflow again"
            )
        return super().resolve_command(ctx, args)


def _declared() -> dict[str, click.Command]:
    commands = {name: (one, named) for name, one in COMMANDS.items()}
    commands |= {name: (one, extra.named) for extra in extras().values() for name, one in extra.commands.items()}
    return {name: _Declared(name, command, imported) for name, (command, imported) in commands.items()}


class _Declared(click.Command):
    """A subcommand known by its declaration until it is used; `imported` gives the object of its place."""

    def __init__(self, name: str, command: Command, imported: Callable[[str], Any]):
        super().__init__(name, help=command.help)
        self._place, self._imported = command.place, imported

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **more: Any) -> Any:
        """The context of the command itself, with its options."""
        return self._imported(self._place).make_context(info_name, args, parent, **more)
