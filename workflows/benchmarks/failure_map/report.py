"""Figures, claims and summary of the failure map, from the dataset alone."""

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from critflow.engine import Claim
from critflow.engine.study import plural
from critflow.pictures import COLOURS
from critflow.result import Status

from ...shared.figures import TEXT, counted, lettered, page
from ...shared.populations import LABELS, OPTIMA
from ...shared.reports import parameters
from ..high_precision import DIGITS
from .outcomes import Outcome, Violation
from .peers import PEERS
from .problems import DIFFICULTIES, METHODS

# One cell of the map: colour and text of the legend.  Of several methods or networks in a cell the last is shown.
CELLS = {
    Outcome.absent: ("#ffffff", ""),
    Outcome.exact: ("#0B3C6F", "correct to rounding"),
    Outcome.bounded: ("#4F93C4", "correct within its claimed bound"),
    Outcome.tolerated: ("#B8D9EF", "correct within tolerance, no bound claimed"),
    Outcome.refused: ("#C9A8DC", "refused with the reason"),
    Outcome.reported: ("#D9D9D9", "a status with the reason"),
    Outcome.unknown: ("#FFFFFF", "the reference fails"),
    Outcome.violation: ("#D55E00", "SILENT WRONG ANSWER"),
}
# The difficulties of each figure, in two columns.
MAPS = {
    "stresses": (
        ("stress_spread", "faint_edge", "faint_cut"),
        ("short_edge", "near_singular", "single_precision"),
    ),
    "networks": (
        ("extra_edges", "smallest", "slack_backbone", "straight_lines"),
        ("anisotropic_cell", "sheared_cell", "skew_cell"),
    ),
    "tasks": (("hard_core", "small_strain", "threshold"), ("contrast", "large_step", "rest_lengths")),
    "peers": (("small_strain", "hard_core"), ("large_step", "contrast")),
}
RIGHT = (Outcome.exact, Outcome.bounded, Outcome.tolerated)
# Difficulties and quantities whose error and bound are drawn.
SHOWN = (("contrast", "linear_response"), ("near_singular", "transition_moduli"), ("short_edge", "stiffening"))
ULP = 2.0**-53
WIDEST = 100.0


def map_figure(ds, name):
    """Every quantity, or every peer, at every strength of the difficulties of one map, coloured by its outcome."""
    ds = _part(ds, peers=name == "peers")
    made = [d for d in map(str, ds.difficulty.values) if d in DIFFICULTIES]
    columns = [[(d, *table) for d in column if d in made and (table := _rows(ds, d))[0]] for column in MAPS[name]]
    heights = [sum(len(rows) + 3 for _, rows, _ in column) for column in columns]
    figure = Figure(figsize=(11, 1.5 + 0.21 * max(heights)), dpi=110, layout="constrained")
    colours = ListedColormap([CELLS[outcome][0] for outcome in sorted(CELLS)])
    head, body = figure.subfigures(2, 1, height_ratios=(0.9, 0.6 + 0.21 * max(heights)))
    for part, column, height in zip(body.subfigures(1, 2), columns, heights, strict=True):
        # An empty panel below the shorter column leaves all cells of one height.
        ratios = [*(len(rows) + 1.5 for _, rows, _ in column), max(heights) - height + 0.1]
        *panels, rest = part.subplots(len(ratios), 1, height_ratios=ratios, squeeze=False)[:, 0]
        rest.set_axis_off()
        for axes, (difficulty, rows, cells) in zip(panels, column, strict=True):
            _draw_table(axes, ds, difficulty, rows, cells, colours)
    outcome = ds.outcome.sel(difficulty=[d for column in columns for d, _, _ in column])
    wrong, points = int((outcome == Outcome.violation).sum()), int((outcome != Outcome.absent).sum())
    verdict = "no silent wrong answer" if not wrong else f"{wrong} SILENT WRONG ANSWERS"
    subject = "Other methods and programs" if name == "peers" else f"Difficult {name}"
    head.suptitle(f"{subject}: {verdict} in {points:,} points", fontsize=13, fontweight="bold")
    kinds = [o for o in list(Outcome)[1:] if (outcome == o).any() or o is Outcome.violation]
    handles = [Patch(facecolor=CELLS[o][0], edgecolor="0.5", label=CELLS[o][1]) for o in kinds]
    head.legend(handles=handles, loc="lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def _part(ds, peers=False):
    """The quantities of the library, or the peers."""
    return ds.isel(quantity=np.isin(ds["quantity"].values, PEERS) == peers)


def _rows(ds, name):
    """Names of the rows of one difficulty, and outcomes (row, step): the methods of an objective in one row."""
    outcomes = ds.outcome.sel(difficulty=name).transpose("quantity", "seed", "step").values
    # A case that failed has no outcomes.
    outcomes = np.maximum(outcomes, Outcome.absent)
    order = list(CELLS)
    rank = np.array([order.index(outcome) for outcome in Outcome])
    rows, cells = [], []
    groups: dict[str, list[int]] = {}
    for place, quantity in enumerate(map(str, ds.quantity.values)):
        groups.setdefault(_group(quantity), []).append(place)
    for group, places in groups.items():
        worst = rank[outcomes[places]].max(axis=(0, 1))
        if worst.any():
            rows.append(group)
            cells.append([int(order[r]) for r in worst])
    return rows, np.array(cells)


def _group(quantity):
    optimum, _, method = quantity.rpartition("_")
    if optimum in OPTIMA and method in METHODS:
        return LABELS[optimum]
    return quantity.replace("_", " ").replace("lengths", "from lengths:").replace("equilibrium", "equilibrium:")


def _draw_table(axes, ds, name, rows, cells, colours):
    strengths = ds.strength.sel(difficulty=name).values
    n = int(np.isfinite(strengths).sum())
    axes.imshow(cells[:, :n], cmap=colours, vmin=-0.5, vmax=len(Outcome) - 0.5, aspect="auto", interpolation="none")
    for row, column in np.argwhere(cells[:, :n] == Outcome.violation):
        axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, fill=False, edgecolor="black", linewidth=1.0))
    axes.set_xticks(np.arange(n), [_number(s) for s in strengths[:n]], fontsize=8, rotation=0 if n < 9 else 45)
    axes.set_yticks(np.arange(len(rows)), rows, fontsize=8.5)
    axes.set_xticks(np.arange(-0.5, n), minor=True)
    axes.set_yticks(np.arange(-0.5, len(rows)), minor=True)
    axes.grid(which="minor", color="white", linewidth=0.8)
    axes.tick_params(which="both", length=0, pad=2)
    axes.spines[:].set_visible(False)
    axes.set_title(f"{DIFFICULTIES[name].label} →", loc="left", fontsize=9.5, fontweight="bold", pad=3)


