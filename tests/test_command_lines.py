"""Malformed command lines and study files: exit 2, one sentence that says what to do next, and nothing written."""

import os
import sys
from hashlib import sha256
from pathlib import Path

import pytest

from critflow.cli import main

STUDY = """
import numpy as np

from critflow import Status
from critflow.workflow import Axis, Coordinate, Study, Variable

def case(parameters, *, seed, population):
    return {"status": Status.ok, "modulus": 1.0}

study = Study(
    name="plain",
    title="As little as a study can have",
    axes=(Axis("seed", range(4), "seed"), Axis("population", ("random", "floppy"), "population", choices=("wide",))),
    parameters={"count": 6, "spread": 0.1, "offset": -1.0, "flag": True, "mode": "fast", "strains": (0.1, 0.2)},
    coordinates=(Coordinate("strain", "strains", "strain"),),
    case=case,
    variables=(
        Variable("modulus", ("seed", "population"), "f8", long_name="modulus"),
        Variable("status", ("seed", "population"), "i1", long_name="outcome", flags=Status),
    ),
)
"""

# Words after `critflow run plain`, and a piece of the sentence.
SETTINGS = {
    "unknown setting": ("sedes=3", "did you mean 'seeds'"),
    "no value": ("seeds", "write --set seeds=VALUE"),
    "no setting": ("=3", "the settings are"),
    "nothing at all": ("", "has no value"),
    "empty": ("seeds=", "write seeds=VALUE"),
    "empty between commas": ("seeds=1,,2", "empty value"),
    "empty word": ("populations=random,", "empty value"),
    "decimals for whole numbers": ("seeds=1.5", "whole numbers"),
    "words for numbers": ("spread=wide", "needs numbers"),
    "no truth value": ("flag=yes", "true or false"),
    "several for one": ("count=1,2", "one value"),
    "negative": ("seeds=-1", "not be negative"),
    "negative width": ("spread=-0.1", "not be negative"),
    "NaN": ("spread=nan", "finite"),
    "NaN where negatives are allowed": ("offset=nan", "finite"),
    "infinite": ("strains=0:inf:1", "finite"),
    "overflow": ("spread=1e999", "finite"),
    "huge whole number": ("count=99999999999999999999999", "whole numbers"),
    "duplicates": ("seeds=1,2,1", "twice"),
    "duplicates of a range": ("seeds=0:3,2", "twice"),
    "duplicate words": ("populations=wide,wide", "twice"),
    "unknown word": ("populations=../../etc/passwd", "the choices are"),
    "backwards": ("seeds=3:1", "empty range"),
    "step in whole numbers": ("seeds=0:9:3", "start:stop"),
    "step of zero": ("strains=0:1:0", "step above zero"),
    "not increasing": ("strains=0.2,0.1", "must increase"),
    "1e9 seeds": ("seeds=0:1000000000", "at most 1,000,000"),
    "1e9 strains": ("strains=0:1:1e-9", "at most 1,000,000"),
    "unknown variable": ("variables=modulos", "did you mean 'modulus'"),
    "not text": ("mode=\udcff", "not text"),
    "control characters": ("mode=a\nb", "not text"),
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory with one good study by name."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "workflows").mkdir()
    (tmp_path / "workflows" / "plain.py").write_text(STUDY)
    (tmp_path / "folder").mkdir()
    (tmp_path / "text.txt").write_text("not a study\n")
    return tmp_path


def digest(folder):
    """Of every name and content below a folder."""
    whole = sha256()
    for path in sorted(folder.rglob("*")):
        whole.update(f"{path}\0".encode(errors="surrogateescape"))
        whole.update(path.read_bytes() if path.is_file() else b"")
    return whole.hexdigest()


def refused(here, capsys, words, piece):
    before, modules, directory = digest(here), set(sys.modules), os.getcwd()
    assert main(words) == 2, capsys.readouterr()
    out, err = capsys.readouterr()
    assert out == ""
    lines = err.splitlines()
    assert len(lines) == 1, err
    assert lines[0].startswith("critflow: ")
    assert piece in lines[0]
    assert len(lines[0]) < 400
    assert digest(here) == before
    assert os.getcwd() == directory
    assert not {name for name in set(sys.modules) - modules if "._bad" in name}


@pytest.mark.parametrize("mistake", SETTINGS)
def test_a_malformed_setting_is_refused(here, capsys, mistake):
    word, piece = SETTINGS[mistake]
    refused(here, capsys, ["run", "plain", "--set", word], piece)


def test_too_many_cases_together_are_refused(here, capsys):
    refused(here, capsys, ["run", "plain", "--set=seeds=0:600000"], "at most 1,000,000")


@pytest.mark.parametrize("date", ["yesterday", "1e9", "-1", ""])
def test_a_malformed_date_is_refused_before_anything_is_computed(here, capsys, monkeypatch, date):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", date)
    refused(here, capsys, ["run", "plain", "--workers=0"], "SOURCE_DATE_EPOCH")


def test_a_setting_given_twice_is_refused(here, capsys):
    refused(here, capsys, ["run", "plain", "--set=seeds=0:2", "--set=seeds=0:3"], "set twice")


# Whole command lines, and a piece of the sentence.
LINES = {
    "no study": (["run", ""], "name of a study"),
    "an option instead of a study": (["run", "--set", "seeds=1"], "Missing argument"),
    "two studies": (["run", "plain", "plain"], "unexpected extra argument"),
    "study of another case": (["run", "Plain"], "did you mean 'plain'"),
    "path out of the studies": (["run", "../plain"], "cannot read the study file"),
    "folder": (["run", "folder/"], "not a file"),
    "this folder": (["run", "./."], "not a file"),
    "device": (["run", "/dev/zero"], "not a file"),
    "text": (["run", "./text.txt"], "mend it"),
    "name that is no text": (["run", "\udcff.py"], "not text"),
    "no folder": (["run", "plain", "--out", ""], "--out"),
    "half a worker": (["run", "plain", "--workers", "0.5"], "--workers"),
    "negative workers": (["run", "plain", "--workers=-2"], "negative"),
    "workers of a cluster": (
        ["run", "plain", "--scheduler", "tls://a:1", "--workers", "2"],
        "leave --workers out",
    ),
    "no scheduler": (["run", "plain", "--scheduler", ""], "--scheduler"),
    "status of a file": (["status", "text.txt"], "not a results folder"),
    "status of an empty folder": (["status", "folder"], "not a results folder"),
    "status of nothing": (["status", ""], "not a results folder"),
    "verify nothing": (["verify", "nowhere"], "not a results folder"),
    "figures of a file": (["figures", "text.txt"], "not a results folder"),
    "show a folder": (["show", "folder"], "no dataset"),
    "list something": (["list", "plain"], "unexpected extra argument"),
}


@pytest.mark.parametrize("mistake", LINES)
def test_a_malformed_command_line_is_refused(here, capsys, mistake):
    words, piece = LINES[mistake]
    refused(here, capsys, words, piece)


def changed(old, new):
    assert STUDY.count(old) == 1
    return STUDY.replace(old, new)


# What a study file holds, and a piece of the sentence.
FILES = {
    "empty": ("", "`study` is missing"),
    "no study": ("stduy = 1", "`study` is missing"),
    "wrong object": ("study = {'name': 'plain'}", "holds dict"),
    "a class instead of an object": ("from critflow.workflow import Study as study", "holds type"),
    "not UTF-8": (b"study = 'caf\xe9'", "SyntaxError"),
    "UTF-16": (STUDY.encode("utf-16"), "cannot be loaded"),
    "zeros": (bytes(1000), "cannot be loaded"),
    "syntax error": ("def case(:", "SyntaxError"),
    "raises": ("x = 1\n1 / 0", "line 2, cannot be loaded: ZeroDivisionError"),
    "raises after an import": ("from ._bad_c import x\n1 / 0", "line 2, cannot be loaded: ZeroDivisionError"),
    "leaves": ("import sys\nsys.exit(0)", "line 2, cannot be loaded: SystemExit"),
    "recursion": ("def f():\n    f()\nf()", "RecursionError"),
    "import of what is not there": ("import no_such_module_at_all", "ModuleNotFoundError"),
    "import out of the folder": ("from ..elsewhere import x", "ImportError"),
    "cyclic import": ("from ._bad_a import x", "circular import"),
    "unknown key": (changed("title=", "titel="), "titel"),
    "missing key": (changed("    case=case,\n", ""), "'case'"),
    "wrong name": (changed('name="plain"', 'name="../plain"'), "letters, digits"),
    "no axes": (changed("axes=(Axis", "axes=() or () and (Axis"), "at least one axis"),
    "axis without values": (changed("range(4)", "range(0)"), "different values"),
    "duplicate axis values": (changed("range(4)", "(1, 1)"), "different values"),
    "negative seeds": (changed("range(4)", "range(-2, 2)"), "from zero"),
    "NaN seeds": (changed("range(4)", "(0.0, float('nan'))"), "whole numbers or words"),
    "1e9 seeds by default": (changed("range(4)", "range(10**9)"), "at most 1,000,000"),
    "1e12 seeds by default": (changed("range(4)", "range(10**12)"), "at most 1,000,000"),
    "1e9 cases by default": (changed("range(4)", "range(900_000)"), "at most 1,000,000"),
    "NaN by default": (changed('"spread": 0.1', '"spread": float("nan")'), "finite"),
    "infinite by default": (changed("(0.1, 0.2)", "(0.1, np.inf)"), "finite"),
    "object by default": (changed('"spread": 0.1', '"spread": object()'), "must default to"),
    "duplicate names": (changed('"count"', '"seeds"'), "'seeds' twice"),
    "case that is no function": (changed("case=case,", "case=3,"), "must be a function"),
    "case without an axis": (changed("*, seed, population", "*, seed"), "population"),
    "case with one more": (changed("*, seed, population", "*, seed, population, size"), "size"),
    "version that is a word": (changed("    case=case,\n", "    case=case, version='2',\n"), "version"),
    "wrong dtype": (changed('"f8"', '"complex"'), "must be one of"),
    "figure out of the folder": (changed("    case=case,\n", "    case=case, figures={'../../up': case},\n"), "figure"),
    "check that breaks": (changed("    case=case,\n", "    case=case, check=lambda p, a: p['cuont'],\n"), "KeyError"),
}


@pytest.mark.parametrize("mistake", FILES)
def test_a_malformed_study_file_is_refused(here, capsys, mistake):
    source, piece = FILES[mistake]
    (here / "bad.py").write_bytes(source.encode() if isinstance(source, str) else source)
    (here / "_bad_a.py").write_text("from ._bad_b import x\n")
    (here / "_bad_c.py").write_text("x = 1\n")
    (here / "_bad_b.py").write_text("from ._bad_a import x\n")
    refused(here, capsys, ["run", "bad.py"], piece)


def test_an_unreadable_study_file_is_refused(here, capsys, monkeypatch):
    """For every user, root too: the permission is refused where the file is read."""

    def refuse(_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refuse)
    monkeypatch.setattr("test_command_lines.digest", lambda folder: sorted(folder.rglob("*")))
    refused(here, capsys, ["run", "plain"], "Permission denied")


def test_a_study_under_another_name_than_its_file_is_refused(here, capsys):
    (here / "workflows" / "bad.py").write_text(STUDY)
    refused(here, capsys, ["run", "bad"], "name it 'bad'")


def test_an_enormous_study_file_is_refused(here, capsys):
    with open(here / "bad.py", "wb") as file:
        file.truncate(10**9)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("test_command_lines.digest", lambda folder: sorted(folder.rglob("*")))
        refused(here, capsys, ["run", "bad.py"], "too large")


def test_a_mark_of_the_byte_order_is_no_mistake(here, capsys):
    """Editors of some systems write one in front of UTF-8."""
    (here / "marked.py").write_bytes(b"\xef\xbb\xbf" + STUDY.encode())
    assert main(["run", "marked.py", "--dry-run"]) == 0
    assert "8 of 8 cases" in capsys.readouterr().out
