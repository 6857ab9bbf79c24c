"""What the command prints: errors, and the report of a folder with its verdicts."""

from __future__ import annotations

import os
import sys
import traceback
from typing import TYPE_CHECKING

from critflow.workflow.claim import KINDS, MEANING, verdict_sentence
from critflow.workflow.folder import Folder
from critflow.workflow.study import Study

if TYPE_CHECKING:
    from critflow.workflow.report import Report
INTEGRITY = 4  # exit code of a damaged folder


def fail(sentence: str, code: int) -> int:
    if os.environ.get("CRITFLOW_TRACEBACK"):
        traceback.print_exc()
    warn(sentence)
    return code


def warn(sentence: str) -> None:
    print("critflow:", " ".join(sentence.split()), file=sys.stderr)


def print_report(folder: Folder, report: Report) -> None:
    if report.written:
        print(f"{folder.path}: {', '.join(report.written)}")
    if report.left_out:
        print(f"{folder.path}: not made, because the run does not store their variables: {', '.join(report.left_out)}")


def print_verdicts(study: Study, folder: Folder, report: Report) -> None:
    """The verdicts of a report in words, and those of the committed run of the study."""
    if not report.claims:
        return
    link = f": see {folder.path / 'claims.md'}"
    texts = [text for kind in KINDS if (text := verdict_sentence(report.claims, kind, link))]
    for text in texts or [f"Measured values, without a verdict{link}."]:
        print(text)
    if verdict_sentence(report.claims, "paper", ""):
        print(f"{MEANING} {study.committed}".rstrip())
