"""From `--set` words to cases."""

from decimal import Decimal

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from critflow.result import StudyError
from critflow.workflow.plan import Case, decimals, select


@pytest.mark.parametrize(
    ("word", "name", "values"),
    [
        ("seeds=7", "seed", (7,)),
        ("seeds=2:5", "seed", (2, 3, 4)),
        ("seeds=9,2:4, 0", "seed", (9, 2, 3, 0)),
        ("populations=floppy,random", "population", ("floppy", "random")),
        ("populations=wide", "population", ("wide",)),
        ("n_edges=8", "n_edges", 8),
        ("spread=3", "spread", 3.0),
        ("spread=1e-3", "spread", 0.001),
        ("strains=0.003", "strains", (0.003,)),
        ("strains=0.001,0.02", "strains", (0.001, 0.02)),
        ("strains=0:0.01:0.003", "strains", (0.0, 0.003, 0.006, 0.009)),
        ("strains=0.001:0.010:0.001", "strains", tuple(i / 1000 for i in range(1, 11))),
        ("how=until a=b", "how", "until a=b"),
    ],
)
def test_settings_are_read_by_the_type_of_their_default(tiny, word, name, values):
    selection = select(tiny.study, [word])
    chosen = {**selection.parameters, **selection.axes}[name]
    assert chosen == values
    assert type(chosen) is type(values)
    assert repr(chosen) == repr(values)  # 3.0 is not 3


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["seeds"], "has no value"),
        (["seed=3"], "did you mean 'seeds'"),
        (["n_edgs=4"], "did you mean 'n_edges'"),
        (["zzz=4"], "the settings are seeds, populations, n_edges"),
        (["seeds=1", "seeds=2"], "set twice"),
        (["seeds="], "empty value"),
        (["seeds=1,,2"], "empty value"),
        (["seeds=0:0"], "empty range"),
        (["seeds=5:2"], "empty range"),
        (["seeds=0:9:2"], "start:stop"),
        (["seeds=-1:3"], "must not be negative"),
        (["seeds=1.5"], "whole numbers"),
        (["seeds=nan"], "whole numbers"),
        (["seeds=3,1:4"], "3 twice"),
        (["seeds=0:1000000000000"], "choose at most"),
        (["seeds=0:1000000"], "cases: choose at most"),
        (["populations=flopy"], "did you mean 'floppy'"),
        (["populations=random,random"], "random twice"),
        (["populations="], "empty value"),
        (["n_edges=7"], "odd"),  # the study's own check
        (["n_edges=1e3"], "whole numbers"),
        (["n_edges=2,4"], "one value"),
        (["n_edges=-2"], "must not be negative"),
        (["spread=nan"], "finite"),
        (["spread=1e999"], "finite"),
        (["spread=wide"], "needs numbers"),
        (["spread=-0.1"], "must not be negative"),
        (["strains=0.01:0.001:0.001"], "backwards"),
        (["strains=0.001:0.01:-0.001"], "step above zero"),
        (["strains=0.001:0.01:0"], "step above zero"),
        (["strains=0.001:0.01"], "start:stop:step"),
        (["strains=0:1:1e-12"], "choose at most"),
        (["strains=0.002,0.001"], "must increase"),
        (["strains=0.001,0.001"], "0.001 twice"),
        (["strains=inf"], "finite"),
        (["strains="], "empty value"),
    ],
)
def test_bad_settings_are_refused_in_one_sentence(tiny, words, sentence):
    with pytest.raises(StudyError, match=sentence) as caught:
        select(tiny.study, words)
    assert "\n" not in str(caught.value)


@given(st.integers(0, 500), st.integers(1, 60), st.integers(1, 40), st.integers(0, 5))
def test_decimal_ranges_are_exact(start, count, step, digits):
    unit = Decimal(1).scaleb(-digits)
    ends = (start * unit, (start + (count - 1) * step) * unit, step * unit)
    found = decimals(":".join(map(str, ends)))
    assert found == tuple(float(f"{start + i * step}e-{digits}") for i in range(count))


@given(
    st.sampled_from(("seeds", "strains", "spread", "n_edges", "populations")),
    st.text("0123456789.:,-+e _nÅ٣", max_size=9),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])  # the study is frozen
def test_any_text_is_a_value_or_a_sentence(tiny, key, text):
    try:
        selection = select(tiny.study, [f"{key}={text}"])
    except StudyError:
        return
    assert all(selection.axes.values())
    assert all(value >= 0 for value in (*selection.axes["seed"], *selection.parameters["strains"]))


def test_identity_is_what_the_case_is(tiny):
    """Other axis values in the run, order of settings and spelling of numbers do not enter; everything else does."""
    few = select(tiny.study, ["seeds=1", "spread=0.10"]).cases()[0]
    many = select(tiny.study, ["spread=1e-1", "seeds=0:3", "populations=wide,random"]).cases()[3]
    assert (few.values, few.id) == (many.values, many.id)
    base = {"study": "tiny", "version": 1, "parameters": dict(few.parameters), "values": few.values}
    assert Case(**base).id == few.id
    others = [
        base | {"study": "other"},
        base | {"version": 2},
        base | {"parameters": base["parameters"] | {"spread": 0.2}},
        base | {"values": {"seed": 2, "population": "random"}},
    ]
    assert len({few.id, *(Case(**other).id for other in others)}) == 5


def test_case_ids_never_change(tiny):
    """Frozen: another id here means that every shard on disk would be computed again."""
    assert select(tiny.study, ["seeds=3"]).cases()[0].id == "seed3-random-7577c7c87ebd336f"
