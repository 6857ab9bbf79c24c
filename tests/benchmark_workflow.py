"""What the engine costs: `python tests/benchmark_workflow.py`.

overhead     3,000 cases of 2 ms: the time of a whole `critflow run`, without and with one worker process, less that of
             a run of two cases and that of the cases.
efficiency   two workers compared with two independent serial runs of one half of the cases each, started together,
             each on one core. Needs two quiet cores.

Not part of the tests: times belong to a quiet machine.
"""

from __future__ import annotations

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
    while time.perf_counter() < end:  # computing, as waiting would hide the cost of the engine
        pass
    return {"status": Status.ok, "field": np.arange(8.0) + seed}

study = Study(
    name="timed", title="Cases of a known length", parameters={"seconds": 0.002}, case=case,
    axes=(Axis("seed", range(1500), "seed"), Axis("part", ("left", "right"), "part")),
    variables=(
        Variable("field", ("seed", "part", "point"), "f8", long_name="field"),
        Variable("status", ("seed", "part"), "i1", long_name="outcome", flags=Status),
    ),
)
"""
CASES, SECONDS = 3_000, 0.002


def started(study: Path, folder: Path, workers: int, *settings: str, core: int | None = None) -> subprocess.Popen:
    words = ["-m", "critflow", "run", str(study), "--out", str(folder), f"--workers={workers}"]
    bind = None if core is None else (lambda: os.sched_setaffinity(0, {core}))
    sets = [f"--set={word}" for word in settings]
    return subprocess.Popen([sys.executable, *words, *sets], stdout=subprocess.DEVNULL, stderr=2, preexec_fn=bind)


def seconds_of(*processes: subprocess.Popen) -> float:
    start = time.perf_counter()
    assert [process.wait() for process in processes] == [0] * len(processes)
    return time.perf_counter() - start


def overhead(study: Path, scratch: Path) -> None:
    for workers in (0, 1):
        fixed = seconds_of(started(study, scratch / f"fixed{workers}", workers, "seeds=0"))
        whole = seconds_of(started(study, scratch / f"run{workers}", workers))
        each = (whole - fixed) / CASES - SECONDS
        print(f"overhead, {workers} workers: {whole:.1f} s, {fixed:.1f} s of it for two cases", end="")
        print(f"; {1000 * each:.2f} ms a case")


def efficiency(study: Path, scratch: Path) -> None:
    halves = [f"seeds={750 * core}:{750 * (core + 1)}" for core in range(2)]
    serial = [started(study, scratch / f"half{core}", 0, half, core=core) for core, half in enumerate(halves)]
    independent = seconds_of(*serial)
    together = seconds_of(started(study, scratch / "two", 2))
    print(f"efficiency: two serial halves {independent:.1f} s, two workers {together:.1f} s: ", end="")
    print(f"{100 * independent / together:.0f} %")


if __name__ == "__main__":
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    with tempfile.TemporaryDirectory(prefix="critflow-") as folder:
        study = Path(folder) / "timed.py"
        study.write_text(STUDY)
        overhead(study, Path(folder))
        efficiency(study, Path(folder))
