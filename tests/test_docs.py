"""The documents of critflow, which run without critflow-extras; `documents.py` has the tests of every page."""

import inspect
import re
from pathlib import Path

import pytest

import critflow
from critflow.quantities import ALIASES
from workflows.pages.paper import EQUATIONS, named

pytest.register_assert_rewrite("documents")

from documents import *  # noqa: E402, F403
from documents import DOCS, PAGES, ROOT, blocks  # noqa: E402

WORDS = 27_000


def test_the_documents_name_nothing_that_needs_the_extras():
    """Code of a page uses critflow alone; the way to the extras is a link to their pages."""
    code = [(page.name, block.text) for page in PAGES if page.is_relative_to(DOCS) for block in blocks(page)]
    scripts = [*DOCS.glob("gallery/*.py"), *DOCS.glob("pictures/*.py")]
    code += [(script.name, script.read_text(encoding="utf-8")) for script in scripts]
    assert [name for name, text in code if "import critflow_extras" in text or "from critflow_extras" in text] == []


def test_the_documents_are_short():
    words = {page: len(page.read_text(encoding="utf-8").split()) for page in PAGES if page.is_relative_to(DOCS)}
    assert sum(words.values()) <= WORDS


def test_every_status_is_explained():
    rows = re.findall(r"^\| `(\w+)` \| (\d+) \|", (DOCS / "failures.md").read_text(encoding="utf-8"), flags=re.M)
    assert rows == [(status.name, str(int(status))) for status in critflow.Status]


def test_the_pages_on_theory_name_the_function_of_every_equation():
    """Those that the extras compute stand on their page on rigidity."""
    pages = [*(DOCS / "theory").glob("*.md"), *(ROOT / "extras" / "docs" / "theory").glob("*.md")]
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    rows = re.findall(r"^\| (\(\d+\).*) \| `([^`]+)` \|$", text, flags=re.M)
    found = [(number, function) for numbers, function in rows for number in re.findall(r"\d+", numbers)]
    assert sorted(found) == sorted((equation.number, named(equation.function)) for equation in EQUATIONS)


# Modules that define the bounds of these functions, and those that are imported from their module.
DELEGATES = {
    "CriticalManifold": ("refinement.py",),
    "critical_from_lengths": ("lengths.py",),
    "optimize": ("descent.py",),
    "strain_path": ("equilibria.py",),
}


BOUND = r"[Ee]rrors?( bounds?)? \("  # before its kind


def source_of(module: str) -> str:
    return (ROOT / "critflow" / module).read_text(encoding="utf-8")


def test_error_bounds_have_the_kind_that_their_modules_state():
    text = (ROOT / "docs" / "failures.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \|.*\| (.*(?:proof|estimate).*) \|$", text, flags=re.M)
    assert len(rows) == 8
    for names, kinds in rows:
        for name in re.findall(r"`(\w+)`", names):
            stated = "".join(source_of(module) for module in DELEGATES.get(name, ()))
            if hasattr(critflow, name):
                one = inspect.unwrap(getattr(critflow, name))
                own, module = inspect.getdoc(one) or "", Path(inspect.getfile(one)).read_text(encoding="utf-8")
                stated += own if re.search(BOUND, own) else module
            assert stated, name
            for kind in ("proof", "estimate"):
                assert bool(re.search(BOUND + kind, stated)) == (kind in kinds), name


def test_the_glossary_lists_the_long_names_of_quantities():
    text = (DOCS / "glossary.md").read_text(encoding="utf-8").split("## Long names")[1]
    rows = dict(re.findall(r"^\| `(\w+)` \| `(\w+)` \|$", text, flags=re.M))
    assert {long: symbol for symbol, long in rows.items()} == ALIASES
