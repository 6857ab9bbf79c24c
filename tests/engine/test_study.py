"""Declarations of a study, and the check of a case's arrays against its table of variables."""

from dataclasses import replace

import numpy as np
import pytest

from critflow.engine import Axis, Claim, Coordinate, Study, Variable
from critflow.engine.settings import select
from critflow.engine.study import plural
from critflow.result import Status, StudyError

STATUS = Variable("status", ("seed",), "i1", long_name="outcome", flags=Status)


def small_study(**changes):
    parts = {
        "name": "small",
        "title": "Small",
        "axes": [Axis("seed", [0, 1], "seed")],
        "parameters": {"n": 3, "strains": [1, 0.5]},
        "case": lambda parameters, *, seed: {"status": Status.ok},
        "variables": [STATUS],
    }
    return Study(**(parts | changes))


@pytest.mark.parametrize(
    ("declare", "word"),
    [
        (lambda: Axis("seed", [], "s"), "values"),
        (lambda: Axis("seed", [1, 1], "s"), "values"),
        (lambda: Axis("seed", [1, "a"], "s"), "kind"),
        (lambda: Axis("seed", [0.5], "s"), "whole"),
        (lambda: Axis("my seed", [1], "s"), "name"),
        (lambda: Axis("seed", range(-2, 2), "s"), "zero"),
        (lambda: Axis("seed", range(10**12), "s"), "at most"),
        (lambda: Variable("x", ("edge"), "f8", long_name="x"), "tuple"),
        (lambda: Variable("x", ("axis", "axis"), "f8", long_name="x"), "twice"),
        (lambda: Variable("x", (), "float", long_name="x"), "one of"),
        (lambda: Variable("x", (), "f8", long_name="x", fill=1), "integer"),
        (lambda: Variable("x", (), "i1", long_name="x", fill=200), "fit"),
        (lambda: Claim("k", "s", "1", "2", "maybe"), "holds"),
        (lambda: Claim("k", "s", "1", "2", "differs", criterion="= 1"), "why|reason"),
        (lambda: Claim("k", "s", "1", "2", "undecided", criterion="= 1"), "why|reason"),
        (lambda: Claim("k", "s", "1", "2", "holds"), "criterion"),
        (lambda: Claim("k", "s", "1", "2", "measured", kind="theirs"), "kind"),
        (lambda: Claim("k", "s", "1", "2", "measured", difference="taste"), "difference"),
        (lambda: small_study(name="a/b"), "name"),
        (lambda: small_study(axes=[]), "axis"),
        (lambda: small_study(variables=[]), "status"),
        (lambda: small_study(variables=[STATUS, replace(STATUS, name="seed")]), "seed"),
        (lambda: small_study(variables=[STATUS, replace(STATUS, name="valid")]), "engine"),
        (lambda: small_study(variables=[STATUS, Variable("x", (), "f8", long_name="x", undefined_at=[1])]), "share"),
        (lambda: small_study(parameters={"seeds": 3}), "seeds"),
        (lambda: small_study(parameters={"variables": 1}), "variables"),
        (lambda: small_study(parameters={"n": None}), "default"),
        (lambda: small_study(parameters={"n": float("nan")}), "finite"),
        (lambda: small_study(parameters={"n": (0.1, np.inf)}), "finite"),
        (lambda: small_study(parameters={"n": [1, "a"]}), "default"),
        (lambda: small_study(parameters={"n": []}), "default"),
        (lambda: small_study(coordinates=[Coordinate("strain", "strain", "s")]), "parameter"),
        (lambda: small_study(coordinates=[Coordinate("strain", "n", "s")]), "parameter"),
        (lambda: small_study(workers=0), "one"),
        (lambda: small_study(workers=1).worker_count(2, available=8), "workers 2"),
        (lambda: small_study(variables=[STATUS, Variable("s", (), "f8", long_name="s", volatile=True)]), "axis"),
    ],
)
def test_an_inconsistent_declaration_is_refused(declare, word):
    with pytest.raises(StudyError, match=word):
        declare()


