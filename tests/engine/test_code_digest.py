"""The code of a case: study files, the digest and what a run does with other code, and what files state about it."""

import json
import os
import subprocess
import tomllib
from hashlib import sha256
from pathlib import Path

import netCDF4
import pytest
import xarray as xr
from disturbed import stamps_of
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from critflow.command.main import main
from critflow.engine import code_digest, study
from critflow.engine.code_digest import (
    code_version,
    load_file,
    load_study,
    named_studies,
    reached_definitions,
    source_tree,
)
from critflow.engine.settings import select
from critflow.engine.store import read_shard, shard_path
from critflow.result import StudyError

PLAIN = Path(__file__).with_name("plain_study.py").read_text()


def changed(old, new):
    assert PLAIN.count(old) == 1
    return PLAIN.replace(old, new)


FILES = {  # contents, and a word of the message
    "empty": ("", "study"),
    "wrong object": ("study = {'name': 'plain'}", "top level"),
    "a class": ("from critflow.engine import Study as study", "top level"),
    "not UTF-8": (b"study = 'caf\xe9'", "SyntaxError"),
    "UTF-16": (PLAIN.encode("utf-16"), "loaded"),
    "zeros": (bytes(1000), "loaded"),
    "syntax error": ("def case(:", "SyntaxError"),
    "raises": ("x = 1\n1 / 0", "line 2"),
    "exits": ("import sys\nsys.exit(0)", "SystemExit"),
    "recursion": ("def f():\n    f()\nf()", "RecursionError"),
    "missing module": ("import no_such_module_at_all", "ModuleNotFoundError"),
    "import from outside": ("from ..elsewhere import x", "ImportError"),
    "circular import": ("from ._first import x", "circular"),
    "unknown key": (changed("    title=", "    titel="), "titel"),
    "missing key": (changed("    case=case,\n", ""), "case"),
    "case that is no function": (changed("case=case,", "case=3,"), "function"),
    "case without an axis": (changed("*, seed", "*, place"), "seed"),
    "case with one more argument": (changed("*, seed", "*, seed, size"), "size"),
    "version that is a word": (changed("    case=case,\n", "    case=case, version='2',\n"), "version"),
    "figure outside": (changed("    case=case,\n", "    case=case, figures={'../../up': case},\n"), "figure"),
    "needs of no figure": (changed("    case=case,\n", "    case=case, needs={'figur': ()},\n"), "figur"),
}


@pytest.mark.parametrize("mistake", FILES)
def test_a_malformed_study_file_is_refused(tmp_path, mistake):
    source, word = FILES[mistake]
    path = tmp_path / "bad.py"
    path.write_bytes(source.encode() if isinstance(source, str) else source)
    (tmp_path / "_first.py").write_text("from ._second import x\n")
    (tmp_path / "_second.py").write_text("from ._first import x\n")
    with pytest.raises(StudyError, match=word) as caught:
        load_study(str(path))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("word", ["nowhere.py", "folder", "/dev/zero", "", "../plain", "\udcff.py", "large.py"])
def test_a_path_that_is_no_study_file_is_refused(tmp_path, monkeypatch, word):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    with open(tmp_path / "large.py", "wb") as file:
        file.truncate(10**8)
    with pytest.raises(StudyError):
        load_study(word)


def test_studies_are_found_by_name_in_the_working_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "workflows").mkdir()
    (tmp_path / "workflows" / "plain.py").write_text(PLAIN)
    (tmp_path / "workflows" / "_part.py").write_text("")
    (tmp_path / "workflows" / "other.py").write_text(PLAIN)
    assert "plain" in named_studies() and "_part" not in named_studies()
    assert load_study("plain").study.title == "Numbers that differ from case to case"
    with pytest.raises(StudyError, match="'plain'"):
        load_study("plian")
    with pytest.raises(StudyError, match="'other'"):
        load_study("other")  # the name in the file is another


