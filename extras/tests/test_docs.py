"""The documents of critflow-extras; `tests/documents.py` has the tests of every page."""

import re
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

pytest.register_assert_rewrite("documents")
ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "docs" / "_ext"))

import place  # noqa: E402

place.DOCS, place.PACKAGE = ROOT / "extras" / "docs", "critflow_extras"

from documents import *  # noqa: E402, F403
from documents import DOCS, PAGES, name_of  # noqa: E402

NAMED = [page for page in PAGES if page.is_relative_to(DOCS) and page.stem not in ("changelog", "claims")]


@pytest.mark.parametrize("page", NAMED, ids=name_of)
def test_a_page_names_at_its_top_what_it_needs(page):
    top = page.read_text(encoding="utf-8").partition("\n\n")[2][:600]
    assert "critflow-extras" in top and re.search(r"`\.venv/bin/pip install \. '?\./extras", top), name_of(page)


def test_the_reference_names_every_folder():
    folders = {path.parent.name for path in (ROOT / "extras" / "critflow_extras").glob("*/__init__.py")}
    text = (DOCS / "reference" / "index.md").read_text(encoding="utf-8")
    # The three `design_...` of other changes share the section of `targets`, whose text names them.
    assert folders <= set(re.findall(r"(?:^## |`)(\w+)\b", text, flags=re.M))
    assert set(re.findall(r"^## (.+)$", text, flags=re.M)) <= folders


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_the_programs_of_a_page_are_in_the_repository(page):
    text = page.read_text(encoding="utf-8")
    for module in re.findall(r"python -m ([\w.]+)", text):
        assert find_spec(module), module
    for file in re.findall(r"python (\S+\.py)\b", text):
        assert (ROOT / file).is_file(), file
