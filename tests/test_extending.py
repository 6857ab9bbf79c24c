"""The extra of `docs/extending.md`, in a copy of the package of which nothing else changes."""

import subprocess
import sys
from pathlib import Path

from extras_there import skip_without
from test_docs import DOCS, blocks, is_of_the_package
from test_extras import without


def test_the_extra_of_the_documents_is_one_folder(tmp_path):
    """The page has its files, its tests, and what its command prints."""
    skip_without(["design_names"])
    page = blocks(DOCS / "extending.md")
    folder, files = without(tmp_path), [block for block in page if is_of_the_package(block)]
    for block in files:
        (folder / block.file).parent.mkdir(parents=True, exist_ok=True)
        (folder / block.file).write_text(block.text, encoding="utf-8")
    names = {Path(block.file).parts[2] for block in files}
    assert names == {"poisson"} and {Path(block.file).parts[1] for block in files} == {"extras"}
    assert 40 <= sum(block.text.count("\n") for block in files if block.file.startswith("critflow")) <= 60
    command, printed = next(block.text for block in page if block.kind == "text").splitlines()
    for words, expected in (
        (["critflow", *command.split()[2:]], printed),
        (["critflow", "--help"], "Print Poisson's ratio of the stiffest critical configuration."),
        (["pytest", "-p", "no:cacheprovider", *(block.file for block in files if "test_" in block.file)], "2 passed"),
    ):
        line = [sys.executable, "-W", "error", "-m", *words]
        done = subprocess.run(line, cwd=folder, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0 and expected in done.stdout, done.stdout[-2000:] + done.stderr[-2000:]
