"""The site as readers see it: built once, then read as HTML.

Examples of the reference run as shown, equations are mathematics, and the tables of the theory lead to functions.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from lxml import html

import critflow
from workflows.pages.paper import EQUATIONS
from workflows.paper.statements import STATEMENTS

ROOT = Path(__file__).parents[2]
PAGES_OF_SITE = 52  # without the pages of functions and classes
LARGEST_ENTRY = 12_000  # letters of prose
SIGNS_OF_TEX = re.compile(r"\$|\\[a-z]+\b|[_^]\{|\\[_*|]")


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """The pages by their names, without search and index."""
    for module in ("sphinx", "myst_parser", "furo", "latex2mathml"):  # the extra `docs`
        pytest.importorskip(module)
    folder = tmp_path_factory.mktemp("site")
    words = ["-W", "-q", "-d", str(folder / "trees"), str(ROOT / "docs"), str(folder / "html")]
    done = subprocess.run([sys.executable, "-m", "sphinx", *words], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    pages = {str(file.relative_to(folder / "html"))[:-5]: file for file in (folder / "html").rglob("*.html")}
    return {name: html.parse(file).getroot() for name, file in pages.items() if name not in ("search", "genindex")}


def article(page):
    return page.xpath("//article[@id='furo-main-content']")[0]


def prose(page):
    """The text of a page without code, equations and values that a notebook shows as HTML."""
    outside = "ancestor::pre or ancestor::code or ancestor::math or ancestor::script or ancestor::div[@class='value']"
    words = article(page).xpath(f".//text()[not({outside})]")
    return " ".join(word for word in words if word.strip())


def test_no_page_shows_the_source_of_its_markup(site):
    for name, page in site.items():
        found = SIGNS_OF_TEX.search(prose(page))
        assert not found, f"{name}: {prose(page)[max(0, found.start() - 60) : found.end() + 20]}"


def test_every_equation_of_the_theory_leads_to_its_function(site):
    functions = 0
    for name in {f"theory/{equation.page}" for equation in EQUATIONS}:
        for row in article(site[name]).xpath(".//tr[td]"):
            number, _, function = row.xpath("td")
            if re.fullmatch(r"\(\d+\)", number.text_content().strip()):
                functions += 1
                studies = function.text_content().startswith("workflows")
                assert studies or function.xpath(".//a[contains(@href, 'reference/')]"), row.text_content()
    assert functions == len(EQUATIONS)


def test_symbols_are_typeset_in_headings_and_docstrings(site):
    for name in ("conventions", "reference/critical", "reference/entries/stiffening", "index"):
        assert article(site[name]).xpath(".//span[@class='symbol']/sub"), name
    assert not re.search(r"(?<!['\"])\b[BGC]_[0BG]\b", prose(site["reference/critical"]))  # 'B_0' is code


def test_every_public_name_has_a_page_that_the_reference_lists(site):
    entries = {name for name in site if name.startswith("reference/entries/")}
    names = article(site["reference/index"]).xpath(".//tr/td[1]//a[contains(@href, 'entries/')]//text()")
    assert sorted(names) == sorted(critflow.__all__)
    linked = set()
    for page in ("solutions", "networks", "critical", "rigidity", "response", "extras"):
        hrefs = article(site[f"reference/{page}"]).xpath(".//tr/td[1]//a/@href")
        linked |= {f"reference/{href.partition('.html')[0]}" for href in hrefs if href.startswith("entries/")}
    assert linked == entries
    assert max(len(prose(site[name])) for name in entries) < LARGEST_ENTRY


def test_a_page_of_a_function_shows_its_pictures_and_links_to_its_uses(site):
    page = article(site["reference/entries/critical_strain"])
    assert page.xpath(".//figure//a[contains(@href, 'gallery/index.html#')]/img")
    assert page.xpath(".//a[contains(@href, 'howto/rigidity.html')]")
    assert page.xpath(".//dt[@id='ce.critical_strain']")


def test_a_tab_has_a_picture(site):
    for page in site.values():
        assert page.xpath("//link[contains(@rel, 'icon')]/@href")[0].endswith("favicon.svg")


def test_claims_are_pages_and_the_site_stays_small(site):
    assert len([name for name in site if "/entries/" not in name]) <= PAGES_OF_SITE
    claims = article(site["claims"])
    assert sum("Measured:" in one.text_content() for one in claims.xpath(".//li")) == len(STATEMENTS)
    assert claims.xpath(".//li//a[contains(@href, 'results.html#shear')]")
    assert not article(site["results"]).xpath(".//a[contains(@href, 'claims.md')]")
