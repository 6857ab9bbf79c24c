"""The command `critflow make`: the best configuration of a file, or one with requested properties."""
