"""Markdown pages: tables from the committed results, pictures that exist, the example of the README."""

import json
import re
from pathlib import Path

import pytest

from workflows.pages.tables import MODULI, claim_counts, filled, pages

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
    rows["shear_modulus_0"] = {"n": 3, "median": 1e-15, "q05": 0.0, "q95": 2e-15}
    rows["C_G_exact"] = measures | {"n": 2, "median": -0.5, "q05": -0.6, "q95": -0.4}
    summary = {"networks": 3, "parameters": {"n_vertices": 60}, "populations": {"max_B_0": rows}}
    (tmp_path / "ensemble" / "summary.json").write_text(json.dumps(summary))
    page = filled("before\n<!-- populations: generated -->\nold\n<!-- /populations -->\nafter\n", tmp_path)
    shown = "0.25 (0.2 to 0.3)"
    assert "| population | n | B_0 | C_B | G_0 | C_G, energy | C_G, stress-corrected |\n" in page
    assert f"| max B_0 | 3, 2 | {shown} | {shown} | < 2e-15 | -0.5 (-0.6 to -0.4) | {shown} |\n" in page
    assert "3 networks of 60 vertices" in page and "old" not in page
    assert page.startswith("before\n<!-- populations: generated -->\n") and page.endswith("after\n")
    assert filled(page, tmp_path) == page


def test_claims_are_counted_by_kind(tmp_path):
    kinds = ["paper", "paper", "paper", "ours", "check", "check"]
    verdicts = ["holds", "undecided", "measured", "differs", "holds", "holds"]
    claims = [{"verdict": verdict, "kind": kind} for verdict, kind in zip(verdicts, kinds, strict=True)]
    for study, its_claims in {"one": claims[:2], "other": claims[2:]}.items():
        (tmp_path / study).mkdir()
        (tmp_path / study / "claims.json").write_text(json.dumps(its_claims))
    table = claim_counts(tmp_path)
    assert "Claims of the paper: 1 hold, 0 differ, 1 undecided; claims of ours: 0 hold, 1 differ, 0 undecided;" in table
    assert table.endswith(" checks of the code: 2 hold, 0 differ, 0 undecided.")


def test_an_unknown_table_is_an_error():
    with pytest.raises(ValueError, match="nonsense"):
        filled("<!-- nonsense: generated -->\n<!-- /nonsense -->\n")
