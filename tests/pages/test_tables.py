"""Markdown pages: tables from the committed results, pictures that exist, lines that a terminal shows."""

import json
import re

import pytest

from critflow.engine.code_digest import load_study
from workflows.pages.packages import CRITFLOW, ROOT, Package
from workflows.pages.tables import COMMITTED, MODULI, STRUCTURE, committed_runs, filled, pages
from workflows.pages.verdicts import (
    LONGEST,
    differences,
    found,
    holding,
    links,
    of_committed_run,
    of_the_paper,
    short,
    statement_counts,
    what_we_found,
)
from workflows.paper.statements import STATEMENTS
from workflows.paper.verdicts import committed_run

# Read in a terminal, too.
PLAIN = ("README.md", "docs/claims.md", "docs/results.md", "results/README.md")


@pytest.mark.parametrize("page", pages(CRITFLOW), ids=lambda page: str(page.relative_to(ROOT)))
def test_tables_are_up_to_date_and_pictures_exist(page):
    text = page.read_text(encoding="utf-8")
    assert filled(text) == text, "write it again: python -m workflows.pages.tables"
    for picture in re.findall(r"\]\(([^)\s]*\.(?:png|gif|svg))\)", text):
        assert picture.startswith("https://") or (page.parent / picture).is_file(), picture


@pytest.mark.parametrize("page", PLAIN)
def test_a_page_has_no_html_and_no_long_cell(page):
    assert unreadable((CRITFLOW.folder / page).read_text(encoding="utf-8")) == []


def unreadable(text):
    """The HTML of a page, its cells of more than 200 characters, and lines of an entry that begin a list by chance."""
    rows = [re.split(r"(?<!\\)\|", line) for line in text.splitlines() if line.startswith("|")]
    outside = re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.S)
    tags = re.findall(r"</?[A-Za-z][^>\n]*>|&\w+;", outside)
    tags += re.findall(r"^ +(?:[-+#>]|\d+[.)]) .*", text, flags=re.M)
    return tags + [cell for row in rows for cell in row if len(cell.strip()) > 200]


@pytest.mark.parametrize(
    "text, seen",
    [
        ("| a | b |\n\n`<x>` <!-- comment -->", []),
        ("a<br>b &lt; c", ["<br>", "&lt;"]),
        ("- C_B/B_0\n  + 1/2", ["  + 1/2"]),
        (f"| a | {'b' * 201} |", [f" {'b' * 201} "]),
    ],
    ids=["none", "HTML", "a list by chance", "a long cell"],
)
def test_html_and_long_cells_are_seen(text, seen):
    assert unreadable(text) == seen


def test_a_table_follows_its_summary(tmp_path):
    package = Package("critflow", tmp_path, tmp_path)
    (package.reference / "ensemble").mkdir(parents=True)
    measures = {"n": 3, "median": 0.25, "q05": 0.2, "q95": 0.3}
    rows = dict.fromkeys([*MODULI, *STRUCTURE], measures) | {"status": {"ok": 2, "edge_collapse": 1}}
    rows["G_0"] = {"n": 3, "median": 1e-15, "q05": 0.0, "q95": 2e-15}
    rows["C_G"] = measures | {"n": 2, "median": -0.5, "q05": -0.6, "q95": -0.4}
    summary = {"networks": 3, "parameters": {"n_vertices": 60}, "populations": {"max_B_0": rows, "max_G_0": rows}}
    (package.reference / "ensemble" / "summary.json").write_text(json.dumps(summary))
    page = filled("before\n<!-- measures: generated -->\nold\n<!-- /measures -->\nafter\n", package)
    shown = "0.25 (0.2 to 0.3)"
    assert "| population | n | B_0 | C_B | G_0 | C_G, energy | C_G, stress-corrected |\n" in page
    assert f"| max B_0 | 3, 2 | {shown} | {shown} | < 2e-15 | -0.5 (-0.6 to -0.4) | {shown} |\n" in page
    assert f"| max B_0 | 3 | {shown} | {shown} | {shown} | {shown} | 2 ok, 1 edge_collapse |\n" in page
    assert "3 networks of 60 vertices" in page and "old" not in page
    assert page.startswith("before\n<!-- measures: generated -->\n") and page.endswith("after\n")
    assert filled(page, package) == page
    assert "C_B = +0.250 k at B_0 = 0.250 k" in " ".join(what_we_found(package).split())


def claim(key, verdict, kind="paper", **more):
    reasons = {"because": "a reason", "criterion": "a rule"} if verdict != "measured" else {}
    named = {"key": key, "statement": f"statement {key}", "paper": "", "value": f"value {key}", "verdict": verdict}
    return named | reasons | {"kind": kind, "sample": "3 networks", "place": "III"} | more


