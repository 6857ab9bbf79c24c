"""The onset of shear rigidity by `critical_strain` and by a quasi-static scan with LAMMPS.

`python -m workflows.benchmarks.onset_scan N_V SEED` prints both answers and the ratio of their processor times.  The
scan halves the interval [0, 1] of the strain to 1e-6.  At each strain FIRE relaxes springs from the last floppy state;
the network counts as rigid where energy remains.

Rest lengths are 1.05 times those of the largest bulk modulus.  All edges are then taut at the onset, which is that of
springs as well as of cables.
"""

import sys
import time
from contextlib import closing

import numpy as np

from critflow import critical_strain, optimize, spring_state, voronoi_network
from critflow.networks.deformation import deformation_of

from .lammps import Lammps

WIDTH, EXCESS, FORCE, MOST_STEPS = 1e-6, 1.05, 1e-12, 400_000


def relaxed(state):
    """Energy, coordinates and steps of the FIRE of LAMMPS."""
    with closing(Lammps(state)) as engine:
        x, steps, _ = engine.relax("fire", "line quadratic", FORCE, MOST_STEPS)
        # LAMMPS wraps coordinates into the cell.
        moved, cell = x - state.coordinates, state.network.cell
        return engine.energy, state.coordinates + moved - np.round(moved @ np.linalg.inv(cell)) @ cell, steps


def scan(network, lengths, coordinates):
    """Interval of the onset, the number of relaxations and of steps of FIRE."""
    shear, low, high, relaxations, steps = deformation_of("simple_shear", 2), 0.0, 1.0, 0, 0
    while high - low > WIDTH:
        strain = 0.5 * (low + high)
        start = coordinates @ np.linalg.inv(shear.gradient(low)).T @ shear.gradient(strain).T
        state = spring_state(network.deformed(shear.gradient(strain)), lengths, start)
        energy, x, taken = relaxed(state)
        relaxations, steps = relaxations + 1, steps + taken
        # At a distance WIDTH past the onset extensions are of its order.
        if energy > 1e-3 * WIDTH**2 * network.n_edges:
            high = strain
        else:
            low, coordinates = strain, x
        print(f"  [{low:.7f}, {high:.7f}] after {steps} steps", file=sys.stderr, flush=True)
    return low, high, relaxations, steps


def main(n_vertices="64", seed="1"):
    """Print both answers and the ratio of their times."""
    network = voronoi_network(int(n_vertices), int(seed))
    critical = optimize(network, "bulk_modulus").value
    lengths = EXCESS * critical.lengths
    begin = time.process_time()
    onset = critical_strain(network, lengths, "simple_shear")
    direct = time.process_time() - begin
    begin = time.process_time()
    low, high, relaxations, steps = scan(network, lengths, critical.coordinates)
    scanned = time.process_time() - begin
    found = onset.value
    print(
        f"N_v = {n_vertices}: γ_c = {found.strain:.12f}, valid for springs: {found.valid_for_springs}, {direct:.3f} s"
    )
    print(f"scan: [{low:.7f}, {high:.7f}], {relaxations} relaxations, {steps} steps of FIRE, {scanned:.1f} s")
    print(f"ratio of the times {scanned / direct:.0f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
