"""The `critflow` command: its subcommands, each imported when it is used, and the exit code of each error.

Modules that compute, and those that need xarray, dask or matplotlib, are imported inside the functions of the
subcommands: they take most of the start-up time, a mistake in the arguments needs none of them, and worker processes
import this module again.
"""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from typing import Any

import click

from critflow.engine.store import Interrupted, LockedError
from critflow.extensions import Command, extras, missing, named
from critflow.result import CritflowError, EnvironmentFailure, InputError, IntegrityError

INTERRUPTED, INTEGRITY = 130, 4
EXIT_CODES = (
    (Interrupted, INTERRUPTED),
    (InputError, 2),
    (IntegrityError, INTEGRITY),
    (LockedError, 5),
    (EnvironmentFailure, 6),
)
# The subcommands of critflow itself; the files of extras declare theirs.
COMMANDS = {
    "run": Command("critflow.command.studies:run", "Compute a study, and write its dataset, figures and claims."),
    "list": Command(
        "critflow.command.studies:list_studies", "Name the studies that can be run, or print the settings of one."
    ),
    "status": Command(
        "critflow.command.studies:status", "Count the cases of a folder that are done, failed and missing."
    ),
    "verify": Command("critflow.command.studies:verify", "Read every byte of a folder, and recompute its physics."),
    "figures": Command("critflow.command.studies:figures", "Draw the figures and write the claims of a folder again."),
    "show": Command("critflow.command.studies:show", "Print what a dataset is, or draw one configuration of it."),
}


def main(words: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code; every error is one line on stderr."""
    try:
        return app(sys.argv[1:] if words is None else list(words), prog_name="critflow", standalone_mode=False) or 0
    except click.Abort:
        return fail("interrupted: run the same command again", INTERRUPTED)
    except click.ClickException as error:
        message = error.format_message().replace(". Did you mean", ", did you mean").rstrip(".?")
        forgotten = "extra argument" in message and "=" in message
        path = getattr(getattr(error, "ctx", None), "command_path", "critflow")
        return fail(f"{message}: {'write --set before KEY=VALUE' if forgotten else f'see {path} --help'}", 2)
    except CritflowError as error:
        return fail(str(error), next((code for kind, code in EXIT_CODES if isinstance(error, kind)), 1))
    except (OSError, MemoryError) as error:
        return fail(f"the operating system refused: {str(error) or 'out of memory'}", 6)
    except Exception as error:
        return fail(f"unexpected {type(error).__name__}: {error}: set CRITFLOW_TRACEBACK=1 for the traceback", 1)


def fail(sentence: str, code: int) -> int:
    if os.environ.get("CRITFLOW_TRACEBACK"):
        traceback.print_exc()
    warn(sentence)
    return code


def warn(sentence: str) -> None:
    print("critflow:", " ".join(sentence.split()), file=sys.stderr)


class Subcommands(click.Group):
    """The subcommands of critflow and of all extras that are installed, in the order of their use."""

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **more: Any) -> click.Context:
        places = [(COMMANDS, named), *((extra.commands, extra.named) for extra in extras().values())]
        self.declared = {name: (one, imported) for commands, imported in places for name, one in commands.items()}
        self.commands = {name: click.Command(name, help=one.help) for name, (one, _) in self.declared.items()}
        return super().make_context(info_name, args, parent, **more)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """The subcommand of the first word, imported; `InputError` for one of an extra that is not installed."""
        if args[0] not in self.commands and (extra := missing(args[0])):
            raise InputError(
                f"{args[0]} belongs to the extra {extra!r} of critflow, which is not installed: install critflow again"
            )
        super().resolve_command(ctx, args)  # raises for an unknown one
        command, imported = self.declared[args[0]]
        return args[0], imported(command.place), args[1:]


@click.group(cls=Subcommands, no_args_is_help=False, epilog="critflow COMMAND --help prints the options of a command.")
@click.version_option(package_name="critflow", message="%(prog)s %(version)s", help="Print the version.")
def app() -> None:
    """Design spring networks at the rigidity transition, and measure ensembles of them."""
