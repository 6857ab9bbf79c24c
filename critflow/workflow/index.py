"""How stored cases ended, in one file, so that a hundred thousand shards need not be opened to count them.

A line for each shard: case, the size and time that tell whether the shard is still the one meant, the table that it was
stored with, its status, a digest of the code that computed it, why it failed, and a checksum.  Lines that are cut,
damaged or out of date mean nothing, and later ones count: the index can make looking faster, never wrong, and may be
deleted at any time.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

from critflow.workflow.store import set_aside_folder

_LONGEST = 300  # letters of why a case failed
_CHECK = 9  # letters of a checksum, with the blank before it


class Stored(NamedTuple):
    """A case that was stored: its id, how it ended, what computed it, and the last line of its error."""

    case_id: str
    status: int
    code: str
    words: str = ""


class Entry(NamedTuple):
    """The same in a line of the index, without its id."""

    table: str
    status: int
    code: str  # digest
    words: str


def read_index(path: Path) -> dict[str, str]:
    """What the last good line of every case says behind its id."""
    try:
        whole = path.read_bytes()
    except OSError:
        return {}
    entries = {}
    for line in whole.split(b"\n"):
        body = line[:-_CHECK]
        if line[-_CHECK:] == b" %08x" % crc32(body):
            case_id, _, entry = body.decode(errors="replace").partition(" ")
            entries[case_id] = entry
    return entries


def known_shards(shards: Path, index: Path) -> dict[str, Entry | None]:
    """The cases that have a shard; with each what the index says of it, None where it was written of another shard."""
    lines, known = read_index(index), dict[str, Entry | None]()
    for case_id in listed_shards(shards):
        try:
            stamp = _stamp(os.stat(f"{shards}/{case_id}.nc"))
        except FileNotFoundError:  # deleted in this moment
            continue
        line = lines.get(case_id, "")
        known[case_id] = _read(line[len(stamp) :]) if line.startswith(stamp) else None
    return known


@cache
def _read(told: str) -> Entry | None:
    try:
        table, status, code, words = told.split(" ", 3)
        return Entry(table, int(status), code, words)
    except ValueError:
        return None


def _stamp(found: os.stat_result) -> str:
    return f"{found.st_size} {found.st_mtime_ns} "


@cache
def code_digest(code: str) -> str:
    """A word for what computed a case."""
    return sha256(code.encode()).hexdigest()[:12]


def append_to_index(path: Path, shards: Path, table: str, stored: Iterable[Stored]) -> None:
    """Add lines for cases that were just stored.  A torn line before them is ended."""
    lines = []
    for case_id, status, code, words in stored:
        try:
            found = os.stat(shards / f"{case_id}.nc")
        except OSError:  # a folder shared by machines may show a file later: then it is opened to be counted
            continue
        line = f"{case_id} {_stamp(found)}{table} {status} {code_digest(code)} {words[:_LONGEST]}"
        body = line.replace("\n", " ").encode(errors="backslashreplace")
        lines.append(b"%s %08x\n" % (body, crc32(body)))
    if not lines:
        return
    set_aside_folder(path)
    with open(path, "ab") as file:
        file.write(b"\n" + b"".join(lines))


def listed_shards(shards: Path) -> list[str]:
    """Names of the cases that have a shard."""
    try:
        return [name[:-3] for name in os.listdir(shards) if name.endswith(".nc")]
    except FileNotFoundError:
        return []
