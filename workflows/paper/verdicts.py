"""Verdicts: the only place where a measurement becomes "holds", "differs" or "undecided".

`committed.json` has the verdicts of the committed runs in words, which `python -m workflows.pages.tables` writes.  The
results themselves are in `results/reference/` of the repository, without which the studies can be installed.
"""

import json
import math
from collections.abc import Iterable
from pathlib import Path

from critflow.engine import Claim

from .statements import STATEMENTS, Measurement, Statement, statement

# An exponent is known if its 95 % interval is no wider than this to each side.
WIDEST = 0.15
LIKELY = 0.5  # a part of the cases above it leaves a share undecided
COMMITTED = Path(__file__).with_name("committed.json")


def committed_run(study: str) -> str:
    """The verdicts of the committed run of a study, empty if it has none."""
    return str(json.loads(COMMITTED.read_text(encoding="utf-8")).get(study, ""))


def claims_of(measurements: Iterable[Measurement]) -> list[Claim]:
    """One claim a statement, in the order of the paper, from all measurements of a study."""
    by_statement: dict[str, list[Measurement]] = {}
    for one in measurements:
        by_statement.setdefault(statement(one.statement).id, []).append(one)
    return [_claim(STATEMENTS[name], by_statement[name]) for name in STATEMENTS if name in by_statement]


def verdict(one: Statement, measured: Measurement) -> str:
    """The verdict of one measurement by the rule of its statement; a value that is not a number decides nothing."""
    ((rule, limit),) = one.rule.items()
    value = measured.value
    if not math.isfinite(value):
        return "undecided"
    if rule == "share":
        return "holds" if value >= limit else "undecided" if LIKELY < value and limit < 1 else "differs"
    if rule == "exponent":
        return _of_exponent(limit, measured)
    low, high = {
        "at_most": lambda: (-math.inf, limit),
        "at_least": lambda: (limit, math.inf),
        "near": lambda: (limit[0] - limit[1], limit[0] + limit[1]),
    }[rule]()
    if low <= value <= high:
        return "holds"
    # An interval that reaches into the range leaves it open.
    return "undecided" if measured.low <= high and low <= measured.high else "differs"


def _of_exponent(printed: float, measured: Measurement) -> str:
    if not measured.low <= printed <= measured.high:
        return "differs" if math.isfinite(measured.low) else "undecided"
    known = measured.high - measured.value <= WIDEST and measured.value - measured.low <= WIDEST
    return "holds" if known else "undecided"


def combined(one: Statement, verdicts: Iterable[str]) -> str:
    """The verdict of a statement from those of its measurements, by its field `rows`."""
    present = set(verdicts)
    if one.rows == "readings":
        return present.pop() if len(present) == 1 else "undecided"
    return next(word for word in ("differs", "undecided", "holds") if word in present)


def _claim(one: Statement, measured: list[Measurement]) -> Claim:
    each = [verdict(one, row) for row in measured]
    counting = [word for word, row in zip(each, measured, strict=True) if row.counts] or ["undecided"]
    result = combined(one, counting)
    # The value of the statement is that of the measurements which gave its verdict: all readings, or those that differ.
    gave = {result} if one.rows == "each" else set(each)
    shown = [row for row, word in zip(measured, each, strict=True) if row.counts and word in gave]
    shown = shown or [row for row in measured if row.counts] or measured
    texts = [f"{row.variant}: {row.text}" if len(measured) > 1 and row.variant else row.text for row in shown]
    reason = {"differs": one.because or "outside the criterion", "undecided": _open(one, counting)}
    notes = dict.fromkeys(row.note for row in measured if row.note)
    rows = [
        {"variant": row.variant, "value": row.text, "n": row.n, "verdict": word if row.counts else ""}
        for row, word in zip(measured, each, strict=True)
    ]
    return Claim(
        one.id, one.text, "", "; ".join(texts), result,
        "; ".join(filter(None, (reason.get(result, ""), *notes))), one.criterion, measured[0].n, "paper", one.place,
        one.difference if result == "differs" else "", rows if len(rows) > 1 else [],
    )  # fmt: skip


def _open(one: Statement, verdicts: list[str]) -> str:
    """What would decide an open statement."""
    if one.open:
        return f"open: {one.open}"
    disagree = {"holds", "differs"} <= set(verdicts)
    return "open: readings of the text disagree" if disagree else "open: more networks"
