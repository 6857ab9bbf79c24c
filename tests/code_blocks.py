"""The fenced code blocks of the documents."""

import re
from pathlib import Path
from typing import NamedTuple


class Block(NamedTuple):
    kind: str
    file: str
    text: str
    line: int


def blocks(page: Path) -> list[Block]:
    """The fenced code blocks of a page."""
    found, current = [], None
    for number, line in enumerate(page.read_text(encoding="utf-8").split("\n"), 1):
        if current is None:
            if opening := re.fullmatch(r"\s*```([\w{}]*) ?(\S*)", line):
                current = (opening[1], opening[2], [], number)
        elif line.strip() == "```":
            kind, file, lines, start = current
            found.append(Block(kind, file, "\n".join(lines) + "\n", start))
            current = None
        else:
            current[2].append(line)
    assert current is None, f"{page.name}: a code block is not closed"
    return found


def is_of_the_package(block: Block) -> bool:
    """Whether a block is a file of critflow or of its tests, which only a copy of the package receives."""
    return block.file.startswith(("critflow/", "tests/"))
