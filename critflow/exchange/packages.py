"""Optional packages that formats need, in one table; a missing one is named with its install command."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from critflow.result import EnvironmentFailure

# Module → extra of this package that installs it.
EXTRAS = {
    "networkx": "graphs",
    "gsd.hoomd": "particles",
    "ase.neighborlist": "particles",
    "meshio": "meshes",
    "ezdxf": "drawings",
    "openpyxl": "tables",
    "trimesh": "solids",
    "lxml.etree": "solids",
    "skimage.morphology": "pictures",
    "skan": "pictures",
}


def optional(module: str) -> Any:
    """Import an optional module; `EnvironmentFailure` with the install command where it is missing."""
    try:
        return import_module(module)
    except ImportError:
        package = module.split(".")[0]
        raise EnvironmentFailure(
            f"this format needs the package {package}, which is not installed: pip install 'critflow[{EXTRAS[module]}]'"
        ) from None
