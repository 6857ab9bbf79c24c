"""Constrained optimisers on one set of designs: `python -m workflows.benchmarks.optimisers`.

All receive the same functions, exact gradients and starts, and seek the least change: of log σ with S/√D or
(B_0, C_B, C_G) prescribed, and of log k with an isotropic tensor.  trust-constr and SLSQP are SciPy's; IPOPT runs where
`cyipopt` is installed (`pip install cyipopt-wheels`).  Each has `--seconds` of processor time for a problem, after
which its best point counts.
"""

import argparse
import time
import warnings
from importlib import import_module
from importlib.util import find_spec

import numpy as np
import pandas as pd
from scipy.optimize import NonlinearConstraint, minimize

from critflow import CriticalManifold, delaunay_network, spring_state, voronoi_network
from critflow.extras.design_stiffness.stiffnesses import Stiffnesses, isotropic_targets
from critflow.extras.targets.constrained import Point, minimise_constrained
from critflow.extras.targets.problem import TargetProblem, parse_targets
from critflow.extras.targets.stresses import Stresses
from critflow.extras.targets.targets import least_change

from .. import design_stiffening
from ..shared.structure import scaled_stress

# Relative error of a target that counts as reached.
REACHED = 1e-8


class TimeOutError(Exception):
    """The time of one problem is over."""


class Counted:
    """Functions of z of a problem, each point evaluated once; of those with the targets the nearest one is kept."""

    def __init__(self, problem, seconds):
        self.problem, self.end, self.n = problem, time.process_time() + seconds, 0
        self.low, self.high, self.key, self.best = problem.low, problem.high, None, (np.inf, np.inf)

    def at(self, z):
        key = z.tobytes()
        if key != self.key:
            if time.process_time() > self.end:
                raise TimeOutError
            self.key, self.n = key, self.n + 1
            try:
                with np.errstate(all="ignore"):
                    self.point = self.problem.at(np.array(z))
            except ZeroDivisionError:  # steps beyond all bounds, which only IPOPT takes
                self.point = self.nowhere(z)
            self.best = min(self.best, self.score(self.point))
        return self.point

    def nowhere(self, z):
        """A point outside the domain."""
        n, values = len(self.low), np.full(len(z), np.nan)
        return Point(z, np.nan, values, np.full(n, np.nan), lambda indices: np.tile(values, (len(indices), 1)))

    def score(self, point):
        """(violation, change), where all violations that count as reached are equal."""
        violation = float(np.abs(point.constraints - self.low).max())
        violation = violation if np.isfinite(violation) else np.inf
        return max(violation, REACHED), point.value

    def rows(self, z):
        return self.at(z).rows(np.arange(len(self.low)))

    def functions(self):
        """Value and gradient, in the words of `scipy.optimize.minimize`."""
        return {"fun": lambda z: self.at(z).value, "jac": lambda z: self.at(z).gradient}

    def equations(self):
        """The targets as equations, likewise."""
        return {"type": "eq", "fun": lambda z: self.at(z).constraints - self.low, "jac": self.rows}


def slsqp(f, start):
    """SLSQP of SciPy."""
    options = {"ftol": 1e-10, "maxiter": 300}
    return minimize(**f.functions(), x0=start, method="SLSQP", constraints=f.equations(), options=options).x


def trust_constr(f, start):
    """trust-constr of SciPy."""
    options = {"gtol": 1e-6, "xtol": 1e-12, "maxiter": 1000}
    equations = NonlinearConstraint(lambda z: f.at(z).constraints, f.low, f.high, jac=f.rows)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return minimize(**f.functions(), x0=start, method="trust-constr", constraints=equations, options=options).x


def ipopt(f, start):
    """IPOPT with its limited-memory Hessian."""
    options = {"hessian_approximation": "limited-memory", "constr_viol_tol": 1e-11, "max_iter": 500}
    options |= {"print_level": 0, "sb": "yes"}
    ipopt = import_module("cyipopt").minimize_ipopt
    return ipopt(**f.functions(), x0=start, constraints=f.equations(), tol=1e-4, options=options).x


def critflow(tolerance):
    """The search of `design`, with a tolerance of the least change."""
    return lambda f, start: minimise_constrained(f, start, tolerance, 0.4, 600).point.z


