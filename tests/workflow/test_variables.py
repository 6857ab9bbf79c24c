"""Variables on request: what is not asked for is neither computed nor stored, and what is stored stays what it was."""

import json
from dataclasses import replace

import pytest
import xarray as xr

from critflow.cli import main
from critflow.result import Status, StudyError
from critflow.workflow.batch import Job, Outcome, run_batch
from critflow.workflow.folder import Folder, _note_text
from critflow.workflow.plan import select
from critflow.workflow.store import read_shard

ALL = ("edges", "sigma", "modulus", "steps", "residual", "status")


def stored_names(study):
    return tuple(variable.name for variable in study.variables)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("residual", ("residual", "status")),
        ("status", ("status",)),
        ("residual, sigma", ("sigma", "residual", "status")),
        ("scalars", ("residual", "status")),
        ("scalars,sigma", ("sigma", "residual", "status")),
        ("sigma,scalars,residual", ("sigma", "residual", "status")),
        ("all", ALL),
        ("steps,modulus,edges,residual,sigma", ALL),
    ],
)
def test_a_run_stores_what_it_is_asked_for_in_the_order_of_the_table(tiny, text, names):
    assert stored_names(select(tiny.study, [f"variables={text}"]).study) == names


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("residua", "no variable 'residua': did you mean 'residual'"),
        ("scalar", "did you mean 'scalars'"),
        ("zzz", "the choices are all, scalars, edges"),
        ("residual,residual", "residual twice"),
        ("", "empty value"),
        ("residual,", "empty value"),
    ],
)
def test_unknown_variables_are_refused(tiny, text, sentence):
    with pytest.raises(StudyError, match=sentence):
        select(tiny.study, [f"variables={text}"])


def test_no_study_calls_a_setting_of_its_own_variables(tiny):
    with pytest.raises(StudyError, match="'variables' twice"):
        replace(tiny.study, parameters={**tiny.study.parameters, "variables": 1})


def test_the_identity_is_that_of_the_variables_and_of_a_plain_run_what_it_was(tiny):
    def identity(*words):
        selection = select(tiny.study, ["seeds=3", *words])
        return selection.cases()[0].id, selection.study.table_digest

    plain, few, other = identity(), identity("variables=residual"), identity("variables=sigma")
    assert identity("variables=all") == plain
    assert identity("variables=status,residual") == few
    assert all(len({*both}) == 3 for both in zip(plain, few, other, strict=True))


def test_fewer_variables_stand_beside_the_whole_and_are_equal_to_it(tmp_path, run, stamps, contents):
    assert run(tmp_path) == 0
    whole, before = contents(tmp_path / "tiny.nc"), stamps(tmp_path)
    assert run(tmp_path, "variables=residual,sigma") == 0
    few = contents(tmp_path / "tiny.nc")
    assert set(few[2]) == {"residual", "sigma", "status", "seed", "population"}
    assert "strain" not in few[0]
    assert all(few[2][name] == whole[2][name] for name in few[2])
    with_few = stamps(tmp_path)
    assert before.items() < with_few.items()
    assert run(tmp_path, "variables=sigma,residual") == 0  # all there
    assert run(tmp_path) == 0
    assert stamps(tmp_path) == with_few
    assert contents(tmp_path / "tiny.nc") == whole


def test_shards_hold_nothing_that_was_not_asked_for(tmp_path, tiny, run):
    assert run(tmp_path, "seeds=0", "variables=steps") == 0
    selection = select(tiny.study, ["seeds=0", "variables=steps"])
    arrays = read_shard(tmp_path / "shards", selection.study, selection.cases()[0]).arrays
    assert set(arrays) == {"steps"}
    with xr.open_dataset(tmp_path / "tiny.nc") as ds:
        assert ds.strain.values.tolist() == [0.001, 0.002, 0.003]


def test_what_cannot_be_read_off_is_left_out_in_one_line(tmp_path, run, capsys):
    assert run(tmp_path) == 0
    written = ("claims.md", "claims.json", "summary.json", "figures/modulus.png", "figures/growth.gif")
    assert all((tmp_path / name).is_file() for name in written)
    capsys.readouterr()
    assert run(tmp_path, "variables=sigma") == 0
    lines = capsys.readouterr().out.splitlines()
    reason = "left out for want of variables: figure 'modulus', animation 'growth', the claims, the summary"
    assert lines[1:] == [f"{tmp_path}: {reason}"]
    # Nothing of the fuller run is left to be taken for this one.
    assert not any((tmp_path / name).exists() for name in written)
    assert main(["figures", str(tmp_path)]) == 0
    assert reason in capsys.readouterr().out
    assert main(["status", str(tmp_path)]) == 0
    assert "8 done of 8 cases" in capsys.readouterr().out
    assert run(tmp_path, "variables=residual") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == f"{tmp_path}: left out for want of variables: figure 'modulus', animation 'growth'"
    assert lines[2] == f"{tmp_path / 'claims.md'}: 1 of 2 claims hold"
    assert (tmp_path / "summary.json").is_file()


