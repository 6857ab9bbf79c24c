"""Fill the tables of Markdown pages from results/reference: `python -m workflows.pages.tables [FILE.md ...]`.

A table stands between `<!-- NAME: any text -->` and `<!-- /NAME -->`, with a NAME of `TABLES`.  Without a file,
README.md and the pages of docs/ are filled, at the root and in extras/.
"""

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from textwrap import fill

from ..paper.verdicts import COMMITTED
from ..shared.populations import NAMES
from .packages import CRITFLOW, PACKAGES, Package, package_of
from .paper import EQUATIONS, named
from .verdicts import (
    committed,
    differences,
    found,
    holding,
    links,
    of_committed_run,
    plain,
    statement_counts,
    what_we_found,
)

# Both conventions of C_G: the sign that the paper states of max G_0 is that of the stress-corrected one.
MODULI = {
    "B_0": "B_0",
    "C_B": "C_B",
    "G_0": "G_0",
    "C_G": "C_G, energy",
    "C_G_stress_corrected": "C_G, stress-corrected",
}
STRUCTURE = {
    "V_L": "V_L",
    "V_tau": "V_τ",
    "stressed_fraction": "stressed edges",
    "tension_fraction": "edges under tension",
}
# Other programs in the study of speed; the names of their methods begin with these.
PROGRAMS = ("LAMMPS", "ASE", "matscipy", "jax_fdm")
# The default method of each task and the reason for it, from the measurements.
REASONS = {
    "configuration": "QDLDL for small matrices, SuperLU or Pardiso for large ones",
    "min_V_L": "an iteration towards equal lengths, ended by Newton's method",
    "min_V_tau": "L-BFGS; Newton's method where gradients alone stop",
    "max_B_0": "closed form: one solve attains the bound",
    "max_G_0": "L-BFGS with the known curvature of the penalty; Newton's method where it stops",
    "min_V_L_pinned": "as above, on pinned networks, which other packages support",
    "strain_step": "Newton's method: no other reaches these errors, since the softness grows as 1/γ",
    "moduli": "linear response with the factor of the last Newton step",
}


def filled(page: str, package: Package = CRITFLOW) -> str:
    """The text of a page with its tables made from the results of the studies."""

    def table(match: re.Match[str]) -> str:
        if match["name"] not in TABLES:
            raise ValueError(f"there is no table {match['name']!r}: the tables are {', '.join(TABLES)}")
        return f"{match['head']}{TABLES[match['name']](package)}\n{match['tail']}"

    marked = r"(?P<head><!-- (?P<name>\w+):[^>]*-->\n).*?(?P<tail><!-- /(?P=name) -->)"
    return re.sub(marked, table, page, flags=re.S)


def _read(package: Package, study: str, name: str) -> dict:
    return json.loads((package.reference / study / f"{name}.json").read_text(encoding="utf-8"))


def row(*cells: str) -> str:
    """One row of a table in Markdown."""
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def head(*cells: str) -> list[str]:
    """The heading of a table, and the line below it."""
    return [row(*cells), "|" + "---|" * len(cells)]


# The ensemble


def measures(package: Package) -> str:
    """One row a population in each of two tables: the response; the structure and the outcomes of the solves."""
    summary = _read(package, "ensemble", "summary")
    return "\n".join(
        [
            f"Median and range of 90 % of {summary['networks']} networks of {summary['parameters']['n_vertices']} "
            "vertices, in units of k. n is the number of networks; a second number is that of C_B and C_G:",
            "",
            *_rows(summary, MODULI),
            "",
            *_rows(summary, STRUCTURE, outcomes=True),
        ]
    )


def _rows(summary: dict, columns: dict[str, str], outcomes: bool = False) -> list[str]:
    lines = head("population", "n", *columns.values(), *(["outcomes"] if outcomes else []))
    for population, rows in summary["populations"].items():
        n = sorted({rows[name]["n"] for name in columns}, reverse=True)  # edges of zero length leave C_B, C_G undefined
        cells = [NAMES[population], ", ".join(map(str, n)), *(_spread(rows[name]) for name in columns)]
        if outcomes:
            cells.append(", ".join(f"{count} {status}" for status, count in rows["status"].items()))
        lines.append(row(*cells))
    return lines


