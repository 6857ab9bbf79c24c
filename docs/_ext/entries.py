"""A page for each function and class of the reference, written before the site reads its pages.

It has the docstring, pictures of the gallery whose scripts use the name, and links to the pages whose code uses it.
"""

import ast
import os
import re
from functools import cache
from pathlib import Path

from api import ENTRIES, REFERENCE, Listed, autodoc, entry_of, listed
from place import DOCS
from programs import gallery_scripts, picture_of

FOLDER = REFERENCE / ENTRIES
PICTURES, LINKS = 2, 6  # at most, in an entry
TAUGHT_FIRST = ("tutorial",)
FENCED = re.compile(r"^```python(?: \S+)?\n(.*?)^```", flags=re.M | re.S)


@cache
def used_in(program: str) -> frozenset[str]:
    """The public names that a program uses, as cf.NAME, ce.NAME or by an import."""
    names = set(re.findall(r"\b(?:cf|ce|critflow|critflow_extras)\.(\w+)", program))
    for imported in re.findall(r"from critflow[\w.]* import (\([^)]*\)|.*)", program):
        names |= set(re.findall(r"\w+", imported))
    return frozenset(names)


@cache
def scripts() -> dict[Path, frozenset[str]]:
    """The scripts of the gallery with the public names that they use, those with the fewest names first."""
    names = {script: used_in(script.read_text(encoding="utf-8")) for script in gallery_scripts()}
    return dict(sorted(names.items(), key=lambda item: len(item[1])))


@cache
def pages() -> dict[str, tuple[str, frozenset[str]]]:
    """The pages whose code is Python: their title, and the public names that they use."""
    titles = {}
    for page in sorted(DOCS.rglob("*.md"), key=lambda page: (page.stem not in TAUGHT_FIRST, -len(page.parts), page)):
        name = page.relative_to(DOCS).with_suffix("").as_posix()
        if name.startswith(("_build", "reference", "notebooks")):
            continue
        text = page.read_text(encoding="utf-8")
        title = re.search(r"^# (.+)", text, flags=re.M)
        titles[name] = (title[1], used_in("\n".join(FENCED.findall(text)))) if title else ("", frozenset())
    return titles


def pictures_of(name: str) -> list[str]:
    """Figures of the scripts that are most about a name: those that use the fewest others."""
    lines = []
    for script in [script for script, names in scripts().items() if name in names][:PICTURES]:
        title = ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))).partition("\n")[0]
        picture = Path(os.path.relpath(picture_of(script), FOLDER)).as_posix()
        target = f"../../gallery/index.html#{script.stem}"
        lines += [f"   .. figure:: {picture}", f"      :target: {target}", f"      :alt: {title}"]
        lines += ["", f"      {title}", ""]
    return [".. rubric:: In the gallery", "", ".. container:: pictures", "", *lines] if lines else []


def links_of(name: str) -> list[str]:
    """Links to the pages whose code uses a name."""
    links = [f":doc:`{title} </{page}>`" for page, (title, names) in pages().items() if name in names][:LINKS]
    return [f"Used in: {'; '.join(links)}.", ""] if links else []


def entry(path: str, place: Listed) -> str:
    """The text of the page of a function or class."""
    module, _, name = path.rpartition(".")
    # Lists of the reference lead to the page: 150 more lines in the contents of every page would hide the others.
    lines = [
        *(":orphan:", ""),
        *(name, "=" * len(name), "", f"``from {module} import {name}``", ""),
        *(autodoc(path), *pictures_of(name), *links_of(name)),
        f"In the group :doc:`{place.heading} </reference/{place.page}>`.",
    ]
    return "\n".join(lines) + "\n"


def write_entries(app):
    """Write the pages that changed, and delete those of names that are gone."""
    FOLDER.mkdir(exist_ok=True)
    texts = {FOLDER / f"{entry_of(path)}.rst": entry(path, place) for place in listed() for path in place.paths}
    assert len({file.name.lower() for file in texts}) == len(texts), "two entries differ in capitals alone"
    for file in set(FOLDER.glob("*.rst")) - set(texts):
        file.unlink()
    for file, text in texts.items():
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def setup(app):
    app.connect("builder-inited", write_entries)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
