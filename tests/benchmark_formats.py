"""Processor time to write and read a network of 100,000 edges in every format: `python tests/benchmark_formats.py`.

One process and one thread of numerics.
"""

from __future__ import annotations

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")  # before NumPy is loaded

import tempfile
import time
from pathlib import Path

from critflow import network_from, voronoi_network, write_network
from critflow.exchange.formats import FORMATS

N_VERTICES = 66_668


def main():
    network = voronoi_network(N_VERTICES, seed=1)
    print(f"{network.n_edges:,} edges")
    with tempfile.TemporaryDirectory() as folder:
        for known in FORMATS:
            for path in [Path(folder, f"network{ending}") for ending in known.endings if known.write is not None]:
                begin = time.process_time()
                write_network(network, path)
                written = time.process_time()
                if known.read is not None:
                    assert network_from(path).network.n_edges == network.n_edges
                line = f"{path.suffix:<10}write {written - begin:6.1f} s"
                print(line + f"     read {time.process_time() - written:6.1f} s" * (known.read is not None), flush=True)


if __name__ == "__main__":
    main()
