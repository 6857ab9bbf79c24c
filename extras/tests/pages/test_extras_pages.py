"""The pages of the extras: up to date with the committed results, functions and tests that exist."""

import ast
import re

import pytest
from pages.test_tables import unreadable

import critflow_extras as ce
from critflow.engine.code_digest import load_study
from workflows.pages.packages import EXTRAS, ROOT
from workflows.pages.paper import EQUATIONS, FIGURES, FINDINGS
from workflows.pages.results import rendered, studies
from workflows.pages.tables import filled, pages
from workflows.pages.verdicts import committed


@pytest.mark.parametrize("page", pages(EXTRAS), ids=lambda page: str(page.relative_to(ROOT)))
def test_tables_are_up_to_date_and_pictures_exist(page):
    text = page.read_text(encoding="utf-8")
    assert filled(text, EXTRAS) == text, "write it again: python -m workflows.pages.tables"
    for picture in re.findall(r"\]\(([^)\s]*\.(?:png|gif|svg))\)", text):
        assert picture.startswith("https://") or (page.parent / picture).is_file(), picture


def test_the_page_of_results_is_up_to_date():
    text = (EXTRAS.folder / "results" / "README.md").read_text(encoding="utf-8")
    assert text == rendered(EXTRAS), "write it again: python -m workflows.pages.results"


@pytest.mark.parametrize("page", ["README.md", "docs/claims.md", "results/README.md"])
def test_a_page_has_no_html_and_no_long_cell(page):
    assert unreadable((EXTRAS.folder / page).read_text(encoding="utf-8")) == []


def test_figures_and_findings_are_of_studies_with_results():
    claims = committed(EXTRAS)
    for figure in FIGURES[EXTRAS.name]:
        for picture in figure.pictures:
            files = (EXTRAS.reference / figure.study / "figures").glob(f"{picture}.*")
            assert [file for file in files if file.suffix in (".png", ".gif")], picture
    for finding in FINDINGS[EXTRAS.name]:
        assert finding.claim in {claim.key for claim in claims[finding.study]}
    assert {load_study(name).study.name for name in studies(EXTRAS)} == set(studies(EXTRAS))


@pytest.mark.parametrize("equation", EQUATIONS, ids=lambda equation: equation.label)
def test_functions_and_tests_of_equations_exist(equation):
    if equation.function.startswith("critflow_extras."):
        assert getattr(ce, equation.function.rpartition(".")[2]).__doc__
    if equation.test.startswith("extras/"):
        file, name = equation.test.split(".")
        tree = ast.parse((ROOT / f"{file}.py").read_text(encoding="utf-8"))
        assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
