"""The tests of documents, for those of critflow and of critflow-extras: `place` in docs/_ext says which ones.

Code blocks run and print what the page shows, links lead somewhere, pictures are those of their scripts.  A page is
executed as one program, in an empty directory, with warnings as errors.  Fenced blocks by info string:

    python FILE      written to FILE, before anything is executed
    console          lines `$ critflow ...` are executed in turn and must succeed, or end in `# exit N`
    python           executed after all commands, as one program for the page
    output           the exact output of the `python` block before it
    text, sh         not executed
"""

import io
import re
import runpy
import shlex
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

from critflow import sparse as backends
from critflow.command.main import main

sys.path.append(str(Path(__file__).parents[1] / "docs" / "_ext"))

import programs
from place import DOCS, ROOT

HERE = DOCS.parent  # the folder of the package, whose README is a page too
MADE = {path.with_suffix(".md") for path in (DOCS / "notebooks").glob("*.ipynb")}  # by the site
BUILT = set((DOCS / "_build").rglob("*.md"))
OUTSIDE = [page for page in (HERE / "README.md", HERE / "workflows" / "README.md") if page.exists()]
PAGES = [*OUTSIDE, *sorted(set(DOCS.rglob("*.md")) - MADE - BUILT)]
COLUMNS, SHOWN = 80, ("python", "console", "sh", "text")
LINES_OF_PICTURE = 40
INFO_STRINGS = {"python", "output", "console", "text", "sh", "toml", "{layer}", "{names}", "{gallery}"}
# Packages of pages that no extra of the project installs.
NEEDED = {"extras/docs/recipes/pictures.md": ("skimage", "skan")}
_MARK = "<<< next block >>>"


class Block(NamedTuple):
    kind: str
    file: str
    text: str
    line: int


def blocks(page: Path) -> list[Block]:
    """The fenced code blocks of a page."""
    found, current = [], None
    for number, line in enumerate(page.read_text(encoding="utf-8").split("\n"), 1):
        if current is None:
            if opening := re.fullmatch(r"\s*```([\w{}]*) ?(\S*)", line):
                current = (opening[1], opening[2], [], number)
        elif line.strip() == "```":
            kind, file, lines, start = current
            found.append(Block(kind, file, "\n".join(lines) + "\n", start))
            current = None
        else:
            current[2].append(line)
    assert current is None, f"{page.name}: a code block is not closed"
    return found


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


def executed(page: Path) -> list[Block]:
    return [block for block in blocks(page) if block.kind in ("python", "console")]


def run_command(line: str) -> None:
    """Run one `$ critflow ...` line and compare its exit code with the one in its comment, 0 by default."""
    command, _, comment = line.removeprefix("$ ").partition("#")
    expected = int(comment.split()[1]) if comment.split()[:1] == ["exit"] else 0
    name, *words = shlex.split(command)
    assert name == "critflow", f"only critflow is executed in a console block, not {name}: use a text block"
    with redirect_stderr(io.StringIO()) as stream:
        code = main(words)
    assert code == expected, f"{command}\n{stream.getvalue()}"


def run_python(page: Path, group: list[Block], folder: Path) -> list[str]:
    """The output of each of these blocks, run as one program."""
    program = folder / "page.py"
    program.write_text(f"print({_MARK!r})\n".join(block.text for block in group), encoding="utf-8")
    if page in OUTSIDE:  # the first program that a reader runs: in a new process, as a script
        words = [sys.executable, "-W", "error", program.name]
        done = subprocess.run(words, capture_output=True, text=True, cwd=folder)
        assert done.returncode == 0, f"{name_of(page)}, blocks from line {group[0].line}:\n{done.stderr}"
        printed = done.stdout
    else:
        with redirect_stdout(io.StringIO()) as stream:
            runpy.run_path(program.name, run_name="__main__")
        printed = stream.getvalue()
        plt.close("all")
    program.unlink()
    return printed.split(f"{_MARK}\n")