def _number(value):
    if value == 0 or 1e-2 <= abs(value) < 1e4:
        return f"{value:g}".replace("-", "−")
    mantissa, exponent = f"{value:.0e}".split("e")
    power = f"{int(exponent)}".replace("-", "−")
    sign = "−" if value < 0 else ""
    return f"{sign}10$^{{{power}}}$" if mantissa.lstrip("-") == "1" else f"{mantissa}e{power}"


def bound_figure(ds):
    """True error and claimed bound against strength, up to the strength with a status."""
    present = [(d, q) for d, q in SHOWN if d in ds.difficulty.values and q in ds.quantity.values]
    figure = page(3.2)
    if not present:
        return figure
    row = figure.subplots(1, len(present), sharey=True, squeeze=False)[0]
    for axes, (difficulty, quantity) in zip(row, present, strict=True):
        _draw_bounds(axes, ds, difficulty, quantity)
    row[0].legend(fontsize=9, frameon=False, loc="upper left")
    lettered(*row)
    relation = "is not always" if (ds.violation == Violation.above_bound).any() else "is always"
    figure.suptitle(
        f"The claimed bound {relation} above the true error; where it ends, a status has the reason\n"
        f"({counted(ds)} at each strength, errors against {DIGITS} digits)", fontsize=TEXT + 1,
    )  # fmt: skip
    return figure


