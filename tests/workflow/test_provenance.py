"""What files say about themselves, and what `critflow status` says about them."""

import json
import os
import subprocess
import tomllib
from hashlib import sha256
from pathlib import Path

import netCDF4
import pytest
import xarray as xr
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from critflow.cli import main
from critflow.workflow import provenance, reasons
from critflow.workflow.folder import Folder
from critflow.workflow.load import load_file
from critflow.workflow.plan import select
from critflow.workflow.provenance import VOLATILE, code_version, source_tree
from critflow.workflow.reasons import OTHER_TABLE
from critflow.workflow.status import folder_status
from critflow.workflow.store import shard_path

TINY = Path(__file__).with_name("tiny_study.py")
ROOT = Path(__file__).parents[2]


def test_a_dataset_says_what_made_it(tmp_path, run, tiny):
    assert run(tmp_path / "out", "spread=0.2", "trouble=1-random") == 3
    selection = select(tiny.study, ["spread=0.2", "trouble=1-random"])
    attributes = xr.load_dataset(tmp_path / "out" / "tiny.nc").attrs
    assert attributes["code"] == code_version(tiny.study)
    assert attributes["cases_code"] == f"{attributes['code']}: 8 cases"
    assert attributes["cases_environment"] == f"{provenance.environment()}: 8 cases"
    versions = json.loads(attributes["versions"])
    assert {"python", "numpy", "scipy", "netCDF4", "critflow", "BLAS", "hdf5"} <= versions.keys()
    assert json.loads(attributes["parameters"])["spread"] == 0.2
    assert "SeedSequence" in attributes["seed_entropy"]
    assert "qdldl" in attributes["sparse_solvers"].split()
    assert attributes["history"].endswith(
        "critflow run tiny_study.py --set=spread=0.2 --set=trouble=1-random (in one process)"
    )
    shards = [shard_path(tmp_path / "out" / "shards", case) for case in selection.cases()]
    seals = {path.stem: path.read_bytes()[-64:].decode() for path in shards}
    failed = selection.case(seed=1, population="random").id
    seals[failed] = "failed"
    assert attributes["shards_sha256_each"] == " ".join(f"{name}:{seals[name]}" for name in sorted(seals))
    each = [sha256(f"{name} {seal}\n".encode()).digest() for name, seal in seals.items()]
    assert attributes["shards_sha256"] == f"{sum(map(int.from_bytes, each)) % 2**256:064x}"


def test_a_shard_says_what_made_it(tmp_path, run, tiny):
    assert run(tmp_path, "seeds=0") == 0
    case = select(tiny.study, ["seeds=0"]).cases()[0]
    with netCDF4.Dataset(shard_path(tmp_path / "shards", case)) as file:
        study, version, parameters, values = json.loads(file.identity)
        assert (study, version, values) == ("tiny", 1, {"seed": 0, "population": "random"})
        assert parameters["spread"] == 0.1
        assert file.code == code_version(tiny.study)
        assert file.environment == provenance.environment()
        assert "SeedSequence" in file.seed_entropy


def test_no_file_names_the_machine_its_user_or_its_folders(tmp_path, run):
    assert run(tmp_path, "seeds=0:2", "trouble=none") == 0
    words = {os.uname().nodename, str(tmp_path), str(ROOT), str(Path.home()), str(TINY.parent)} - {"/"}
    for path in [tmp_path / "tiny.nc", *(tmp_path / "shards").iterdir()]:
        with netCDF4.Dataset(path) as file:
            told = " ".join(str(file.getncattr(name)) for name in file.ncattrs())
        assert [word for word in words if word in told] == []


def test_two_runs_differ_in_the_listed_attributes_alone(tmp_path, run, contents, monkeypatch):
    """Shards agree to the last byte, datasets in all but `history`, whatever the command, the workers and the time."""
    assert run(tmp_path / "one") == 0
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1000000000")
    assert run(tmp_path / "two", "seeds=0:4", workers=2) == 0
    one, two = (tmp_path / name for name in ("one", "two"))
    assert contents(one / "tiny.nc") == contents(two / "tiny.nc")
    assert [p.read_bytes() for p in sorted((one / "shards").iterdir())] == [
        p.read_bytes() for p in sorted((two / "shards").iterdir())
    ]
    told = [xr.load_dataset(folder / "tiny.nc").attrs for folder in (one, two)]
    assert tuple(told[0]["volatile_attributes"].split()) == VOLATILE
    assert [name for name in told[0] if told[0][name] != told[1][name]] == list(VOLATILE)


def git(folder, *words):
    clean = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    who = ["-c", "user.name=n", "-c", "user.email=e@example.org"]
    return subprocess.run(["git", *who, "-C", folder, *words], env=clean, check=True, capture_output=True, text=True)


