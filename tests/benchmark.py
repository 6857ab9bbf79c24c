"""Times of the library at N_v = 1,000 with their accuracy: `python tests/benchmark.py`.

The argument `step` selects strain steps alone.

One process, one thread of numerics; each row is the median of repeats, and what is compared is compared in this run.
"""

from __future__ import annotations

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")  # before NumPy is loaded

import statistics
import sys
import time

import numpy as np

from critflow import CriticalManifold, critical_from_lengths, optimize, stiffening, strain_path, voronoi_network
from critflow.critical.quantity import named_objective
from critflow.springs.equilibrium import equilibrium
from critflow.springs.state import SpringState

SEEDS = range(5)


def median_ms(function, repeats=1, arguments=SEEDS):
    """Median over the arguments of the time of one call, in milliseconds."""
    times = []
    for argument in arguments:
        start = time.perf_counter()
        for _ in range(repeats):
            function(argument)
        times.append(1e3 * (time.perf_counter() - start) / repeats)
    return statistics.median(times)


def refactor_and_solve(pattern, right):
    """One numeric refactorisation and four solves of the last matrix of a pattern, without the library around them."""
    solver = pattern._solvers[0]
    solver.update(pattern._matrix)
    for _ in range(4):
        solver.solve(right)


def strain_steps(networks, critical, tensors, repeats=3):
    """Paths of ten steps, and the processor time in ms of a step and of its refactorisation with four solves, in turn.

    Processor time, since another load of the machine enters the time that passes.
    """
    strains, patterns = 1e-3 * np.arange(1, 11), [CriticalManifold(network).hessian for network in networks]
    paths, steps, units = [], [], []
    for _ in range(repeats + 1):
        for start, pattern in zip(critical, patterns, strict=True):
            right, begin = np.random.default_rng(1).standard_normal(pattern.size), time.process_time()
            paths.append(strain_path(start, strains, pattern=pattern, tensors=tensors))
            after = time.process_time()
            refactor_and_solve(pattern, right)
            steps.append(1e3 * (after - begin) / len(strains))
            units.append(1e3 * (time.process_time() - after))
    # The first round makes the patterns.
    return paths, steps[len(networks) :], units[len(networks) :]


def strain_rows(networks, manifolds, stressed):
    largest_bulk = [optimize(manifold, "bulk_modulus").value for manifold in manifolds]
    for kind, starts in (("random stress", stressed), ("largest bulk modulus", largest_bulk)):
        for name, tensors in (("moduli", False), ("tensors", True)):
            paths, steps, units = strain_steps(networks, starts, tensors)
            ratio = statistics.median(step / unit for step, unit in zip(steps, units, strict=True))
            worst = max(s.value.max_force.max() for s in paths)
            unit = f"{ratio:.2f} x a refactor and four solves, {statistics.median(units):.2f} ms"
            row(f"strain step with {name}, {kind}", statistics.median(steps), f"{unit}; largest force {worst:.0e}")


def row(name, milliseconds, said):
    print(f"{name:<46}{milliseconds:10.2f} ms   {said}")


def main():
    networks = [voronoi_network(1000, seed) for seed in SEEDS]
    manifolds = [CriticalManifold(network) for network in networks]
    if "step" in sys.argv[1:]:
        rng = np.random.default_rng(1)
        strain_rows(networks, manifolds, [m.configuration(np.abs(rng.standard_normal(1500))) for m in manifolds])
        return
    row("network", median_ms(lambda seed: voronoi_network(1000, seed), 3), "generation, faces included")

    rng = np.random.default_rng(1)
    sigma = np.abs(rng.standard_normal(1500))
    goal = named_objective(networks[0], "bulk_modulus")
    manifold = manifolds[0]

    def gradient(_seed):
        return manifold.balance(sigma).pull_back(*partials)

    _, partials = goal.evaluate(sigma, manifold.balance(sigma).bond_vectors)
    pattern = manifold.prestress
    right = rng.standard_normal(pattern.size)

    def bare(_seed):
        refactor_and_solve(pattern, right)

    whole, least = [], []
    for _ in range(20):
        whole.append(median_ms(gradient, 20, (0,)))
        least.append(median_ms(bare, 20, (0,)))
    ratio = statistics.median(a / b for a, b in zip(whole, least, strict=True))
    row("configuration + gradient", statistics.median(whole), f"{ratio:.2f} x the bare refactor and four solves")

    for objective, method in (
        ("length_variance", "conic"),
        ("length_variance", "newton"),
        ("tension_variance", "auto"),
        ("bulk_modulus", "auto"),
        ("shear_modulus", "auto"),
    ):
        found = []

        def solve(seed, objective=objective, method=method, found=found):
            found.append(optimize(manifolds[seed], objective, method, throw=False))

        spent = median_ms(solve)
        worst = max(s.stats.residual for s in found if s.ok)
        row(f"{objective}, {method}", spent, f"largest gradient {worst:.0e}, {sum(s.ok for s in found)} of 5 attained")

    lengths = [1 + 0.1 * np.random.default_rng(seed).standard_normal(1500) for seed in SEEDS]
    fitted = []
    spent = median_ms(lambda seed: fitted.append(critical_from_lengths(manifolds[seed], lengths[seed], throw=False)))
    row(
        "rest lengths, conic",
        spent,
        f"relative error of the lengths {max(s.stats.residual for s in fitted if s.ok):.0e}",
    )

    stressed = [m.configuration(np.abs(rng.standard_normal(1500))) for m in manifolds]
    patterns = [m.hessian for m in manifolds]
    strain_rows(networks, manifolds, stressed)

    spent = median_ms(lambda seed: stiffening(manifolds[seed], stressed[seed]), 3)
    row("exact C_B and C_G", spent, "from the transition alone")

    # The same step by both methods, in turn, to the same force.
    tolerance, times = 1e-13, {"newton": [], "fire": []}
    steps, ends = {}, {}
    for seed in SEEDS[:3]:
        critical = stressed[seed]
        start = SpringState(networks[seed], critical.lengths, critical.coordinates, critical.bond_vectors)
        start = start.deformed(np.sqrt(1.001) * np.eye(2))
        for method, spent_on in times.items():
            begin = time.perf_counter()
            ends[method] = equilibrium(start, method, tolerance, pattern=patterns[seed])
            spent_on.append(1e3 * (time.perf_counter() - begin))
            steps.setdefault(method, []).append(ends[method].stats.steps)
    ratio = statistics.median(f / n for f, n in zip(times["fire"], times["newton"], strict=True))
    apart = np.abs(ends["fire"].value.coordinates - ends["newton"].value.coordinates).max()
    row("strain step by Newton", statistics.median(times["newton"]), f"{steps['newton']} steps to force {tolerance:g}")
    row("strain step by FIRE", statistics.median(times["fire"]), f"{steps['fire']} steps, {apart:.0e} off in position")
    print(f"\nNewton is {ratio:.0f} times faster than FIRE at the same force tolerance.")


if __name__ == "__main__":
    main()
