"""Whole runs: the dataset is a function of the selection alone, whatever happens on the way."""

import fcntl
import json
import os
import random
import re
import resource
import shutil
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
import xarray as xr
from distributed import LocalCluster
from in_memory import merge

from critflow.result import IntegrityError, Status
from critflow.workflow.clusters import NO_DASHBOARD, _local_client
from critflow.workflow.folder import Folder
from critflow.workflow.limits import Limits
from critflow.workflow.plan import select
from critflow.workflow.store import read_shard, shard_path

SLOW = ("seeds=0:10", "pause=0.5")  # seconds long, to be stopped in the middle on the busiest machine


@pytest.fixture(scope="session")
def golden(tmp_path_factory):
    """Folders of undisturbed runs in one process, by their settings."""
    return {"base": tmp_path_factory.mktemp("golden")}


@pytest.fixture
def undisturbed(run, golden):
    """`undisturbed(*settings)` is the dataset of an undisturbed run in one process."""

    def dataset(*settings):
        folder = golden["base"] / "_".join(settings or ("default",)).replace(":", "-")
        if not (folder / "tiny.nc").exists():
            assert run(folder, *settings) == 0
        return folder / "tiny.nc"

    return dataset


@pytest.mark.parametrize("workers", [1, 2, 4])
def test_any_number_of_workers_gives_the_same_dataset(tmp_path, run, undisturbed, contents, workers):
    assert run(tmp_path / "out", workers=workers) == 0
    assert contents(tmp_path / "out" / "tiny.nc") == contents(undisturbed())


def test_any_order_of_the_cases_gives_the_same_dataset(tmp_path, run, undisturbed, contents, stamps):
    assert run(tmp_path, "seeds=3,0,2,1", "populations=floppy,random") == 0
    before = stamps(tmp_path)
    assert run(tmp_path) == 0
    assert stamps(tmp_path) == before
    assert contents(tmp_path / "tiny.nc") == contents(undisturbed())


def test_a_scheduler_elsewhere_gives_the_same_dataset(tmp_path, run, undisturbed, contents):
    """Its workers have several threads, which must take turns with the netCDF library."""
    with LocalCluster(n_workers=1, threads_per_worker=3, scheduler_kwargs=NO_DASHBOARD) as cluster:
        assert run(tmp_path / "out", workers=None, more=("--scheduler", cluster.scheduler_address, "--insecure")) == 0
    assert contents(tmp_path / "out" / "tiny.nc") == contents(undisturbed())


def test_local_workers_are_single_threaded_private_and_deaf_to_interrupts(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)

    def look():
        return dict(os.environ), Path("/proc/self/status").read_text()

    with _local_client(1, Limits()) as client:
        (environment, process), *others = client.run(look).values()
        family = [psutil.Process(), *psutil.Process().children(recursive=True)]
        listening = [c.laddr.ip for p in family for c in p.net_connections() if c.status == psutil.CONN_LISTEN]
    assert not others
    libraries = ("OMP", "OPENBLAS", "MKL", "NUMEXPR")
    assert {environment[f"{name}_NUM_THREADS"] for name in libraries} == {"1"}
    assert environment["VECLIB_MAXIMUM_THREADS"] == "1"
    blocked = int(re.search(r"SigBlk:\s*(\w+)", process)[1], 16)
    assert blocked >> (signal.SIGINT - 1) & 1
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    assert set(listening) == {"127.0.0.1"}
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "OPENBLAS_NUM_THREADS" not in os.environ


def wait_for_shards(process, folder, count):
    """Block until some shards are stored, so that a signal hits the middle of the run."""
    while len(list((folder / "shards").glob("*.nc"))) < count:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)


@pytest.mark.parametrize("workers", [0, 2])
def test_a_killed_run_leaves_whole_shards_and_is_resumed(
    tmp_path, tiny, run, start, undisturbed, contents, stamps, workers
):
    process = start(tmp_path, *SLOW, workers=workers)
    wait_for_shards(process, tmp_path, 3)
    process.kill()
    process.wait()
    stored = [read_shard(tmp_path / "shards", tiny.study, case) for case in select(tiny.study, SLOW).cases()]
    assert 3 <= sum(shard is not None for shard in stored) < 20
    assert not (tmp_path / "tiny.nc").exists()
    before = stamps(tmp_path)
    (tmp_path / "shards" / ".left.nc.0.partial").write_text("of a run that was killed while it wrote")
    assert run(tmp_path, *SLOW) == 0
    assert before.items() <= stamps(tmp_path).items()
    assert contents(tmp_path / "tiny.nc") == contents(undisturbed(*SLOW))
    assert not list(tmp_path.rglob(".*.partial"))


