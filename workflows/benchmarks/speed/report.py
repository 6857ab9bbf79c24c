"""Claims and summary of times at equal errors and of sizes, from the dataset."""

from critflow.engine import Claim
from critflow.engine.study import plural

from ...shared.reports import parameters, status_counts
from .curves import ERRORS, SAME, cases, ratios
from .sizes import size_claims, size_summary
from .tasks import TASKS

MISSING = 3
_CRITERION = f"at least 1/{SAME:g} of the time at each error of {', '.join(f'{e:.0e}' for e in ERRORS)}"


def claims(ds):
    """Claims on every task against other packages, on the default against other methods, and on sizes."""
    return [*_speed_claims(ds), *size_claims(ds)]


def _speed_claims(ds):
    compared: dict[str, list] = {}
    for word, size, default, others in cases(ds):
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
    gone = (ds.presence == MISSING).any(("task", "n_vertices")).values
    return [str(name) for name, missing in zip(ds.contestant.values, gone, strict=True) if missing]


def summary(ds):
    """For each task and size the default's points, and times of all others over its own at equal errors; stages."""
    tables: dict = {}
    for word, size, default, others in cases(ds):
        of_others = {
            other.name: {f"{r.error:.0e}": [_short(r.warm), _short(r.cold)] for r in ratios(default, other)}
            for other in others
        }
        tables.setdefault(word, {})[str(size)] = {
            "default": [[_short(t), _short(e)] for t, e in zip(default.seconds, default.errors, strict=True)],
            "preparation": _short(default.preparation),
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
        "stages": size_summary(ds),
    }


def _short(number):
    return float(f"{number:.3g}")