@pytest.mark.parametrize("page", [page for page in PAGES if executed(page)], ids=name_of)
def test_the_code_of_a_page_runs_and_prints_what_the_page_shows(page, tmp_path, monkeypatch, empty_pictures):
    for package in NEEDED.get(name_of(page), ()):
        pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(backends, "BACKENDS", dict(backends.BACKENDS))  # a page adds one
    found = blocks(page)
    for block in found:
        if block.kind == "python" and block.file:
            (tmp_path / block.file).write_text(block.text, encoding="utf-8")
    group = [block for block in found if block.kind == "python" and not block.file]
    with empty_pictures():
        for block in found:
            if block.kind == "console":
                for line in block.text.replace("\\\n", " ").splitlines():
                    if line.startswith("$ "):
                        run_command(line)
        printed = dict(zip(group, run_python(page, group, tmp_path), strict=True)) if group else {}
    for block, following in pairwise(found):
        if following.kind == "output":
            assert printed[block] == following.text, f"{name_of(page)}, line {block.line}"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_block_says_how_it_is_used_and_fits_on_the_page(page):
    for block in blocks(page):
        assert block.kind in INFO_STRINGS, f"{name_of(page)}, line {block.line}: ```{block.kind}"
        wide = [line for line in block.text.splitlines() if len(line) > COLUMNS and block.kind in SHOWN]
        assert not wide, f"{name_of(page)}, block at {block.line}: {wide}"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_relative_links_and_anchors_lead_somewhere(page):
    prose = re.sub(r"^\s*```.*?^\s*```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    for target in re.findall(r"\]\(([^)\s]+)\)", prose):
        if re.match(r"https?://|mailto:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{name_of(page)}: {target}"
        if anchor:
            assert anchor in anchors(file), f"{name_of(page)}: {target}"


def anchors(page: Path) -> set[str]:
    """The anchors that GitHub gives to the headings of a page."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), flags=re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_every_page_is_in_the_contents():
    for page in PAGES[len(OUTSIDE) :]:
        folder = page.parent if page.name != "index.md" else page.parent.parent
        above = [index for index in (folder / "index.md", DOCS / "index.md") if index.exists() and index != page]
        links = [f"({page.relative_to(index.parent)})" in index.read_text(encoding="utf-8") for index in above]
        assert page == DOCS / "index.md" or any(links), f"{name_of(page)} is in no index.md"


TAUGHT = [page for page in PAGES if page.parent.name in ("howto", "reference") or page.stem in ("index", "tutorial")]


@pytest.mark.parametrize("page", TAUGHT, ids=name_of)
def test_what_a_block_prints_stands_below_it(page):
    """In a block of output, which is compared, and not in a comment, which is not."""
    found = [block for block in blocks(page) if not block.file]
    for block, following in pairwise([*found, Block("", "", "", 0)]):
        if block.kind == "python":
            place = f"{name_of(page)}, line {block.line}"
            assert "print(" not in block.text or following.kind == "output", f"{place}: its output is not shown"
            assert not re.search(r"^# ?([\[({'\d-]|True|False|None)", block.text, flags=re.M), f"{place}: typed output"


INSTALLED = r"(pip install|sphinx-build|pytest -m|python (?=-m workflows|docs/|workflows/))"
BARE_COMMAND = re.compile(rf"(?<![\w/.'-]){INSTALLED}")


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_name_the_environment_unless_the_page_activates_it(page):
    text = re.sub(r"^<!--.*-->$", "", page.read_text(encoding="utf-8"), flags=re.M)
    found = BARE_COMMAND.search(text)
    assert not found or "bin/activate" in text[: found.start()], f"{name_of(page)}: .venv/bin/{found[0]}"


@pytest.mark.parametrize("page", sorted((DOCS / "howto").glob("*.md")), ids=name_of)
def test_a_how_to_page_begins_with_its_purpose_and_a_picture(page):
    parts = page.read_text(encoding="utf-8").partition("```")[0].split("\n\n")[1:]
    purpose, picture = [part for part in parts if not part.startswith("Needs ")][:2]
    assert re.match(r"\S.* (computes|finds|opens|tells|writes|reads) ", purpose.replace("\n", " ")), "its purpose"
    assert picture.startswith("!["), "a picture"


def test_the_gallery_has_short_scripts_and_shows_them_all():
    scripts = programs.gallery_scripts()
    listed = re.findall(r"```{gallery}\n(.*?)```", (DOCS / "gallery" / "index.md").read_text("utf-8"), flags=re.S)
    assert sorted(" ".join(listed).split()) == [script.stem for script in scripts]
    for script in scripts:
        lines = script.read_text(encoding="utf-8").splitlines()
        assert len(lines) <= LINES_OF_PICTURE and max(map(len, lines)) <= COLUMNS, script.name


@pytest.mark.parametrize("script", programs.gallery_scripts(), ids=lambda script: script.stem)
def test_a_picture_of_the_gallery_is_made_by_its_script(script):
    assert 5_000 < programs.execute_script(script).stat().st_size < 120_000


def reduced(picture: Path) -> np.ndarray:
    """The mean colours of tiles of 6 × 6 pixels, which smoothing and palettes hardly change."""
    with Image.open(picture) as image:
        tiles = image.convert("RGB").resize((image.width // 6, image.height // 6), Image.Resampling.BOX)
    return np.asarray(tiles, float)


DRAWN = sorted((DOCS / "pictures").glob("*.py"))


@pytest.mark.parametrize("script", DRAWN, ids=lambda script: script.stem)
def test_a_committed_picture_is_the_one_of_its_script(script, tmp_path, monkeypatch):
    texts = [script.read_text(encoding="utf-8")]
    texts += [
        (DOCS / "gallery" / name).read_text(encoding="utf-8") for name in re.findall(r"gallery/(\w+\.py)", texts[0])
    ]
    monkeypatch.setattr(sys, "argv", [str(script), str(tmp_path / "made.png")])
    agg = matplotlib.rcParamsDefault | {"backend": "Agg"}
    with matplotlib.rc_context(agg):
        runpy.run_path(str(script), run_name="__main__")
    made, committed = reduced(tmp_path / "made.png"), reduced(script.with_suffix(".png"))
    assert made.shape == committed.shape
    # Of 255: a palette changes 0.05, letters of another font 0.2, one other panel of three or eight more than 1.2.
    # The picture of rounding errors has other points on another processor.
    assert np.abs(made - committed).mean() < (3 if script.stem == "errors" else 1)
    movie = script.with_suffix(".gif")
    assert movie.exists() == (tmp_path / "made.gif").exists()
    if movie.exists():
        with Image.open(movie) as shown, Image.open(tmp_path / "made.gif") as again:
            assert movie.stat().st_size < 2**20 and shown.n_frames == again.n_frames > 20
            for at in (0, shown.n_frames // 2):
                shown.seek(at), again.seek(at)
                difference = np.asarray(shown.convert("RGB"), float) - np.asarray(again.convert("RGB"), float)
                assert np.abs(difference).mean() < 1
