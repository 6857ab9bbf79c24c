"""Checks of parameters before a run, for several studies."""

from __future__ import annotations

from critflow import InputError, StudyError


def check_positive(parameters, *names):
    """Raise `StudyError` for parameters that are not positive."""
    for name in names:
        if not parameters[name] > 0:
            raise StudyError(f"{name}={parameters[name]} must be positive")


def check_network(make, *arguments):
    """Raise `StudyError` for sizes and hard cores without a network."""
    try:
        make(*arguments)
    except InputError as error:
        raise StudyError(str(error)) from error
