"""What the machine refuses is one sentence and exit 6, damages nothing, and is made good by the same command later."""

import contextlib
import ctypes
import errno
import io
import multiprocessing
import os
import platform
import resource
import shutil
import sys
import tempfile
import time
from pathlib import Path

import pytest

from critflow.cli import main
from critflow.result import EnvironmentFailure
from critflow.workflow.errors import LockedError
from critflow.workflow.folder import Folder
from critflow.workflow.load import load_file
from critflow.workflow.plan import select
from critflow.workflow.room import Room
from critflow.workflow.store import read_shard

PLAIN = Path(__file__).with_name("plain_study.py")
LOADED = load_file(PLAIN)
SELECTION = select(LOADED.study)

# Processes start from one that has imported everything, because imports are slow and not what is limited.
SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(["critflow.cli", "critflow.workflow.run", "critflow.workflow.verify"])

pytestmark = pytest.mark.timeout(120)


def run_under(words, err, kind, value, beyond, prepare):
    """Run the command under a limit, `beyond` what is used already, as the whole of this process."""
    os.dup2(err.fileno(), 2)
    sys.stderr = os.fdopen(2, "w", buffering=1)
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stderr(io.StringIO()):
        main(["run", str(PLAIN), "--out", folder, "--workers", "0"])  # brings the modules that are imported on the way
    if prepare is not None:
        prepare()
    if kind:
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() if beyond else 0
        resource.setrlimit(getattr(resource, kind), (value + used, value + used))
    os._exit(main(words))


@pytest.fixture
def limited():
    """`limited(folder, ...)` runs the plain study under a limit: its exit code and stderr, without a traceback."""
    started = []

    def run_limited(folder, kind="", value=0, *, beyond=False, verb="run", prepare=None):
        words = ["run", str(PLAIN), "--out", str(folder), "--workers", "0"] if verb == "run" else [verb, str(folder)]
        ours, theirs = SERVER.Pipe(duplex=False)  # no file, which would be limited too
        process = SERVER.Process(target=run_under, args=(words, theirs, kind, value, beyond, prepare))
        started.append(process)
        process.start()
        theirs.close()
        with os.fdopen(os.dup(ours.fileno()), encoding="utf-8") as file:
            err = file.read()
        process.join()
        assert "Traceback" not in err
        return process.exitcode, err

    yield run_limited
    for process in started:
        process.kill()
        process.join()


@pytest.fixture
def whole():
    """`whole(folder)` tells that no stored shard is damaged and no half file was left."""

    def check(folder):
        for case in SELECTION.cases():
            read_shard(folder / "shards", LOADED.study, case)
        assert not list(folder.rglob(".*.partial"))

    return check


def complains(err):
    lines = [line for line in err.splitlines() if line.startswith("critflow:")]
    return len(lines) == 1 and lines[0].count(": ") >= 2


SIZE = 1_190  # bytes of a shard, about


@pytest.mark.parametrize("size", [0, 1, 60, 300, 420, 900, SIZE, 2_000, 8_000])
def test_a_disk_full_at_any_size_is_told_and_made_good(tmp_path, limited, whole, size):
    """A limit on the size of files is refused like a full disk, and works for every user."""
    code, err = limited(tmp_path, "RLIMIT_FSIZE", size)
    assert code == 6, err
    assert complains(err)
    whole(tmp_path)
    assert main(["run", str(PLAIN), "--out", str(tmp_path), "--workers", "0"]) == 0
    assert main(["verify", str(tmp_path)]) == 0


@pytest.fixture
def free(monkeypatch):
    """`free(size)` makes the disk seem to have so many bytes left."""
    real = shutil.disk_usage

    def set_free(size):
        monkeypatch.setattr(shutil, "disk_usage", lambda path: real(path)._replace(free=size))

    return set_free


@pytest.mark.parametrize("workers", ["0", "1"])
def test_a_disk_too_small_for_the_rest_is_told_after_the_first_case(tmp_path, free, capsys, workers):
    free(3 * SIZE)  # three other cases and the dataset of four
    words = ["run", str(PLAIN), "--out", str(tmp_path), "--workers", workers]
    assert main(words) == 6
    assert "3 cases and the dataset will need about" in capsys.readouterr().err
    assert 1 <= len(list(tmp_path.glob("shards/*.nc"))) < 4
    free(10 * SIZE)
    assert main(words) == 0


