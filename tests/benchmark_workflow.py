"""What the engine costs: `python tests/benchmark_workflow.py [overhead] [efficiency] [scale]`, all by default.

overhead     10,000 cases of some milliseconds: the time of a whole `critflow run` with one worker beside that of a
             plain loop which computes and stores the same cases (`run_batch` in one process).  The loop is the base:
             what it leaves out is planning, the worker's start, scheduling, transport, the log, the index, the merge.
efficiency   two workers beside two independent serial runs (`--workers 0`) of one half of the cases each, started
             together, each on a core of its own: for those 10,000 cases, and for the ensemble.  Needs two quiet cores.
scale        planning, dry run, status, merge and verify at 1,000, 10,000 and 100,000 shards, and the dry run at
             1,000,000 cases: seconds, seconds for each thousand cases, which stay level where all is linear, and peak
             memory; then the whole command `critflow status`.

Not a part of the tests: times belong to a quiet machine.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

STUDY = """
import time
import numpy as np
from critflow.result import Status
from critflow.workflow import Axis, Study, Variable

def case(parameters, *, seed, part):
    end = time.perf_counter() + parameters["seconds"]
    while time.perf_counter() < end:  # at work, as waiting would hide what the engine takes
        pass
    return {"status": Status.ok, "field": np.arange(8.0) + seed}

study = Study(
    name="timed", title="Cases of a known length", parameters={"seconds": 0.002}, case=case,
    axes=(Axis("seed", range(5000), "seed"), Axis("part", ("left", "right"), "part")),
    variables=(
        Variable("field", ("seed", "part", "point"), "f8", long_name="field"),
        Variable("status", ("seed", "part"), "i1", long_name="outcome", flags=Status),
    ),
)
"""
LOOP = """
import sys, time
from pathlib import Path
from critflow.workflow.batch import Job, run_batch
from critflow.workflow.load import load_file
from critflow.workflow.plan import select
loaded = load_file(Path(sys.argv[1]))
selection = select(loaded.study, sys.argv[3:])
Path(sys.argv[2]).mkdir(parents=True)
start = time.perf_counter()
job = Job("loop", sys.argv[1], loaded.digest, sys.argv[2], dict(selection.parameters))
run_batch(job, [case.values for case in selection.cases()])
print(time.perf_counter() - start)
"""
CASES = 10_000
COMMAND = "import sys; from critflow.cli import main; sys.exit(main())"


def python(code: str, *words: str, core: int | None = None) -> subprocess.Popen:
    bind = None if core is None else (lambda: os.sched_setaffinity(0, {core}))
    return subprocess.Popen([sys.executable, "-c", code, *words], stdout=subprocess.PIPE, text=True, preexec_fn=bind)


def seconds_of_loop(study: Path, folder: Path, *words: str) -> float:
    out, _ = python(LOOP, str(study), str(folder), *words).communicate()
    return float(out)


def seconds_of_run(study: Path, folder: Path, workers: int, *words: str) -> float:
    start = time.perf_counter()
    sets = [f"--set={word}" for word in words]
    process = python(COMMAND, "run", str(study), "--out", str(folder), "--workers", str(workers), *sets)
    process.communicate()
    assert process.returncode == 0
    return time.perf_counter() - start


def overhead(study: Path, scratch: Path) -> None:
    """The loop before and after the run, so that a drift of the machine shows."""
    before = seconds_of_loop(study, scratch / "loop1")
    fixed = seconds_of_run(study, scratch / "fixed", 1, "seeds=0:1")
    whole = seconds_of_run(study, scratch / "run", 1)
    after = seconds_of_loop(study, scratch / "loop2")
    base = (before + after) / 2
    each = (whole - fixed - base) / CASES
    print(f"overhead: {CASES:,} cases, computed and stored in a plain loop {before:.1f} s and {after:.1f} s")
    print(f"  critflow run --workers 1: {whole:.1f} s, of which a run of two cases takes {fixed:.1f} s")
    print(f"  {1000 * each:.2f} ms a case, {100 * each * CASES / base:.1f} %; 5 % of cases of {20_000 * each:.0f} ms")


def efficiency(study: Path, scratch: Path) -> None:
    """The slower of two independent runs of one half each is what two cores can do at best."""
    for name, seeds in (("timed", 5_000), ("ensemble", 100)):
        what = study if name == "timed" else Path("ensemble")
        start = time.perf_counter()
        halves = []
        for core in range(2):
            chosen = f"--set=seeds={seeds * core // 2}:{seeds * (core + 1) // 2}"
            folder = str(scratch / f"{name}{core}")
            words = ("run", str(what), "--out", folder, "--workers", "0", chosen)
            halves.append(python(COMMAND, *words, core=core))
        for half in halves:
            half.communicate()
            assert half.returncode == 0
        independent = time.perf_counter() - start
        together = seconds_of_run(what, scratch / f"{name}-two", 2)
        print(
            f"efficiency: {name}, two serial runs of a half {independent:.1f} s, two workers {together:.1f} s", end=""
        )
        print(f": {100 * independent / together:.1f} %", flush=True)


SCALE = """
import os, resource, sys, time
from pathlib import Path
from critflow.result import Status
from critflow.workflow import store
from critflow.workflow.folder import Folder
from critflow.workflow.index import Stored, append_to_index
from critflow.workflow.load import load_file
from critflow.workflow.merge import write_dataset
from critflow.workflow.plan import select
from critflow.workflow.provenance import code_version
from critflow.workflow.run import missing_cases
from critflow.workflow.status import folder_status
from critflow.workflow.verify import verify_folder