def _spread(row: dict) -> str:
    if 0 <= row["q95"] < 1e-12:
        return f"< {max(row['q95'], 1e-30):.0e}"
    return f"{row['median']:.3g} ({row['q05']:.3g} to {row['q95']:.3g})"


# Speed, size and failure


def speed(package: Package) -> str:
    """One row a task and size: time and error of the default method, the nearest package, the reason."""
    lines = head("task", "N_v", "time", "once", "error", "nearest package", "reason")
    for word, task in _read(package, "speed", "summary")["tasks"].items():
        for n, (size, cells) in enumerate(task["sizes"].items()):
            title, reason = ("", "") if n else (plain(task["title"]), REASONS[word])
            shown = _multiple(*nearest) if (nearest := _nearest(cells)) else "none"
            lines.append(row(title, f"{int(size):,}", *_best(cells), shown, reason))
    return "\n".join(lines)


def speed_line(package: Package) -> str:
    """Time and error of a strain step at 1,000 vertices, the nearest package, and where all others end."""
    summary = _read(package, "speed", "summary")
    cells = summary["tasks"]["strain_step"]["sizes"]["1000"]
    seconds, _, error = _best(cells)
    text = f"A strain step of 1,000 vertices at γ = 0.001 takes {seconds}, with an error of {error}"
    if nearest := _nearest(cells):
        name, finest, (ratio, _) = nearest
        text += f"; {name}, the nearest package, reaches {_power(finest)} in {_number(ratio)} times the time"
    others = [one for name, one in summary["gamma"]["tasks"]["strain_step"].items() if name != "Newton"]
    reached = [g for one in others for g, n in zip(one["gamma"], _failures(one), strict=True) if n <= 0.5]
    if reached:
        text += f". Below γ = {_power(min(reached))} no other method comes to within one percent"
    return fill(f"{text}.", 120)


def _failures(approach: dict) -> list[float]:
    """Part of the networks in which a method fails, at each γ."""
    rows = zip(approach["gave_up"], approach["wrong"], approach["networks"], strict=True)
    return [(gave_up + wrong) / networks for gave_up, wrong, networks in rows]


def _power(value: float) -> str:
    # At the sign of minus no line is broken.
    return f"{value:.0e}".replace("e-0", "e-").replace("-", "−")


def programs(_: Package) -> str:
    """One row a task and size that other programs solve as well: time of critflow, and theirs as multiples of it."""
    lines = head("task", "N_v", "critflow", "once", "error", "other programs at their finest error, prepared / in all")
    for task in _read(CRITFLOW, "speed", "summary")["tasks"].values():
        for size, cells in task["sizes"].items():
            others = [_multiple(*one) for one in _finest(cells) if one[0].startswith(PROGRAMS)]
            if others:
                lines.append(row(plain(task["title"]), f"{int(size):,}", *_best(cells), "; ".join(others)))
    return "\n".join(lines)


def _best(cells: dict) -> tuple[str, str, str]:
    """Time of the default at its least error, of its preparation, and the error."""
    seconds, error = min(cells["default"], key=lambda point: point[::-1])
    return _time(seconds), _time(cells["preparation"]), _power(error)


def _finest(cells: dict) -> list[tuple[str, float, list[float]]]:
    """Other methods, the finest error of each and the default, and their times for it over that of the default."""
    known = {name: [one for one in its.items() if one[1][0]] for name, its in cells["others"].items()}
    return [(name, float(its[-1][0]), its[-1][1]) for name, its in known.items() if its]


def _nearest(cells: dict) -> tuple[str, float, list[float]] | None:
    """That of another package with the finest error, of several the fastest."""
    packages = [one for one in _finest(cells) if one[0] in cells["packages"]]
    return min(packages, key=lambda one: (one[1], one[2][0]), default=None)


def _multiple(name: str, error: float, ratios: list[float]) -> str:
    """Prepared / with the preparation."""
    return f"{name}, {_power(error)}: {' / '.join(map(_number, ratios))} ×"


def _time(seconds: float) -> str:
    return f"{_number(1e3 * seconds)} ms" if seconds < 1 else f"{_number(seconds)} s"


def _number(value: float) -> str:
    """Two digits, and no power of ten for large numbers."""
    return f"{value:,.0f}" if value >= 99.5 else f"{value:.2g}"


