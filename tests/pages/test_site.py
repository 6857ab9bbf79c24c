"""The site of critflow; `sites.py` has the tests of every site."""

import re

import pytest

import critflow
from workflows.paper.statements import STATEMENTS

pytest.register_assert_rewrite("sites")

from sites import *  # noqa: E402, F403
from sites import article, prose  # noqa: E402

PAGES_OF_SITE = 40  # without the pages of functions and classes


def test_symbols_are_typeset_in_headings_and_docstrings(site):
    for name in ("conventions", "reference/critical", "reference/entries/stiffening", "index"):
        assert article(site[name]).xpath(".//span[@class='symbol']/sub"), name
    assert not re.search(r"(?<!['\"])\b[BGC]_[0BG]\b", prose(site["reference/critical"]))  # 'B_0' is code


def test_the_index_of_the_reference_lists_all_public_names(site):
    names = article(site["reference/index"]).xpath(".//tr/td[1]//a[contains(@href, 'entries/')]//text()")
    assert sorted(names) == sorted(critflow.__all__)


def test_a_page_of_a_function_shows_its_pictures_and_links_to_its_uses(site):
    page = article(site["reference/entries/stiffening"])
    assert page.xpath(".//figure//a[contains(@href, 'gallery/index.html#')]/img")
    assert page.xpath(".//a[contains(@href, 'howto/moduli.html')]")
    assert page.xpath(".//dt[@id='critflow.stiffening']")


def test_claims_are_pages_and_the_site_stays_small(site):
    assert 30 < len([name for name in site if "/entries/" not in name]) <= PAGES_OF_SITE
    claims = article(site["claims"])
    assert len(claims.xpath(".//li[.//strong]")) == len(STATEMENTS)
    assert claims.xpath(".//li//a[contains(@href, 'results.html#shear')]")
    assert not article(site["results"]).xpath(".//a[contains(@href, 'claims.md')]")
    assert "The largest shear modulus needs compression" in article(site["index"]).text_content()  # of README.md
