"""Processor time to write and read a network of 100,000 edges: `python tests/benchmark_formats.py [ENDING ...]`.

All formats by default; those whose packages are missing are left out.  One process and one thread of numerics.
"""

from __future__ import annotations

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")  # before NumPy is loaded

import sys
import tempfile
import time
from pathlib import Path

from critflow import network_from, voronoi_network, write_network
from critflow.exchange.formats import FORMATS
from critflow.result import EnvironmentFailure

N_VERTICES = 66_668
ENDINGS = [ending for known in FORMATS if known.write for ending in known.endings]


def seconds(function, *arguments, **named):
    start = time.process_time()
    result = function(*arguments, **named)
    return time.process_time() - start, result


def main():
    network = voronoi_network(N_VERTICES, seed=1)
    arrays = {"edges": network.edges, "positions": network.positions, "cell": network.cell}
    print(f"{network.n_edges:,} edges")
    print(f"{'arrays':<10}{'':>20}read {seconds(network_from, **arrays, offsets=network.offsets)[0]:6.1f} s")
    with tempfile.TemporaryDirectory() as folder:
        for ending in sys.argv[1:] or ENDINGS:
            path = Path(folder, f"network{ending}")
            try:
                written, _ = seconds(write_network, network, path)
            except EnvironmentFailure as missing:
                print(f"{ending:<10}{missing}")
                continue
            line = f"{ending:<10}write {written:6.1f} s"
            if next(known for known in FORMATS if ending in known.endings).read is not None:
                read, found = seconds(network_from, path)
                assert found.network.n_edges == network.n_edges
                line += f"     read {read:6.1f} s"
            print(line, flush=True)


if __name__ == "__main__":
    main()
