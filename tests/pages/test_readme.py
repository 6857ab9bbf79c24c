"""The README: its example runs, and its tables are those of the committed results."""

import re
import subprocess
import sys
from pathlib import Path

from critflow.workflow.load import load_file
from workflows.pages.readme import rendered

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_example_runs(tmp_path):
    code = re.search(r"<!-- example -->\n```python\n(.*?)```", README, re.S)[1]
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "n_self_stresses=1" in done.stdout and "rigid=True" in done.stdout


def test_the_tables_are_those_of_the_results():
    assert rendered(README, ROOT / "results") == README


def test_the_pictures_are_there():
    pictures = re.findall(r"\]\((results/[^)]*\.png)\)", README)
    assert pictures
    assert all((ROOT / picture).is_file() for picture in pictures)


def test_no_file_is_too_large_and_every_study_loads():
    tracked = subprocess.run(["git", "ls-files"], capture_output=True, text=True, cwd=ROOT).stdout.split()
    assert all((ROOT / name).stat().st_size <= 2**20 for name in tracked if (ROOT / name).is_file())
    for path in (ROOT / "workflows").rglob("study.py"):
        assert load_file(path).study.name == path.parent.name
