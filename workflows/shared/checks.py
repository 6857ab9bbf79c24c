"""What several studies refuse before anything runs."""

from __future__ import annotations

from critflow import InputError, StudyError


def check_positive(parameters, *names):
    """Refuse parameters that are not positive."""
    for name in names:
        if not parameters[name] > 0:
            raise StudyError(f"{name}={parameters[name]} must be positive")


def check_network(make, *arguments):
    """Refuse sizes and hard cores of which no network can be made."""
    try:
        make(*arguments)
    except InputError as error:
        raise StudyError(str(error)) from error
