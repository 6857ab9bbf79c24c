"""The labelled dataset: names, units, meanings, missing values, and the conventions that it states."""

import json
import warnings
from types import SimpleNamespace

import netCDF4
import numpy as np
import pytest
import xarray as xr
from disturbed import contents_of, stamps_of

from critflow.command.main import main
from critflow.engine import dataset as dataset_module
from critflow.engine.code_digest import code_version
from critflow.engine.store import SCHEMA_VERSION
from critflow.result import Status


def test_the_dataset_has_the_dtypes_units_and_meanings_of_the_table(tmp_path, run, tiny):
    """With a failed case: a fill value must not turn integers into floats."""
    assert run(tmp_path, "trouble=1-random", "how=raise") == 3
    with xr.open_dataset(tmp_path / "tiny.nc") as ds:
        variables = tiny.study.variables
        assert {name: ds[name].dtype.str[1:] for name in ds.data_vars} == {v.name: v.dtype for v in variables}
        assert {name: ds[name].dims for name in ds.data_vars} == {v.name: v.dims for v in variables}
        for name, variable in ds.variables.items():
            assert variable.attrs["units"], name
            assert variable.attrs["long_name"], name
        assert ds.modulus.attrs["units"] == "N m-1"
        assert ds.seed.dtype.kind == "i"
        assert ds.population.values.tolist() == ["random", "floppy"]
        assert ds.strain.values.tolist() == [0.001, 0.002, 0.003]
        assert "_FillValue" not in ds.strain.encoding
        assert ds.attrs["Conventions"] == "CF-1.11, ACDD-1.3"
        assert ds.attrs["title"] == tiny.study.title
        assert json.loads(ds.attrs["parameters"])["strains"] == [0.001, 0.002, 0.003]
        meanings = dict(zip(ds.status.attrs["flag_meanings"].split(), ds.status.attrs["flag_values"], strict=True))
        assert meanings == {status.name: status.value for status in Status}
        assert ds.status.attrs["flag_values"].dtype == ds.status.dtype
        failed = ds.sel(seed=1, population="random")
        assert failed.status == Status.failed and (failed.steps == -1).all()
        assert failed.residual.isnull() and ds.sigma.sel(population="random").isnull().sum() == ds.sizes["edge"]
        assert ds.steps.attrs["value_if_missing"] == -1
        assert (ds.status.sel(population="random") == Status.ok).sum() == 3


def test_values_are_those_of_the_case_function(tmp_path, run, tiny):
    assert run(tmp_path, "seeds=3,1", "populations=floppy,random") == 0
    with netCDF4.Dataset(tmp_path / "tiny.nc") as file:  # no strings of variable length
        assert {name: file[name].dtype for name in ("seed", "population")} == {"seed": "i8", "population": "S1"}
    ds = xr.load_dataset(tmp_path / "tiny.nc")
    for seed in (3, 1):
        right = tiny.study.case(tiny.study.parameters, seed=seed, population="random")
        case = ds.sel(seed=seed, population="random")
        for name in ("edges", "sigma", "modulus", "steps", "residual", "status"):
            np.testing.assert_array_equal(case[name].values, np.asarray(right[name], case[name].dtype), err_msg=name)
    assert ds.seed.values.tolist() == [1, 3]
    assert ds.population.values.tolist() == ["random", "floppy"]  # the order of the study


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        (("trouble=2-floppy", "how=other edges"), ("seed2-floppy", "edges")),
        (("trouble=0-random", "how=longer", "populations=random"), ("seed1-random", "edge")),
    ],
)
def test_cases_that_disagree_about_shared_arrays_or_sizes_are_an_error(tmp_path, output_of, settings, names):
    err = output_of(tmp_path, *settings, code=4).err
    assert all(name in err for name in names), err
    assert not (tmp_path / "tiny.nc").exists()


def test_the_variables_of_a_large_dataset_do_not_stay_in_memory(tmp_path, run, monkeypatch):
    assert run(tmp_path) == 0
    for most, kept in ((dataset_module.SMALL, True), (0, False)):
        monkeypatch.setattr(dataset_module, "SMALL", most)
        with dataset_module.opened_dataset(tmp_path / "tiny.nc") as ds:
            assert np.shares_memory(ds.sigma.values, ds.sigma.values) == kept
    monkeypatch.setattr(dataset_module, "_LAZY", ds.status.nbytes)
    with dataset_module.opened_dataset(tmp_path / "tiny.nc") as ds:
        assert ds.sigma.chunks and not ds.status.chunks


