"""The line on a terminal about long calls, in processes of their own: with a terminal, without, and in workers."""

import os
import pty
import subprocess
import sys

import pytest

PREPARED = """
import sys, time
import critflow
from critflow import progress
progress.PATIENCE, progress.PERIOD = 0.0, 0.02
@progress.running("inner")
def inner(step: int) -> None:
    time.sleep(0.1)
@progress.running("outer")
def outer(n: int) -> None:
    for step in progress.counted(range(n), "step"):
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


@pytest.mark.parametrize("code", [IN_A_THREAD, IN_A_WORKER, "progress.PATIENCE = 9\nouter(3)"])
def test_threads_workers_and_short_calls_write_nothing(code):
    assert on_a_terminal(code) == ""


def test_nothing_is_written_without_a_terminal():
    found = subprocess.run([sys.executable, "-c", PREPARED + "outer(3)"], capture_output=True, text=True, timeout=60)
    assert (found.returncode, found.stdout, found.stderr) == (0, "", "")
