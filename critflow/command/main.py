"""The `critflow` command: its subcommands, and the exit code of each error.

Modules that compute are imported when a subcommand is used: they take most of the start-up time, and worker processes
import this module again.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import click

from critflow.command.messages import INTEGRITY, fail
from critflow.command.subcommands import Subcommands
from critflow.result import CritflowError, EnvironmentFailure, InputError, IntegrityError
from critflow.workflow.folder import LockedError
from critflow.workflow.tasks import Interrupted

INTERRUPTED = 130
EXIT_CODES = (
    (Interrupted, INTERRUPTED),
    (InputError, 2),
    (IntegrityError, INTEGRITY),
    (LockedError, 5),
    (EnvironmentFailure, 6),
)


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


@click.group(cls=Subcommands, no_args_is_help=False, epilog="critflow COMMAND --help prints the options of a command.")
@click.version_option(package_name="critflow", message="%(prog)s %(version)s", help="Print the version.")
def app() -> None:
    """Design spring networks at the rigidity transition, and measure ensembles of them."""
