"""Reading of a user's file: whatever its reader raises is one sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from critflow.exchange.convert import network_from
from critflow.exchange.repair import ImportedNetwork
from critflow.exchange.tables import table_paths
from critflow.result import CritflowError, InputError

# What steps after the reader raise for damaged files.
_DAMAGED = (ValueError, LookupError, TypeError, AttributeError)


def network_of_file(path: Path, **hints: Any) -> ImportedNetwork:
    """The network of a file, with the hints of `network_from`; raises `InputError` where it cannot be read."""
    require_regular(path)
    try:
        with np.errstate(invalid="raise"):
            return network_from(path, **hints)
    except CritflowError:
        raise
    except ArithmeticError:
        reason = "one of its numbers is too large or not finite: correct it"
    except _DAMAGED as error:
        reason = f"{error}: check that it is complete"
    raise InputError(f"{path} cannot be read, {reason}")


def require_regular(path: Path) -> None:
    """Raise `InputError` for a pipe or a device, whose reading may never end."""
    for part in (path, *(table_paths(path) if path.name else ())):
        if part.exists() and not part.is_file() and not part.is_dir():
            raise InputError(f"{part} is no regular file: copy its contents into one")
