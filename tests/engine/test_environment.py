"""What the machine refuses is one sentence and exit code 6; nothing is damaged, and the same command continues."""

import ctypes
import errno
import os
import resource
import sys
from functools import partial
from pathlib import Path

import pytest
from disturbed import begun, ended, messages, stored_whole, words_of

from critflow.command.main import main
from critflow.engine import store

pytestmark = pytest.mark.timeout(120)


def limit(kind, value):
    resource.setrlimit(getattr(resource, kind), (value, value))


def obey_permissions():
    """Root loses the capability to ignore permissions; other users have none."""
    if os.geteuid() == 0:
        libc, version_3 = ctypes.CDLL(None, use_errno=True), 0x20080522
        head, sets = (ctypes.c_uint32 * 2)(version_3, 0), (ctypes.c_uint32 * 6)()
        assert libc.capset(head, sets) == 0


def refuse_reading(number, suffix):
    """In the process of a run: files of this kind cannot be opened to be read, however often it is tried."""
    store._PAUSES = (0.0, 0.0)

    def audit(event, args):
        if event == "open" and str(args[0]).endswith(suffix) and not args[2] & (os.O_WRONLY | os.O_RDWR):
            raise OSError(number, os.strerror(number), args[0])

    sys.addaudithook(audit)


def assert_refused(folder, code):
    """One sentence, no traceback, no damaged file."""
    said = messages(folder)
    assert code == 6, said
    assert "Traceback" not in said
    (line,) = [line for line in said.splitlines() if line.startswith("critflow:")]
    assert line.count(":") >= 2, line  # what, why, what to do
    stored_whole(folder)
    assert not list(folder.rglob("*.partial"))
    return line


def assert_completed(folder):
    assert main(words_of(folder)) == 0
    assert main(["verify", str(folder)]) == 0


@pytest.mark.parametrize("size", [700, 2_000, 8_000])
def test_a_refused_file_size_is_reported(tmp_path, size):
    folder = tmp_path / "out"
    assert_refused(folder, ended(begun(folder, prepare=partial(limit, "RLIMIT_FSIZE", size))))
    assert_completed(folder)


@pytest.mark.parametrize("which", [".", "shards", "above"])
def test_a_folder_without_permission_to_write_is_reported(tmp_path, which):
    folder = tmp_path / "parent" / "out"
    (folder / "shards").mkdir(parents=True)
    closed = {".": folder, "shards": folder / "shards", "above": tmp_path / "parent"}[which]
    folder = folder.with_name("new") if which == "above" else folder
    Path(f"{folder}.err").touch()
    closed.chmod(0o555)
    try:
        assert "ermission denied" in assert_refused(folder, ended(begun(folder, prepare=obey_permissions)))
    finally:
        closed.chmod(0o755)
    assert_completed(folder)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(errno.EIO, "Input/output error", "some file"), "refused some file: Input/output error: correct"),
        (TimeoutError(), "refused: TimeoutError()"),
        (MemoryError(), "out of memory: give"),
    ],
)
def test_what_the_system_refuses_is_one_sentence_without_its_number(monkeypatch, said, error, words):
    def refused(*more):
        raise error

    monkeypatch.setattr("critflow.command.main.load_study", refused)
    err = said(["list", "tiny"], 6).err
    assert words in err and "[Errno" not in err


@pytest.mark.parametrize("suffix", [".nc", "study.json"])
@pytest.mark.parametrize("number", [errno.EMFILE, errno.EIO, errno.EACCES])
def test_a_file_that_the_machine_does_not_read_is_not_taken_for_damaged(tmp_path, number, suffix, tally):
    folder = tmp_path / "out"
    assert main(words_of(folder)) == 0
    stored = {path: path.stat().st_ino for path in (folder / "shards").iterdir()}
    tally()
    assert_refused(folder, ended(begun(folder, prepare=partial(refuse_reading, number, suffix))))
    assert {path: path.stat().st_ino for path in (folder / "shards").iterdir()} == stored
    assert tally() == []
    assert_completed(folder)
