"""How stored cases ended, in one file, so that a hundred thousand shards need not be opened to count them.

A line for each shard: case, status, and the size and time that tell whether the shard is still the one meant; a
checksum guards the line.  Lines that are cut, damaged or out of date mean nothing, and later ones count: the index can
make looking faster, never wrong, and may be deleted at any time.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from zlib import crc32


def read_index(path: Path) -> dict[str, str]:
    """What the last good line of every case says: its status, and the size and time of its shard."""
    try:
        whole = path.read_bytes()
    except OSError:
        return {}
    entries = {}
    for line in whole.split(b"\n"):
        body, _, check = line.rpartition(b" ")
        if check == b"%08x" % crc32(body):
            case_id, _, entry = body.decode().partition(" ")
            entries[case_id] = entry
    return entries


def indexed_status(entry: str, shard: os.DirEntry) -> int | None:
    """The status in a line of the index; None when the shard is another one now."""
    status, _, meant = entry.partition(" ")
    try:
        return int(status) if _stamp(shard.stat()) == meant else None
    except OSError:
        return None


def _stamp(found: os.stat_result) -> str:
    return f"{found.st_size} {found.st_mtime_ns}"


def append_to_index(path: Path, shards: Path, statuses: Iterable[tuple[str, int]]) -> None:
    """Add lines for cases that were just stored; a torn line before them is ended first."""
    lines = []
    for case_id, status in statuses:
        try:
            found = os.stat(shards / f"{case_id}.nc")
        except OSError:  # a folder shared by machines may show a file later: then it is opened to be counted
            continue
        body = f"{case_id} {status} {_stamp(found)}".encode()
        lines.append(b"%s %08x\n" % (body, crc32(body)))
    if not lines:
        return
    with open(path, "ab") as file:
        file.write(b"\n" + b"".join(lines))


def listed_shards(shards: Path) -> dict[str, os.DirEntry]:
    """The shards in a folder by the names of their cases, from one look at the folder."""
    try:
        with os.scandir(shards) as entries:
            return {entry.name[:-3]: entry for entry in entries if entry.name.endswith(".nc")}
    except FileNotFoundError:
        return {}