METHODS = {
    "critflow": critflow(Stresses.tolerance),
    "critflow, 1e-5": critflow(1e-5),
    "IPOPT": ipopt,
    "SLSQP": slsqp,
    "trust-constr": trust_constr,
}


def linear_response(manifold, rng):
    """S/√D of log-normal stresses, stronger in one direction."""
    reference = manifold.balance(np.ones(manifold.network.n_edges)).bond_vectors
    angle = 2 * (np.arctan2(reference[:, 1], reference[:, 0]) - np.pi * rng.random())
    spread, anisotropy = rng.random(2)
    sigma = np.exp(spread * rng.standard_normal(len(angle)) + anisotropy * np.cos(angle))
    return scaled_stress(manifold.configuration(sigma))


def problems(n_vertices, n_problems):
    """(kind, problem, start) of designs of S/√D, of stiffening and of stiffnesses."""
    for seed in range(n_problems):
        manifold = CriticalManifold(voronoi_network(n_vertices, seed))
        other = CriticalManifold(voronoi_network(n_vertices, seed + design_stiffening.OTHER))
        rng = np.random.default_rng(seed)
        S = linear_response(manifold, rng)
        stressed = other.configuration(np.exp(0.4 * rng.standard_normal(other.network.n_edges)))
        stresses = Stresses(manifold)
        start = stresses.origin + 0.1 * rng.standard_normal(len(stresses.origin))
        for kind, names, targets in (
            ("S/√D", ("S_xx", "S_yy", "S_xy"), S),
            ("B₀, C_B, C_G", design_stiffening.NAMES, design_stiffening.triple(stressed)[0]),
        ):
            parsed = parse_targets(manifold.network, dict(zip(names, targets.tolist(), strict=True)))
            yield kind, TargetProblem(stresses, least_change(stresses), parsed), start
        cell = delaunay_network(n_vertices // 3, seed)
        ratio = float(np.linspace(-0.6, 0.7, n_problems)[seed])
        lengths = np.linalg.norm(cell.bond_vectors(cell.positions), axis=1)
        stiffnesses = Stiffnesses(spring_state(cell, lengths, cell.positions))
        parsed = parse_targets(cell, isotropic_targets(2, 1.0, ratio))
        problem = TargetProblem(stiffnesses, least_change(stiffnesses), parsed)
        yield "isotropic tensor", problem, stiffnesses.origin


def measured(problem, start, name, seconds):
    """One method on one problem."""
    f, begin = Counted(problem, seconds), time.process_time()
    try:
        point, end = f.at(METHODS[name](f, start)), "finished"
        violation, change = float(np.abs(point.constraints - f.low).max()), point.value
    except TimeOutError:
        (violation, change), end = f.best, "time"
    spent = time.process_time() - begin
    return {"seconds": spent, "points": f.n, "violation": violation, "change": change, "end": end}


def main():
    """Run all methods, and print a table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--vertices", type=int, default=200)
    options.add_argument("--problems", type=int, default=4)
    options.add_argument("--seconds", type=float, default=5.0)
    chosen = options.parse_args()
    measurements = [
        {"problem": n, "kind": kind, "method": name, **measured(problem, start, name, chosen.seconds)}
        for n, (kind, problem, start) in enumerate(problems(chosen.vertices, chosen.problems))
        for name in METHODS
        if name != "IPOPT" or find_spec("cyipopt")
    ]
    print(table(with_excess(pd.DataFrame(measurements))))


def with_excess(frame):
    """Whether each row has the targets, and its change over the least one of all methods with them."""
    reached = frame.violation <= REACHED
    change = frame.change.where(reached)
    return frame.assign(reached=reached, excess=np.sqrt(change / change.groupby(frame.problem).transform("min")))


def table(frame):
    """Medians by kind and method, in Markdown."""
    lines = [
        "| targets | method | reached to 1e-8 | median error | median time [s] | longest [s] | points | "
        "median change over the least |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for (kind, name), own in frame.groupby(["kind", "method"], sort=False):
        excess = f"{own.excess.median():.3f}" if own.reached.any() else "–"
        lines.append(
            f"| {kind} | {name} | {own.reached.sum()} of {len(own)} | {own.violation.median():.0e} | "
            f"{own.seconds.median():.2f} | {own.seconds.max():.2f} | {own.points.median():.0f} | {excess} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
