"""The same numbers to the last bit, wherever and in whatever order cases are computed."""

import random
from pathlib import Path
from uuid import uuid4

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from threadpoolctl import threadpool_info, threadpool_limits

from critflow.cli import main
from critflow.workflow.batch import Job
from critflow.workflow.clusters import client_of
from critflow.workflow.fanout import Interruption, _through_dask
from critflow.workflow.limits import Limits
from critflow.workflow.load import load_file
from critflow.workflow.merge import write_dataset
from critflow.workflow.plan import select

ALGEBRA = Path(__file__).with_name("algebra_study.py")
NUMBERS = ("product", "solution", "eigenvalues", "status")


def run(folder, *words, workers=0):
    assert main(["run", str(ALGEBRA), "--out", str(folder), "--workers", str(workers), *words]) == 0
    return xr.load_dataset(folder / "algebra.nc")


def bits(dataset):
    return {name: (dataset[name].dims, dataset[name].values.tobytes()) for name in NUMBERS}


@pytest.fixture(scope="module")
def serial(tmp_path_factory):
    """The dataset of one process."""
    return run(tmp_path_factory.mktemp("serial"))


def test_one_process_keeps_its_libraries_to_one_thread(tmp_path):
    """Whatever the environment allows them."""
    with threadpool_limits(limits=2):
        assert {library["num_threads"] for library in threadpool_info()} == {2}
        assert (run(tmp_path, "--set=seeds=0:2").threads == 1).all()


@pytest.mark.timeout(300)
@pytest.mark.parametrize("workers", [1, 2, 4])
def test_any_number_of_processes_gives_the_same_bits(tmp_path, serial, workers, monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    parallel = run(tmp_path, workers=workers)
    assert bits(parallel) == bits(serial)
    assert (parallel.threads == 1).all()


@pytest.mark.timeout(300)
def test_any_order_of_submission_gives_the_same_bits(tmp_path, serial):
    loaded = load_file(ALGEBRA)
    selection = select(loaded.study)
    batches = [[case.values for case in batch] for batch in selection.batches()]
    with Interruption("none") as interruption, client_of(None, 2, Limits(), tmp_path, lambda: False) as (client, _):
        for order in range(3):
            shards = tmp_path / str(order)
            shards.mkdir()
            shuffled = random.Random(order).sample(batches, len(batches))
            parameters = dict(selection.parameters)
            job = Job(uuid4().hex[:12], str(loaded.path), loaded.digest, str(shards), parameters)
            ended = list(_through_dask(client, job, interruption, shuffled))
            assert sum(len(outcomes) for _, outcomes in ended) == 12
            write_dataset(selection, shards, tmp_path / f"{order}.nc", "")
            assert bits(xr.load_dataset(tmp_path / f"{order}.nc")) == bits(serial)


def test_other_values_beside_them_and_another_order_change_no_bit(tmp_path, serial):
    again = run(tmp_path, "--set", "parts=middle,right,left", "--set", "seeds=5,1")
    chosen = serial.sel(seed=[5, 1], part=["right", "left"])
    assert bits(again.sel(part=["right", "left"])) == bits(chosen)


values = st.lists(st.integers(0, 10**6), min_size=1, max_size=8, unique=True)


@given(values, values, st.sets(st.sampled_from(["left", "right", "middle"]), min_size=1))
def test_more_axis_values_change_no_other_case(seeds, more, parts):
    """Neither its id nor, as it is seeded by its own values, its numbers."""
    study = load_file(ALGEBRA).study

    def ids(chosen, words):
        selection = select(study, [f"seeds={','.join(map(str, chosen))}", f"parts={','.join(sorted(words))}"])
        return {tuple(case.values.values()): case.id for case in selection.cases()}

    few, many = ids(seeds, parts), ids([*more, *(s for s in seeds if s not in more)], {"left", "right", "middle"})
    assert few.items() <= many.items()
    assert len(set(many.values())) == len(many)


def test_a_run_leaves_the_global_generator_alone(tmp_path):
    before = np.random.get_state()[1].tobytes()  # noqa: NPY002 (the point of the test)
    run(tmp_path, "--set", "seeds=0")
    assert np.random.get_state()[1].tobytes() == before  # noqa: NPY002


def test_the_linter_refuses_the_global_generator():
    settings = (Path(__file__).parents[2] / "pyproject.toml").read_text()
    assert '"NPY"' in settings.split("select = ")[1].splitlines()[0]
