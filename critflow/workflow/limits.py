"""How much time and memory a case may take before its worker process is ended."""

from __future__ import annotations

import math
from dataclasses import dataclass

from critflow.result import InputError

HOUR = 3600.0
GIGABYTE = 10**9
GRACE = 60.0  # seconds that may pass beyond a limit before anyone else has to notice


@dataclass(frozen=True)
class Limits:
    """What holds in worker processes; in the process of the command itself nothing can be ended."""

    case_seconds: float = HOUR
    worker_gigabytes: float | None = None  # an equal share of the machine's memory when left out

    def __post_init__(self) -> None:
        for option, value in (("--time-limit", self.case_seconds), ("--memory-limit", self.worker_gigabytes)):
            if value is not None and not (0 < value < math.inf):
                raise InputError(f"{option} {value:g} must be a number above zero")

    def dask_config(self) -> dict[str, object]:
        """What the scheduler, nannies and workers that a run starts must know."""
        return {
            # One death is told at once: who is tried again is decided where the guilty case is known.
            "distributed.scheduler.allowed-failures": 0,
            # A worker that does not answer at all, as one that was stopped, is restarted.
            "distributed.scheduler.worker-ttl": f"{self.case_seconds + GRACE:.3f}s",
            # A nanny restarts its worker as often as it dies; this would dismiss one that is not back in time.
            "distributed.deploy.lost-worker-timeout": "365 days",
            # No array waits in a worker, so there is nothing to write to disk, and a paused worker would never go on.
            "distributed.worker.memory.target": False,
            "distributed.worker.memory.spill": False,
            "distributed.worker.memory.pause": False,
        }

    @property
    def memory_limit(self) -> int | str:
        """In dask's words."""
        return "auto" if self.worker_gigabytes is None else int(self.worker_gigabytes * GIGABYTE)

    @property
    def silence(self) -> float:
        """Seconds after which a run in which nothing happens has lost its workers."""
        return 2 * (self.case_seconds + GRACE) + GRACE  # the heartbeat of workers is looked at once in its time
