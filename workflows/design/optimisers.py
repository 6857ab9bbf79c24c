"""Constrained optimisers on one set of designs: `python -m workflows.design.optimisers --out DIR`.

All receive the same functions, exact gradients and starts, and seek the least change: of log σ with S/√D or
(B_0, C_B, C_G) prescribed, and of log k with an isotropic tensor.  trust-constr and SLSQP are SciPy's; IPOPT runs where
`cyipopt` is installed (`pip install cyipopt-wheels`).  Each has `--seconds` of processor time for a problem, after
which its best point counts.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from importlib import import_module
from pathlib import Path

import numpy as np
from critflow.design.stiffness_design import TensorGoals
from critflow.design.target_problem import TARGET_NEAREST, Preference, TargetProblem, Unknowns
from critflow.quantities.table import wanted
from matplotlib.figure import Figure
from scipy.optimize import NonlinearConstraint, minimize

from critflow import CriticalManifold, delaunay_network, isotropic_targets, voronoi_network
from critflow.solvers.constrained import Point, minimise_constrained

from ..shared.reports import series
from . import stiffening_targets, stress_targets

# Relative error of a target that counts as reached, and the smallest one that is drawn.
REACHED, FLOOR = 1e-8, 1e-17
TITLES = {"S/√D": "$S/\\sqrt{D}$", "B₀, C_B, C_G": "$B_0$, $C_B$, $C_G$", "isotropic tensor": "isotropic tensor"}


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


def scipy_method(method, options):
    """A method of `scipy.optimize.minimize`."""

    def run(f, start):
        constraints = (
            NonlinearConstraint(lambda z: f.at(z).constraints, f.low, f.high, jac=f.rows)
            if method == "trust-constr"
            else {"type": "eq", "fun": lambda z: f.at(z).constraints - f.low, "jac": f.rows}
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return minimize(
                lambda z: f.at(z).value,
                start,
                jac=lambda z: f.at(z).gradient,
                method=method,
                constraints=constraints,
                options=options,
            ).x

    return run


def ipopt(f, start):
    """IPOPT with its limited-memory Hessian."""
    options = {
        "hessian_approximation": "limited-memory",
        "constr_viol_tol": 1e-11,
        "max_iter": 500,
        "print_level": 0,
        "sb": "yes",
    }
    return (
        import_module("cyipopt")
        .minimize_ipopt(
            lambda z: f.at(z).value,
            start,
            jac=lambda z: f.at(z).gradient,
            constraints={"type": "eq", "fun": lambda z: f.at(z).constraints - f.low, "jac": f.rows},
            tol=1e-4,
            options=options,
        )
        .x
    )


def critflow(tolerance):
    """The search of `design`, with a tolerance of the least change."""
    return lambda f, start: minimise_constrained(f, start, tolerance, 0.4, 600).point.z


METHODS = {
    "critflow": critflow(TARGET_NEAREST),
    "critflow, 1e-5": critflow(1e-5),
    "IPOPT": ipopt,
    "SLSQP": scipy_method("SLSQP", {"ftol": 1e-10, "maxiter": 300}),
    "trust-constr": scipy_method("trust-constr", {"gtol": 1e-6, "xtol": 1e-12, "maxiter": 1000}),
}


def problems(n_vertices, n_problems):
    """(kind, problem, start) of designs of S/√D, of stiffening and of stiffnesses."""
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
            ("B₀, C_B, C_G", stiffening_targets.NAMES, growth),
        ):
            wants = wanted(manifold, dict(zip(names, targets.tolist(), strict=True)))
            yield kind, TargetProblem(manifold, unknowns, preference, wants, []), start
        cell = delaunay_network(n_vertices // 3, seed)
        ratio = float(np.linspace(-0.6, 0.7, n_problems)[seed])
        goals = TensorGoals(cell, cell.positions, isotropic_targets(2, 1.0, ratio), cell.stiffness)
        yield "isotropic tensor", goals, goals.origin


def measured(kind, problem, start, name, seconds):
    """One method on one problem; None where it is not installed."""
    f, begin = Counted(problem, seconds), time.process_time()
    try:
        point, end = f.at(METHODS[name](f, start)), "finished"
    except TimeOutError:
        point, end = None, "time"
    except ImportError:
        return None
    spent = time.process_time() - begin
    if point is None:
        violation, change = f.best
    else:
        violation, change = float(np.abs(point.constraints - f.low).max()), point.value
    return {
        "kind": kind, "method": name, "seconds": spent, "points": f.n, "violation": violation, "change": change,
        "end": end,
    }  # fmt: skip


def main():
    """Run all methods, write optimisers.json and optimisers.md, and draw optimisers.png."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--vertices", type=int, default=200)
    options.add_argument("--problems", type=int, default=4)
    options.add_argument("--seconds", type=float, default=5.0)
    options.add_argument("--out", type=Path, default=Path("out"))
    chosen = options.parse_args()
    cases = [
        measured(kind, problem, start, name, chosen.seconds)
        for kind, problem, start in problems(chosen.vertices, chosen.problems)
        for name in METHODS
    ]
    rows = [row for row in cases if row is not None]
    chosen.out.mkdir(parents=True, exist_ok=True)
    (chosen.out / "optimisers.json").write_text(json.dumps(rows, indent=1))
    (chosen.out / "optimisers.md").write_text(table(rows))
    draw(rows).savefig(chosen.out / "optimisers.png", dpi=110)
    print(table(rows))


