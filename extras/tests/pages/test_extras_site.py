"""The site of critflow-extras; `tests/sites.py` has the tests of every site."""

import sys
from pathlib import Path

import pytest

pytest.register_assert_rewrite("sites")
ROOT = Path(__file__).parents[3]
sys.path.append(str(ROOT / "docs" / "_ext"))

import place  # noqa: E402

place.DOCS, place.PACKAGE = ROOT / "extras" / "docs", "critflow_extras"

from sites import *  # noqa: E402, F403
from sites import article  # noqa: E402


def test_a_page_of_a_function_shows_its_pictures_and_links_to_its_uses(site):
    page = article(site["reference/entries/critical_strain"])
    assert page.xpath(".//figure//a[contains(@href, 'gallery/index.html#')]/img")
    assert page.xpath(".//a[contains(@href, 'howto/rigidity.html')]")
    assert page.xpath(".//dt[@id='critflow_extras.critical_strain']")
