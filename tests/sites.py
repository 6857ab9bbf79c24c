"""The tests of a site as readers see it: built once, then read as HTML; `place` in docs/_ext says which one.

Examples of the reference run as shown, equations are mathematics, and the tables of the theory lead to functions.
"""

import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from lxml import html

from workflows.pages.paper import EQUATIONS

sys.path.append(str(Path(__file__).parents[1] / "docs" / "_ext"))

from place import DOCS, PACKAGE, ROOT

LARGEST_ENTRY = 12_000  # letters of prose
SIGNS_OF_TEX = re.compile(r"\$|\\[a-z]+\b|[_^]\{|\\[_*|]")


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """The pages by their names, without search and index."""
    for module in ("sphinx", "myst_parser", "furo", "latex2mathml"):  # installed by `docs`
        pytest.importorskip(module)
    folder = tmp_path_factory.mktemp("site")
    words = ["-W", "-q", "-d", str(folder / "trees"), str(DOCS), str(folder / "html")]
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
    pages = {equation.page for equation in EQUATIONS} & {path.stem for path in (DOCS / "theory").glob("*.md")}
    functions = 0
    for name in pages:
        for row in article(site[f"theory/{name}"]).xpath(".//tr[td]"):
            numbers, function = row.xpath("td[1]")[0].text_content(), row.xpath("td[last()]")[0]
            if re.fullmatch(r"(\(\d+\)[,\s]*)+", numbers.strip()):
                functions += numbers.count("(")
                studies = function.text_content().startswith("workflows")
                assert studies or function.xpath(".//a[contains(@href, 'reference/')]"), row.text_content()
    assert functions == sum(equation.page in pages for equation in EQUATIONS) > 9


def test_every_public_name_has_a_page_that_the_reference_lists(site):
    entries = {name for name in site if name.startswith("reference/entries/")}
    linked = set()
    for page in [name for name in site if name.startswith("reference/") and name not in entries]:
        hrefs = article(site[page]).xpath(".//tr/td[1]//a/@href")
        linked |= {f"reference/{href.partition('.html')[0]}" for href in hrefs if href.startswith("entries/")}
    assert linked == entries
    names = {article(site[name]).xpath(".//h1")[0].text_content().rstrip("¶#") for name in entries}
    assert set(import_module(PACKAGE).__all__) <= names
    assert max(len(prose(site[name])) for name in entries) < LARGEST_ENTRY


def test_a_tab_has_a_picture(site):
    for page in site.values():
        assert page.xpath("//link[contains(@rel, 'icon')]/@href")[0].endswith("favicon.svg")
