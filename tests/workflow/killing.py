"""Runs in processes of their own that are killed: quick to start, because the libraries are loaded once for all."""

import multiprocessing
import os
import signal
import sys
from pathlib import Path

from critflow.cli import main
from critflow.workflow import faults

BARE = Path(__file__).with_name("bare_study.py")
_server = multiprocessing.get_context("forkserver")
_server.set_forkserver_preload(["killing", "critflow.workflow.run", "critflow.workflow.report"])


def begun(folder, *settings, fault="", more=("--workers=0",)):
    """The process of a run that has begun."""
    words = ["run", str(BARE), "--out", str(folder), *(f"--set={word}" for word in settings), *more]
    process = _server.Process(target=_run, args=(words, fault, str(folder) + ".err"))
    process.start()
    return process


def ended(process, seconds=120.0):
    """Its exit code, once it has one; the number of the signal below zero."""
    process.join(seconds)
    if process.exitcode is None:
        process.kill()
        process.join()
        raise AssertionError(f"the run did not end in {seconds} s")
    return process.exitcode


def _run(words, fault, said):
    os.environ[faults.VARIABLE] = fault
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
    with open(said, "a") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
        sys.stdout = sys.stderr = open(2, "w", closefd=False)
        sys.exit(main(words))
