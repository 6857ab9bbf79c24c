"""The line on a terminal about long calls, in processes of their own: with a terminal, without, and in workers."""

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

PREPARED = """
import sys, time
import critflow
from critflow import calls
calls.PATIENCE, calls.PERIOD = 0.0, 0.02
@calls.running("inner")
def inner(step: int) -> None:
    time.sleep(0.1)
@calls.running("outer")
def outer(n: int) -> None:
    for step in calls.counted(range(n), "step"):
        inner(step)
"""
IN_A_THREAD = "import threading\nt = threading.Thread(target=outer, args=(3,)); t.start(); t.join()"
IN_A_WORKER = """
import multiprocessing
process = multiprocessing.get_context("fork").Process(target=outer, args=(3,)); process.start(); process.join()
"""


def on_a_terminal(code):
    """What a process writes to a standard error that is a terminal."""
    here, there = pty.openpty()
    try:
        subprocess.run([sys.executable, "-W", "error", "-c", PREPARED + code], stderr=there, check=True, timeout=60)
        os.write(there, b"END")
        written = b""
        while not written.endswith(b"END"):
            written += os.read(here, 10_000)
    finally:
        os.close(here)
        os.close(there)
    return written.decode().removesuffix("END")


def test_a_terminal_shows_the_outermost_call_and_its_part_and_erases_them():
    written = on_a_terminal("outer(3)\nprint('done', file=sys.stderr)")
    for number in (1, 2, 3):
        assert f"\r\x1b[Kouter: step {number} of 3, 0 s" in written
    assert "inner" not in written
    assert written.rstrip().endswith("0 s\r\x1b[Kdone")


def test_a_line_that_is_said_stands_above_that_of_the_call_whose_name_may_change():
    code = """
with calls.running("cases"):
    time.sleep(0.1)
    calls.say("a message")
    calls.rename("cases: 3 of 4")
    time.sleep(0.1)
calls.rename("no call")
calls.say("done")
"""
    written = on_a_terminal(code)
    assert "\r\x1b[Kcases, 0 s\r\x1b[Ka message\r\n\r\x1b[Kcases: 3 of 4, 0 s" in written
    assert written.endswith("0 s\r\x1b[Kdone\r\n") and "no call" not in written


def test_a_run_counts_its_cases_on_a_terminal():
    study = Path(__file__).parent / "engine" / "plain_study.py"
    code = f"""
import os, tempfile
from critflow.command.main import main
os.environ["CRITFLOW_TEST_PAUSE"] = "0.1"
sys.stdout = open(os.devnull, "w")
with tempfile.TemporaryDirectory() as folder:
    assert main(["run", {str(study)!r}, "--workers", "0", "--out", folder]) == 0
"""
    written = on_a_terminal(code)
    assert "plain: 3/4 cases (about 0 s left), 0 s" in written
    assert "\x1b[Kplain: writing the dataset of 4 cases\r\n" in written


@pytest.mark.parametrize("code", [IN_A_THREAD, IN_A_WORKER, "calls.PATIENCE = 9\nouter(3)"])
def test_threads_workers_and_short_calls_write_nothing(code):
    assert on_a_terminal(code) == ""


def test_nothing_is_written_without_a_terminal():
    found = subprocess.run([sys.executable, "-c", PREPARED + "outer(3)"], capture_output=True, text=True, timeout=60)
    assert (found.returncode, found.stdout, found.stderr) == (0, "", "")
