"""The subcommands of the extras, each imported when it is used: `critflow --help` prints what their files declare."""

from __future__ import annotations

from typing import Any

import click

from critflow.extensions import Command, Extra, extras, missing
from critflow.result import InputError


class Subcommands(click.Group):
    """The subcommands of critflow and of all extras that are installed."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The names in the order of their use, not of the alphabet, those of extras last."""
        return [*self.commands, *_of_extras()]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        return super().get_command(ctx, name) or _of_extras().get(name)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """The subcommand of the first word; `InputError` for one of an extra that is not installed."""
        if args[0] not in self.list_commands(ctx) and (extra := missing(args[0])):
            raise InputError(
                f"{args[0]} belongs to the extra {extra!r} of critflow, which is not installed: install critflow again"
            )
        return super().resolve_command(ctx, args)


def _of_extras() -> dict[str, click.Command]:
    declared = ((name, extra, command) for extra in extras().values() for name, command in extra.commands.items())
    return {name: _Declared(name, extra, command) for name, extra, command in declared}


class _Declared(click.Command):
    """A subcommand of an extra, known by its declaration until it is used."""

    def __init__(self, name: str, extra: Extra, command: Command):
        super().__init__(name, help=command.help)
        self._extra, self._place = extra, command.place

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **more: Any) -> Any:
        """The context of the command itself, with its options."""
        return self._extra.named(self._place).make_context(info_name, args, parent, **more)
