"""The command, as a script and as `python -m critflow`."""

from critflow.command.main import main

# Worker processes import this module again.
if __name__ == "__main__":
    raise SystemExit(main())
