"""The command, as a script and as `python -m critflow`."""

import signal
from importlib import import_module


def main() -> int:
    """Run it; a Ctrl-C while its parts are still imported just ends it, as there is nothing to tell."""
    answer = signal.signal(signal.SIGINT, signal.SIG_DFL)
    command = import_module("critflow.cli")
    signal.signal(signal.SIGINT, answer)
    return int(command.main())


# Worker processes import this module again.
if __name__ == "__main__":
    raise SystemExit(main())
