"""Kill runs at random moments for long, and compare what they leave with an undisturbed run.

    python tests/soak.py --kills 200

Every round runs a small study in a new folder, in one process or with two workers, kills the run or one of its workers
with SIGKILL, SIGTERM or SIGINT at a random time, kills the resumed run too in one round of four, and runs it to its
end. The dataset must equal that of an undisturbed run in everything but its `history`, no complete stored case may be
computed again, and no temporary file may remain. A line reports each round; the exit code is 1 if one went wrong, and
its folder is kept. Not part of the test suite: a round with workers takes some seconds.
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

from disturbed import begun, contents_of, ended, messages, stamps_of, stored_whole

from critflow.result import IntegrityError

SLOW = {"CRITFLOW_TEST_PAUSE": "0.2"}  # so that most of a run is spent in its cases
CASES = ("seeds=0:8",)
LIMIT = 120.0  # seconds: a run that takes longer hangs


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    dice, base, seconds = random.Random(arguments.seed), Path(tempfile.mkdtemp(prefix="soak-")), {}
    for workers in (0, 2):
        for _ in range(2):  # the first loads libraries
            start, folder = time.monotonic(), base / f"golden-{workers}"
            shutil.rmtree(folder, ignore_errors=True)
            assert ended(begun(folder, CASES, workers=workers, environment=SLOW), LIMIT) == 0, messages(folder)
            seconds[workers] = time.monotonic() - start
    golden, kills, wrong = contents_of(base / "golden-0" / "plain.nc"), 0, 0
    while kills < arguments.kills:
        workers, folder = dice.choice([0, 0, 0, 2]), base / f"round-{kills}"
        rounds = [killed_once(folder, workers, dice, seconds[workers]) for _ in range(dice.choice([1, 1, 1, 2]))]
        kills += len(rounds)
        errors = resumed(folder, workers, golden)
        wrong += bool(errors)
        line = f"{kills:4} kills, {workers} workers: {', '.join(rounds)}: {'; '.join(errors) or 'same data'}"
        print(line, flush=True)
        if not errors:
            shutil.rmtree(folder)
    print(f"{kills} kills, {wrong} rounds went wrong" + (f": see {base}" if wrong else ""))
    if not wrong:
        shutil.rmtree(base)
    return 1 if wrong else 0


def killed_once(folder, workers, dice, seconds):
    """Kill the run or one of its workers at a random time; a description."""
    process = begun(folder, CASES, workers=workers, environment=SLOW)
    number = dice.choice([signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
    victim, worker = process.pid, workers and number != signal.SIGINT and dice.random() < 0.5
    if dice.random() < 0.9:  # most kills are meant for runs that compute
        while not (folder / "study.json").exists() and process.is_alive():
            time.sleep(0.01)
    time.sleep(dice.uniform(0.0, seconds))
    try:
        if worker:
            spawned = [p for p in psutil.Process(process.pid).children() if "spawn_main" in " ".join(p.cmdline())]
            victim = dice.choice(spawned).pid if spawned else victim
        psutil.Process(victim).send_signal(number)
    except psutil.NoSuchProcess:
        pass  # it had ended
    code = ended(process, LIMIT)
    # 1: before it could answer an interrupt; 6: a worker did not start.
    assert code in (0, 6, 130, -number) or (code == 1 and "unexpected" not in messages(folder)), messages(folder)
    who = "a worker" if victim != process.pid else "the run"
    return f"{number.name} to {who}, which ended with {code} and {len(stamps_of(folder))} shards"


def resumed(folder, workers, golden):
    """Run to the end, and list what is not as it should be."""
    try:
        whole = stored_whole(folder, CASES)
    except IntegrityError as error:
        return [str(error)]
    before = {name: stamp for name, stamp in stamps_of(folder).items() if name in whole}
    if (code := ended(begun(folder, CASES, workers=workers, environment=SLOW), LIMIT)) != 0:
        return [f"the resumed run ended with {code}: {messages(folder)}"]
    errors = [] if contents_of(folder / "plain.nc") == golden else ["the dataset differs"]
    after = stamps_of(folder)
    if again := [name for name, stamp in before.items() if after[name] != stamp]:
        errors.append(f"computed again: {', '.join(again)}")
    if left := [path.name for path in folder.rglob(".*") if path.name != ".lock"]:
        errors.append(f"left behind: {', '.join(left)}")
    return errors


if __name__ == "__main__":
    sys.exit(main())
