"""Where each equation and figure of the paper is computed: `paper.toml`, read and checked.

Keys are the labels of Hain, Santangelo and Manning's source (arXiv:2407.13939).  A verdict other than "holds" states
the difference; the verdict of a figure follows from the claims of its study.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import NamedTuple


class Equation(NamedTuple):
    """One labelled equation: its meaning, the public function or method that computes it, the test that checks it."""

    label: str
    meaning: str
    function: str
    test: str
    verdict: str = "holds"


class Figure(NamedTuple):
    """One figure: its content, and the study and pictures that reproduce it.  The label is empty beyond the paper."""

    meaning: str
    study: str
    label: str = ""
    pictures: tuple[str, ...] = ()


_TABLE = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
EQUATIONS = tuple(Equation(**row) for row in _TABLE["equation"])
FIGURES = tuple(Figure(**row) for row in _TABLE["figure"])
