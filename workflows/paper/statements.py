"""The statements of the paper, read from `statements.toml`, and measurements of them."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from critflow.engine.study import DIFFERENCES, nearest
from critflow.result import StudyError

RULES = ("share", "at_most", "at_least", "near", "exponent")
KINDS = ("measurement", "identity")
ROWS = ("each", "readings")


@dataclass(frozen=True)
class Statement:
    """One statement of the paper; the head of `statements.toml` describes the fields."""

    id: str
    place: str
    text: str
    criterion: str
    rule: Mapping[str, float | list[float]]
    study: str
    kind: str = "measurement"
    rows: str = "each"
    difference: str = "number"
    because: str = ""
    open: str = ""

    def __post_init__(self) -> None:
        known = len(self.rule) == 1 and set(self.rule) <= set(RULES)
        if not known or self.kind not in KINDS or self.rows not in ROWS or self.difference not in DIFFERENCES:
            raise StudyError(f"statement {self.id!r} has an unknown rule, kind, rows or difference")


@dataclass(frozen=True)
class Measurement:
    """A value of one statement.

    value      what the rule of the statement takes: a number, an exponent, or the part of the cases that satisfy it
    low, high  its 95 % interval, required of exponents
    text       the value with its spread, as a reader sees it
    n          what was measured, for example "84 networks"; values of the first axis by default
    variant    method, stage, size or population where a statement has several measurements
    counts     False: shown beneath the statement, without a part in its verdict
    note       a remark that is shown with the verdict
    """

    statement: str
    value: float
    text: str
    n: str = ""
    variant: str = ""
    low: float = float("nan")
    high: float = float("nan")
    counts: bool = True
    note: str = ""


_TABLE = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))

STATEMENTS = {row["id"]: Statement(**row) for row in _TABLE["statement"]}


def statement(name: str) -> Statement:
    """The statement of this id; `StudyError` for an unknown one."""
    if name not in STATEMENTS:
        raise StudyError(f"no statement is called {name!r}: {nearest(name, list(STATEMENTS), 'statements')}")
    return STATEMENTS[name]
