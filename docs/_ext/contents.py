"""The contents of the site, from the lists of links in the pages `index.md`, and pages made from files elsewhere."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
ELSEWHERE = {"results/README.md": "studies.md", "README.md": "index.md"}


def relocated(text: str, page: Path) -> str:
    """The text of a page with links to files outside docs/ that have a page in the site."""

    up = "../" * (len(page.relative_to(ROOT / "docs").parts) - 1)

    def link(found: re.Match) -> str:
        target = (page.parent / found["path"]).resolve()
        made = next((made for source, made in ELSEWHERE.items() if target == ROOT / source), None)
        return f"]({up}{made}{found['anchor']})" if made else found[0]

    text = re.sub(r"\]\((0\w+)\.py\)", r"](\1.md)", text) if page.parent.name == "notebooks" else text
    return re.sub(r"\]\((?P<path>[^)#\s]+\.md)(?P<anchor>#[^)\s]*|)\)", link, text)


def with_contents(text: str) -> str:
    """A page `index.md` followed by the contents that its lists of links are, one for each heading."""
    tables = []
    for section in re.split(r"^(?=## )", text, flags=re.M):
        pages = re.findall(r"^- \[[^\]]*\]\(([\w./]+)\.md\)", section, flags=re.M)
        if pages:
            heading = re.match(r"## (.+)", section)
            caption = [f":caption: {heading[1]}"] if heading else []
            tables += ["", "```{toctree}", ":hidden:", *caption, "", *pages, "```"]
    return text + "\n".join(tables) + "\n"


def make_studies() -> None:
    """The page of all studies, from results/README.md."""
    text = (ROOT / "results" / "README.md").read_text(encoding="utf-8")
    text = re.sub(r"\]\((reference/[^)]+\.md)\)", r"](path:../results/\1)", text)
    text = re.sub(r"\]\((reference/[^)]+)\)", r"](../results/\1)", text)
    text = re.sub(r"\]\(\.\./docs/([^)]+)\)", r"](\1)", text)
    page = ROOT / "docs" / "studies.md"
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")


def read(app, name, source):
    page = ROOT / "docs" / f"{name}.md"
    source[0] = relocated(source[0], page)
    if page.name == "index.md":
        source[0] = with_contents(source[0])


def setup(app):
    make_studies()
    app.connect("source-read", read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
