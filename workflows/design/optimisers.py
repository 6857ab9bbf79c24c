"""Constrained optimisers on one set of designs: `python -m workflows.design.optimisers --out DIR`.

All receive the same functions, exact gradients and starts: least change of log σ with S/√D or (B_0, C_B, C_G)
prescribed.  trust-constr and SLSQP are SciPy's; IPOPT runs where `cyipopt` is installed.  Each has `--seconds` for a
problem: a callback ends it after that.
"""

from __future__ import annotations

import argparse
import json
import time
from importlib import import_module
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import NonlinearConstraint, minimize

from critflow import CriticalManifold, voronoi_network
from critflow.design.target_problem import Preference, TargetProblem, Unknowns
from critflow.design.target_table import wanted
from critflow.solvers.constrained import minimise_constrained

from . import stiffening_targets, stress_targets


class TimeOut(Exception):
    """The time of one problem is over."""


class Counted:
    """Functions of z of a problem, each point evaluated once; the best point with its violation is kept."""

    def __init__(self, problem, seconds):
        self.problem, self.end = problem, time.process_time() + seconds
        self.low, self.high, self.key, self.best = problem.low, problem.high, None, (np.inf, np.inf)

    def at(self, z):
        key = z.tobytes()
        if key != self.key:
            if time.process_time() > self.end:
                raise TimeOut
            self.key, self.point = key, self.problem.at(np.array(z))
            violation = float(np.abs(self.point.constraints - self.low).max())
            # The nearest of those with the targets, else the one of least violation.
            score = (0.0, self.point.value) if violation < 1e-8 else (violation, np.inf)
            if score < self.best:
                self.best, self.violation = score, violation
        return self.point

    def rows(self, z):
        return self.at(z).rows(np.arange(len(self.low)))


def scipy_method(method, options):
    """A method of `scipy.optimize.minimize`."""

    def run(f, start):
        constraints = (
            NonlinearConstraint(lambda z: f.at(z).constraints, f.low, f.high, jac=f.rows)
            if method == "trust-constr"
            else {"type": "eq", "fun": lambda z: f.at(z).constraints - f.low, "jac": f.rows}
        )
        minimize(
            lambda z: f.at(z).value,
            start,
            jac=lambda z: f.at(z).gradient,
            method=method,
            constraints=constraints,
            options=options,
        )

    return run


def ipopt(f, start):
    """IPOPT with its limited-memory Hessian."""
    import_module("cyipopt").minimize_ipopt(
        lambda z: f.at(z).value,
        start,
        jac=lambda z: f.at(z).gradient,
        constraints={"type": "eq", "fun": lambda z: f.at(z).constraints - f.low, "jac": f.rows},
        options={"hessian_approximation": "limited-memory", "tol": 1e-9, "max_iter": 500, "print_level": 0},
    )


def critflow(f, start):
    """The search of `design`."""
    minimise_constrained(f, start, 1e-2, 0.4, 300)


METHODS = {
    "critflow": critflow,
    "trust-constr": scipy_method("trust-constr", {"gtol": 1e-8, "maxiter": 300}),
    "SLSQP": scipy_method("SLSQP", {"ftol": 1e-10, "maxiter": 100}),
    "IPOPT": ipopt,
}


def problems(n_vertices, n_problems):
    """(kind, problem, start) of designs of S/√D and of stiffening."""
    for seed in range(n_problems):
        manifold = CriticalManifold(voronoi_network(n_vertices, seed))
        other = CriticalManifold(voronoi_network(n_vertices, seed + stiffening_targets.OTHER))
        rng = np.random.default_rng(seed)
        S = stress_targets.response(stress_targets.attained(manifold, rng))
        stressed = other.configuration(np.exp(0.4 * rng.standard_normal(other.network.n_edges)))
        growth = stiffening_targets.triple(other, stressed)
        unknowns = Unknowns.of(manifold.network, None, None, "positive")
        preference = Preference(manifold.network, "least_change", None)
        start = unknowns.origin + 0.1 * rng.standard_normal(len(unknowns.origin))
        for kind, names, targets in (
            ("S/√D", stress_targets.NAMES, S),
            ("B_0, C_B, C_G", stiffening_targets.NAMES, growth),
        ):
            wants = wanted(manifold, dict(zip(names, targets.tolist(), strict=True)))
            yield kind, TargetProblem(manifold, unknowns, preference, wants, []), start


def main():
    """Run all methods, write optimisers.json and draw optimisers.png."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--vertices", type=int, default=200)
    options.add_argument("--problems", type=int, default=5)
    options.add_argument("--seconds", type=float, default=20.0)
    options.add_argument("--out", type=Path, default=Path("out"))
    chosen = options.parse_args()
    rows = []
    for kind, problem, start in problems(chosen.vertices, chosen.problems):
        for name, method in METHODS.items():
            f, begin = Counted(problem, chosen.seconds), time.process_time()
            try:
                method(f, start)
                end = "finished"
            except TimeOut:
                end = "time"
            except ImportError:
                continue
            seconds = time.process_time() - begin
            rows.append({"kind": kind, "method": name, "seconds": seconds, "violation": f.violation, "end": end})
            rows[-1]["change"] = f.best[1]
            print(rows[-1], flush=True)
    chosen.out.mkdir(parents=True, exist_ok=True)
    (chosen.out / "optimisers.json").write_text(json.dumps(rows, indent=1))
    draw(rows).savefig(chosen.out / "optimisers.png", dpi=150)


def draw(rows):
    """Largest error of a target against time, one panel a kind."""
    fig = Figure(figsize=(8, 3.4), layout="constrained")
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    for axes, kind in zip(fig.subplots(1, len(kinds), squeeze=False)[0], kinds, strict=True):
        for n, name in enumerate(METHODS):
            own = [row for row in rows if row["kind"] == kind and row["method"] == name]
            errors = [max(row["violation"], 1e-17) for row in own]
            axes.loglog([row["seconds"] for row in own], errors, "osDv"[n], label=name, markersize=5)
        axes.set(xlabel="processor time [s]", ylabel="largest relative error of a target", title=kind)
        axes.legend(fontsize=8)
    return fig


if __name__ == "__main__":
    main()
