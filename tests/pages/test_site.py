"""The site of critflow; `sites.py` has the tests of every site."""

import re

import pytest

import critflow


def test_claims_are_pages_and_the_site_stays_small(site):
    assert 30 < len([name for name in site if "/entries/" not in name]) <= PAGES_OF_SITE
    claims = article(site["claims"])
    assert sum("Measured:" in one.text_content() for one in claims.xpath(".//li")) == len(STATEMENTS)
    assert claims.xpath(".//li//a[contains(@href, 'results.html#shear')]")
    assert not article(site["results"]).xpath(".//a[contains(@href, 'claims.md')]")
