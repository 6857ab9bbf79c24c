"""Energies of designed networks by LAMMPS: `python -m workflows.benchmarks.design_energies`, with `lammps` installed.

Ten designs (B_0, C_B, C_G), and the three curves of `design_curves`, are relaxed by LAMMPS at several strains.  The
energies of the designs at small strains give B_0 and C_B by differences, E = V (½ B_0 γ² + (C_B − B_0) γ³/6 + …).
"""

import argparse
from contextlib import closing

import numpy as np

from critflow import CriticalManifold, design, strain_path, voronoi_network

from .. import design_curves, design_stiffening
from ..shared.populations import LABELS
from .lammps import Lammps

# Strains of the designs; a polynomial in γ of E/γ² has its derivative at 0 from these.
STRAINS = np.array([0.001, 0.002, 0.003, 0.004, 0.006, 0.008])


def relaxed_energy(state):
    """Energy of a periodic spring state relaxed by LAMMPS."""
    with closing(Lammps(state)) as program:
        program.relax("cg", "line quadratic dmax 0.05", 1e-12, 20000)
        return program.energy


def check_design(n_vertices, seed, source):
    """One design: its targets, the largest relative difference of energies, and B_0 and C_B by LAMMPS."""
    other = seed + design_stiffening.OTHER
    parameters = dict(design_stiffening.study.parameters) | {"n_vertices": n_vertices}
    manifold = CriticalManifold(voronoi_network(n_vertices, other))
    targets = design_stiffening.attained(manifold, parameters, other, source)
    critical = design(voronoi_network(n_vertices, seed), dict(zip(design_stiffening.NAMES, targets, strict=True))).value
    path = strain_path(critical, STRAINS).value
    energies = np.array([relaxed_energy(state) for state in path.states])
    # 2E/(V γ²) = B_0 + (C_B − B_0) γ/3 + …, at most cubic here.
    scaled = 2 * energies / (critical.network.volume * STRAINS**2)
    first, slope, *_ = np.polynomial.Polynomial.fit(STRAINS, scaled, 4).convert().coef
    return targets, np.abs(energies / path.energy - 1).max(), np.array([first, 3 * slope + first])


def check_curves(n_vertices):
    """Largest relative difference of the energies of the three curves."""
    worst = 0.0
    for made in design_curves.designs(n_vertices, 0):
        path = strain_path(made.value, design_curves.STRAINS).value
        for state, energy in zip(path.states[5::4], path.energy[5::4], strict=True):
            worst = max(worst, abs(relaxed_energy(state) / energy - 1))
    return worst


def main():
    """Print the differences."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--vertices", type=int, default=400)
    options.add_argument("--designs", type=int, default=10)
    chosen = options.parse_args()
    print(f"curves: energies differ by {check_curves(chosen.vertices):.1e}")
    print("| triple of | B_0 | C_B | C_G | energies differ by | B_0 of LAMMPS | C_B of LAMMPS |\n" + "|---" * 7 + "|")
    sources, worst = [source for source in design_stiffening.SOURCES if source != "max_B_0"], np.zeros(2)
    for seed in range(chosen.designs):
        source = sources[seed % len(sources)]
        targets, apart, moduli = check_design(chosen.vertices, seed, source)
        worst = np.maximum(worst, (apart, np.abs(moduli - targets[:2]).max()))
        numbers = [f"{value:.6f}" for value in (*targets, *moduli)]
        cells = (LABELS.get(source, source), *numbers[:3], f"{apart:.0e}", *numbers[3:])
        print("| " + " | ".join(cells) + " |", flush=True)
    print(f"designs: energies differ by {worst[0]:.1e}, B_0 and C_B by {worst[1]:.1e}")


if __name__ == "__main__":
    main()