def package_with(folder, runs, **more):
    """A package with committed claims."""
    package = Package("critflow", folder, folder, **more)
    for study, claims in runs.items():
        (package.reference / study).mkdir(parents=True)
        (package.reference / study / "claims.json").write_text(json.dumps(claims))
    return package


@pytest.fixture
def package(tmp_path):
    """Committed results of two studies, one claim of which belongs to another study, and of a study of an extension."""
    robust = claim("robust", "holds", value="in 10 of 10; force: 0")
    others = {"weak": [robust, claim("equal-lengths", "undecided")], "far": []}
    runs = {
        "ensemble": [claim("equal-lengths", "holds"), claim("kappa-force", "differs", difference="number")],
        "shear": [
            claim("compressed-number", "undecided", rows=[{"variant": "FIRE", "value": "0.5", "n": "9 ascents"}]),
            claim("compressed-length", "undecided"),
            claim("equal-lengths", "differs", difference="text"),
            claim("a bound", "holds", "ours"),
        ],
    }
    return package_with(tmp_path, runs, extensions=(package_with(tmp_path / "more", others),))


def test_each_statement_has_one_verdict_that_of_its_study(package):
    measured = {name: (one.verdict, study) for name, (one, study) in of_the_paper(package).items()}
    assert measured == {
        "compressed-number": ("undecided", "shear"),
        "compressed-length": ("undecided", "shear"),
        "equal-lengths": ("holds", "ensemble"),
        "kappa-force": ("differs", "ensemble"),
        "robust": ("holds", "weak"),
    }
    counts = statement_counts(package)
    assert "Of 5 statements of the paper that were tested, 2 hold, 1 differs and 2 are undecided." in counts
    assert "disagree, 1 by a number." in counts
    assert "Of the 5 that are measurements, 2 hold, 1 differs and 2 are undecided." in counts
    assert "identities" not in counts
    assert "Of these, 1 is tested by studies of critflow-extras: weak." in counts
    assert of_committed_run(package, "ensemble") == "In the committed run of 3 networks, 1 holds and 1 differs."
    assert of_committed_run(package, "gallery") == ""


def test_the_end_of_a_run_quotes_the_committed_one():
    assert COMMITTED.read_text(encoding="utf-8") == committed_runs()
    text = of_committed_run(CRITFLOW, "ensemble")
    assert load_study("ensemble").study.committed == committed_run("ensemble") == text != ""


def test_every_statement_of_the_paper_stands_once_with_its_value_and_study():
    assert set(of_the_paper(CRITFLOW)) == set(STATEMENTS)
    text = (ROOT / "docs" / "claims.md").read_text(encoding="utf-8")
    entries = re.findall(r"^- \*\*(.*?)\n(?=- |<!--)", text, flags=re.M | re.S)
    studies = [re.search(r"\[(\w+)\]$", one.strip())[1] for one in entries]
    assert len(studies) == len(STATEMENTS)
    for study in {*studies}:
        assert (ROOT / "docs" / re.search(rf"^\[{study}\]: (\S+)$", text, flags=re.M)[1]).is_file()


def test_statements_are_entries_with_place_value_and_study(package):
    assert holding(package).splitlines() == [
        "- **Statement equal-lengths** (III): value equal-lengths. [ensemble]",
        "- **Statement robust** (III): force: 0. [weak]",
    ]
    first, second, third = " ".join(differences(package).split()).split(" - ")
    assert first.startswith("- **Statement kappa-force** (III). The number is another: a reason. Measured: value kappa")
    assert "Open: a reason. Measured: value" in second and second.endswith("[shear]")
    assert "Open: as above. Measured: value" in third
    assert "### [shear]\n\n- **Statement a bound**: value a bound (holds)." in found(package)
    assert "kappa-force" not in found(package)
    assert links(package).splitlines() == [
        "[ensemble]: ../results/reference/ensemble/claims.md",
        "[shear]: ../results/reference/shear/claims.md",
        "[weak]: ../more/results/reference/weak/claims.md",
    ]


@pytest.mark.parametrize(
    "text, cut",
    [
        ("1; 2, 3", "1; 2, 3"),
        (f"{'a' * 100}; {'b' * 100}", f"{'a' * 100}; …"),
        (f"{'a' * 100} and {'b' * 50}, {'c' * 50}", f"{'a' * 100} and …"),
        ("word " * 100, "word " * (LONGEST // 5) + "…"),
    ],
    ids=["whole", "at a semicolon", "at a word", "between words"],
)
def test_a_value_is_cut_between_its_parts(text, cut):
    assert short(text) == cut


def test_an_unknown_table_is_an_error():
    with pytest.raises(ValueError, match="nonsense"):
        filled("<!-- nonsense: generated -->\n<!-- /nonsense -->\n")
