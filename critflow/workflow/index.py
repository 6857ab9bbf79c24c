"""How stored cases ended, in one file, so that a hundred thousand shards need not be opened to count them.

A line for each shard: case, status, the size and time that tell whether the shard is still the one meant, the table of
the study that it was stored with and a digest of the code that computed it; a checksum guards the line.  Lines that are
cut, damaged or out of date mean nothing, and later ones count: the index can make looking faster, never wrong, and may
be deleted at any time.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import cache
from hashlib import sha256
from pathlib import Path
from zlib import crc32

from critflow.workflow.store import set_aside_folder


def read_index(path: Path) -> dict[str, str]:
    """What the last good line of every case says, for `indexed`."""
    try:
        whole = path.read_bytes()
    except OSError:
        return {}
    entries = {}
    for line in whole.split(b"\n"):
        body, _, check = line.rpartition(b" ")
        if check == b"%08x" % crc32(body):
            case_id, _, entry = body.decode(errors="replace").partition(" ")
            entries[case_id] = entry
    return entries


def indexed(entry: str, shard: os.DirEntry, table: str) -> tuple[int, str] | None:
    """Status and digest of the code in a line; None when the shard is another one now, or the table of the study is."""
    meant, _, told = entry.rpartition(" ")
    try:
        return _read(told) if _stamp(shard.stat(), table) == meant else None
    except (OSError, ValueError):
        return None


@cache
def _read(told: str) -> tuple[int, str]:
    status, _, code = told.partition(":")
    return int(status), code


def _stamp(found: os.stat_result, table: str) -> str:
    return f"{found.st_size} {found.st_mtime_ns} {table}"


@cache
def code_digest(code: str) -> str:
    """A word for what computed a case."""
    return sha256(code.encode()).hexdigest()[:12]


def append_to_index(path: Path, shards: Path, table: str, stored: Iterable[tuple[str, int, str]]) -> None:
    """Add lines for cases that were just stored: case, status and code of each.  A torn line before them is ended."""
    lines = []
    for case_id, status, code in stored:
        try:
            found = os.stat(shards / f"{case_id}.nc")
        except OSError:  # a folder shared by machines may show a file later: then it is opened to be counted
            continue
        body = f"{case_id} {_stamp(found, table)} {status}:{code_digest(code)}".encode()
        lines.append(b"%s %08x\n" % (body, crc32(body)))
    if not lines:
        return
    set_aside_folder(path)
    with open(path, "ab") as file:
        file.write(b"\n" + b"".join(lines))


def listed_shards(shards: Path) -> dict[str, os.DirEntry]:
    """The shards in a folder by the names of their cases, from one look at the folder."""
    try:
        with os.scandir(shards) as entries:
            return {entry.name[:-3]: entry for entry in entries if entry.name.endswith(".nc")}
    except FileNotFoundError:
        return {}