def test_volatile_variables_are_marked(tmp_path, run, source):
    path = source('long_name="residual")', 'long_name="residual", volatile=True)')
    assert run(tmp_path / "out", "seeds=0", study=path) == 0
    ds = xr.load_dataset(tmp_path / "out" / "tiny.nc")
    assert [name for name in ds if "comment" in ds[name].attrs] == ["residual"]


def test_fewer_variables_equal_those_of_the_whole(tmp_path, run):
    assert run(tmp_path) == 0
    whole, before = contents_of(tmp_path / "tiny.nc"), stamps_of(tmp_path)
    assert run(tmp_path, "variables=residual,sigma") == 0
    few = contents_of(tmp_path / "tiny.nc")
    assert set(few[2]) == {"residual", "sigma", "status", "valid", "seed", "population"}
    assert "strain" not in few[0]
    assert all(few[2][name] == whole[2][name] for name in few[2])
    with_few = stamps_of(tmp_path)
    assert before.items() < with_few.items()
    assert run(tmp_path, "variables=sigma,residual") == 0  # all are stored
    assert run(tmp_path) == 0
    assert stamps_of(tmp_path) == with_few
    assert contents_of(tmp_path / "tiny.nc") == whole


# What ACDD recommends and a spring network does not have: a place on Earth, a time, an instrument, a publisher; names
# of people and institutions, which the software does not know; a name in the table of standard names. The date is in
# `history` only, so that nothing else differs from run to run.
NOT_OURS = (
    *("geospatial", "time_coverage", "instrument", "platform", "publisher", "creator", "contributor", "institution"),
    *("acknowledgment", "license", "naming_authority", "project", "processing_level", "program", "metadata_link"),
    *("keywords_vocabulary", "standard_name", "Attr date_", "references"),
)
# Networks with fewer edges than others end in NaN.
RAGGED = ("rng.normal(size=n_edges)", "np.where(np.arange(n_edges) < 3 + seed, rng.normal(size=n_edges), np.nan)")
SAMPLES = {
    "scalars": ((), ("variables=scalars",)),
    "ragged networks": (RAGGED, ()),
    "a failed case": ((), ("trouble=1-random", "how=raise")),
    "failed cases only": ((), ("seeds=1", "populations=random", "trouble=1-random")),
}


@pytest.fixture(scope="module")
def complaints():
    """`complaints(path, suite, out)`: the messages of compliance-checker in its strict mode."""
    runner = pytest.importorskip("compliance_checker.runner", reason="no compliance-checker: install critflow[test]")
    runner.CheckSuite.load_all_available_checkers()

    def check(path, suite, out):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of its dependencies
            options = {"output_filename": str(out), "output_format": "json"}
            runner.ComplianceChecker.run_checker(str(path), [suite], 0, "strict", **options)
        found = json.loads(out.read_text())[suite]
        assert found["scored_points"] > 0
        results = [result for level in ("high", "medium", "low") for result in found[f"{level}_priorities"]]
        return [f"{result['name']}: {message}" for result in results for message in result["msgs"]]

    return check


@pytest.mark.parametrize(
    "sample", [pytest.param("ragged networks", marks=pytest.mark.sweep), *sorted(set(SAMPLES) - {"ragged networks"})]
)
def test_datasets_follow_the_conventions_that_they_state(tmp_path, run, source, complaints, sample):
    changes, settings = SAMPLES[sample]
    assert run(tmp_path / "out", *settings, study=source(*changes)) in (0, 3)
    path = tmp_path / "out" / "tiny.nc"
    assert complaints(path, "cf:1.11", tmp_path / "cf.json") == []
    found = complaints(path, "acdd:1.3", tmp_path / "acdd.json")
    assert [line for line in found if not any(word in line for word in NOT_OURS)] == []