def timed(what, count, call):
    start = time.perf_counter()
    call()
    taken = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"  {count:>9,} {what:<8} {taken:8.2f} s {1000 * taken / (count / 1000):8.2f} ms a thousand {peak:7.0f} MB")

study, folder, seeds = Path(sys.argv[1]), Folder(Path(sys.argv[2])), int(sys.argv[3])
loaded = load_file(study)
selection = select(loaded.study, [f"seeds=0:{seeds}", "seconds=0"])
count = 2 * seeds
timed("plan", count, lambda: sum(1 for _ in selection.ids()))
if len(sys.argv) > 4:
    timed("dry run", count, lambda: missing_cases(selection, folder))
    sys.exit()
os.fsync = lambda descriptor: None  # what is timed comes later
with folder.held(loaded, selection):
    for case in selection.cases():
        arrays = loaded.study.computed(case.parameters, case.values)
        store.write_shard(folder.shards, loaded.study, case, Status(int(arrays.pop("status"))), arrays)
stored = (Stored(case_id, 0, code_version(loaded.study)) for case_id in selection.ids())
append_to_index(folder.index, folder.shards, loaded.study.table_digest, stored)
timed("status", count, lambda: folder_status(folder))
timed("dry run", count, lambda: missing_cases(selection, folder))
timed("merge", count, lambda: write_dataset(selection, folder.shards, folder.dataset("timed"), ""))
timed("verify", count, lambda: verify_folder(folder))
"""


def scale(study: Path, scratch: Path) -> None:
    print("scale: cases, what, and the most memory until then")
    for seeds in (500, 5_000, 50_000):
        folder = str(scratch / f"scale{seeds}")
        print(python(SCALE, str(study), folder, str(seeds)).communicate()[0], end="", flush=True)
        start = time.perf_counter()
        python(COMMAND, "status", folder).communicate()
        print(f"  {2 * seeds:>9,} critflow status, the whole command {time.perf_counter() - start:.2f} s", flush=True)
    print(python(SCALE, str(study), str(scratch / "none"), "500000", "dry").communicate()[0], end="")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = {"overhead": overhead, "efficiency": efficiency, "scale": scale}
    parser.add_argument("parts", nargs="*", choices=[*parts, []], help="what to measure")
    chosen = parser.parse_args().parts or list(parts)
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    with tempfile.TemporaryDirectory(prefix="critflow-") as scratch:
        study = Path(scratch) / "timed.py"
        study.write_text(STUDY)
        for part in chosen:
            parts[part](study, Path(scratch))


if __name__ == "__main__":
    main()
