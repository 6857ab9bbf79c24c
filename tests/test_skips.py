"""The lines at the end of a run of the tests that say what was skipped and why."""

import os
import subprocess
import sys
from pathlib import Path

from skips import skipped_lines

SKIPPING = """
import pytest

@pytest.mark.skipif(True, reason="no Chromium: install it")
@pytest.mark.parametrize("n", range(3))
def test_a_browser(n): ...

def test_a_package():
    pytest.importorskip("no_such_package")
"""


def test_a_run_ends_with_what_was_skipped_and_why(tmp_path):
    """In a process of its own, with two workers, as the tests run."""
    (tmp_path / "conftest.py").write_text("from skips import pytest_terminal_summary\n")
    (tmp_path / "test_some.py").write_text(SKIPPING)
    (tmp_path / "test_whole.py").write_text("import pytest\npytest.importorskip('no_such_package')\n")
    words = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "2", f"--rootdir={tmp_path}", str(tmp_path)]
    environment = {"PYTHONPATH": str(Path(__file__).parent), "PATH": os.environ["PATH"]}
    run = subprocess.run([sys.executable, *words], capture_output=True, text=True, env=environment, check=False)
    assert "skipped: 4 tests and 1 file" in run.stdout, run.stdout
    assert "3 tests: no Chromium: install it" in run.stdout
    assert "1 file: could not import 'no_such_package'" in run.stdout


def test_a_run_that_skips_nothing_has_no_such_lines():
    assert skipped_lines([]) == []
