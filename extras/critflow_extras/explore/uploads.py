"""Files that a tab sends: written to its folder as they arrive, never kept in memory."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import IO

from critflow.result import InputError
from critflow_extras.explore.page import Page

# Largest file that is accepted, and longest name of one, in bytes; files of all tabs that may arrive at a time.
LARGEST_FILE, _LONGEST_NAME, MOST_AT_A_TIME = 50_000_000, 200, 4


def file_name(given: bytes) -> str:
    """The name of a file as sent, without the replacement of control characters; raises `InputError` for others."""
    name = given.decode(errors="ignore")
    is_name = name.encode() == given and name.isprintable() and Path(name).name == name and name != ".."
    if not (is_name and 0 < len(given) <= _LONGEST_NAME):
        raise InputError("the file has no usable name, rename it")
    return name


class Upload:
    """A file on its way to a tab: `write` its parts, then `keep` it, or `drop` it."""

    def __init__(self, page: Page, name: str, root: Path):
        # In one folder, where the two tables of a network find each other.
        page.folder = page.folder or Path(tempfile.mkdtemp(dir=root))
        self.page, self.name = page, name
        self._file: IO[bytes] = tempfile.NamedTemporaryFile(dir=root, prefix="arriving-", delete=False)

    def write(self, part: bytes) -> None:
        """Add the next bytes."""
        self._file.write(part)

    def keep(self) -> None:
        """The file is complete: the tab may open it."""
        assert self.page.folder is not None
        self._file.close()
        self.page.uploads[self.name] = Path(self._file.name).replace(self.page.folder / self.name)

    def drop(self) -> None:
        """The file did not arrive."""
        self._file.close()
        Path(self._file.name).unlink(missing_ok=True)
