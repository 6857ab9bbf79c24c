"""Markdown pages: tables from the committed results, pictures that exist, the example of the README."""

import json
import re
from pathlib import Path

import pytest

from critflow.engine.code_digest import load_study
from workflows.pages.tables import COMMITTED, MODULI, REFERENCE, filled, pages
from workflows.pages.verdicts import differences, found, of_committed_run, of_the_paper, statement_counts, statements
from workflows.paper.committed import committed_run
from workflows.paper.statements import STATEMENTS

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_tables_are_up_to_date_and_pictures_exist(page):
    text = page.read_text(encoding="utf-8")
    assert filled(text) == text, "write it again: python -m workflows.pages.tables"
    for picture in re.findall(r"\]\(([^)\s]*\.(?:png|gif|svg))\)", text):
        assert picture.startswith("https://") or (page.parent / picture).is_file(), picture


def test_a_table_follows_its_summary(tmp_path):
    (tmp_path / "ensemble").mkdir()
    measures = {"n": 3, "median": 0.25, "q05": 0.2, "q95": 0.3}
    rows = dict.fromkeys(MODULI, measures)
    rows["G_0"] = {"n": 3, "median": 1e-15, "q05": 0.0, "q95": 2e-15}
    rows["C_G"] = measures | {"n": 2, "median": -0.5, "q05": -0.6, "q95": -0.4}
    summary = {"networks": 3, "parameters": {"n_vertices": 60}, "populations": {"max_B_0": rows}}
    (tmp_path / "ensemble" / "summary.json").write_text(json.dumps(summary))
    page = filled("before\n<!-- populations: generated -->\nold\n<!-- /populations -->\nafter\n", tmp_path)
    shown = "0.25 (0.2 to 0.3)"
    assert "| population | n | B_0 | C_B | G_0 | C_G, energy | C_G, stress-corrected |\n" in page
    assert f"| max B_0 | 3, 2 | {shown} | {shown} | < 2e-15 | -0.5 (-0.6 to -0.4) | {shown} |\n" in page
    assert "3 networks of 60 vertices" in page and "old" not in page
    assert page.startswith("before\n<!-- populations: generated -->\n") and page.endswith("after\n")
    assert filled(page, tmp_path) == page


def claim(key, verdict, kind="paper", **more):
    reasons = {"because": "a reason", "criterion": "a rule"} if verdict != "measured" else {}
    named = {"key": key, "statement": f"statement {key}", "paper": "", "value": f"value {key}", "verdict": verdict}
    return named | reasons | {"kind": kind, "sample": "3 networks", "place": "III"} | more


@pytest.fixture
def reference(tmp_path):
    """Committed results of two studies, one claim of which belongs to another study."""
    runs = {
        "ensemble": [claim("equal-lengths", "holds"), claim("kappa-force", "differs", difference="number")],
        "shear": [
            claim("compressed-number", "undecided", rows=[{"variant": "FIRE", "value": "0.5", "n": "9 ascents"}]),
            claim("equal-lengths", "differs", difference="text"),
            claim("a bound", "holds", "ours"),
        ],
    }
    for study, claims in runs.items():
        (tmp_path / study).mkdir()
        (tmp_path / study / "claims.json").write_text(json.dumps(claims))
    return tmp_path


def test_each_statement_has_one_verdict_that_of_its_study(reference):
    assert [one.verdict for one in of_the_paper(reference)] == ["undecided", "holds", "differs"]
    counts = statement_counts(reference)
    assert "Of 3 statements of the paper that were tested, 1 holds, 1 differs and 1 is undecided." in counts
    assert counts.endswith("disagree, 1 by a number.")
    assert of_committed_run(reference, "ensemble") == "In the committed run of 3 networks, 1 holds and 1 differs."
    assert of_committed_run(reference, "gallery") == ""


def test_the_end_of_a_run_quotes_the_committed_one():
    texts = {
        file.parent.name: of_committed_run(REFERENCE, file.parent.name) for file in REFERENCE.glob("*/claims.json")
    }
    assert json.loads(COMMITTED.read_text(encoding="utf-8")) == {name: text for name, text in texts.items() if text}
    assert load_study("ensemble").study.committed == committed_run("ensemble") == texts["ensemble"] != ""


def test_statements_are_one_table_with_their_measurements_beneath(reference):
    table = statements(reference)
    rows = [line for line in table.splitlines() if line.startswith("| statement ")]
    assert [line.split(" | ")[0] for line in rows[1:]] == [
        f"| statement {key}" for key in ("compressed-number", "equal-lengths", "kappa-force")
    ]
    assert "<details><summary>criterion, 1 measurement</summary>a rule<br>FIRE: 0.5 (9 ascents)</details>" in rows[1]
    assert f"Not in the committed results yet, {len(STATEMENTS) - 3} statements: " in table
    first, second = differences(reference).splitlines()
    assert first.startswith("- **Statement kappa-force** (III). The number is another. Measured: value kappa-force.")
    assert second.endswith("Open: a reason.")
    assert "a bound" in found(reference) and "kappa-force" not in found(reference)


def test_an_unknown_table_is_an_error():
    with pytest.raises(ValueError, match="nonsense"):
        filled("<!-- nonsense: generated -->\n<!-- /nonsense -->\n")
