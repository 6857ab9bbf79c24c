"""The page of results: every label of the paper once, functions and tests that exist, text that is up to date."""

import ast
import importlib
from pathlib import Path

import pytest

from critflow.workflow.load import named_studies
from critflow.workflow.manifest import strangers
from workflows.pages.paper import EQUATIONS, FIGURES, MORE
from workflows.pages.results import RESULTS, rendered, studies

ROOT = Path(__file__).parents[2]


def test_every_label_stands_once():
    labels = [equation.label for equation in EQUATIONS]
    assert len(set(labels)) == len(labels)
    # The source has 53 labelled equations and 8 labelled figures.
    assert len(labels) == 53
    assert len({figure.label for figure in FIGURES}) == 8


@pytest.mark.parametrize("function", sorted({equation.function for equation in EQUATIONS}))
def test_every_function_exists(function):
    layer, module, *names = function.split(".")
    thing = importlib.import_module(f"critflow.{layer}.{module}")
    for name in names:
        thing = getattr(thing, name)
    assert thing.__doc__, f"{function} has no docstring"


def test_every_equation_is_named_where_it_is_computed():
    """Its label stands in a docstring, or in the supplement's case that of the equation it derives."""
    text = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "critflow").rglob("*.py"))
    named = {equation.function for equation in EQUATIONS if f"`{equation.label}`" in text}
    unnamed = [e.label for e in EQUATIONS if f"`{e.label}`" not in text]
    assert set(unnamed) <= {"BondVectorFDM", "BondVectorDerivativeFDM", "BondVectorDerivativeFDM2", "tangents", "2FF2"}
    assert {equation.function for equation in EQUATIONS if equation.label in unnamed} <= named


@pytest.mark.parametrize("test", sorted({equation.test for equation in EQUATIONS}))
def test_every_test_exists(test):
    file, name = test.split(".")
    tree = ast.parse((ROOT / "tests" / f"{file}.py").read_text(encoding="utf-8"))
    assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_every_study_has_its_place_and_pictures():
    assert set(studies()) == set(named_studies())
    for figure in (*FIGURES, *MORE):
        for picture in figure.pictures:
            assert (RESULTS / figure.study / "figures" / f"{picture}.png").exists(), picture


def test_what_is_kept_is_what_was_made():
    """Where a manifest tells; a figure drawn again by other code would be a stranger."""
    folders = [path.parent for path in RESULTS.glob("*/manifest.json")]
    assert [line for folder in folders for line in strangers(folder)] == []


def test_verdicts_are_words_that_the_table_knows():
    for equation in EQUATIONS:
        assert equation.verdict.split(":")[0].split(";")[0] in ("holds", "differs"), equation.label


def test_the_page_is_up_to_date():
    assert (RESULTS / "README.md").read_text(encoding="utf-8") == rendered()


def test_nothing_committed_is_large():
    for path in RESULTS.rglob("*"):
        if path.suffix in (".png", ".gif", ".json", ".md"):
            assert path.stat().st_size < 2**20, path