def test_a_dataset_in_pieces_has_the_contents_of_one_in_memory(tmp_path, run, source, monkeypatch):
    """With a variable of no axis, whose values all pieces share."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    shared = ('Variable("status"', 'Variable("shared", ("edge",), "f8", long_name="shared"), Variable("status"')
    path = source(*shared, '"status":', '"shared": np.arange(float(n_edges)), "status":')
    written = []
    for size in (2**24, 1):
        monkeypatch.setattr(dataset_module, "_CHUNK", size)
        out = tmp_path / str(size)
        assert run(out, study=path) == 0
        assert main(["verify", str(out)]) == 0
        written.append(contents_of(out / "tiny.nc"))
    assert written[0] == written[1]
    with xr.open_dataset(tmp_path / "1" / "tiny.nc", chunks={}) as ds:
        assert ds.chunks["seed"] == (1, 1, 1, 1)


def test_a_large_dataset_with_arrays_is_written_in_parts_that_are_one(tmp_path, run, source, said, monkeypatch):
    """Parts of one network each; numbers alone are one file, and parts that are no longer needed are deleted."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    shared = ('Variable("status"', 'Variable("shared", ("edge",), "f8", long_name="shared"), Variable("status"')
    path = source(*shared, '"status":', '"shared": np.arange(float(n_edges)), "status":')
    out, whole = tmp_path / "out", tmp_path / "whole"
    assert run(whole, study=path) == 0
    for name in ("_CHUNK", "_PART"):
        monkeypatch.setattr(dataset_module, name, 1)
    assert run(out, study=path) == 0
    parts = sorted(out.glob("*.nc"))
    assert [part.name for part in parts] == [f"tiny-part00{number}.nc" for number in range(4)]
    with xr.open_dataset(whole / "tiny.nc") as one, xr.open_mfdataset(str(out / "*.nc"), **dataset_module.AS_ONE) as ds:
        del ds.attrs["parts"]
        assert ds.load().identical(one)
    for most in (dataset_module.SMALL, 0):
        monkeypatch.setattr(dataset_module, "SMALL", most)
        with dataset_module.opened_dataset(out / "tiny.nc") as ds:
            assert bool(ds.sigma.chunks) == (not most and ds.sigma.nbytes > dataset_module._LAZY)
            assert ds.seed.values.tolist() == [0, 1, 2, 3]
    assert main(["verify", str(out)]) == 0
    shown = said(["show", str(whole / "tiny.nc")]).out
    assert said(["show", str(out / "tiny.nc")]).out == shown == said(["show", str(parts[2])]).out
    kept = parts[1].read_bytes()
    parts[1].unlink()
    assert "3 of its 4 parts" in said(["show", str(out / "tiny.nc")], 4).err
    parts[1].write_bytes(kept)
    assert run(out, "variables=scalars", study=path) == 0
    assert [file.name for file in out.glob("*.nc")] == ["tiny.nc"]


def test_values_that_differ_between_pieces_are_an_error(tmp_path, output_of, source, monkeypatch):
    monkeypatch.setattr(dataset_module, "_CHUNK", 1)
    shared = ('Variable("status"', 'Variable("shared", (), "f8", long_name="shared"), Variable("status"')
    path = source(*shared, '"status":', '"shared": float(seed), "status":')
    assert "shared" in output_of(tmp_path, study=path, code=4).err


def test_the_largest_variables_have_chunks_along_the_first_axis_and_integers_are_compressed(
    tmp_path, run, source, monkeypatch
):
    monkeypatch.setattr(dataset_module, "_CHUNK", 2**16)
    words = ("n_edges=2000", "seeds=0:5", "populations=random")
    assert run(tmp_path, *words) == 0
    with netCDF4.Dataset(tmp_path / "tiny.nc") as file:
        assert file["sigma"].chunking() == [1, 4, 2000] and file["residual"].chunking() == [1, 4]
        assert file["edges"].filters()["zlib"] and not file["sigma"].filters()["zlib"]
    with xr.open_dataset(tmp_path / "tiny.nc", chunks={}) as ds:
        assert ds.chunks["seed"] == (4, 1)  # the same for all variables
    assert main(["verify", str(tmp_path)]) == 0


@pytest.mark.parametrize(("more", "stored"), [("seed", 2), ("5 * (population == 'floppy')", 1)])
def test_other_sizes_end_the_run_at_once(tmp_path, output_of, source, more, stored):
    """Between networks at the second one, within a network at its second case."""
    path = source("    sleep(parameters", f"    n_edges += {more}\n    sleep(parameters")
    err = output_of(tmp_path / "out", "seeds=0:50", study=path, code=4).err
    assert "each size into a folder of its own and join them" in err and "'edge'" in err
    assert len(list((tmp_path / "out" / "shards").iterdir())) == stored


def test_cases_of_other_sizes_that_are_kept_are_not_joined(tmp_path, run, source, output_of):
    assert run(tmp_path / "out", "seeds=0", study=source()) == 0
    path = source('n_edges = parameters["n_edges"]', 'n_edges = parameters["n_edges"] + 2')
    err = output_of(tmp_path / "out", "seeds=0:2", study=path, more=("--keep",), code=4).err
    assert "length 8 in 'edge', cases before it 6" in err


def test_a_dataset_that_does_not_read_back_is_not_put_in_place(tmp_path, run, output_of, monkeypatch):
    """A library or a disk that alters the data is detected before the file is put in place."""
    assert run(tmp_path, "seeds=0") == 0
    before, real = contents_of(tmp_path / "tiny.nc"), netCDF4.Dataset

    def altered(path, mode="r"):
        if mode == "r":
            with real(path, "a") as file:
                file["residual"][0, 0] = 7.0
        return real(path, mode)

    monkeypatch.setattr(dataset_module, "netCDF4", SimpleNamespace(**vars(netCDF4) | {"Dataset": altered}))
    assert "back" in output_of(tmp_path, "seeds=0", code=6).err
    monkeypatch.undo()
    assert contents_of(tmp_path / "tiny.nc") == before


