"""The onset of shear rigidity by `critical_strain` and by a quasi-static scan.

`python -m workflows.benchmarks.onset_scan N_V SEED` prints both answers and the ratio of their times.  The scan halves
the interval [0, 1] of the strain to 1e-6.  At each strain FIRE relaxes springs from the last floppy state; the network
counts as rigid where energy remains.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from critflow import (
    critical_from_lengths,
    critical_strain,
    deformation_of,
    equilibrium,
    spring_state,
    voronoi_network,
)

WIDTH, EXCESS, FORCE = 1e-6, 1.05, 1e-12


def scan(network, lengths, coordinates):
    """Interval of the onset, the number of relaxations and of steps of FIRE."""
    shear, low, high, relaxations, steps = deformation_of("simple_shear", 2), 0.0, 1.0, 0, 0
    while high - low > WIDTH:
        strain = 0.5 * (low + high)
        start = coordinates @ np.linalg.inv(shear.gradient(low)).T @ shear.gradient(strain).T
        state = spring_state(network.deformed(shear.gradient(strain)), lengths, start)
        found = equilibrium(state, "fire", tolerance=FORCE, max_steps=400_000, throw=False)
        relaxations, steps = relaxations + 1, steps + found.stats.steps
        # At a distance WIDTH past the onset extensions are of its order.
        if found.value.energy > 1e-3 * WIDTH**2 * network.n_edges:
            high = strain
        else:
            low, coordinates = strain, found.value.coordinates
    return low, high, relaxations, steps


def main(n_vertices=64, seed=1):
    """Print both answers and the ratio of their times."""
    network = voronoi_network(n_vertices, seed)
    isotropic = critical_from_lengths(network, np.ones(network.n_edges), throw=False)
    lengths = np.full(network.n_edges, EXCESS * isotropic.ratio)
    begin = time.perf_counter()
    onset = critical_strain(network, lengths, "simple_shear")
    direct = time.perf_counter() - begin
    begin = time.perf_counter()
    low, high, relaxations, steps = scan(network, lengths, isotropic.value.coordinates)
    scanned = time.perf_counter() - begin
    print(f"N_v = {n_vertices}: γ_c = {onset.strain:.12f}, exact for {onset.exact_for}, {direct:.3f} s")
    print(f"scan: [{low:.7f}, {high:.7f}], {relaxations} relaxations, {steps} steps, {scanned:.1f} s")
    print(f"ratio of the times {scanned / direct:.0f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
