"""Curves of error against cost from the dataset, costs of an error, and ratios of times at equal errors.

The cost of an error is that of the cheapest setting whose error is not larger, in each network; a method that has none
fails there.  Costs are seconds of a prepared run, in which everything is prepared that does not depend on the stress,
or the number of its calls; the second ratio contains the preparation: of the network, of patterns and their symbolic
analysis, of a compiled function.
"""

from typing import NamedTuple

import numpy as np

from critflow.result import Status

from ..timing import CALLS
from .tasks import MAIN_GAMMA, TASKS

# Errors at which methods are compared.
ERRORS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10)
# Error of the costs against the distance to the transition.
TARGET = 1e-2
# Times closer than this are the same.
SAME = 1.1
# The size of the charts that show one size.
MAIN_SIZE = 1_000
OWN = 1


class Curve(NamedTuple):
    """One method: seconds, calls, errors and statuses (networks, levels), and seconds of its preparation (networks,).

    NaN where a level was not run, infinite errors where it has no answer.
    """

    name: str
    own: bool
    seconds: np.ndarray
    calls: np.ndarray
    errors: np.ndarray
    outcomes: np.ndarray
    preparation: np.ndarray

    def costs(self, error: float, kind: str = "seconds", prepared: bool = True) -> np.ndarray:
        """Cost of each network, infinite without a setting of this error."""
        cost = getattr(self, kind) if prepared else self.seconds + self.preparation[:, None]
        return np.where(self.errors <= error, cost, np.inf).min(axis=1)

    def wrong(self, error: float) -> np.ndarray:
        """Networks in which the method has no such error although it reports all of its settings as reached."""
        reported = ~np.isin(self.outcomes, (Status.ok, Status.missing))
        return (self.errors > error).all(axis=1) & ~reported.any(axis=1)

    @property
    def spent(self) -> dict[str, np.ndarray]:
        """Largest cost of a setting in each network, by kind."""
        return {kind: np.nanmax(getattr(self, kind), axis=1, initial=0) for kind in ("seconds", "calls")}


class Ratio(NamedTuple):
    """Time of another method over that of the default at the same error; zero where the default has no such error."""

    error: float
    warm: float
    cold: float

    def __str__(self) -> str:
        return f"{number(self.warm)} / {number(self.cold)} ×"


def number(ratio):
    """A ratio with two digits, as text."""
    return f"{ratio:,.0f}" if ratio >= 9.95 else f"{ratio:.2g}"


def ratios(default: Curve, rival: Curve) -> list[Ratio]:
    """The ratios of medians at all errors that the rival has in most networks, from rough to fine."""
    compared = []
    for error in ERRORS:
        warm, cold = (
            [middle(curve.costs(error, prepared=prepared)) for curve in (rival, default)] for prepared in (True, False)
        )
        if np.isfinite(warm[0]):
            compared.append(Ratio(error, warm[0] / warm[1], cold[0] / cold[1]))
    return compared


def middle(costs: np.ndarray) -> float:
    """The median, infinite where half of the costs are."""
    return float(np.quantile(costs, 0.5, method="higher"))


def finest(default: Curve, rival: Curve) -> Ratio | None:
    """The ratio at the finest error that both have."""
    return next((ratio for ratio in reversed(ratios(default, rival)) if ratio.warm), None)


def curves(one) -> list[Curve]:
    """The methods of a task at one size and strain that have a time, over the networks in which any has."""
    values = {name: one[name].transpose("contestant", "seed", ...).values for name in ("seconds", "error", "outcome")}
    calls = sum(one[name].transpose("contestant", "seed", ...).values for name in CALLS)
    ran = np.isfinite(values["seconds"])
    kept, errors = ran.any(axis=(0, 2)), np.where(np.isnan(values["error"]), np.inf, values["error"])
    presence = one.presence.transpose("contestant", "seed").values
    preparation = one.preparation_seconds.transpose("contestant", "seed").values
    return [
        Curve(
            str(name), bool((presence[n][kept] == OWN).any()), values["seconds"][n][kept],
            np.where(ran[n], calls[n], np.nan)[kept], errors[n][kept], values["outcome"][n][kept], preparation[n][kept],
        )
        for n, name in enumerate(one.contestant.values) if ran[n].any()
    ]  # fmt: skip