def test_show_prints_what_a_dataset_is(tmp_path, run, tiny, said):
    assert run(tmp_path, "trouble=1-random", "seeds=1:3", "spread=0.2") == 3
    text = said(["show", str(tmp_path / "tiny.nc")]).out
    assert text.strip() == xr.load_dataset(tmp_path / "tiny.nc").attrs["summary"]
    assert len(text.splitlines()) <= 20 and max(map(len, text.splitlines())) <= 120
    for words in (
        "A study without physics (study tiny, version 1)",
        "2 seeds × 2 populations = 4; in each 3 strain, 6 edge, 2 end",
        "critflow run tiny_study.py --set seeds=1,2 --set spread=0.2 --set trouble=1-random",
        f"code: {code_version(tiny.study)}: 3 cases",
        "random: 1 ok, 1 failed",
        "floppy: 2 floppy",
        "ds[['residual']].where(ds.valid)",
    ):
        assert words in text, text


# A study whose random cases have slack edges, sound members of its population, and whose residual is undefined there.
SLACK = ('"status": Status.ok,', '"status": Status.slack_edges,')
UNDEFINED = (
    'Variable("residual", ("population", "seed"), "f8", long_name="residual")',
    'Variable("residual", ("population", "seed"), "f8", long_name="residual", undefined_at=[Status.slack_edges])',
)


def test_every_study_has_valid_by_which_its_population_is_selected_as_show_advises(tmp_path, run, source, said):
    """A study of a user declares nothing for it."""
    assert run(tmp_path / "out", study=source(*SLACK)) == 0
    with xr.open_dataset(tmp_path / "out" / "tiny.nc") as ds:
        assert ds.valid.dims == ds.status.dims
        assert ds.valid.sel(population="random").values.tolist() == [1] * 4
        assert ds.valid.sel(population="floppy").values.tolist() == [0] * 4
        shown = said(["show", str(tmp_path / "out" / "tiny.nc")]).out.splitlines()
        (line,) = [line for line in shown if line.startswith("valid members: ")]
        members = eval(line.removeprefix("valid members: ").partition(";")[0], {"ds": ds})
        assert members.residual.count() == 4
    assert main(["verify", str(tmp_path / "out")]) == 0


def test_a_study_declares_which_statuses_are_sound(tmp_path, run, source):
    change = ("    check=check,", "    check=check, sound=[Status.floppy],")
    assert run(tmp_path, "seeds=0", "trouble=0-random", study=source(*change)) == 3
    with xr.open_dataset(tmp_path / "tiny.nc") as ds:
        assert ds.valid.sel(population="floppy").item() == 1
        assert ds.valid.sel(population="random").item() == 0  # failed
        assert "floppy" in ds.valid.attrs["long_name"]


def test_a_variable_is_missing_where_it_is_declared_undefined(tmp_path, run, source):
    """What the case function returned stays stored, so that the declaration can change."""
    slack = (SLACK[0], '"status": Status.slack_edges if seed else Status.ok,')
    for name, change in (("all", slack), ("some", (*slack, *UNDEFINED))):
        assert run(tmp_path / name, study=source(*change)) == 0
    with xr.open_dataset(tmp_path / "all" / "tiny.nc") as ds, xr.open_dataset(tmp_path / "some" / "tiny.nc") as other:
        assert ds.residual.count() == 4
        assert other.residual.sel(population="random").isnull().values.tolist() == [False, True, True, True]
        assert other.drop_vars("residual").identical(ds.drop_vars("residual").assign_attrs(other.attrs))
    assert main(["verify", str(tmp_path / "some")]) == 0
    assert run(tmp_path / "some", more=("--dry-run",), study=source(*slack)) == 0


def test_a_folder_or_a_dataset_of_another_schema_is_refused_and_kept(tmp_path, run, said, monkeypatch):
    for name in ("dataset", "store"):
        monkeypatch.setattr(f"critflow.engine.{name}.SCHEMA_VERSION", 3)
    assert run(tmp_path, "seeds=0") == 0
    monkeypatch.undo()
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    for command in (["status"], ["verify"], ["figures"], ["run", "tests/engine/tiny_study.py", "--out"]):
        (line,) = said([*command, str(tmp_path)], 2).err.splitlines()
        assert f"schema 3, not {SCHEMA_VERSION}" in line and "--out" in line
    assert f"schema 3, not {SCHEMA_VERSION}" in said(["show", str(tmp_path / "tiny.nc")], 2).err
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
