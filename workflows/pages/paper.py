"""Where each equation and figure of the paper is computed: `paper.toml`, read and checked.

Keys are the labels of Hain, Santangelo and Manning's source (arXiv:2407.13939), numbers those that it prints.  A
verdict other than "holds" states the difference; the verdict of a figure follows from the claims of its study.
"""

import tomllib
from pathlib import Path
from typing import NamedTuple


class Equation(NamedTuple):
    """One labelled equation: its number, its page in docs/theory, its meaning, the public function or method that
    computes it, and the test that checks it."""

    label: str
    number: str
    page: str
    meaning: str
    function: str
    test: str
    verdict: str = "holds"


class Figure(NamedTuple):
    """One figure: its content, what is seen, and the study and pictures that reproduce it; no label and number beyond
    the paper."""

    meaning: str
    study: str
    seen: str = ""
    label: str = ""
    number: str = ""
    pictures: tuple[str, ...] = ()


_TABLE = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))

EQUATIONS = tuple(Equation(**row) for row in _TABLE["equation"])
FIGURES = tuple(Figure(**row) for row in _TABLE["figure"])


def named(function: str) -> str:
    """A function of the table as the documents name it: `MODULE: NAME`, `EXTRA: NAME` or `workflows: MODULE.NAME`."""
    module, _, name = function.partition(".")
    if module in ("extras", "workflows"):
        module, _, name = function.removeprefix("extras.").split(".", 2)
    return f"{module}: {name}"


def printed(key: str) -> str:
    """A key as a reader of the paper finds it: "ResponseMetrics-A-max" is Fig. 7 A, max.  Keys of ours stay."""
    numbers = {equation.label: f"Eq. ({equation.number})" for equation in EQUATIONS}
    numbers |= {figure.label: f"Fig. {figure.number}" for figure in FIGURES if figure.label}
    label = max((name for name in numbers if key == name or key.startswith(f"{name}-")), key=len, default="")
    rest = key.removeprefix(label).strip("-").replace("-", ", ")
    return f"{numbers[label]} {rest}".strip() if label else key
