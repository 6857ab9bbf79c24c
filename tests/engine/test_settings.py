"""From `--set` words to cases, their identifiers and their random generators."""

from dataclasses import replace
from decimal import Decimal

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from critflow.engine import decimals, stable_rng
from critflow.engine.settings import select
from critflow.result import StudyError

ALL = ("edges", "sigma", "modulus", "steps", "residual", "status", "valid")


@pytest.mark.parametrize(
    ("word", "name", "values"),
    [
        ("seeds=7", "seed", (7,)),
        ("seeds=2:5", "seed", (2, 3, 4)),
        ("seeds=9,2:4, 0", "seed", (0, 2, 3, 9)),
        ("populations=floppy,random", "population", ("random", "floppy")),
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
def test_a_setting_has_the_type_of_its_default(tiny, word, name, values):
    selection = select(tiny.study, [word])
    chosen = {**selection.parameters, **selection.axes}[name]
    assert chosen == values
    assert type(chosen) is type(values)
    assert repr(chosen) == repr(values)  # 3.0 is not 3


BAD = {  # settings, and a word of the message
    "seeds": "value",
    "": "value",
    "=3": "settings",
    "seed=3": "'seeds'",
    "sedes=3": "'seeds'",
    "n_edgs=4": "'n_edges'",
    "seeds=1 seeds=2": "twice",
    "seeds=": "value",
    "seeds=0:0": "empty",
    "seeds=5:2": "empty",
    "seeds=-1:3": "negative",
    "seeds=1.5": "whole",
    "seeds=3,1:4": "twice",
    "seeds=0:1000000000000": "at most",
    "seeds=0:600000": "at most",
    "populations=flopy": "'floppy'",
    "populations=random,random": "twice",
    "n_edges=7": "even",  # the check of the study
    "n_edges=1e3": "whole",
    "n_edges=2,4": "one value",
    "n_edges=-2": "negative",
    "spread=nan": "finite",
    "spread=wide": "numbers",
    "spread=-0.1": "negative",
    "strains=0.01:0.001:0.001": "backwards",
    "strains=0.001:0.01:-0.001": "step",
    "strains=0.001:0.01": "step",
    "strains=0:1:1e-12": "at most",
    "strains=0:inf:1": "finite",
    "strains=0.002,0.001": "increas",
    "variables=residua": "'residual'",
    "variables=scalar": "'scalars'",
    "variables=zzz": "scalars",
    "variables=residual,residual": "twice",
    "variables=": "empty",
    "how=a\nb": "unprintable",
    "how=\udcff": "unprintable",
}


@pytest.mark.parametrize("words", BAD)
def test_a_bad_setting_is_refused_in_one_sentence(tiny, words):
    with pytest.raises(StudyError, match=BAD[words]) as caught:
        select(tiny.study, [words] if "\n" in words or not words else words.split(" "))
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
def test_any_text_is_a_value_or_an_error(tiny, key, text):
    try:
        selection = select(tiny.study, [f"{key}={text}"])
    except StudyError:
        return
    assert all(selection.axes.values())
    assert all(value >= 0 for value in (*selection.axes["seed"], *selection.parameters["strains"]))


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("residual", ("residual", "status", "valid")),
        ("status", ("status", "valid")),
        ("residual, sigma", ("sigma", "residual", "status", "valid")),
        ("scalars", ("residual", "status", "valid")),
        ("sigma,scalars,residual", ("sigma", "residual", "status", "valid")),
        ("all", ALL),
        ("steps,modulus,edges,residual,sigma", ALL),
    ],
)
def test_requested_variables_have_the_order_of_the_table(tiny, text, names):
    study = select(tiny.study, [f"variables={text}"]).study
    assert tuple(variable.name for variable in study.variables) == names


def ids(study, *words):
    return {tuple(case.values.values()): case.id for case in select(study, words).cases}


def test_the_identifier_of_a_case_depends_on_its_values_parameters_and_variables_only(tiny):
    """Other values in the run, the order of settings and the spelling of numbers do not matter."""
    few = ids(tiny.study, "seeds=1", "spread=0.10")
    many = ids(tiny.study, "spread=1e-1", "seeds=0:3", "populations=random,floppy")
    assert few.items() <= many.items()
    assert len(set(many.values())) == 6
    key = (1, "random")
    others = ("spread=0.2", "variables=residual", "variables=sigma", "strains=0.001")
    assert len({few[key], *(ids(tiny.study, "seeds=1", word)[key] for word in others)}) == 5
    assert ids(tiny.study, "seeds=1", "variables=all")[key] == ids(tiny.study, "seeds=1")[key]
    same = [ids(tiny.study, "seeds=1", f"variables={text}")[key] for text in ("status,residual", "residual")]
    assert same[0] == same[1]


def test_the_identifiers_never_change(tiny):
    """Frozen: another identifier here means that every stored case would be computed again."""
    assert select(tiny.study, ["seeds=3"]).cases[0].id == "seed3-random-7577c7c87ebd336f"


@pytest.mark.parametrize(
    ("name", "draws"),
    [
        ((0,), [4047996732, 4154883421, 3771220488]),
        ((7, "network"), [1581593097, 3619310726, 3367848767]),
        ((7, "rest_lengths", "random_lengths"), [4082507471, 2045364871, 2839303814]),
        ((2**70, "é"), [3912850049, 2182706300, 3248301135]),
    ],
)
def test_the_draws_of_a_generator_never_change(name, draws):
    """Frozen: another number here means that every published dataset would change."""
    assert stable_rng(*name).integers(0, 2**32, 3).tolist() == draws


words = st.lists(st.text(max_size=8), max_size=3)


@given(st.tuples(st.integers(0, 99), words), st.tuples(st.integers(0, 99), words))
def test_different_names_give_different_generators(one, other):
    draws = [stable_rng(entropy, *names).integers(0, 2**63, 2).tolist() for entropy, names in (one, other)]
    assert (draws[0] == draws[1]) == (one == other)


def test_a_comma_in_brackets_belongs_to_a_name(tiny):
    study = replace(tiny.study, parameters={**tiny.study.parameters, "quantity": "B_0", "quantities": ("B_0", "G_0")})
    parameters = select(study, ["quantity=local[0-1,2-3]", "quantities=G_0,local[0-1,2-3]"]).parameters
    assert parameters["quantity"] == "local[0-1,2-3]"
    assert parameters["quantities"] == ("G_0", "local[0-1,2-3]")