def test_a_benchmark_that_a_wheel_does_not_contain_is_named_with_its_place(tmp_path, monkeypatch):
    """Outside a checkout of the source."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("critflow.engine.code_digest.named_studies", lambda: {})
    with pytest.raises(StudyError, match="checkout") as caught:
        load_study("speed")
    assert "\n" not in str(caught.value)


def test_a_file_is_executed_once_for_each_content(tmp_path):
    path = tmp_path / "plain.py"
    path.write_text(PLAIN)
    first = load_file(path)
    assert load_file(path).study is first.study  # caches in a study persist from task to task
    path.write_text(changed("Numbers that differ from case to case", "Another"))
    assert load_file(path).study.title == "Another"
    path.write_bytes(b"\xef\xbb\xbf" + PLAIN.encode())  # a byte-order mark
    assert load_file(path).study.name == "plain"


STUDY = '''
"""A study in a file."""
import critflow as cf
from critflow.calls import tell
from critflow.result import Status
from critflow.engine import Axis, Study, Variable
from . import _tools
from ._numbers import one, two
from ._drawing import drawn

SCALE = {"good": 1.0}
SCALE["bad"] = 2.0
LABEL = "n"

def case(parameters, *, seed):
    """A number."""
    return {"status": Status.ok, "n": helper(seed)}

def helper(seed):
    if seed < 0:
        raise ValueError("negative")
    tell(f"seed {seed}")
    return seed * one() * SCALE["good"] * _tools.three

def figure(ds):
    return drawn(ds, LABEL, two())

study = Study(
    name="numbers", title="Numbers", axes=(Axis("seed", [0], "seed"),), parameters={}, case=case,
    variables=(
        Variable("n", ("seed",), "f8", long_name="n"),
        Variable("status", ("seed",), "i1", long_name="s", flags=Status),
    ),
    figures={"n": figure},
)
'''
NUMBERS = "from critflow.engine import stable_rng\n\ndef one():\n    return stable_rng(1).random()\n\ndef two(): ...\n"
OTHERS = {"_numbers.py": NUMBERS, "_tools.py": "three = 3\n", "_drawing.py": "def drawn(ds, *more): ...\n"}


@pytest.fixture
def version(tmp_path):
    """`version((file, old, new), ...)`: the code of the study with these changes of its files."""

    def of(*changes, folder="a"):
        (tmp_path / folder).mkdir(exist_ok=True)
        texts = {"numbers.py": STUDY, **OTHERS}
        for name, old, new in changes:
            assert texts[name].count(old) == 1
            texts[name] = texts[name].replace(old, new)
        for name, text in texts.items():
            (tmp_path / folder / name).write_text(text)
        return code_version(load_file(tmp_path / folder / "numbers.py").study)

    return of


COUNTS = [
    ("numbers.py", "helper(seed)}", "helper(seed) + 1}"),
    ("numbers.py", "return seed *", "return 2 * seed *"),
    ("numbers.py", "seed < 0", "seed < 1"),
    ("numbers.py", '{"good": 1.0}', '{"good": 3.0}'),
    ("numbers.py", 'SCALE["bad"] = 2.0', 'SCALE["good"] = 2.0'),
    ("_numbers.py", "stable_rng(1)", "stable_rng(2)"),
    ("_tools.py", "3", "4"),
]
COUNTS_NOT = [
    ("numbers.py", '"""A number."""', '"""A number and its status."""'),
    ("numbers.py", '"""A study in a file."""', '"""Another word."""'),
    ("numbers.py", 'ValueError("negative")', 'ValueError("below zero")'),
    ("numbers.py", 'tell(f"seed ', 'tell(f"number '),
    ("numbers.py", "    return seed * one()", "    # The weight\n    return  seed *one()"),
    ("numbers.py", '"n"\n', '"another"\n'),
    ("numbers.py", "return drawn(ds, ", "return drawn(ds, 3, "),
    ("numbers.py", 'title="Numbers"', 'title="Other numbers"'),
    ("_numbers.py", "def two(): ...", "def two(): return 2"),
    ("_drawing.py", "...", "return 3"),
]


@pytest.mark.parametrize("change", COUNTS)
def test_a_change_that_a_case_reaches_counts(version, change):
    assert version(change) != version()


@pytest.mark.parametrize("change", COUNTS_NOT)
def test_a_change_of_texts_and_figures_does_not_count(version, change):
    assert version(change) == version()
    assert version(folder="b") == version()


def test_a_name_that_nobody_has_cannot_be_declared(version):
    with pytest.raises(StudyError, match="'nonsense' in extras="):
        version(("numbers.py", "parameters={}", 'parameters={}, extras=["nonsense"]'))


def test_the_scene_counts_and_the_engine_and_figures_do_not(tmp_path, monkeypatch):
    names = ("manifold.py", "arguments.py", "engine/study.py")
    names += ("engine/run.py", "pictures.py", "command/main.py", "studies/ensemble.py")
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("THREADS = 1")
    monkeypatch.setattr(code_digest, "_PACKAGE", tmp_path)
    monkeypatch.setattr(code_digest, "_file_digest", code_digest._file_digest.__wrapped__)

    def digest():
        return code_digest._scene_digest.__wrapped__(frozenset())

    first, changes = digest(), {}
    for name in names:
        for text in ("THREADS = 1  # one", '"""What it is."""\nTHREADS = 1'):
            (tmp_path / name).write_text(text)
            assert digest() == first
        (tmp_path / name).write_text("THREADS = 2")
        changes[name] = digest() != first
        (tmp_path / name).write_text("THREADS = 1")
    assert [name for name in names if changes[name]] == list(names[:3])


@pytest.mark.parametrize("change", ["given.astype(target)", "self.arrays(self.case("])
def test_how_the_numbers_of_a_case_are_cast_counts(tmp_path, monkeypatch, change):
    first, text = code_digest._scene_digest.__wrapped__(frozenset()), Path(study.__file__).read_text()
    (tmp_path / "engine").mkdir()
    assert text.count(change) == 1
    (tmp_path / "engine" / "study.py").write_text(text.replace(change, f"1 * {change}"))
    modules = code_digest.numeric_modules()
    monkeypatch.setattr(code_digest, "numeric_modules", lambda: modules)
    monkeypatch.setattr(code_digest, "_PACKAGE", tmp_path)
    assert code_digest._scene_digest.__wrapped__(frozenset()) != first


def test_the_ensemble_depends_on_its_measurements_and_on_no_figure():
    study = load_study("ensemble").study
    names = {name for _, name in reached_definitions(study.case.__module__, "case")}
    assert {"measured", "configuration", "stable_rng", "force_anisotropy"} <= names
    assert not names & {"violins", "structure_figure", "claims", "population_claims", "verify", "LABELS"}


CHANGE = ('"modulus": strains * seed', '"modulus": 2 * strains * seed')


def test_a_run_over_cases_of_other_code_stops_before_it_computes(tmp_path, run, source, said, output_of):
    out = tmp_path / "out"
    assert run(out, study=source()) == 0
    before, first = stamps_of(out), code_version(load_file(source()).study)
    path = source(*CHANGE)
    now = code_version(load_file(path).study)
    for more in ((), ("--dry-run",)):
        err = output_of(out, "seeds=0:5", study=path, more=more, code=4).err
        assert len(err.splitlines()) == 1 and "8 of 8 stored cases" in err and first in err and now in err
        assert all(word in err for word in ("--recompute", "--keep", "--out"))
    assert stamps_of(out) == before
    assert "8 other of 8 cases" in said(["status", str(out)]).out
    err = said(["verify", str(out)], 4).err
    assert first in err and "run the study again with --recompute to correct" in err
    both = output_of(out, "seeds=0:5", study=path, more=("--keep", "--recompute"), code=2).err
    assert "contradict" in both and stamps_of(out) == before
    assert run(out, "seeds=0:5", study=path, more=("--recompute",)) == 0
    assert xr.load_dataset(out / "tiny.nc").attrs["cases_code"] == f"{now}: 10 cases"
    assert main(["verify", str(out)]) == 0


@pytest.mark.parametrize(
    ("more", "dims"), [(("seeds=0:6",), ("seed",)), (("populations=random,floppy",), ("population",))]
)
def test_kept_cases_of_other_code_are_told_apart(tmp_path, run, source, said, output_of, more, dims):
    out, few = tmp_path / "out", {"seed": "seeds=0:4", "population": "populations=random"}[dims[0]]
    assert run(out, few, study=source()) == 0
    first = load_file(source()).study
    path = source(*CHANGE)
    codes = sorted({code_version(first), code_version(load_file(path).study)})
    assert "other code" in output_of(out, *more, study=path, more=("--keep",)).err
    with xr.open_dataset(out / "tiny.nc") as ds:
        assert ds.code.dims == dims
        meanings = ds.code.attrs["flag_meanings"].split()
        assert [word.replace("_", "") for word in meanings] == [
            text.replace(", ", "").replace(" ", "") for text in codes
        ]
        old = ds.code.values == codes.index(code_version(first))
        assert old.tolist() == ([True] * 4 + [False] * 2 if dims == ("seed",) else [True, False])
    assert "2 versions of the code" in (out / "claims.md").read_text()
    assert "other code" in said(["verify", str(out)], 4).err
    assert run(out, *more, study=path) == 4


@pytest.mark.parametrize(
    ("more", "dims"), [(("seeds=0:4",), ("seed",)), (("populations=random,floppy",), ("population",))]
)
def test_cases_of_other_libraries_are_told_apart(tmp_path, output_of, monkeypatch, said, more, dims):
    few = {"seed": "seeds=0:3", "population": "populations=random"}[dims[0]]
    assert "libraries" not in output_of(tmp_path, few).err
    monkeypatch.setattr("critflow.engine.tasks.environment", lambda: "python 9.9, numpy 8.8")
    err = output_of(tmp_path, *more).err
    assert "cases of different libraries" in err and "python 9.9, numpy 8.8: " in err
    with xr.open_dataset(tmp_path / "tiny.nc") as ds:
        assert ds.environment.dims == dims and "code" not in ds
        last = ds.environment.values[-1] if dims == ("seed",) else ds.environment.sel(population="floppy").item()
        assert ds.environment.attrs["flag_meanings"].split()[last] == "python_9_9_numpy_8_8"
    assert "to the last byte" in said(["verify", str(tmp_path), "--sample=0"]).out


def test_the_solvers_of_the_extras_are_a_library(monkeypatch):
    """Their table of sizes chooses the solver of a large network, and with it the last digits."""
    if not code_digest.has_extras():
        pytest.skip("critflow-extras is not installed")
    solvers = code_digest._versions()["solvers"]
    monkeypatch.setattr(code_digest, "_file_digest", lambda path: "changed" * path.match("large/choice.py"))
    assert code_digest._versions()["solvers"] != solvers


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


def test_a_changed_version_or_table_computes_all_cases_again(tmp_path, run, source, said, output_of):
    out = tmp_path / "out"
    table = ('"residual", ("population", "seed"), "f8"', '"residual", ("population", "seed"), "f4"')
    assert run(out, study=source()) == 0
    for number, change in enumerate((table, (*table, "    check=check,", "    check=check, version=2,"))):
        before, path = stamps_of(out), source(*change)
        assert "8 of 8 cases to compute" in output_of(out, more=("--dry-run",), study=path).out
        if number == 0:
            assert main(["verify", str(out)]) == 4
            first = "changed: seed 0, population random and 7 more: stored with another table"
            assert first in said(["status", str(out)]).out
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
