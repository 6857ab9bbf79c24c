"""Kill runs at random moments for long, and look whether anything is lost.

    python tests/soak.py --kills 200

Every round runs the tiny study in a new folder, in one process or with two workers, and kills the run or one of its
workers with SIGKILL, SIGTERM or SIGINT at a random time, resumes, kills the resumed run too in one round of four, and
runs it to its end.  The dataset must equal that of an undisturbed run in all but its `history`, no shard that was whole
may be computed again, and nothing partial may stay behind.  A line tells of each round; the exit code is 1 when one
went wrong, and its folder is kept.  Not part of the test suite: a round with workers takes some seconds.
"""

import argparse
import random
import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path

import psutil

sys.path.insert(0, str(Path(__file__).parent / "workflow"))

from conftest import contents_of
from killing import BARE, begun, ended

from critflow.cli import INTERRUPTED
from critflow.result import IntegrityError
from critflow.workflow.load import load_file
from critflow.workflow.plan import select
from critflow.workflow.store import read_shard

SLOWER = "pause=0.1"  # so that most of a run is spent on its cases
LIMIT = 120.0  # seconds: a run that takes longer hangs


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    dice = random.Random(asked.seed)
    base = Path(tempfile.mkdtemp(prefix="soak-"))
    seconds = {}
    for workers in (0, 2):
        assert ended(begun(base / f"warm-{workers}", SLOWER, more=(f"--workers={workers}",)), LIMIT) == 0
        start = time.monotonic()
        assert ended(begun(base / f"golden-{workers}", SLOWER, more=(f"--workers={workers}",)), LIMIT) == 0
        seconds[workers] = time.monotonic() - start
    golden = contents_of(base / "golden-0" / "bare.nc")
    kills = wrong = 0
    while kills < asked.kills:
        workers = dice.choice([0, 0, 0, 2])
        folder = base / f"round-{kills}"
        told = []
        for _ in range(dice.choice([1, 1, 1, 2])):
            told.append(killed_once(folder, workers, dice, seconds[workers]))
            kills += 1
        troubles = resumed(folder, workers, golden)
        wrong += bool(troubles)
        print(
            f"{kills:4} kills, {workers} workers: {', '.join(told)}: {'; '.join(troubles) or 'same data'}", flush=True
        )
        if not troubles:
            shutil.rmtree(folder)
            Path(f"{folder}.err").unlink()
    print(f"{kills} kills, {wrong} rounds went wrong" + (f": see {base}" if wrong else ""))
    if not wrong:
        shutil.rmtree(base)
    return 1 if wrong else 0


def killed_once(folder, workers, dice, seconds):
    """Kill the run or one of its workers at some time; what was done, in words."""
    process = begun(folder, SLOWER, more=(f"--workers={workers}",))
    number = dice.choice([signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
    victim, worker = process.pid, workers and number != signal.SIGINT and dice.random() < 0.5
    if dice.random() < 0.9:  # most kills are meant for runs that are at work
        while not (folder / "study.json").exists() and process.is_alive():
            time.sleep(0.01)
    time.sleep(dice.uniform(0.0, seconds))
    try:
        if worker:
            spawned = [p for p in psutil.Process(process.pid).children() if "spawn_main" in " ".join(p.cmdline())]
            victim = dice.choice(spawned).pid if spawned else victim
        psutil.Process(victim).send_signal(number)
    except psutil.NoSuchProcess:
        pass  # it was done before
    code = ended(process, LIMIT)
    who = "a worker" if victim != process.pid else "the run"
    shards = len(list((folder / "shards").glob("*.nc")))
    with open(f"{folder}.err", "a+") as file:  # killed early, it has not even made it
        file.seek(0)
        said = file.read()
    # Ended with 1 before it could answer an interrupt, or with 6 because a worker did not come to life.
    assert code in (0, 6, INTERRUPTED, -number) or (code == 1 and "unexpected" not in said), said
    return f"{number.name} to {who}, which ended with {code} and {shards} shards"


def resumed(folder, workers, golden):
    """Run to the end, and say what is not as it should be."""
    study, troubles = load_file(BARE).study, []
    shards, whole = folder / "shards", {}
    for case in select(study, [SLOWER]).cases():
        try:
            if read_shard(shards, study, case) is not None:
                whole[case.id] = (shards / f"{case.id}.nc").stat().st_mtime_ns
        except IntegrityError as error:
            troubles.append(str(error))
    if (code := ended(begun(folder, SLOWER, more=(f"--workers={workers}",)), LIMIT)) != 0:
        return [*troubles, f"the resumed run ended with {code}"]
    if contents_of(folder / "bare.nc") != golden:
        troubles.append("the dataset differs")
    if again := [name for name, stamp in whole.items() if (shards / f"{name}.nc").stat().st_mtime_ns != stamp]:
        troubles.append(f"computed again: {', '.join(again)}")
    if left := [path.name for path in folder.rglob(".*") if path.name != ".lock"]:
        troubles.append(f"left behind: {', '.join(left)}")
    return troubles


if __name__ == "__main__":
    sys.exit(main())