def test_the_commit_is_that_of_the_source_tree(tmp_path, monkeypatch):
    git(tmp_path, "init")
    (tmp_path / "critflow").mkdir()
    code = tmp_path / "critflow" / "code.py"
    code.write_text("1")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-m", "first")
    head = git(tmp_path, "rev-parse", "HEAD").stdout.strip()
    monkeypatch.setenv("GIT_DIR", "/nowhere")  # as a hook does
    (tmp_path / "results.txt").write_text("what a run leaves is no change of the code")
    look = source_tree.__wrapped__
    assert look(tmp_path) == {"commit": head, "commit_dirty": "false"}
    code.write_text("2")
    assert look(tmp_path) == {"commit": head, "commit_dirty": "true"}
    assert look(tmp_path / "critflow") == {}  # as of a wheel in an environment inside some repository
    monkeypatch.setenv("PATH", "")
    assert look(tmp_path) == {}


@pytest.fixture
def study(tmp_path):
    """`study(old, new)` writes the tiny study with a change, under the same name, and returns the file."""

    def write(old="", new=""):
        (tmp_path / "study").mkdir(exist_ok=True)
        path = tmp_path / "study" / "tiny.py"
        assert old in TINY.read_text()
        path.write_text(TINY.read_text().replace(old, new) if old else TINY.read_text())
        return path

    return write


def told(capsys, folder):
    """The reasons that `critflow status --json` gives, by kind."""
    capsys.readouterr()
    assert main(["status", str(folder), "--json"]) == 0
    status = json.loads(capsys.readouterr().out)
    assert sum(status["total"].values()) == 8
    return {reason["kind"]: reason for reason in status["to_compute"] + status["other_code"]}


def test_status_says_why_a_case_is_computed_again(tmp_path, capsys, study):
    run = ["run", str(study()), "--out", str(tmp_path / "out"), "--workers=0", "--set=trouble=1-random"]
    assert main(run) == 3
    shards = sorted((tmp_path / "out" / "shards").iterdir())
    shards[0].unlink()
    shards[-1].write_bytes(b"")
    found = told(capsys, tmp_path / "out")
    assert found.keys() == {"missing", "failed", "damaged"}
    assert found["missing"]["sentence"] == "not computed yet"
    assert found["missing"]["cases"] == [{"id": shards[0].stem, "seed": 0, "population": "floppy"}]
    assert found["failed"]["sentence"] == "asked for"
    assert [case["id"] for case in found["damaged"]["cases"]] == [shards[-1].stem]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("    check=check,", "    check=check, version=2,", "stored with version 1 of the study, now 2"),
        ('"residual", ("population", "seed"), "f8"', '"residual", ("population", "seed"), "f4"', OTHER_TABLE[1]),
    ],
)
def test_status_says_that_the_study_changed(tmp_path, capsys, study, old, new, sentence):
    assert main(["run", str(study()), "--out", str(tmp_path / "out"), "--workers=0"]) == 0
    study(old, new)
    found = told(capsys, tmp_path / "out")
    assert [found[kind]["sentence"] for kind in found] == [sentence]
    assert len(found["changed"]["cases"]) == 8


@pytest.mark.parametrize("index", [True, False])
def test_a_changed_table_is_no_damage(tmp_path, capsys, study, stamps, index):
    """Whether the index knows the shards or each is opened: they are told as changed, and computed again."""
    out = tmp_path / "out"
    run = ["run", str(study()), "--out", str(out), "--workers=0"]
    assert main(run) == 0
    before = stamps(out)
    study('"residual", ("population", "seed"), "f8"', '"residual", ("population", "seed"), "f4"')
    if not index:
        Folder(out).index.unlink()
    assert told(capsys, out).keys() == {"changed"}
    assert main([*run, "--dry-run"]) == 0
    assert "changed: seed 0, population random and 7 more: stored with another table" in capsys.readouterr().out
    assert main(["verify", str(out)]) == 4
    first, second, *_ = capsys.readouterr().err.splitlines()
    assert "the table of the study changed since 8 of 8 cases were stored: run the study again" in first
    assert "1 thing is wrong" in second
    assert main(run) == 0
    assert "damaged" not in capsys.readouterr().err
    after = stamps(out)
    assert after.keys() == before.keys() and not set(after.values()) & set(before.values())
    assert told(capsys, out) == {}
    assert main(["verify", str(out)]) == 0


def test_status_loads_no_study_that_is_as_it_was(tmp_path, capsys, study, monkeypatch):
    path = study("import os", "import os\nfrom ._beside import nothing")
    beside = path.with_name("_beside.py")
    beside.write_text("nothing = None")
    assert main(["run", str(path), "--out", str(tmp_path / "out"), "--workers=0", "--set=trouble=1-random"]) == 3
    loaded: list[Path] = []
    monkeypatch.setattr("critflow.workflow.folder.load_file", lambda file: loaded.append(file) or load_file(file))
    assert told(capsys, tmp_path / "out").keys() == {"failed"}
    assert loaded == []
    beside.write_text("nothing = 0")  # the numbers may come from there
    assert told(capsys, tmp_path / "out").keys() == {"failed", "other code"}
    assert len(loaded) == 1
    beside.write_text("nothing = None")
    monkeypatch.setattr("critflow.workflow.folder.library_version", lambda: "critflow of tomorrow")
    assert told(capsys, tmp_path / "out").keys() == {"failed"}
    assert len(loaded) == 2


