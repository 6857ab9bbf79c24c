"""Resident memory of this process, per stage where the system can restart its peak, as Linux can."""

from __future__ import annotations

import contextlib
import resource
import sys
from pathlib import Path

_STATUS, _RESTART = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def restart_peak():
    """Reset the peak; where that is not possible it is that of the process so far."""
    with contextlib.suppress(OSError):
        _RESTART.write_text("5", encoding="ascii")


def peak_memory():
    """Peak resident memory in MB."""
    with contextlib.suppress(OSError):
        for line in _STATUS.read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM"):
                return int(line.split()[1]) / 1e3 * 1.024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1.024 / 1e3