@pytest.mark.parametrize(("number", "workers"), [(signal.SIGINT, 0), (signal.SIGINT, 2), (signal.SIGTERM, 0)])
def test_an_interrupted_run_finishes_what_runs_and_is_resumed(
    tmp_path, tiny, run, start, undisturbed, contents, stamps, number, workers
):
    process = start(tmp_path, *SLOW, workers=workers)
    wait_for_shards(process, tmp_path, 3)
    os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)  # as a terminal does
    out, err = process.communicate()
    assert process.returncode == 130
    assert out == ""
    assert "Traceback" not in err
    assert err.count("critflow: interrupted") == 1
    assert "run the same command again" in err
    states = [read_shard(tmp_path / "shards", tiny.study, case) for case in select(tiny.study, SLOW).cases()]
    done = sum(shard is not None for shard in states)
    assert 3 <= done < 20
    assert f"{done} of 20 cases" in err  # what was told is what is there
    before = stamps(tmp_path)
    assert run(tmp_path, *SLOW) == 0
    assert before.items() <= stamps(tmp_path).items()
    assert contents(tmp_path / "tiny.nc") == contents(undisturbed(*SLOW))


@pytest.mark.parametrize("workers", [0, 2])
def test_a_second_interrupt_stops_at_once(tmp_path, start, workers):
    process = start(tmp_path, "pause=200", workers=workers)
    while "cases to compute" not in (line := process.stderr.readline()):
        assert line, "the run ended before it began"
    children = psutil.Process(process.pid).children
    while workers and len(children(recursive=True)) < workers:
        time.sleep(0.05)
    time.sleep(1.0 if workers else 0.2)
    os.killpg(process.pid, signal.SIGINT)
    while "stopping" not in (line := process.stderr.readline()):
        assert line, "the first interrupt was not answered"
    family = children(recursive=True)
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate()
    assert process.returncode == 130
    assert "Traceback" not in err
    assert "critflow: stopped at once" in err
    assert psutil.wait_procs(family, timeout=60)[1] == []  # no worker outlives the command


IMPATIENT = """
import asyncio, os, signal, sys
from distributed import Client
from critflow.cli import main
from critflow.workflow import clusters

made, started = clusters._local_cluster, Client._start

def first(*asked):
    cluster = made(*asked)
    signal.raise_signal(signal.SIGINT)
    return cluster

async def second(client, **options):
    client.status = "connecting"
    os.kill(os.getpid(), signal.SIGINT)
    await asyncio.sleep(0.5)
    return await started(client, **options)

clusters._local_cluster, Client._start = first, second
sys.exit(main())
"""


@pytest.mark.timeout(300)
def test_a_second_interrupt_while_the_workers_are_joined_stops_at_once(tmp_path, start):
    """A client left open holds up the end of the interpreter for a minute, and then there is a traceback."""
    process = start(tmp_path, "pause=200", workers=1, code=IMPATIENT)
    _, err = process.communicate()
    assert process.returncode == 130
    assert "Traceback" not in err
    assert err.count("critflow: stopped at once") == 1


def test_more_seeds_and_populations_leave_the_old_ones_alone(tmp_path, run, stamps, capsys):
    assert run(tmp_path, "seeds=1:3", "populations=random") == 0
    old, before = xr.load_dataset(tmp_path / "tiny.nc"), stamps(tmp_path)
    capsys.readouterr()
    assert run(tmp_path, "seeds=0:4", "populations=wide,random,floppy") == 0
    assert "2 of 12 cases were there before" in capsys.readouterr().out
    after = stamps(tmp_path)
    assert len(after) == 12
    assert before.items() <= after.items()
    new = xr.load_dataset(tmp_path / "tiny.nc")
    xr.testing.assert_identical(new.sel(seed=[1, 2], population=["random"]).drop_attrs(), old.drop_attrs())


def test_when_all_is_done_a_run_only_writes_the_dataset_anew(tmp_path, run, stamps, contents, capsys):
    assert run(tmp_path) == 0
    before, data = stamps(tmp_path), contents(tmp_path / "tiny.nc")
    shutil.rmtree(tmp_path / "figures")
    for name in ("tiny.nc", "claims.md", "claims.json", "summary.json"):
        (tmp_path / name).unlink()
    assert run(tmp_path, workers=2) == 0
    assert "cases to compute" not in capsys.readouterr().err.split("4/4")[-1]
    assert stamps(tmp_path) == before
    assert contents(tmp_path / "tiny.nc") == data
    assert (tmp_path / "figures" / "modulus.png").exists()


def cut(path):
    path.write_bytes(path.read_bytes()[:-100])