def test_a_disk_too_small_for_the_rest_is_told_before_anything_is_computed(tmp_path, free, capsys):
    words = ["run", str(PLAIN), "--out", str(tmp_path), "--workers", "0", "--set"]
    assert main([*words, "seeds=0"]) == 0
    free(10 * SIZE)
    assert main([*words, "seeds=0:40"]) == 6
    assert "39 cases and the dataset will need" in capsys.readouterr().err
    assert len(list(tmp_path.glob("shards/*.nc"))) == 1


def test_a_disk_that_holds_the_cases_must_hold_the_dataset_too(tmp_path, free, capsys):
    words = ["run", str(PLAIN), "--out", str(tmp_path), "--workers", "0"]
    assert main(words) == 0
    free(3 * SIZE)
    assert main(words) == 6
    assert "0 cases and the dataset will need" in capsys.readouterr().err


def test_cases_that_grow_are_noticed_while_they_are_stored(tmp_path, free):
    free(8_000)
    room = Room(tmp_path, 40, 40)
    with pytest.raises(EnvironmentFailure, match="make room"):
        for number in range(40):
            (tmp_path / f"{number}.nc").write_bytes(bytes(10 * number))
            room.look([str(number)], computed=True)
    assert number == 31  # the mean of sixteen promised 5,760 bytes, that of thirty-two 8,928


def without_override():
    """Become a user whom permissions bind; only root can, and need."""
    if os.geteuid() == 0:
        libc, version_3 = ctypes.CDLL(None, use_errno=True), 0x20080522
        head, sets = (ctypes.c_uint32 * 2)(version_3, 0), (ctypes.c_uint32 * 6)()
        assert libc.capset(head, sets) == 0  # root without any capability


@pytest.mark.parametrize("which", [".", "shards", "above"])
def test_a_folder_that_cannot_be_written_is_told(tmp_path, limited, which):
    out = tmp_path / "out"
    (out / "shards").mkdir(parents=True)
    locked = {".": out, "shards": out / "shards", "above": tmp_path}[which]
    if which == "above":
        out = out.with_name("new")
    locked.chmod(0o555)
    try:
        code, err = limited(out, prepare=without_override)
        assert code == 6, err
        assert complains(err)
        assert "Permission denied" in err
    finally:
        locked.chmod(0o755)
    assert main(["run", str(PLAIN), "--out", str(out), "--workers", "0"]) == 0


@pytest.mark.parametrize("verb", ["run", "verify"])
@pytest.mark.parametrize("files", [3, 4, 5, 6, 8])
def test_too_many_open_files_are_told_and_no_shard_is_blamed(tmp_path, limited, whole, verb, files):
    assert main(["run", str(PLAIN), "--out", str(tmp_path), "--workers", "0"]) == 0
    before = {path: path.stat().st_ino for path in (tmp_path / "shards").iterdir()}
    code, err = limited(tmp_path, "RLIMIT_NOFILE", files, verb=verb)
    assert code in (0, 6), err
    assert code == 0 or complains(err)
    assert files > 4 or code == 6
    assert {path: path.stat().st_ino for path in (tmp_path / "shards").iterdir()} == before
    whole(tmp_path)


@pytest.mark.parametrize("number", [errno.EMFILE, errno.EIO, errno.EACCES])
def test_a_shard_that_the_machine_does_not_give_is_not_called_damaged(tmp_path, monkeypatch, capsys, number):
    assert main(["run", str(PLAIN), "--out", str(tmp_path), "--workers", "0"]) == 0
    real = open

    def refusing(path, mode="r", *more, **options):
        if str(path).endswith(".nc") and mode == "rb":
            raise OSError(number, os.strerror(number), str(path))
        return real(path, mode, *more, **options)

    monkeypatch.setattr("critflow.workflow.store.open", refusing, raising=False)
    for words in (["run", str(PLAIN), "--out", str(tmp_path), "--workers", "0"], ["verify", str(tmp_path)]):
        capsys.readouterr()
        assert main(words) == 6
        assert "cannot read" in capsys.readouterr().err


