"""Times at N_v = 1,000 over those of the bare refactorisations and solves in them: `python tests/benchmark.py`.

Times and errors of all methods are those of the study `speed`.  One process, one thread of numerics; each row is the
median of repeats, and what is compared is compared in this run.
"""

from __future__ import annotations

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")  # before NumPy is loaded

import statistics
import time

import numpy as np

from critflow import CriticalManifold, optimize, quantity, strain_path, voronoi_network
from critflow.sparse import block_laplacian

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


def refactor_and_solve(solver, matrix, right):
    """One numeric refactorisation and four solves of a matrix, without the library around them."""
    solver.update(matrix)
    for _ in range(4):
        solver.solve(right)


def strain_steps(critical, measure, repeats=3):
    """Paths of ten steps, and the processor time in ms of a step and of its refactorisation with four solves, in turn.

    Processor time, since another load of the machine enters the time that passes.
    """
    strains, patterns = 1e-3 * np.arange(1, 11), [block_laplacian(start.network) for start in critical]
    alone = [(pattern._solver(), pattern._model()) for pattern in patterns]
    paths, steps, units = [], [], []
    for _ in range(repeats + 1):
        for start, pattern, unit in zip(critical, patterns, alone, strict=True):
            right, begin = np.random.default_rng(1).standard_normal(pattern.size), time.process_time()
            paths.append(strain_path(start, strains, measure=measure))
            after = time.process_time()
            refactor_and_solve(*unit, right)
            steps.append(1e3 * (after - begin) / len(strains))
            units.append(1e3 * (time.process_time() - after))
    # The first round makes the patterns.
    return paths, steps[len(critical) :], units[len(critical) :]


def strain_rows(manifolds, stressed):
    largest_bulk = [optimize(manifold, "bulk_modulus").value for manifold in manifolds]
    for kind, starts in (("random stress", stressed), ("largest bulk modulus", largest_bulk)):
        for name in ("moduli", "tensors"):
            paths, steps, units = strain_steps(starts, name)
            ratio = statistics.median(step / unit for step, unit in zip(steps, units, strict=True))
            worst = max(s.value.max_force.max() for s in paths)
            unit = f"{ratio:.2f} x a refactor and four solves, {statistics.median(units):.2f} ms"
            row(f"strain step with {name}, {kind}", statistics.median(steps), f"{unit}; largest force {worst:.0e}")


def row(name, milliseconds, said):
    print(f"{name:<46}{milliseconds:10.2f} ms   {said}")


def main():
    networks = [voronoi_network(1000, seed) for seed in SEEDS]
    manifolds = [CriticalManifold(network) for network in networks]
    rng = np.random.default_rng(1)
    sigma = np.abs(rng.standard_normal(1500))
    goal = quantity(networks[0], "bulk_modulus")
    manifold = manifolds[0]

    def gradient(_seed):
        return manifold.balance(sigma).pull_back(*partials)

    _, partials = goal.evaluate(manifold.balance(sigma))
    solver, matrix = manifold.prestress._solver(), manifold.prestress._model()
    right = rng.standard_normal(manifold.prestress.size)

    def bare(_seed):
        refactor_and_solve(solver, matrix, right)

    whole, least = [], []
    for _ in range(20):
        whole.append(median_ms(gradient, 20, (0,)))
        least.append(median_ms(bare, 20, (0,)))
    ratio = statistics.median(a / b for a, b in zip(whole, least, strict=True))
    row("configuration + gradient", statistics.median(whole), f"{ratio:.2f} x the bare refactor and four solves")
    strain_rows(manifolds, [m.configuration(np.abs(rng.standard_normal(1500))) for m in manifolds])


if __name__ == "__main__":
    main()