def _draw_bounds(axes, ds, difficulty, quantity):
    one = ds.sel(difficulty=difficulty, quantity=quantity).transpose("seed", "step", ...)
    strengths = one.strength.values
    n = int(np.isfinite(strengths).sum())
    steps, floor = np.arange(n), 1e-18
    answered = np.isin(one.outcome.values[:, :n], [*RIGHT, Outcome.violation])
    for seed in range(ds.sizes["seed"]):
        error = np.where(answered[seed], np.maximum(one.error.values[seed, :n], floor), np.nan)
        bound = np.where(answered[seed], one.bound.values[seed, :n], np.nan)
        wrong = one.outcome.values[seed, :n] == Outcome.violation
        axes.plot(steps, bound, "-", color=COLOURS[4], linewidth=2, label="claimed bound" if not seed else None)
        axes.plot(
            steps, error, "o-", color=COLOURS[0], markersize=3.5, linewidth=1, label="true error" if not seed else None
        )
        if wrong.any():
            label = None if seed else "silently wrong"
            axes.plot(steps[wrong], error[wrong], "X", color=COLOURS[2], markersize=9, label=label)
    silent = ~answered.any(axis=0)
    codes = one.answer_status.values[:, :n]
    for step in np.flatnonzero(silent):
        axes.axvspan(step - 0.5, step + 0.5, color="0.9", linewidth=0)
    if silent.any():
        names = np.unique([Status(int(c)).name.replace("_", " ") for c in codes[:, silent].ravel()])
        text = " / ".join(word for word in names if word != "missing") or "refused"
        axes.text(
            np.flatnonzero(silent).mean(), 0.5, text, rotation=90, ha="center", va="center", fontsize=TEXT,
            transform=axes.get_xaxis_transform(),
        )  # fmt: skip
    shown = steps[:: max(1, n // 3)]
    axes.set_xticks(shown, [_number(strengths[s]) for s in shown])
    axes.set(
        yscale="log",
        xlim=(-0.5, n - 0.5),
        ylim=(floor / 3, 1e2),
        xlabel=DIFFICULTIES[difficulty].label,
        title=quantity.replace("_", " "),
        ylabel="relative error" if axes.get_subplotspec().is_first_col() else "",
    )
    axes.spines[["top", "right"]].set_visible(False)


def claims(ds):
    """Silent wrong answers, bounds against errors, and the same of peers."""
    everything, ds = ds, _part(ds)
    wrong = _violations(ds)
    places = ", ".join(f"{count} {where}" for where, count in wrong.items())
    points = int((ds.outcome != Outcome.absent).sum())
    yield Claim(
        "violations", "no silent wrong answer", "not stated",
        f"{sum(wrong.values())} of {points} points" + (f": {places}" if wrong else ""),
        "differs" if wrong else "holds", "answers with status ok are wrong there" if wrong else "",
        "every point", plural(points, "point"), "check",
    )  # fmt: skip
    yield from _bound_claims(ds)
    share = 100 * float(np.isin(ds.outcome.values, RIGHT).sum() / max(points, 1))
    unknown = int((ds.outcome == Outcome.unknown).sum())
    yield Claim(
        "answered", "part of all points with a correct answer", "not stated",
        f"{share:.0f} %; the reference fails in {unknown}", "measured",
    )  # fmt: skip
    for name, row in _peers(everything).items():
        yield Claim(
            f"peer-{name.replace(' ', '-')}", f"{name} on the same strained springs, with its usual tolerance",
            "not stated",
            f"right in {row['right']} of {row['points']} points, silently wrong in {row['wrong']}, with a "
            f"status or message in {row['reported']}", "measured",
        )  # fmt: skip


def _violations(ds):
    """Number of violations by difficulty, quantity and kind."""
    wrong: dict[str, int] = {}
    table = ds.transpose("difficulty", "quantity", "seed", "step", ...)
    for d, q, seed, step in np.argwhere(table.outcome.values == Outcome.violation):
        kind = Violation(int(table.violation.values[d, q, seed, step])).name.replace("_", " ")
        where = f"{table.difficulty.values[d]}/{table.quantity.values[q]} ({kind})"
        wrong[where] = wrong.get(where, 0) + 1
    return wrong


def _bound_claims(ds):
    # Counts are whole numbers, which claim to be exact.
    claimed = (np.isfinite(ds.bound) & (ds.bound > 0)).values
    if not claimed.any():
        return
    error, bound = ds.error.values[claimed], ds.bound.values[claimed]
    above = int((error > bound).sum())
    yield Claim(
        "bounds", "the claimed bound is never below the true error", "not stated",
        f"below it in {above} of {len(error)} points", "differs" if above else "holds",
        "these bounds are too small" if above else "", "every point", plural(len(error), "point"), "check",
    )  # fmt: skip
    ratios = (np.maximum(ds.bound, ULP) / np.maximum(ds.error, ULP)).where(np.isfinite(ds.bound) & (ds.bound > 0))
    # In the order of the difficulties that first have such a bound.
    present = ratios.notnull().any(("seed", "step")).transpose("difficulty", "quantity")
    for quantity in dict.fromkeys(str(present.quantity.values[n]) for _, n in np.argwhere(present.values)):
        ratio = float(ratios.sel(quantity=quantity).median())
        yield Claim(
            f"bounds-{quantity}", f"the bound of {quantity} is within {WIDEST:g} times of the error (median)",
            "not stated", f"{ratio:.3g} times", "holds" if ratio <= WIDEST else "differs",
            "" if ratio <= WIDEST else "the bound is large; errors and bounds below a rounding count as one",
            f"median ≤ {WIDEST:g}", kind="check",
        )  # fmt: skip


def summary(ds):
    """Scalars for tables: violations, outcomes by quantity, and peers."""
    everything, ds = ds, _part(ds)
    counts = {}
    for quantity in map(str, ds.quantity.values):
        numbers = {o.name: int((ds.outcome.sel(quantity=quantity) == o).sum()) for o in list(Outcome)[1:]}
        counts[quantity] = {name: number for name, number in numbers.items() if number}
    return {
        "violations": sum(_violations(ds).values()),
        "violations_by_place": _violations(ds),
        "outcomes": counts,
        "peers": _peers(everything),
        "parameters": parameters(ds),
    }


def _peers(ds):
    """Of each peer the points by outcome, the error where it is silently wrong, and the calls of all answers."""
    found = {}
    for name in (name for name in PEERS if name in ds["quantity"].values):
        one = ds.sel(quantity=name)
        outcome = one.outcome.values
        ran = ~np.isin(outcome, (Outcome.absent, Outcome.unknown)) & (outcome >= 0)
        wrong = outcome == Outcome.violation
        if ran.any():
            found[name] = {
                "points": int(ran.sum()),
                "right": int(np.isin(outcome, RIGHT).sum()),
                "reported": int(np.isin(outcome, (Outcome.reported, Outcome.refused)).sum()),
                "wrong": int(wrong.sum()),
                "error": float(np.median(one.error.values[wrong])) if wrong.any() else None,
                "largest_error": float(one.error.values[wrong].max()) if wrong.any() else None,
                "calls": float(np.median(one.calls.values[ran])),
            }
    return found
