"""The dataset written slab by slab: the same file as at once, in little memory."""

import tracemalloc
from dataclasses import replace

import netCDF4
import numpy as np
import pytest
import xarray as xr
from in_memory import merge as merged

from critflow.result import EnvironmentFailure, IntegrityError, Status
from critflow.workflow import Axis, Study, Variable, merge, verify
from critflow.workflow.folder import Folder
from critflow.workflow.manifest import write_manifest
from critflow.workflow.plan import select
from critflow.workflow.store import write_shard


@pytest.mark.parametrize("settings", [(), ("populations=random,floppy,wide", "seeds=0:2"), ("trouble=0-random",)])
@pytest.mark.parametrize("slab", [1, 150, 2**26])
def test_slabs_of_any_size_give_what_is_merged_at_once(tmp_path, run, tiny, contents, monkeypatch, slab, settings):
    monkeypatch.setattr(merge, "SLAB_BYTES", slab)
    assert run(tmp_path, *settings) in (0, 3)
    selection = select(tiny.study, settings)
    whole = merged(selection, tmp_path / "shards")
    whole.to_netcdf(tmp_path / "whole.nc", engine="netcdf4", format="NETCDF4")
    assert contents(tmp_path / "tiny.nc") == contents(tmp_path / "whole.nc")
    xr.testing.assert_equal(xr.load_dataset(tmp_path / "tiny.nc"), whole)


def test_cases_in_different_slabs_that_disagree_about_what_they_share_are_an_error(tmp_path, run, capsys, monkeypatch):
    monkeypatch.setattr(merge, "SLAB_BYTES", 1)
    assert run(tmp_path, "trouble=2-wide", "how=other edges", "seeds=2", "populations=random,wide,floppy") == 4
    err = capsys.readouterr().err
    assert "seed2-wide" in err
    assert "'edges'" in err


def case(parameters, *, number):
    return {"status": Status.ok, "field": np.full(1000, float(number))}


LARGE = Study(
    name="large",
    title="Much data",
    axes=(Axis("number", range(400), "number"),),
    parameters={"none": 0},
    case=case,
    variables=(
        Variable("field", ("number", "point"), "f8", long_name="field"),
        Variable("status", ("number",), "i1", long_name="outcome", flags=Status),
    ),
)


def test_memory_holds_a_slab_and_not_the_dataset(tmp_path, monkeypatch):
    monkeypatch.setattr(merge, "SLAB_BYTES", 80_000)  # ten of 400 cases
    selection = select(LARGE)
    for one in selection.cases():
        arrays = LARGE.computed(one.parameters, one.values)
        write_shard(tmp_path, LARGE, one, Status(int(arrays.pop("status"))), arrays)
    merge.write_dataset(selection, tmp_path, tmp_path / "warm.nc", "")
    tracemalloc.start()
    merge.write_dataset(selection, tmp_path, tmp_path / "large.nc", "")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1_000_000  # the data have 3.2 million bytes
    with xr.open_dataset(tmp_path / "large.nc") as ds:
        np.testing.assert_array_equal(ds.field.values, np.repeat(np.arange(400.0), 1000).reshape(400, 1000))


def test_verify_holds_a_slab_and_not_the_dataset(tmp_path, monkeypatch):
    monkeypatch.setattr(merge, "SLAB_BYTES", 80_000)
    monkeypatch.setattr(verify, "_IN_MEMORY", 0)
    selection, folder = select(LARGE), Folder(tmp_path)
    folder.shards.mkdir()
    for one in selection.cases():
        arrays = LARGE.computed(one.parameters, one.values)
        write_shard(folder.shards, LARGE, one, Status(int(arrays.pop("status"))), arrays)
    merge.write_dataset(selection, folder.shards, folder.dataset("large"), "")
    write_manifest(tmp_path, {}, [])
    monkeypatch.setattr(Folder, "selection", lambda folder: (None, selection))
    assert verify.verify_folder(folder) == (400, [], False)
    tracemalloc.start()
    verify.verify_folder(folder)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2_500_000  # the data have 3.2 million bytes, and two million are read at a time for the seal
    with netCDF4.Dataset(folder.dataset("large"), "a") as file:
        file["field"][399, 999] = 0.0  # the last slab
    assert verify.verify_folder(folder)[1][0].startswith(f"{folder.dataset('large')}: field is not what the shards")


def test_a_size_that_differs_from_slab_to_slab_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(merge, "SLAB_BYTES", 1)
    study = replace(LARGE, case=lambda parameters, number: {"status": Status.ok, "field": np.ones(3 + number // 7)})
    selection = select(study, ["numbers=5:9"])
    for one in selection.cases():
        arrays = study.computed(one.parameters, one.values)
        write_shard(tmp_path, study, one, Status(int(arrays.pop("status"))), arrays)
    with pytest.raises(IntegrityError, match="'point'"):
        merge.write_dataset(selection, tmp_path, tmp_path / "large.nc", "")


def test_a_dataset_that_does_not_read_back_takes_no_place(tmp_path, monkeypatch):
    selection = select(LARGE, ["numbers=0"])
    monkeypatch.setattr(merge.xr, "open_dataset", lambda *_, **__: xr.Dataset())
    with pytest.raises(EnvironmentFailure, match="read back"):
        merge.write_dataset(selection, tmp_path, tmp_path / "large.nc", "")
    assert list(tmp_path.iterdir()) == []