def flip(path):
    whole = bytearray(path.read_bytes())
    whole[len(whole) // 2] ^= 4
    path.write_bytes(whole)


def replace_by_folder(path):
    path.unlink()
    path.mkdir()
    (path / "precious").write_text("not ours to delete")


def replace_by_neighbour(path):
    neighbour = next(other for other in sorted(path.parent.glob("*.nc")) if other != path)
    shutil.copy(neighbour, path)


DAMAGES = {
    "empty": lambda path: path.write_bytes(b""),
    "cut": cut,
    "flipped": flip,
    "text": lambda path: path.write_text("not a shard " * 100),
    "folder": replace_by_folder,
    "neighbour": replace_by_neighbour,
    "deleted": lambda path: path.unlink(),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_exactly_the_damaged_shard_is_computed_again(
    tmp_path, tiny, run, undisturbed, contents, stamps, capsys, damage
):
    assert run(tmp_path) == 0
    path = shard_path(tmp_path / "shards", select(tiny.study).cases()[2])
    before = stamps(tmp_path)
    DAMAGES[damage](path)
    capsys.readouterr()
    assert run(tmp_path) == 0
    err = capsys.readouterr().err
    named = [line for line in err.splitlines() if path.name in line]
    assert len(named) == (damage != "deleted")
    assert "Traceback" not in err
    after = stamps(tmp_path)
    assert after.pop(path.name) != before.pop(path.name)
    assert {name: stamp for name, stamp in after.items() if name in before} == before
    assert contents(tmp_path / "tiny.nc") == contents(undisturbed())
    assert damage != "folder" or list(tmp_path.rglob("precious"))


@pytest.mark.parametrize(("how", "reason"), [("raise", "the trouble asked for"), ("exit", "SystemExit")])
def test_a_failed_case_is_named_and_keeps_no_other_back(tmp_path, tiny, run, capsys, how, reason):
    assert run(tmp_path, "trouble=1-random", f"how={how}") == 3
    err = capsys.readouterr().err
    assert "seed1-random" in err
    assert "critflow: 1 case failed" in err
    assert "Traceback" not in err
    ds = xr.load_dataset(tmp_path / "tiny.nc")
    assert ds.status.sel(seed=1, population="random") == Status.failed
    assert ds.residual.sel(seed=1, population="random").isnull()
    assert (ds.steps.sel(seed=1, population="random") == -1).all()
    assert (ds.status.sel(population="random") == Status.ok).sum() == 3
    case = select(tiny.study, ["trouble=1-random", f"how={how}"]).case(seed=1, population="random")
    assert reason in read_shard(tmp_path / "shards", tiny.study, case).error.replace("\n", " ")


def test_a_failed_case_is_tried_again_when_that_is_asked_for(tmp_path, run, stamps):
    settings = ("trouble=1-random", f"how=until {tmp_path / 'mended'}")
    assert run(tmp_path / "out", *settings) == 3
    before = stamps(tmp_path / "out")
    (tmp_path / "mended").touch()
    assert run(tmp_path / "out", *settings) == 3
    assert stamps(tmp_path / "out") == before
    assert run(tmp_path / "out", *settings, more=("--retry-failed",)) == 0
    after = stamps(tmp_path / "out")
    assert [name for name in after if after[name] != before[name]] == [n for n in after if n.startswith("seed1-random")]
    assert (xr.load_dataset(tmp_path / "out" / "tiny.nc").status != Status.failed).all()


def test_a_case_that_kills_its_worker_is_found_and_the_others_are_computed(tmp_path, run, capsys):
    assert run(tmp_path, "trouble=1-random", "how=die", workers=2) == 3
    assert "ended its worker process" in capsys.readouterr().err
    status = xr.load_dataset(tmp_path / "tiny.nc").status
    assert status.sel(seed=1, population="random") == Status.failed
    assert (status == Status.failed).sum() == 1
    assert (status != Status.missing).all()


def test_cases_that_disagree_about_what_they_share_are_an_error(tmp_path, run, capsys):
    assert run(tmp_path, "trouble=2-floppy", "how=other edges") == 4
    err = capsys.readouterr().err
    assert "seed2-floppy" in err
    assert "'edges'" in err


def test_inner_sizes_that_differ_are_an_error(tmp_path, run, capsys):
    assert run(tmp_path, "trouble=0-random", "how=longer", "populations=random") == 4
    err = capsys.readouterr().err
    assert "seed1-random" in err  # the first one that does not fit those before
    assert "'edge'" in err


def test_missing_cases_are_filled(tmp_path, tiny, run):
    assert run(tmp_path, "seeds=0:2") == 0
    ds = merge(select(tiny.study, ["seeds=0:3"]), tmp_path / "shards")
    assert (ds.status.sel(seed=2) == Status.missing).all()
    assert ds.sigma.sel(seed=2).isnull().all()
    assert (ds.edges.sel(seed=2) == np.iinfo("i4").min).all()


def test_a_damaged_shard_is_not_merged(tmp_path, tiny, run):
    assert run(tmp_path) == 0
    selection = select(tiny.study)
    flip(shard_path(tmp_path / "shards", selection.cases()[0]))
    with pytest.raises(IntegrityError, match="checksum"):
        merge(selection, tmp_path / "shards")


def test_when_every_case_fails_there_is_still_a_dataset(tmp_path, run, capsys):
    assert run(tmp_path, "seeds=1", "populations=random", "trouble=1-random") == 3
    assert "Traceback" not in capsys.readouterr().err
    assert xr.load_dataset(tmp_path / "tiny.nc").status.item() == Status.failed


def test_the_dataset_opens_plainly_with_types_units_and_meanings(tmp_path, run, tiny):
    """Failed cases included: a fill must not turn integers into floats."""
    assert run(tmp_path, "trouble=1-random", "how=raise") == 3
    with xr.open_dataset(tmp_path / "tiny.nc") as ds:
        assert {name: ds[name].dtype.str[1:] for name in ds.data_vars} == {
            v.name: v.dtype for v in tiny.study.variables
        }
        assert {name: ds[name].dims for name in ds.data_vars} == {v.name: v.dims for v in tiny.study.variables}
        for name, variable in ds.variables.items():
            assert variable.attrs["units"], name
            assert variable.attrs["long_name"], name
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
        assert ds.steps.attrs["value_if_missing"] == -1


def test_what_differs_from_run_to_run_says_so(tmp_path, tiny, run):
    assert run(tmp_path, "seeds=0") == 0
    timed = [replace(v, volatile=v.name == "residual") for v in tiny.study.variables]
    ds = merge(select(replace(tiny.study, variables=timed), ["seeds=0"]), tmp_path / "shards")
    assert [name for name in ds if "comment" in ds[name].attrs] == ["residual"]
    assert ds.residual.attrs["comment"] == "differs from run to run"


def test_history_honours_the_source_date(tmp_path, run, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    assert run(tmp_path, "seeds=0") == 0
    assert xr.load_dataset(tmp_path / "tiny.nc").attrs["history"].startswith("1970-01-01T00:00:00Z critflow run")


def test_one_folder_has_one_run_at_a_time(tmp_path, run, capsys):
    assert run(tmp_path, "seeds=0") == 0
    with open(tmp_path / ".lock", "a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert run(tmp_path) == 5
    assert "another run" in capsys.readouterr().err
    assert run(tmp_path) == 0


def test_a_full_disk_is_told_and_what_was_stored_stays(tmp_path, run, start, undisturbed, contents):
    """A limit on the size of files is refused like a full disk, and works for every user."""
    tight = {"preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1400, 1400))}
    process = start(tmp_path, **tight)
    _, err = process.communicate()
    assert process.returncode == 6, err
    assert "Traceback" not in err
    assert "critflow: cannot write" in err
    assert not (tmp_path / "tiny.nc").exists()
    assert not list(tmp_path.rglob(".*.partial"))
    assert run(tmp_path) == 0
    assert contents(tmp_path / "tiny.nc") == contents(undisturbed())


def test_the_note_of_a_folder_gives_its_selection_back(tmp_path, run, tiny):
    settings = ["seeds=5,2", "populations=wide", "strains=0.5", "spread=3"]
    assert run(tmp_path, *settings) == 0
    loaded, selection = Folder(tmp_path).selection()
    assert loaded.path.samefile(tiny.path)
    assert [case.id for case in selection.cases()] == [case.id for case in select(tiny.study, settings).cases()]


def test_two_runs_in_random_order_of_events_agree(tmp_path, run, undisturbed, contents):
    """Extend, damage, delete, run in any order: the dataset of a selection is always the same."""
    dice = random.Random(20250101)
    for _ in range(12):
        seeds = sorted(dice.sample(range(4), dice.randint(1, 4)))
        event = dice.choice([cut, flip, os.unlink, str])
        for path in dice.sample(sorted((tmp_path / "shards").glob("*.nc")), 1 if (tmp_path / "shards").exists() else 0):
            event(path)
        assert run(tmp_path, f"seeds={','.join(map(str, seeds))}") == 0
    assert run(tmp_path) == 0
    assert contents(tmp_path / "tiny.nc") == contents(undisturbed())
