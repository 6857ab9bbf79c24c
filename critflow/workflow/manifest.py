"""What the pictures, claims and summary of a folder were made from: a file beside them says it, with their checksums.

A dataset says about itself what made it; a figure that is sent on, or kept without the data, cannot.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from critflow.workflow.provenance import VOLATILE
from critflow.workflow.store import write_text

NAME = "manifest.json"


def write_manifest(folder: Path, attributes: Mapping[str, Any], written: Iterable[Path]) -> None:
    """Say that these files come from a dataset with these attributes; so do those that were made from it before."""
    dataset = {name: np.asarray(value).tolist() for name, value in attributes.items()}
    before = _read(folder)
    same = before is not None and _lasting(before["dataset"]) == _lasting(dataset)
    files = before["files"] if before is not None and same else {}
    files = {name: checksum for name, checksum in files.items() if (folder / name).is_file()}
    files |= {str(path.relative_to(folder)): _checksum(path) for path in written}
    plain = {"files": dict(sorted(files.items())), "dataset": dataset}
    write_text(folder / NAME, json.dumps(plain, indent=1, ensure_ascii=False) + "\n")


def strangers(folder: Path) -> Iterator[str]:
    """A line for each file that is not the one that was written, or for the manifest that cannot say."""
    found = _read(folder)
    if found is None:
        yield f"{folder / NAME} does not say what was made"
        return
    for name, checksum in found["files"].items():
        path = folder / name
        if not path.is_file():
            yield f"{path} is missing"
        elif _checksum(path) != checksum:
            yield f"{path} is not the file that was written"


def _read(folder: Path) -> dict[str, dict[str, Any]] | None:
    try:
        found = json.loads((folder / NAME).read_text(encoding="utf-8"))
        whole = all(isinstance(found[part], dict) for part in ("files", "dataset"))
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None
    return found if whole else None


def _lasting(dataset: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in dataset.items() if name not in VOLATILE}


def _checksum(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()