def test_other_errors_of_a_figure_are_still_told(tmp_path, capsys, tiny):
    study = tmp_path / "study.py"
    study.write_text(tiny.path.read_text() + "\nstudy.figures['modulus'] = lambda ds: ds['sigm']\n")
    words = ["run", str(study), "--workers", "0", "--out", str(tmp_path / "out"), "--set", "variables=residual"]
    assert main(words) == 1
    assert "figure 'modulus' could not be made" in capsys.readouterr().err


def test_verify_looks_at_what_is_there(tmp_path, capsys, tiny):
    study = tmp_path / "study.py"
    study.write_text(
        tiny.path.read_text()
        + "\nobject.__setattr__(study, 'verify', lambda ds: ['wrong'] * int(ds.sigma[0, 0, 0] < 9))\n"
    )
    run = ["run", str(study), "--workers", "0", "--out", str(tmp_path / "out"), "--set", "seeds=0"]
    assert main([*run, "--set", "variables=residual"]) == 0
    assert main(["verify", str(tmp_path / "out")]) == 0
    assert "2 stored cases and the dataset agree to the last byte; no physics" in capsys.readouterr().out
    assert main([*run, "--set", "variables=sigma"]) == 0
    assert main(["verify", str(tmp_path / "out")]) == 4
    assert "wrong" in capsys.readouterr().err


def test_a_folder_knows_its_variables(tmp_path, run):
    assert run(tmp_path, "seeds=0", "variables=residual") == 0
    folder = Folder(tmp_path)
    _, selection = folder.selection()
    assert stored_names(selection.study) == ("residual", "status")
    note = json.loads(folder.note.read_text())
    del note["sha256"]
    folder.note.write_text(_note_text(note | {"variables": ["sigma", "gone"]}))
    with pytest.raises(StudyError, match="other variables now"):
        folder.selection()


ASKS = '''
from pathlib import Path

def asking(parameters, *, seed, population, wanted):
    """Like the other, but writes down what it was asked for, and returns no more."""
    Path(parameters["how"]).write_text(",".join(sorted(wanted)))
    made = case(parameters, seed=seed, population=population)
    return {name: value for name, value in made.items() if name in {*wanted, "status"}}

object.__setattr__(study, "case", asking)
'''


@pytest.mark.parametrize("workers", [0, 1])
def test_a_case_function_that_asks_is_told_what_is_wanted(tmp_path, tiny, workers):
    study, seen = tmp_path / "study.py", tmp_path / "seen"
    study.write_text(tiny.path.read_text() + ASKS)
    words = ["run", str(study), "--workers", str(workers), "--out", str(tmp_path / "out"), "--set", f"how={seen}"]
    words += ["--set", "seeds=0", "--set", "populations=random"]
    for text, wanted in (("all", sorted(ALL)), ("scalars", ["residual", "status"]), ("steps", ["status", "steps"])):
        assert main([*words, "--set", f"variables={text}"]) == 0
        assert seen.read_text().split(",") == wanted


def test_without_what_was_asked_for_an_ok_case_has_failed(tmp_path, tiny):
    """The case function still has to return all that is stored, and to return nothing unknown."""
    study = replace(tiny.study, case=lambda parameters, *, seed, population: {"status": Status.ok}).storing(["sigma"])
    values = {"seed": 0, "population": "random"}
    with pytest.raises(StudyError, match="status ok without sigma"):
        study.computed(study.parameters, values)
    assert study.storing(["status"]).computed(study.parameters, values) == {"status": Status.ok}
    unknown = replace(study, case=lambda parameters, *, seed, population: {"status": Status.ok, "residua": 1.0})
    with pytest.raises(StudyError, match="did you mean 'residual'"):
        unknown.computed(study.parameters, values)


def test_a_failed_case_is_stored_as_one_with_fewer_variables(tmp_path, tiny, run):
    assert run(tmp_path, "variables=residual", "trouble=1-random", "how=raise") == 3
    assert run(tmp_path, "variables=residual", "trouble=1-random", "how=raise") == 3  # read back, tried again
    with xr.open_dataset(tmp_path / "tiny.nc") as ds:
        assert ds.status.sel(seed=1, population="random") == Status.failed


def test_a_worker_finds_what_it_stored(tmp_path, tiny):
    (tmp_path / "shards").mkdir()
    job = Job("run", str(tiny.path), tiny.digest, str(tmp_path / "shards"), dict(tiny.study.parameters), ("residual",))
    batch = [{"seed": 0, "population": "random"}]
    first, again = (Outcome(*run_batch(job, batch)[0]) for _ in range(2))
    assert first.checksum == again.checksum and again.seconds == 0.0
    assert first.case_id == select(tiny.study, ["seeds=0", "variables=residual"]).cases()[0].id
