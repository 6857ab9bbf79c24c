"""The command `critflow`: arguments and messages."""
