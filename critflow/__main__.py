"""`python -m critflow`: the command, where its script is not on the path."""

from critflow.cli import main

# Worker processes import this module again.
if __name__ == "__main__":
    raise SystemExit(main())
