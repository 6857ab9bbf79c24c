"""Measure the page in a headless Chromium: the first picture, and from a slider event to the painted picture.

    python -m extras.benchmarks.explore.measure [N_VERTICES]

Events come at a steady rate, slower and faster than the page answers; of several that wait the last one is painted,
and its time counts from its own event.  The time ends with the first task of the browser after the frame is painted.
Processor times of the server and of all processes of the browser depend less on other programs than times do.
"""

import asyncio
import os
import sys
import time
from pathlib import Path

import numpy as np

from critflow_extras.explore.server import Explorer, listening
from critflow_extras.explore.source import Random

from .chromium import Chromium, Tab

# Milliseconds between events: a slow drag, a quick one, and every frame of a screen.
_RATES = (200, 80, 16)
_EVENTS = 120
_SCRIPT = """
(async () => {{
  window.latencies = [];
  for (let i = 0; i < {events}; i++) {{
    {event}
    await new Promise(r => setTimeout(r, {pause}));
  }}
  while (waiting || queue.length || window.shown !== sequence) await new Promise(r => setTimeout(r, 10));
  return window.latencies;
}})()
"""
_SLIDER = "const s = get('{name}'); s.value = {value}; s.dispatchEvent(new Event('input'));"
_KINDS = {
    "stress of an edge": _SLIDER.format(name="stress", value="3 * Math.sin(i / 9)"),
    "size of a face": _SLIDER.format(name="size", value="0.8 * Math.sin(i / 9) * s.max"),
    "dilation": _SLIDER.format(name="gamma", value="0.05 * (1.01 + Math.sin(i / 9))"),
}


async def measured(n_vertices: int) -> None:
    """Print the times of one size."""
    explorer = Explorer(Random(n_vertices, 0))
    server, address = listening(explorer)
    async with Chromium() as chromium:
        start = time.perf_counter()
        tab = await chromium.tab(address)
        await tab.until("typeof sequence !== 'undefined' && window.shown === 0", wait=120)
        print(f"{n_vertices:,} vertices: first picture after {time.perf_counter() - start:.2f} s", flush=True)
        for message in ("{do: 'select', edge: 5}", "{do: 'select', face: 5}"):
            await tab.run(f"send({message})")
            await tab.until("window.shown === sequence && !waiting && !queue.length", wait=120)
        for kind, event in _KINDS.items():
            for pause in _RATES:
                await _sweep(tab, chromium.process.pid, kind, event, pause)
    server.stop()
    explorer.close()


async def _sweep(tab: Tab, browser: int, kind: str, event: str, pause: int) -> None:
    """Print the median, the 95th percentile and the processor times of one slider at one rate."""
    server, group = time.process_time(), _processor_time(browser)
    times = await tab.run(_SCRIPT.format(events=_EVENTS, event=event, pause=pause))
    used = (time.process_time() - server, _processor_time(browser) - group)
    median, late = np.quantile(times, (0.5, 0.95))
    each = " + ".join(f"{1000 * seconds / len(times):.0f}" for seconds in used)
    print(
        f"  {kind}, an event every {pause} ms: {len(times)} painted, median {median:.0f} ms, "
        f"95th percentile {late:.0f} ms, server + browser {each} ms of processor time (load {os.getloadavg()[0]:.1f})",
        flush=True,
    )


def _processor_time(group: int) -> float:
    """Seconds of all processes of a group so far."""
    ticks = 0
    for process in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = process.read_text(encoding="utf-8").rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[2]) == group:
            ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    asyncio.run(measured(int(sys.argv[1]) if len(sys.argv) > 1 else 1000))
