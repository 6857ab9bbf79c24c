"""Statements of the paper: the table, the rules of verdicts, and the claims that measurements give."""

import math
from collections import Counter

import pytest

from critflow.engine.code_digest import load_study, named_studies
from critflow.result import StudyError
from workflows.paper.statements import STATEMENTS, Measurement, Statement, statement
from workflows.paper.verdicts import claims_of, combined, verdict


def one(rule, **more):
    return Statement("s", "III", "a statement", "a criterion", rule, "ensemble", **more)


def test_every_statement_is_complete_and_its_study_exists():
    assert len(STATEMENTS) == 80
    for known in STATEMENTS.values():
        assert known.place and known.text and known.criterion, known.id
        assert known.study in named_studies(), known.id
    assert len({known.text for known in STATEMENTS.values()}) == len(STATEMENTS)
    assert Counter(known.kind for known in STATEMENTS.values()) == {"identity": 41, "measurement": 39}
    assert all(known.kind == "identity" for known in STATEMENTS.values() if known.difference == "proof")


def test_an_unknown_statement_or_rule_is_refused():
    with pytest.raises(StudyError, match="unique-V_L"):
        statement("unique-V_l")
    with pytest.raises(StudyError, match="rule"):
        one({"about": 3})
    with pytest.raises(StudyError, match="kind"):
        one({"share": 1}, kind="theorem")
    with pytest.raises(StudyError, match="rows"):
        one({"share": 1}, rows="one")


@pytest.mark.parametrize(
    "rule, value, span, expected",
    [
        ({"share": 1}, 1.0, (), "holds"),
        ({"share": 1}, 0.99, (), "differs"),
        ({"share": 0.95}, 0.95, (), "holds"),
        ({"share": 0.95}, 0.6, (), "undecided"),
        ({"share": 0.95}, 0.5, (), "differs"),
        ({"at_most": 10}, 10.0, (), "holds"),
        ({"at_most": 10}, 10.1, (), "differs"),
        ({"at_least": 10}, 9.9, (), "differs"),
        ({"near": [10, 5]}, 14.9, (), "holds"),
        ({"near": [10, 5]}, 15.1, (), "differs"),
        ({"near": [0, 0.05]}, 0.06, (0.04, 0.26), "undecided"),
        ({"near": [0, 0.05]}, 0.36, (0.3, 0.46), "differs"),
        # An exponent needs an interval that contains the number and is no wider than 0.15 to each side.
        ({"exponent": -1}, -1.05, (-1.17, -0.91), "holds"),
        ({"exponent": -1}, 0.59, (-2.22, 2.55), "undecided"),
        ({"exponent": -1}, -1.0, (-1.16, -0.9), "undecided"),
        ({"exponent": 0.5}, 0.65, (0.55, 0.71), "differs"),
        ({"exponent": 0.5}, 0.5, (), "undecided"),
        ({"share": 1}, math.nan, (), "undecided"),
    ],
)  # fmt: skip
def test_one_measurement(rule, value, span, expected):
    low, high = span or (math.nan, math.nan)
    assert verdict(one(rule), Measurement("s", value, "", low=low, high=high)) == expected


@pytest.mark.parametrize(
    "rows, verdicts, expected",
    [
        ("each", "holds holds", "holds"),
        ("each", "holds undecided", "undecided"),
        ("each", "holds undecided differs", "differs"),
        ("readings", "holds undecided", "undecided"),
        ("readings", "holds differs", "undecided"),
        ("readings", "differs undecided", "undecided"),
        ("readings", "holds holds", "holds"),
        ("readings", "differs differs", "differs"),
    ],
)
def test_several_measurements(rows, verdicts, expected):
    assert combined(one({"share": 1}, rows=rows), verdicts.split()) == expected


def test_a_statement_is_one_claim_with_its_measurements_beneath():
    fire = Measurement("compressed-number", 0.53, "0.53", "60 ascents", "FIRE", 0.46, 0.59)
    lbfgs = Measurement("compressed-number", 0.65, "0.65", "58 ascents", "L-BFGS", 0.55, 0.71)
    aside = Measurement("compressed-number", 3.0, "3.0", "58 ascents", "means", 2.9, 3.1, counts=False)
    first = Measurement("G_0-rises", 1.0, "it rises", "60 networks", note="a remark")
    rises, number = claims_of([fire, lbfgs, aside, first])
    assert (rises.key, rises.verdict, rises.rows, rises.because) == ("G_0-rises", "holds", [], "a remark")
    assert (number.verdict, number.difference, len(number.rows)) == ("undecided", "", 3)
    assert number.because.startswith("open: ascents of all sizes")
    assert number.value == "FIRE: 0.53; L-BFGS: 0.65"
    assert [row["verdict"] for row in number.rows] == ["holds", "differs", ""]
    (alone,) = claims_of([aside])
    assert (alone.verdict, alone.value) == ("undecided", "3.0")
    (differs,) = claims_of([lbfgs, aside])
    assert (differs.verdict, differs.difference, differs.value) == ("differs", "number", "L-BFGS: 0.65")


@pytest.mark.parametrize("name", sorted({known.study for known in STATEMENTS.values()} - {"ensemble", "gallery"}))
def test_a_study_measures_every_statement_of_the_table(name, runs):
    claims = load_study(name).study.claims(runs(name)[1])
    expected = [known.id for known in STATEMENTS.values() if known.study == name]
    assert [claim.key for claim in claims if claim.kind == "paper"] == expected


def test_the_statements_study_follows_its_arrays(runs):
    dataset = runs("statements")[1].copy(deep=True)
    dataset.satisfied.loc[{"statement": "unique-V_L"}] = 0
    verdicts = {claim.key: claim.verdict for claim in load_study("statements").study.claims(dataset)}
    assert {key for key, verdict in verdicts.items() if verdict != "holds"} == {"unique-V_L"}