def test_a_dry_run_says_what_was_stored_with_other_settings(tmp_path, capsys, run):
    assert run(tmp_path) == 0
    words = ["run", str(TINY), "--out", str(tmp_path), "--dry-run"]
    capsys.readouterr()
    assert main([*words, "--set=strains=0.1,0.2", "--set=seeds=3:5"]) == 0
    out = capsys.readouterr().out
    assert "  changed: seed 3, population random and 1 more: stored with strains=0.001,0.002,0.003, now 0.1,0.2" in out
    assert "  missing: seed 4, population random and 1 more: not computed yet" in out
    assert main([*words, "--set=variables=scalars"]) == 0
    assert "stored with variables=all, now residual,status" in capsys.readouterr().out


def test_status_reports_other_code_and_forces_nothing(tmp_path, capsys, study, stamps):
    run = ["run", str(study()), "--out", str(tmp_path / "out"), "--workers=0"]
    assert main(run) == 0
    before, first = stamps(tmp_path / "out"), code_version(load_file(study()).study)
    assert told(capsys, tmp_path / "out") == {}
    study("import os", "import os  # a change that changes no number")
    now = code_version(load_file(tmp_path / "study" / "tiny.py").study)
    assert now != first
    found = told(capsys, tmp_path / "out")
    assert found.keys() == {"other code"}
    assert found["other code"]["sentence"].startswith(f"computed by {first}, not {now}: kept")
    assert len(found["other code"]["cases"]) == 8
    assert main(run) == 0
    assert stamps(tmp_path / "out") == before
    dataset = xr.load_dataset(tmp_path / "out" / "tiny.nc")
    assert (dataset.attrs["code"], dataset.attrs["cases_code"]) == (now, f"{first}: 8 cases")


def test_of_each_code_one_stored_case_is_looked_at(tmp_path, run, monkeypatch):
    assert run(tmp_path) == 0
    now = Folder(tmp_path).noted()._replace(code="of tomorrow")
    monkeypatch.setattr(Folder, "noted", lambda folder: now)
    looked: list[Path] = []
    monkeypatch.setattr(reasons, "read_code", lambda path: looked.append(path) or "of today")
    status = folder_status(Folder(tmp_path))
    (found,) = reasons.made_by_other_code(status.of_other_code, status.code, tmp_path / "shards")
    assert len(found.cases) == 8
    assert "computed by of today" in found.sentence
    assert len(looked) == 1


def test_the_code_of_a_study_is_what_its_numbers_come_from(tmp_path):
    """Files beside it that its cases use count; those that only draw and claim do not; nor does the folder."""
    source = TINY.read_text().replace(
        "def figure(", "from ._numbers import one\nfrom ._drawing import drawn\n\ndef figure("
    )
    source = source.replace('{"modulus": figure}', '{"modulus": drawn}')

    def version(folder="a", numbers="one = 1", drawing="def drawn(ds): ..."):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / "_numbers.py").write_text(numbers)
        (tmp_path / folder / "_drawing.py").write_text(drawing)
        (tmp_path / folder / "tiny.py").write_text(source)
        return code_version(load_file(tmp_path / folder / "tiny.py").study)

    first = version()
    assert version("b") == first
    assert version(drawing="def drawn(ds): return None") == first
    assert version(numbers="one = 2") != first
    assert version() == first


def test_a_dry_run_and_status_write_nothing(tmp_path, capsys, run):
    """Not a byte, not a time: beside the shards nothing is opened for writing."""
    assert run(tmp_path / "out", "trouble=1-random") == 3
    next(iter((tmp_path / "out" / "shards").iterdir())).write_bytes(b"damaged")

    def state():
        paths = sorted(tmp_path.rglob("*"))
        return [(p, p.stat().st_mtime_ns, sha256(p.read_bytes()).hexdigest() if p.is_file() else "") for p in paths]

    before = state()
    assert main(["run", str(TINY), "--out", str(tmp_path / "out"), "--dry-run", "--set=seeds=0:9"]) == 0
    assert main(["run", str(TINY), "--out", str(tmp_path / "new"), "--dry-run"]) == 0
    assert main(["status", str(tmp_path / "out")]) == 0
    assert main(["status", str(tmp_path / "out"), "--json"]) == 0
    assert state() == before


def test_every_dependency_is_locked_to_a_version_that_it_allows():
    text = (ROOT / "results" / "reference" / "requirements-lock.txt").read_text()
    lock = dict(line.split("==") for line in text.splitlines() if "==" in line)
    locked = {canonicalize_name(name): number for name, number in lock.items()}
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    for requirement in map(Requirement, wanted):
        assert requirement.specifier.contains(locked[canonicalize_name(requirement.name)]), requirement
