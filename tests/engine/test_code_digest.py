"""The code of a case: what counts, and what a run does with stored cases of other code."""

import sys
from pathlib import Path

import pytest
import xarray as xr
from disturbed import stamps_of
from extras_there import skip_without

from critflow.command.main import main
from critflow.engine import code_digest
from critflow.engine.code_digest import code_version, load_file, load_study, reached_definitions, used_extras

STUDY = '''
"""A study in a file."""
import critflow as cf
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

    def of(*changes, folder="a", look=code_version):
        (tmp_path / folder).mkdir(exist_ok=True)
        texts = {"numbers.py": STUDY, **OTHERS}
        for name, old, new in changes:
            assert texts[name].count(old) == 1
            texts[name] = texts[name].replace(old, new)
        for name, text in texts.items():
            (tmp_path / folder / name).write_text(text)
        return look(load_file(tmp_path / folder / "numbers.py").study)

    return of


COUNTS = [
    ("numbers.py", "helper(seed)}", "helper(seed) + 1}"),
    ("numbers.py", "return seed *", "return 2 * seed *"),
    ("numbers.py", '{"good": 1.0}', '{"good": 3.0}'),
    ("numbers.py", 'SCALE["bad"] = 2.0', 'SCALE["good"] = 2.0'),
    ("_numbers.py", "stable_rng(1)", "stable_rng(2)"),
    ("_tools.py", "3", "4"),
]
COUNTS_NOT = [
    ("numbers.py", '"""A number."""', '"""A number and its status."""'),
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


@pytest.mark.parametrize(
    ("change", "names"),
    [
        (("numbers.py", "helper(seed)}", "cf.design}"), {"targets"}),
        (("numbers.py", "helper(seed)}", 'f"onset[{seed}]"}'), {"cables"}),
        (("_numbers.py", "return stable_rng(1)", "from critflow import weak_forces\n    return weak_forces"), {"weak"}),
        (("_tools.py", "three = 3", "from critflow.extras.local.diagonals import face_diagonals as three"), {"local"}),
        (("numbers.py", "parameters={}", 'parameters={}, extras=("rest",)'), {"rest"}),
        (("_numbers.py", "def two(): ...", "def two():\n    import critflow.extras.weak"), set()),
    ],
)
def test_the_extras_of_a_case_are_those_that_it_names(version, change, names):
    skip_without(names)
    assert version(change, look=used_extras) - version(look=used_extras) == names


def test_the_scene_counts_and_the_engine_figures_and_unused_extras_do_not(tmp_path, monkeypatch):
    names = ("manifold.py", "arguments.py", "extras/weak/state.py")
    names += ("engine/run.py", "pictures.py", "command/main.py", "extras/local/state.py", "studies/ensemble.py")
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x = 1")
    monkeypatch.setattr(code_digest, "_PACKAGE", tmp_path)
    monkeypatch.setattr(code_digest, "_file_digest", code_digest._file_digest.__wrapped__)

    def digest():
        return code_digest._scene_digest.__wrapped__(frozenset({"weak"}))

    first, changes = digest(), {}
    for name in names:
        for text in ("x = 1  # one", '"""What it is."""\nx = 1'):
            (tmp_path / name).write_text(text)
            assert digest() == first
        (tmp_path / name).write_text("x = 2")
        changes[name] = digest() != first
        (tmp_path / name).write_text("x = 1")
    assert [name for name in names if changes[name]] == list(names[:3])


def test_the_ensemble_depends_on_its_measurements_and_on_no_figure():
    study = load_study("ensemble").study
    names = {name for _, name in reached_definitions(study.case.__module__, "case")}
    assert {"measured", "configuration", "stable_rng", "force_anisotropy"} <= names
    assert not names & {"violins", "structure_figure", "claims", "population_claims", "verify", "LABELS"}


CHANGE = ('"modulus": strains * seed', '"modulus": 2 * strains * seed')


def test_a_run_over_cases_of_other_code_stops_before_it_computes(tmp_path, run, source, capsys):
    out = tmp_path / "out"
    assert run(out, study=source()) == 0
    before, first = stamps_of(out), code_version(load_file(source()).study)
    path = source(*CHANGE)
    now = code_version(load_file(path).study)
    capsys.readouterr()
    for more in ((), ("--dry-run",)):
        assert run(out, "seeds=0:5", study=path, more=more) == 4
        err = capsys.readouterr().err
        assert len(err.splitlines()) == 1 and "8 of 8 stored cases" in err and first in err and now in err
        assert all(word in err for word in ("--recompute", "--keep", "--out"))
    assert stamps_of(out) == before
    assert main(["status", str(out)]) == 0
    assert "8 other of 8 cases" in capsys.readouterr().out
    assert main(["verify", str(out)]) == 4
    assert first in capsys.readouterr().err
    assert run(out, "seeds=0:5", study=path, more=("--recompute",)) == 0
    assert xr.load_dataset(out / "tiny.nc").attrs["cases_code"] == f"{now}: 10 cases"
    assert main(["verify", str(out)]) == 0


@pytest.mark.parametrize(
    ("more", "dims"), [(("seeds=0:6",), ("seed",)), (("populations=random,floppy",), ("population",))]
)
def test_kept_cases_of_other_code_are_told_apart(tmp_path, run, source, capsys, more, dims):
    out, few = tmp_path / "out", {"seed": "seeds=0:4", "population": "populations=random"}[dims[0]]
    assert run(out, few, study=source()) == 0
    first = load_file(source()).study
    path = source(*CHANGE)
    codes = sorted({code_version(first), code_version(load_file(path).study)})
    assert run(out, *more, study=path, more=("--keep",)) == 0
    assert "other code" in capsys.readouterr().err
    with xr.open_dataset(out / "tiny.nc") as ds:
        assert ds.code.dims == dims
        meanings = ds.code.attrs["flag_meanings"].split()
        assert [word.replace("_", "") for word in meanings] == [
            text.replace(", ", "").replace(" ", "") for text in codes
        ]
        old = ds.code.values == codes.index(code_version(first))
        assert old.tolist() == ([True] * 4 + [False] * 2 if dims == ("seed",) else [True, False])
    assert "2 versions of the code" in (out / "claims.md").read_text()
    capsys.readouterr()
    assert main(["verify", str(out)]) == 4
    assert "other code" in capsys.readouterr().err
    assert run(out, *more, study=path) == 4


def test_an_extra_that_a_case_uses_without_a_name_must_be_declared(tmp_path, run, source, monkeypatch):
    skip_without(["tensegrity"])
    # As in a process that has not imported it for another test.
    for module in [name for name in sys.modules if name.startswith("critflow.extras.tensegrity")]:
        monkeypatch.delitem(sys.modules, module)
    hidden = "import_module('critflow.extras.' + 'tens' + 'egrity')"
    change = ("import numpy as np", "from importlib import import_module\nimport numpy as np")
    change += ("    sleep(parameters", f"    {hidden}\n    sleep(parameters")
    assert Path(code_digest.__file__).parents[1].joinpath("extras", "tensegrity").is_dir()
    assert run(tmp_path / "out", "seeds=0", study=source(*change)) == 3
    texts = " ".join(path.read_text() for path in (tmp_path / "out" / "failed").iterdir())
    assert "extras=('tensegrity',)" in texts
    assert (
        run(
            tmp_path / "two",
            "seeds=0",
            study=source(*change, "    case=case,", "    case=case, extras=('tensegrity',),"),
        )
        == 0
    )
