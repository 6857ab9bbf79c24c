"""Claims and summary of costs at equal errors, towards the transition, and of sizes, from the dataset."""

import numpy as np

from critflow.engine import Claim
from critflow.engine.study import plural

from ...shared.reports import parameters, status_counts
from .curves import ERRORS, SAME, TARGET, approaches, cases, middle, profiles, ratios
from .sizes import size_claims, size_summary
from .tasks import TASKS

MISSING = 3
_CRITERION = f"at least 1/{SAME:g} of the time at each error of {', '.join(f'{e:.0e}' for e in ERRORS)}"


def claims(ds):
    """Claims on every task against other packages, on the default against other methods, on γ, and on sizes."""
    return [*_speed_claims(ds), *_approach_claims(ds), *size_claims(ds)]


def _speed_claims(ds):
    compared: dict[str, list] = {}
    for word, size, _, default, others in cases(ds):
        rows = compared.setdefault(word, [])
        rows += [(ratio, other, size) for other in others for ratio in reversed(ratios(default, other))]
    for word, rows in compared.items():
        peers = [row for row in rows if not row[1].own]
        if peers:
            yield _claim(
                f"speed-{word}", f"{TASKS[word].title}: no other package has the same error sooner", peers,
                plural(len({size for *_, size in peers}), "size"),
            )  # fmt: skip
    own = [row for rows in compared.values() for row in rows if row[1].own]
    if own:
        statement = "no other method of critflow has the same error sooner than the default"
        yield _claim("speed-default", statement, own, plural(len(compared), "task"))
    for name in _missing(ds):
        yield Claim(
            f"speed-missing-{name.replace(' ', '-')}", f"{name} takes part", "not stated",
            f"{name.split()[0]} is not installed: `pip install 'critflow[peers]'`", "measured",
        )  # fmt: skip


def _claim(key, statement, rows, sample):
    """The least ratios, prepared and with the preparation, and every method that is faster than the default."""
    ahead: dict = {}
    for row in sorted(rows, key=lambda row: row[0].warm):
        if min(row[0].warm, row[0].cold) < 1 / SAME:
            # Of each method and size the error at which it is furthest ahead.
            ahead.setdefault((row[1].name, row[2]), row)
    both = [row for row in rows if row[0].warm] or rows
    least = [min(both, key=lambda row, kind=kind: getattr(row[0], kind)) for kind in ("warm", "cold")]
    value = f"time over that of the default, prepared / with the preparation: at least {_place(least[0])}"
    if least[1] is not least[0]:
        value += f" and {_place(least[1])}"
    return Claim.tested(
        key, statement, "not stated", value, not ahead, "; ".join(map(_place, ahead.values())),
        criterion=_CRITERION, sample=sample,
    )  # fmt: skip


def _place(row):
    ratio, curve, size = row
    times = f"{ratio}" if ratio.warm else "the default has no such error"
    return f"{times} ({curve.name}, error {ratio.error:.0e}, N_v = {size:,})"


def _missing(ds):
    """Methods whose package is not installed."""
    gone = (ds.presence == MISSING).any(("task", "n_vertices", "seed")).values
    return [str(name) for name, missing in zip(ds.contestant.values, gone, strict=True) if missing]


def _approach_claims(ds):
    """Where each method ends on the way to the transition."""
    for word, task in ((word, task) for word, task in TASKS.items() if task.strained):
        its = approaches(ds, word)
        if task.default not in its:
            continue
        ends = {}
        for name, one in its.items():
            if name != task.default and one.failed.any():
                wrong = int(one.wrong.sum())
                said = f", silently in {wrong} of {int((one.wrong + one.gave_up).sum())}" if wrong else ""
                ends[name] = f"{name} from γ = {one.gamma[one.failed].max():.0e}{said}"
        failures = int((its[task.default].gave_up + its[task.default].wrong).sum())
        yield Claim.tested(
            f"gamma-{word}", f"{task.title}: the default reaches an error of {TARGET:g} at every γ", "not stated",
            f"it fails in {failures} of {int(its[task.default].networks.sum())}; most networks fail with "
            + ("; ".join(ends.values()) or "no other method"), not failures, "the default fails there",
            criterion="no failure", sample=plural(int(its[task.default].networks.max()), "network"), kind="check",
        )  # fmt: skip


def summary(ds):
    """For each task and size the default's points, and times of all others over its own at equal errors; γ; stages."""
    tables: dict = {}
    for word, size, _, default, others in cases(ds):
        of_others = {
            other.name: {f"{r.error:.0e}": [_short(r.warm), _short(r.cold)] for r in ratios(default, other)}
            for other in others
        }
        tables.setdefault(word, {})[str(size)] = {
            "networks": len(default.seconds),
            "default": points(default),
            "preparation": _short(middle(default.preparation)),
            "others": {name: times for name, times in of_others.items() if times},
            "packages": [other.name for other in others if not other.own],
        }
    return {
        "parameters": parameters(ds),
        "outcomes": status_counts(ds.outcome.values),
        "tasks": {
            word: {"title": TASKS[word].title, "error": TASKS[word].error, "default": TASKS[word].default, "sizes": its}
            for word, its in tables.items()
        },
        "gamma": _towards(ds),
        "profile": {
            f"{error:.0e}": {
                name: {
                    "problems": len(found),
                    "solved": int(np.isfinite(found).sum()),
                    "fastest": int((found == 1).sum()),
                }
                for name, found in profiles(ds, error).items()
            }
            for error in ERRORS
        },
        "stages": size_summary(ds),
    }


def points(curve):
    """Medians of time and error at each level that most networks reach; one that ended before it counts as slower."""
    costs, reached = np.where(np.isnan(curve.seconds), np.inf, curve.seconds), np.isfinite(curve.seconds)
    most = np.flatnonzero(2 * reached.sum(axis=0) > len(reached))
    return [[_short(middle(part[:, level])) for part in (costs, curve.errors)] for level in most]


def _towards(ds):
    """Strains as a list, and for each task and method the cost of the error `TARGET` with quartiles, and failures."""
    tables = {word: approaches(ds, word) for word, task in TASKS.items() if task.strained}
    return {
        "gamma": [gamma for gamma in map(float, ds.gamma.values) if gamma],
        "error": TARGET,
        "tasks": {
            word: {
                name: {
                    "gamma": list(one.gamma),
                    **{
                        f"{kind}_{part}": [_short(value) for value in getattr(one, kind)[:, n]]
                        for kind in ("seconds", "calls")
                        for n, part in enumerate(("median", "lower_quartile", "upper_quartile"))
                    },
                    "networks": one.networks.tolist(),
                    "gave_up": one.gave_up.tolist(),
                    "wrong": one.wrong.tolist(),
                }
                for name, one in its.items()
            }
            for word, its in tables.items() if its
        },
    }  # fmt: skip


def _short(number):
    return float(f"{number:.3g}")