@pytest.mark.parametrize(
    ("allowed", "requested", "count"),
    [(None, None, 8), (None, 20, 20), (None, 0, 0), (1, None, 1), (1, 0, 0), (1, 1, 1), (20, None, 8), (20, 12, 12)],
)
def test_the_number_of_workers_respects_the_limit_of_the_study(allowed, requested, count):
    assert small_study(workers=allowed).worker_count(requested, available=8) == count


@pytest.mark.parametrize("dtype, fill", [("i1", -128), ("u2", 65535), ("f4", None)])
def test_integers_without_a_fill_have_the_most_distant_from_ordinary_values(dtype, fill):
    assert Variable("x", (), dtype, long_name="x").fill == fill


def test_numbers_stand_with_their_nouns():
    assert [plural(n, noun) for n, noun in ((1, "case"), (0, "case"), (2, "stress"))] == [
        "1 case",
        "0 cases",
        "2 stresses",
    ]
    axes = Axis("seed", [0], "s", noun="network"), Axis("seed", [0], "s"), Axis("family", ["a"], "f", key="families")
    assert [axis.counted(1) for axis in axes] == ["1 network", "1 seed", "1 family"]
    assert [axis.counted(2) for axis in axes] == ["2 networks", "2 seeds", "2 families"]


def test_labels_of_inner_dimensions_keep_the_requested_order():
    study = small_study(parameters={"kinds": ("b", "a")}, coordinates=[Coordinate("kind", "kinds", "kind")])
    assert select(study, []).parameters["kinds"] == ("b", "a")
    assert select(study, ["kinds=a,c"]).parameters["kinds"] == ("a", "c")
    with pytest.raises(StudyError, match="twice"):
        select(study, ["kinds=a,a"])


def test_labels_of_inner_dimensions_may_be_fixed_words():
    """An array of another size is refused."""
    ends = Coordinate("end", "", "end of an edge", words=("tail", "head"))
    study = small_study(coordinates=[ends], variables=[STATUS, Variable("x", ("seed", "end"), "f8", long_name="x")])
    assert study.arrays({"status": Status.ok, "x": [1.0, 2.0]}, {})["x"].tolist() == [1.0, 2.0]
    with pytest.raises(StudyError, match="length 3 in 'end', not 2"):
        study.arrays({"status": Status.ok, "x": [1.0, 2.0, 3.0]}, {})


def test_default_parameters_become_plain_python_values():
    study = small_study(parameters={"a": np.float64(0.5), "b": np.arange(3), "c": [1, 0.5], "d": np.bool_(True)})
    assert repr(dict(study.parameters)) == "{'a': 0.5, 'b': (0, 1, 2), 'c': (1.0, 0.5), 'd': True}"


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"sigma": None}, "sigma"),
        ({"sigm": np.ones(6)}, "'sigma'"),
        ({"sigma": np.ones((6, 1))}, "shape"),
        ({"sigma": np.ones(0)}, "shape"),
        ({"sigma": np.ones(5)}, "edge"),
        ({"modulus": np.ones(4)}, "strain"),
        ({"sigma": np.ones(6, complex)}, "complex"),
        ({"steps": np.ones(3)}, "float64"),
        ({"steps": np.full(3, 70000)}, "large"),
        ({"steps": np.full(3, -1)}, "missing"),
        ({"status": 77}, "77"),
        ({"status": None}, "status"),
    ],
)
def test_arrays_that_do_not_fit_the_table_are_refused(tiny, change, word):
    good = tiny.study.case(tiny.study.parameters, seed=1, population="random")
    assert tiny.study.arrays(good, tiny.study.parameters)["steps"].dtype == "i2"
    bad = {name: value for name, value in (good | change).items() if value is not None}
    with pytest.raises(ValueError, match=word):
        tiny.study.arrays(bad, tiny.study.parameters)
