"""What a run of the tests left out, and why: lines at its end, since a dot and an s say nothing."""

from collections import Counter
from collections.abc import Iterable
from typing import Any

import pytest


def skipped_lines(reports: Iterable[pytest.TestReport | pytest.CollectReport]) -> list[str]:
    """The number of skipped tests, and of files that were skipped as a whole, by reason; the most frequent first."""
    reasons = Counter[str]()
    files = Counter[str]()
    for report in reports:
        # A skip has the file, the line and the reason in place of a traceback.
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        counter = files if isinstance(report, pytest.CollectReport) else reasons
        counter[reason.removeprefix("Skipped: ")] += 1
    if not reasons and not files:
        return []
    counts = [_number(reasons.total(), "test"), _number(files.total(), "file")]
    left_out = " and ".join(count for count, of in zip(counts, (reasons, files), strict=True) if of)
    lines = [f"skipped: {left_out}"]
    for counter, noun in ((reasons, "test"), (files, "file")):
        lines += [f"  {_number(number, noun)}: {reason}" for reason, number in counter.most_common()]
    return lines


def _number(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """A hook of pytest, for a conftest.py to import."""
    for line in skipped_lines(terminalreporter.stats.get("skipped", [])):
        terminalreporter.write_line(line)
