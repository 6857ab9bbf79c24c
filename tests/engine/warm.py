"""Imported by the server of processes only: after one run, the processes start with all libraries loaded."""

import contextlib
import io
import os
import tempfile

from disturbed import words_of

from critflow.command.main import main

os.environ.pop("CRITFLOW_TEST_TALLY", None)  # this run is none of those that the first test counts
with (
    tempfile.TemporaryDirectory() as folder,
    contextlib.redirect_stderr(io.StringIO()),
    contextlib.redirect_stdout(io.StringIO()),
):
    main(words_of(folder, ["seeds=0"]))