def cases(ds, gammas=(0.0, MAIN_GAMMA)):
    """Task, size, strain, default and other methods of each case in which the default was timed."""
    for word in (str(word) for word in ds.task.values if word in TASKS):
        for size in map(int, ds.n_vertices.values):
            for gamma in (gamma for gamma in map(float, ds.gamma.values) if gamma in gammas):
                methods = {c.name: c for c in curves(ds.sel(task=word, n_vertices=size, gamma=gamma))}
                if default := methods.pop(TASKS[word].default, None):
                    yield word, size, gamma, default, list(methods.values())


def of_task(ds, word):
    """Size, default and other methods of a task at the size nearest to the one in the middle, or None."""
    found = [(size, default, others) for task, size, _, default, others in cases(ds.sel(task=[word]))]
    return min(found, key=lambda case: abs(np.log(case[0] / MAIN_SIZE)), default=None)


class Approach(NamedTuple):
    """Costs of one method towards the transition: strains (n,), median and quartiles (3, n), and failures (n,).

    Costs are those of the error `TARGET`; where it fails in more than half of the networks, of what was spent.
    """

    gamma: np.ndarray
    seconds: np.ndarray
    calls: np.ndarray
    gave_up: np.ndarray
    wrong: np.ndarray
    networks: np.ndarray

    @property
    def failed(self) -> np.ndarray:
        """Whether the method fails in more than half of the networks, (n,)."""
        return 2 * (self.gave_up + self.wrong) > self.networks


def approaches(ds, word) -> dict[str, Approach]:
    """Costs of every method of a task towards the transition, at the smallest size with strains."""
    if word not in ds.task.values:
        return {}
    gammas = tuple(gamma for gamma in map(float, ds.gamma.values) if gamma)
    found = list(cases(ds.sel(task=[word]), gammas))
    smallest = min((size for _, size, *_ in found), default=0)
    rows: dict[str, list] = {}
    for _, size, gamma, default, others in found:
        if size == smallest:
            for curve in (default, *others):
                rows.setdefault(curve.name, []).append((gamma, *_approach(curve)))
    return {name: Approach(*map(np.array, zip(*its, strict=True))) for name, its in rows.items()}


def _approach(curve: Curve) -> tuple:
    failed, wrong = np.isinf(curve.costs(TARGET)), curve.wrong(TARGET)
    quartiles = []
    for kind in ("seconds", "calls"):
        costs = curve.spent[kind] if failed.mean() > 0.5 else curve.costs(TARGET, kind)[~failed]
        quartiles.append(np.quantile(costs, (0.5, 0.25, 0.75)))
    return *quartiles, int((failed & ~wrong).sum()), int((failed & wrong).sum()), len(failed)


def profiles(ds, error) -> dict[str, np.ndarray]:
    """Cost of each problem over the least of all, by family of methods, infinite where all of a family fail.

    A problem is a task, size, network and strain in which the default was timed; a family is the default, FIRE, or the
    methods of one package, of which the best counts, on the tasks in which it takes part.
    """
    found: dict[str, list] = {}
    for *_, default, others in cases(ds, tuple(map(float, ds.gamma.values))):
        costs = {"critflow": default.costs(error)}
        for curve in others:
            name = "FIRE" if curve.name.upper() == "FIRE" else "" if curve.own else curve.name.split()[0]
            costs[name] = np.minimum(costs.get(name, np.inf), curve.costs(error))
        least = np.min(list(costs.values()), axis=0)
        for name, its in costs.items():
            with np.errstate(invalid="ignore"):
                found.setdefault(name, []).append(np.where(np.isinf(its), np.inf, its / least))
    found.pop("", None)
    return {name: np.concatenate(its) for name, its in found.items()}
