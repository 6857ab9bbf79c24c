"""What a declaration refuses, what the table does to the arrays of a case, and how studies are found."""

from dataclasses import replace

import numpy as np
import pytest

from critflow.result import Status, StudyError
from critflow.workflow import Axis, Claim, Coordinate, Study, Variable
from critflow.workflow.load import load_file, load_study, named_studies
from critflow.workflow.plan import select

STATUS = Variable("status", ("seed",), "i1", long_name="outcome", flags=Status)


def small_study(**changes):
    parts = {
        "name": "small",
        "title": "Small",
        "axes": [Axis("seed", [0, 1], "seed")],
        "parameters": {"n": 3, "strains": [1, 0.5]},
        "case": dict,
        "variables": [STATUS],
    }
    return Study(**(parts | changes))


@pytest.mark.parametrize(
    ("declare", "sentence"),
    [
        (lambda: Axis("seed", [], "s"), "different values"),
        (lambda: Axis("seed", [1, 1], "s"), "different values"),
        (lambda: Axis("seed", [1, "a"], "s"), "all of one kind"),
        (lambda: Axis("seed", [0.5], "s"), "whole numbers or words"),
        (lambda: Axis("my seed", [1], "s"), "axis name"),
        (lambda: Variable("x", ("edge"), "f8", long_name="x"), "must be a tuple"),
        (lambda: Variable("x", ("axis", "axis"), "f8", long_name="x"), "twice"),
        (lambda: Variable("x", (), "float", long_name="x"), "must be one of"),
        (lambda: Variable("x", (), "f8", long_name="x", fill=1), "must be an integer"),
        (lambda: Variable("x", (), "i1", long_name="x", fill=200), "does not fit"),
        (lambda: Claim("k", "s", "1", "2", "maybe"), "'holds', 'differs' or 'measured'"),
        (lambda: Claim("k", "s", "1", "2", "differs"), "say why"),
        (lambda: small_study(name="a/b"), "study name"),
        (lambda: small_study(axes=[]), "at least one axis"),
        (lambda: small_study(variables=[]), "needs a variable 'status'"),
        (lambda: small_study(variables=[STATUS, replace(STATUS, name="seed")]), "'seed' twice"),
        (lambda: small_study(parameters={"seeds": 3}), "'seeds' twice"),
        (lambda: small_study(parameters={"n": None}), "must default to"),
        (lambda: small_study(parameters={"n": [1, "a"]}), "must default to"),
        (lambda: small_study(parameters={"n": []}), "must default to"),
        (lambda: small_study(coordinates=[Coordinate("strain", "strain", "s")]), "needs a parameter 'strain'"),
        (lambda: small_study(coordinates=[Coordinate("strain", "n", "s")]), "needs a parameter 'n'"),
        (lambda: small_study(workers=0), "allow one"),
        (
            lambda: small_study(variables=[STATUS, Variable("s", (), "f8", long_name="s", volatile=True)]),
            "add every axis",
        ),
    ],
)
def test_bad_declarations_are_refused(declare, sentence):
    with pytest.raises(StudyError, match=sentence):
        declare()


@pytest.mark.parametrize(
    ("allowed", "asked", "count"),
    [(None, None, 8), (None, 20, 20), (None, 0, 0), (1, None, 1), (1, 0, 0), (1, 1, 1), (20, None, 8), (20, 12, 12)],
)
def test_a_study_has_no_more_workers_than_it_allows(allowed, asked, count):
    assert small_study(workers=allowed).worker_count(asked, available=8) == count


def test_more_workers_than_a_study_allows_are_refused():
    with pytest.raises(StudyError, match="--workers 2 would disturb what 'small' measures: give at most 1"):
        small_study(workers=1).worker_count(2, available=8)


def test_inner_labels_that_are_words_keep_their_order():
    study = small_study(parameters={"kinds": ("b", "a")}, coordinates=[Coordinate("kind", "kinds", "kind")])
    assert select(study, []).parameters["kinds"] == ("b", "a")
    assert select(study, ["kinds=a,c"]).parameters["kinds"] == ("a", "c")
    with pytest.raises(StudyError, match="kinds contains a twice"):
        select(study, ["kinds=a,a"])


def test_parameters_become_plain_numbers():
    study = small_study(parameters={"a": np.float64(0.5), "b": np.arange(3), "c": [1, 0.5], "d": np.bool_(True)})
    assert repr(dict(study.parameters)) == "{'a': 0.5, 'b': (0, 1, 2), 'c': (1.0, 0.5), 'd': True}"


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"sigma": None}, "without sigma"),
        ({"sigm": np.ones(6)}, "did you mean 'sigma'"),
        ({"sigma": np.ones((6, 1))}, "has shape"),
        ({"sigma": np.ones(0)}, "has shape"),
        ({"sigma": np.ones(5)}, "5 along 'edge' where 6"),
        ({"modulus": np.ones(4)}, "4 along 'strain' where 3"),
        ({"sigma": np.ones(6, complex)}, "complex128"),
        ({"steps": np.ones(3)}, "float64"),
        ({"steps": np.full(3, 70000)}, "too large"),
        ({"steps": np.full(3, -1)}, "stands for a missing value"),
        ({"status": 77}, "77"),
        ({"status": None}, "at least 'status'"),
    ],
)
def test_arrays_that_do_not_fit_the_table_are_refused(tiny, change, sentence):
    good = tiny.study.case(tiny.study.parameters, seed=1, population="random")
    assert tiny.study.arrays(good, tiny.study.parameters)["steps"].dtype == "i2"
    bad = {name: value for name, value in (good | change).items() if value is not None}
    with pytest.raises(ValueError, match=sentence):
        tiny.study.arrays(bad, tiny.study.parameters)


SOURCE = "from critflow.workflow import *\nfrom critflow.result import Status\n"
SMALL = SOURCE + (
    "study = Study(name='small', title='T', axes=[Axis('seed', [0], 's')], parameters={}, case=dict,"
    " variables=[Variable('status', ('seed',), 'i1', long_name='s', flags=Status)])\n"
)


def test_names_are_looked_for_here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "workflows").mkdir()
    (tmp_path / "workflows" / "small.py").write_text(SMALL)
    (tmp_path / "workflows" / "_part.py").write_text("")
    assert "small" in named_studies()
    assert "_part" not in named_studies()
    assert load_study("small").study.title == "T"
    with pytest.raises(StudyError, match="did you mean 'small'"):
        load_study("smal")


def test_a_file_is_executed_once_for_each_content(tmp_path):
    path = tmp_path / "small.py"
    path.write_text(SMALL)
    first = load_file(path)
    assert load_file(path).study is first.study  # caches inside a study stay warm from batch to batch
    path.write_text(SMALL.replace("'T'", "'U'"))
    assert load_file(path).study.title == "U"


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        ("", "`study` is missing"),
        ("study = 3", "`study` holds int 3"),
        ("def", "SyntaxError"),
        ("import nowhere_to_be_found", "ModuleNotFoundError"),
        (SMALL.replace("'seed'", "'a b'"), "axis name"),
        ("\0", "cannot be loaded"),
    ],
)
def test_files_that_are_no_study_are_refused(tmp_path, source, sentence):
    path = tmp_path / "small.py"
    path.write_text(source)
    with pytest.raises(StudyError, match=sentence):
        load_file(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(StudyError, match="cannot read"):
        load_study(str(tmp_path / "small.py"))
