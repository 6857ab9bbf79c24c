"""Markdown pages: tables from the committed results, pictures that exist, the example of the README."""

import json
import re
from pathlib import Path

import pytest

from workflows.pages.tables import REFERENCE, TABLES, filled, pages

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_tables_are_up_to_date_and_pictures_exist(page):
    text = page.read_text(encoding="utf-8")
    assert filled(text) == text, "write it again: python -m workflows.pages.tables"
    for picture in re.findall(r"\]\(([^)\s]*\.(?:png|gif|svg))\)", text):
        assert picture.startswith("https://") or (page.parent / picture).is_file(), picture


def test_a_table_follows_its_summary(tmp_path):
    (tmp_path / "ensemble").mkdir()
    measures = {"mean": 0.25, "std": 0.05, "q95": 0.3}
    names = ("bulk_modulus_0", "C_B_exact", "shear_modulus_0", "C_G_exact")
    rows = dict.fromkeys(names, measures) | {"shear_modulus_0": {"mean": 1e-15, "std": 1e-15, "q95": 2e-15}}
    summary = {"networks": 3, "parameters": {"n_vertices": 60}, "populations": {"bulk_modulus": rows}}
    (tmp_path / "ensemble" / "summary.json").write_text(json.dumps(summary))
    page = filled("before\n<!-- populations: generated -->\nold\n<!-- /populations -->\nafter\n", tmp_path)
    assert "| bulk_modulus | 0.25 ± 0.05 | 0.25 ± 0.05 | < 2e-15 | 0.25 ± 0.05 |\n" in page
    assert "3 networks of 60 vertices" in page and "old" not in page
    assert page.startswith("before\n<!-- populations: generated -->\n") and page.endswith("after\n")
    assert filled(page, tmp_path) == page


def test_every_table_can_be_made():
    for name, table in TABLES.items():
        assert "\n|---|" in table(REFERENCE), name


def test_an_unknown_table_is_an_error():
    with pytest.raises(ValueError, match="nonsense"):
        filled("<!-- nonsense: generated -->\n<!-- /nonsense -->\n")
