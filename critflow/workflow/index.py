"""How stored cases ended, in one file, so that a hundred thousand shards need not be opened to count them.

A line for each shard: case, status, and the size and time that tell whether the shard is still the one meant; a
checksum guards the line.  Lines that are cut, damaged or out of date mean nothing, and later ones count: the index can
make looking faster, never wrong, and may be deleted at any time.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple


class Entry(NamedTuple):
    """What a line says of a shard."""

    status: int
    size: int
    time: int  # of the last change, in nanoseconds


def read_index(path: Path) -> dict[str, Entry]:
    """The last good line of every case."""
    try:
        lines = path.read_bytes().split(b"\n")
    except OSError:
        return {}
    entries = {}
    for line in lines:
        body, _, check = line.rpartition(b" ")
        if check == b"%08x" % zlib.crc32(body):
            case_id, status, size, time = body.split(b" ")
            entries[case_id.decode()] = Entry(int(status), int(size), int(time))
    return entries


def append_to_index(path: Path, shards: Path, statuses: Iterable[tuple[str, int]]) -> None:
    """Add lines for cases that were just stored; a torn line before them is ended first."""
    lines = []
    for case_id, status in statuses:
        try:
            found = os.stat(shards / f"{case_id}.nc")
        except OSError:  # a folder shared by machines may show a file later: then it is opened to be counted
            continue
        body = f"{case_id} {status} {found.st_size} {found.st_mtime_ns}".encode()
        lines.append(b"%s %08x\n" % (body, zlib.crc32(body)))
    with open(path, "ab") as file:
        file.write(b"\n" + b"".join(lines) if lines else b"")


def listed_shards(shards: Path) -> dict[str, os.DirEntry]:
    """The shards in a folder by the names of their cases, from one look at the folder."""
    try:
        with os.scandir(shards) as entries:
            return {entry.name[:-3]: entry for entry in entries if entry.name.endswith(".nc")}
    except FileNotFoundError:
        return {}