def sizes(package: Package) -> str:
    """One row a stage: seconds at every size, and the exponent of the large sizes."""
    summary = _read(package, "speed", "summary")["stages"]
    powers = summary["exponents_from_10000"]
    lines = head("seconds at N_v = ", *(f"{n:,}" for n in summary["n_vertices"]), "exponent from 10⁴")
    for stage, seconds in summary["seconds"].items():
        cells = (f"{s:.2g}" if s is not None else "" for s in seconds)
        lines.append(row(stage, *cells, f"{powers[stage]:.2f}" if stage in powers else ""))
    return "\n".join(lines)


def failures(package: Package) -> str:
    """The number of silent wrong answers in a sentence."""
    summary = _read(package, "failure_map", "summary")
    counts = summary["outcomes"].values()
    points = sum(sum(kinds.values()) for kinds in counts)
    correct = sum(kinds.get(kind, 0) for kinds in counts for kind in ("exact", "bounded", "tolerated"))
    refused = sum(kinds.get(kind, 0) for kinds in counts for kind in ("reported", "refused"))
    return (
        f"Of {points:,} points (all quantities at all strengths of all difficulties) {correct:,} are correct within\n"
        f"the claimed bound or tolerance; {refused:,} return a status or an error message with the reason.\n"
        f"Silent wrong answers: {summary['violations']}."
    )


def peers(package: Package) -> str:
    """One row a method or program: points by outcome, error where it is silently wrong, and calls."""
    lines = head("method", "points", "right", "status or message", "silently wrong", "error there", "calls")
    for name, its in _read(package, "failure_map", "summary").get("peers", {}).items():
        wrong = f"{_number(100 * its['error'])} %" if its["wrong"] else ""
        counts = (f"{its[kind]:,}" for kind in ("points", "right", "reported", "wrong"))
        lines.append(row(name, *counts, wrong, _number(its["calls"])))
    return "\n".join(lines)


def approach(package: Package) -> str:
    """One row a method: median calls of a strain step to an error of one percent at each γ, or how it fails."""
    towards = _read(package, "speed", "summary").get("gamma", {"gamma": (), "tasks": {}})
    gammas = sorted(towards["gamma"], reverse=True)
    lines = head("calls at γ = ", *map(_power, gammas))
    for name, its in towards["tasks"].get("strain_step", {}).items():
        at = dict(zip(its["gamma"], zip(_failures(its), its["calls_median"], strict=True), strict=True))
        lines.append(row(name, *("fails" if at[g][0] > 0.5 else f"{at[g][1]:,.0f}" for g in gammas)))
    return "\n".join(lines)


# The equations of the paper


def equations(page: str) -> str:
    """One row for each function of a page of docs/theory: the numbers of the equations that it computes."""
    numbers: dict[str, list[str]] = {}
    for one in sorted((one for one in EQUATIONS if one.page == page), key=lambda one: int(one.number)):
        numbers.setdefault(f"`{named(one.function)}`", []).append(f"({one.number})")
    return "\n".join([*head("paper", "function"), *(row(", ".join(its), name) for name, its in numbers.items())])


_OF_VERDICTS = (statement_counts, differences, holding, found, links, what_we_found)
TABLES: dict[str, Callable[[Package], str]] = {
    table.__name__: table
    for table in (measures, *_OF_VERDICTS, speed, speed_line, programs, sizes, failures, peers, approach)
} | {f"equations_{page}": lambda _, page=page: equations(page) for page in {e.page: None for e in EQUATIONS}}


def pages(package: Package) -> list[Path]:
    """The pages of a package that are filled by default, without those that the site makes."""
    docs = package.folder / "docs"
    made = {*(docs / "_build").rglob("*.md"), *(docs / "notebooks").glob("0*.md")}
    return [package.folder / "README.md", *sorted(set(docs.rglob("*.md")) - made)]


def committed_runs() -> str:
    """The verdicts of the committed runs of all studies, as the studies read them."""
    runs = {study: of_committed_run(package, study) for package in PACKAGES for study in committed(package)}
    kept = {study: text for study, text in sorted(runs.items()) if text}
    return json.dumps(kept, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    COMMITTED.write_text(committed_runs(), encoding="utf-8")
    for path in map(Path, sys.argv[1:]) if sys.argv[1:] else [page for one in PACKAGES for page in pages(one)]:
        path.write_text(filled(path.read_text(encoding="utf-8"), package_of(path)), encoding="utf-8")
