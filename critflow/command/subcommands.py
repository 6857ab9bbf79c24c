"""The subcommands of the extras, each imported when it is used: `critflow --help` prints what their files declare."""

from __future__ import annotations

from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from critflow.extensions import Command, Extra, extras, missing
from critflow.result import InputError


class Subcommands(TyperGroup):
    """The subcommands of critflow and of all extras that are installed."""

    def __init__(self, **options: Any):
        super().__init__(**options)
        for extra in extras().values():
            for name, command in extra.commands.items():
                self.commands[name] = _Declared(name, extra, command)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The subcommand of the first word; `InputError` for one of an extra that is not installed."""
        if args[0] not in self.commands and (extra := missing(args[0])):
            raise InputError(
                f"{args[0]} belongs to the extra {extra!r} of critflow, which is not installed: install critflow again"
            )
        return super().resolve_command(ctx, args)


class _Declared(TyperCommand):
    """A subcommand of an extra, known by its declaration until it is used."""

    def __init__(self, name: str, extra: Extra, command: Command):
        super().__init__(name, help=command.help)
        self._extra, self._place = extra, command.place

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **more: Any) -> Any:
        """The context of the function itself, with its options."""
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        alone.command(self.name)(self._extra.named(self._place))
        return typer.main.get_command(alone).make_context(info_name, args, parent, **more)