def excesses(rows):
    """The change of each row over the least one of all methods with the targets; nan without them."""
    cases = list(dict.fromkeys(row["method"] for row in rows))
    least = []
    for n in range(0, len(rows), len(cases)):
        reached = [row["change"] for row in rows[n : n + len(cases)] if row["violation"] <= REACHED]
        least += [min(reached, default=np.nan)] * len(cases)
    return [
        np.sqrt(row["change"] / best) if row["violation"] <= REACHED else np.nan
        for row, best in zip(rows, least, strict=True)
    ]


def table(rows):
    """Medians by kind and method, in Markdown."""
    lines = [
        "| targets | method | reached to 1e-8 | median error | median time [s] | longest [s] | points | "
        "median change over the least |",
        "|---|---|---|---|---|---|---|---|",
    ]
    excess = excesses(rows)
    for kind in dict.fromkeys(row["kind"] for row in rows):
        for name in METHODS:
            own = [
                (row, over)
                for row, over in zip(rows, excess, strict=True)
                if (row["kind"], row["method"]) == (kind, name)
            ]
            if not own:
                continue
            error, seconds, points = (
                np.array([row[key] for row, _ in own]) for key in ("violation", "seconds", "points")
            )
            over = np.array([over for _, over in own])
            known = over[np.isfinite(over)]
            reached = int(np.count_nonzero(error <= REACHED))
            lines.append(
                f"| {kind} | {name} | {reached} of {len(own)} | {np.median(error):.0e} | {np.median(seconds):.2f} | "
                f"{seconds.max():.2f} | {np.median(points):.0f} | {f'{np.median(known):.3f}' if len(known) else '–'} |"
            )
    return "\n".join(lines) + "\n"


def draw(rows):
    """Largest error of a target, and the change over the least one, against time: a column a kind."""
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    fig = Figure(figsize=(3.6 * len(kinds), 6.4), layout="constrained")
    excess = np.array(excesses(rows))
    panels = fig.subplots(2, len(kinds), squeeze=False, sharex=True)
    for column, kind in zip(panels.T, kinds, strict=True):
        for n, name in enumerate(METHODS):
            own = [i for i, row in enumerate(rows) if (row["kind"], row["method"]) == (kind, name)]
            seconds = [rows[i]["seconds"] for i in own]
            style = series(n) | {"linestyle": "none", "markersize": 6, "alpha": 0.8, "label": name}
            column[0].loglog(seconds, [max(rows[i]["violation"], FLOOR) for i in own], **style)
            column[1].semilogx(seconds, excess[own], **style)
        column[0].axhline(REACHED, color="0.5", linewidth=0.8, linestyle="--")
        column[0].set(title=f"targets: {TITLES[kind]}", ylim=(FLOOR / 3, 30))
        column[1].set(xlabel="processor time  [s]", ylim=(0.995, 1.1))
        column[0].set_xlim(1e-2, 10)
        for axes in column:
            axes.spines[["top", "right"]].set_visible(False)
    panels[0, 0].set_ylabel("largest relative error of a target")
    panels[1, 0].set_ylabel("change over the least one found")
    panels[0, 0].legend(fontsize=9, frameon=False)
    fig.suptitle(
        "Five optimisers on the same designs: a symbol a design; dashed: an error that counts as reached", fontsize=11
    )
    return fig


if __name__ == "__main__":
    main()
