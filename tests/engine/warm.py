"""Imported by the server of processes only: after one run, the processes start with all libraries loaded."""

import contextlib
import io
import tempfile

from disturbed import words_of

from critflow.command.main import main

with (
    tempfile.TemporaryDirectory() as folder,
    contextlib.redirect_stderr(io.StringIO()),
    contextlib.redirect_stdout(io.StringIO()),
):
    main(words_of(folder, ["seeds=0"]))
