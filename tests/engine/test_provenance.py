"""What files state about their origin, and what `status` reports about it."""

import json
import os
import subprocess
import tomllib
from hashlib import sha256
from pathlib import Path

import netCDF4
import xarray as xr
from disturbed import stamps_of
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from critflow.command.main import main
from critflow.engine.code_digest import code_version, source_tree
from critflow.engine.settings import select
from critflow.engine.store import read_shard, shard_path

ROOT = Path(__file__).parents[2]


def test_a_dataset_states_its_settings_versions_and_stored_cases(tmp_path, run, tiny):
    settings = ["spread=0.2", "trouble=1-random"]
    assert run(tmp_path / "out", *settings) == 3
    attributes = xr.load_dataset(tmp_path / "out" / "tiny.nc").attrs
    assert attributes["code"] == code_version(tiny.study)
    assert attributes["cases_code"] == f"{attributes['code']}: 7 cases"
    assert {"python", "numpy", "scipy", "netCDF4", "critflow", "BLAS", "hdf5"} <= json.loads(
        attributes["versions"]
    ).keys()
    assert json.loads(attributes["parameters"])["spread"] == 0.2
    assert "SeedSequence" in attributes["seed_entropy"]
    assert "critflow run tiny_study.py --set=spread=0.2 --set=trouble=1-random" in attributes["history"]
    shards = {case.shard: case for case in select(tiny.study, settings).cases}
    folder = tmp_path / "out" / "shards"
    stored = {name: read_shard(shard_path(folder, case), tiny.study, case) for name, case in shards.items()}
    each = [sha256(f"{name} {checksum}\n".encode()).digest() for name, (_, checksum) in stored.items()]
    assert attributes["shards_sha256"] == f"{sum(map(int.from_bytes, each)) % 2**256:064x}"


def test_no_file_names_the_machine_its_user_or_its_folders(tmp_path, run):
    assert run(tmp_path, "seeds=0:2") == 0
    words = {os.uname().nodename, str(tmp_path), str(ROOT), str(Path.home())} - {"/"}
    for path in [tmp_path / "tiny.nc", *(tmp_path / "shards").iterdir()]:
        with netCDF4.Dataset(path) as file:
            text = " ".join(str(file.getncattr(name)) for name in file.ncattrs())
        assert [word for word in words if word in text] == []


def git(folder, *words):
    clean = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    author = ["-c", "user.name=n", "-c", "user.email=e@example.org"]
    return subprocess.run(["git", *author, "-C", folder, *words], env=clean, check=True, capture_output=True, text=True)


def test_the_commit_is_that_of_the_source_tree(tmp_path, monkeypatch):
    git(tmp_path, "init")
    (tmp_path / "critflow").mkdir()
    code = tmp_path / "critflow" / "code.py"
    code.write_text("1")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-m", "first")
    head = git(tmp_path, "rev-parse", "HEAD").stdout.strip()
    monkeypatch.setenv("GIT_DIR", "/nowhere")  # as a hook does
    (tmp_path / "results.txt").write_text("files of a run are no change of the code")
    look = source_tree.__wrapped__
    assert look(tmp_path) == {"commit": head, "commit_dirty": "false"}
    code.write_text("2")
    assert look(tmp_path) == {"commit": head, "commit_dirty": "true"}
    assert look(tmp_path / "critflow") == {}  # as of a wheel in an environment inside some repository
    monkeypatch.setenv("PATH", "")
    assert look(tmp_path) == {}


def test_a_changed_version_or_table_computes_all_cases_again(tmp_path, run, source, capsys):
    out = tmp_path / "out"
    table = ('"residual", ("population", "seed"), "f8"', '"residual", ("population", "seed"), "f4"')
    assert run(out, study=source()) == 0
    for number, change in enumerate((table, (*table, "    check=check,", "    check=check, version=2,"))):
        before, path = stamps_of(out), source(*change)
        capsys.readouterr()
        assert run(out, more=("--dry-run",), study=path) == 0
        assert "8 of 8 cases to compute" in capsys.readouterr().out
        if number == 0:
            assert main(["verify", str(out)]) == 4
            assert main(["status", str(out)]) == 0
            assert "table" in capsys.readouterr().out
        assert run(out, study=path) == 0
        assert len(set(stamps_of(out).values()) - set(before.values())) == 4
        assert main(["verify", str(out)]) == 0


def test_every_dependency_is_locked_to_a_version_that_it_allows():
    lock = (ROOT / "results" / "reference" / "requirements-lock.txt").read_text().splitlines()
    pairs = (line.split("==") for line in lock if "==" in line)
    locked = {canonicalize_name(name): number for name, number in pairs}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for requirement in map(Requirement, project["dependencies"]):
        assert requirement.specifier.contains(locked[canonicalize_name(requirement.name)]), requirement
