"""The contents of the site, from the lists of links in the pages `index.md`, and pages with parts from elsewhere."""

import re
from pathlib import Path

from place import DOCS, ROOT

ELSEWHERE = {"results/README.md": "results.md", "README.md": "index.md"} if DOCS == ROOT / "docs" else {}


def relocated(text: str, page: Path) -> str:
    """The text of a page with links to files outside its site: to their page in it, or as text with the file."""

    up = "../" * (len(page.relative_to(DOCS).parts) - 1)

    def link(found: re.Match) -> str:
        target = (page.parent / found["path"]).resolve()
        made = next((made for source, made in ELSEWHERE.items() if target == ROOT / source), None)
        if made:
            return f"[{found['text']}]({up}{made}{found['anchor']})"
        outside = target.is_relative_to(ROOT) and not target.is_relative_to(DOCS)
        return f"{found['text']} (`{target.relative_to(ROOT)}`)" if outside else found[0]

    def study(found: re.Match) -> str:  # the target of [STUDY] in a list of claims: its figures in the page of results
        return f"[{found[1]}]: results.md#{found[1]}" if ELSEWHERE and "extras" not in found[2] else ""

    text = re.sub(r"^\[(\w+)\]: (\.\./\S*/claims\.md)$", study, text, flags=re.M)
    text = re.sub(r"(\]\([./]*notebooks/0\w+)\.ipynb\)", r"\1.md)", text)
    return re.sub(r"(?<!!)\[(?P<text>[^\]]*)\]\((?P<path>[^)#\s]+\.md)(?P<anchor>#[^)\s]*|)\)", link, text)


def with_contents(text: str, folder: Path) -> str:
    """A page `index.md` followed by its contents: the pages that its lists link to, one table for each heading.

    The index of a folder below contains every page of the folder, those that it links to first.
    """
    if folder != DOCS:
        links = re.findall(r"\]\((\w+)\.md\)", text)
        present = sorted(page.stem for page in folder.glob("*.md") if page.stem != "index")
        pages = [name for name in dict.fromkeys([*links, *present]) if name in present]
        return text + table_of("", pages)
    for section in re.split(r"^(?=## )", text, flags=re.M):
        if heading := re.match(r"## (.+)", section):
            text += table_of(heading[1], re.findall(r"^- \[[^\]]*\]\(([\w./]+)\.md\)", section, flags=re.M))
    return text


def table_of(caption: str, pages: list[str]) -> str:
    options = [":hidden:", *([f":caption: {caption}"] if caption else [])]
    return "\n".join(["", "```{toctree}", *options, "", *pages, "```", ""]) if pages else ""


def all_studies() -> str:
    """results/README.md as the second part of the page of results."""
    text = (ROOT / "results" / "README.md").read_text(encoding="utf-8").split("\n", 1)[1]
    text = re.sub(r"\]\(reference/(\w+)/claims\.md\)", "](claims.md)", text)
    text = re.sub(r"\]\(reference/([^)]+)\)", r"](../results/reference/\1)", text)
    return "## Studies\n" + re.sub(r"\]\(\.\./docs/([^)]+)\)", r"](\1)", text)


def with_findings(text: str) -> str:
    """The findings of README.md in place of the line that links to them."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    findings = re.search(r"<!-- what_we_found.*<!-- /what_we_found -->", readme, flags=re.S)[0]
    return re.sub(r"^.*\]\(\.\./README\.md#what-we-found\).*$", lambda _: findings, text, flags=re.M)


APPENDED = {"results": all_studies} if DOCS == ROOT / "docs" else {}


def unbroken(text: str) -> str:
    """Numbers in tables with their units, ranges and exponents in one line."""

    def row(line: re.Match[str]) -> str:
        cells = re.sub(r"(?<=\d) (?=(ms|s|×)\b|×)", "\N{NO-BREAK SPACE}", line[0])
        cells = re.sub(r"(?<=\de)-(?=\d)", "\N{MINUS SIGN}", cells)
        return re.sub(r"\(\S+ to \S+\)", lambda span: span[0].replace(" ", "\N{NO-BREAK SPACE}"), cells)

    return re.sub(r"^\|.*\|$", row, text, flags=re.M)


def read(app, name, source):
    page = DOCS / f"{name}.md"
    if name in APPENDED:
        source[0] += "\n" + APPENDED[name]()
    if name == "index" and ELSEWHERE:
        source[0] = with_findings(source[0])
    source[0] = unbroken(relocated(source[0], page))
    if page.name == "index.md":
        source[0] = with_contents(source[0], page.parent)


def setup(app):
    app.connect("source-read", read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
