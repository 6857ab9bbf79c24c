"""Where each equation and figure is computed, and what was found: the tables `pages.toml` of both packages.

Keys are the labels of Hain, Santangelo and Manning's source (arXiv:2407.13939), numbers those that it prints.  A
verdict other than "holds" states the difference.
"""

import tomllib
from typing import NamedTuple

from .packages import CRITFLOW, PACKAGES


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


class Finding(NamedTuple):
    """What a study found beyond the paper: a sentence, and the claim whose value follows it or a text with medians."""

    text: str
    study: str
    claim: str = ""
    value: str = ""


_TABLES = {package.name: tomllib.loads(package.texts.read_text(encoding="utf-8")) for package in PACKAGES}

EQUATIONS = tuple(Equation(**row) for row in _TABLES[CRITFLOW.name]["equation"])
FIGURES = {name: tuple(Figure(**row) for row in table["figure"]) for name, table in _TABLES.items()}
FINDINGS = {name: tuple(Finding(**row) for row in table["finding"]) for name, table in _TABLES.items()}


def named(function: str) -> str:
    """A function of the table as the documents name it: `MODULE: NAME`, `EXTRA: NAME` or `workflows: MODULE.NAME`."""
    module, _, name = function.partition(".")
    if module in ("critflow_extras", "workflows"):
        module, _, name = function.removeprefix("critflow_extras.").split(".", 2)
    return f"{module}: {name}"


def printed(key: str) -> str:
    """A key as a reader of the paper finds it: "ResponseMetrics-A-max" is Fig. 7 A, max.  Keys of ours stay."""
    numbers = {equation.label: f"Eq. ({equation.number})" for equation in EQUATIONS}
    numbers |= {figure.label: f"Fig. {figure.number}" for figure in FIGURES[CRITFLOW.name] if figure.label}
    label = max((name for name in numbers if key == name or key.startswith(f"{name}-")), key=len, default="")
    rest = key.removeprefix(label).strip("-").replace("-", ", ")
    return f"{numbers[label]} {rest}".strip() if label else key