@pytest.mark.parametrize("spare", [0, 2**17, 2**20, 2**22, 2**23])
def test_too_little_memory_is_told_and_made_good(tmp_path, limited, whole, spare):
    code, err = limited(tmp_path, "RLIMIT_AS", spare, beyond=True)
    assert code in (0, 3, 6), err
    if code == 6:
        assert complains(err)
    whole(tmp_path)
    assert main(["run", str(PLAIN), "--out", str(tmp_path), "--workers", "0"]) == 0
    assert main(["verify", str(tmp_path)]) == 0


def hold(folder, told):
    try:
        with Folder(folder).held(LOADED, SELECTION):
            told.send("held")
            time.sleep(1000)
    except LockedError as error:
        told.send(str(error))


@pytest.fixture
def holder():
    """`holder(folder)` starts a process that holds the folder; also what it says."""
    started = []

    def start(folder):
        ours, theirs = SERVER.Pipe()
        started.append(SERVER.Process(target=hold, args=(folder, theirs)))
        started[-1].start()
        return started[-1], ours

    yield start
    for process in started:
        process.kill()
        process.join()


def test_the_holder_is_named_and_its_death_frees_the_folder(tmp_path, holder, capsys):
    process, told = holder(tmp_path)
    assert told.recv() == "held"
    assert main(["run", str(PLAIN), "--out", str(tmp_path), "--workers", "0"]) == 5
    err = capsys.readouterr().err
    assert f"process {process.pid} on {platform.node()} since 2" in err
    assert not (tmp_path / "plain.nc").exists()
    process.kill()
    process.join()
    assert main(["run", str(PLAIN), "--out", str(tmp_path), "--workers", "0"]) == 0
    assert not (tmp_path / ".lock").read_text()  # nobody is named who has gone


@pytest.mark.parametrize("attempt", range(10))
def test_of_two_started_together_exactly_one_works(tmp_path, holder, attempt):
    two = [holder(tmp_path) for _ in range(2)]
    said = sorted(told.recv() for _, told in two)
    assert said[0].startswith(f"another run is at work in {tmp_path}")
    assert said[1] == "held"


def test_a_file_system_without_locks_is_told(tmp_path, monkeypatch, capsys):
    def refuse(*_):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("critflow.workflow.folder.fcntl.flock", refuse)
    assert main(["run", str(PLAIN), "--out", str(tmp_path), "--workers", "0"]) == 6
    assert "cannot lock" in capsys.readouterr().err
    assert not (tmp_path / "study.json").exists()


def test_files_of_others_are_left_alone(tmp_path):
    """Only where a run writes are the half files of a killed one looked for."""
    other = tmp_path / "download" / ".song.partial"
    ours = [tmp_path / folder / ".left.partial" for folder in (".", "shards", "figures")]
    for path in (other, *ours):
        path.parent.mkdir(exist_ok=True)
        path.touch()
    with Folder(tmp_path).held(LOADED, SELECTION):
        assert other.exists()
        assert not any(path.exists() for path in ours)


def test_the_lock_names_nobody_but_its_holder(tmp_path):
    (tmp_path / ".lock").write_text("process 1 on elsewhere, which was killed\n")
    with Folder(tmp_path).held(LOADED, SELECTION):
        (told,) = (tmp_path / ".lock").read_text().splitlines()
    assert told.startswith(f"process {os.getpid()} on ")


def test_no_other_user_can_hold_the_folder(tmp_path):
    """A lock needs no more than to read the file, and one held by a stranger would keep its owner out for ever."""
    with Folder(tmp_path).held(LOADED, SELECTION):
        assert (tmp_path / ".lock").stat().st_mode & 0o007 == 0


def test_a_note_that_the_machine_does_not_give_is_not_called_damaged(tmp_path, monkeypatch, capsys):
    assert main(["run", str(PLAIN), "--out", str(tmp_path), "--workers", "0"]) == 0
    real = Path.read_text

    def refusing(path, **options):
        if path.name == "study.json":
            raise OSError(errno.EIO, os.strerror(errno.EIO), str(path))
        return real(path, **options)

    monkeypatch.setattr(Path, "read_text", refusing)
    for words in (["run", str(PLAIN), "--out", str(tmp_path), "--workers", "0"], ["status", str(tmp_path)]):
        capsys.readouterr()
        assert main(words) == 6
        assert "study.json: Input/output error: mend that and run again" in capsys.readouterr().err
