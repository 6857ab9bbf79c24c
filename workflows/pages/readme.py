"""Write the result tables of README.md from the committed summaries and claims: `python -m workflows.pages.readme`."""

from __future__ import annotations

import json
import re
from pathlib import Path

from .choices import choices, failures, sizes

ROOT = Path(__file__).parents[2]
COLUMNS = {
    "bulk_modulus_0": "B_0",
    "C_B_exact": "C_B",
    "shear_modulus_0": "G_0",
    "C_G_exact": "C_G, energy",
    "C_G_stress_corrected_exact": "C_G, stress-corrected",
    "length_variance": "V_L",
    "tension_variance": "V_τ",
    "stressed_fraction": "stressed edges",
}


def rendered(readme: str, results: Path) -> str:
    """The text of the README with its tables made anew from the results of the studies."""

    def read(study: str, name: str) -> dict:
        return json.loads((results / study / f"{name}.json").read_text(encoding="utf-8"))

    tables = {
        "tables": f"{_populations(read('ensemble', 'summary'))}\n\n{_claims(read('ensemble', 'claims'))}",
        "choices": choices(read("speed_accuracy", "summary")),
        "failures": failures(read("failure_map", "summary"), read("failure_map", "claims")),
        "sizes": sizes(read("scale", "summary")),
    }
    for name, text in tables.items():
        place = re.compile(rf"(<!-- {name}:[^>]*-->\n).*(<!-- /{name} -->)", flags=re.S)
        readme = place.sub(lambda m, text=text: f"{m[1]}{text}\n{m[2]}", readme)
    return readme


def _populations(summary: dict) -> str:
    head = f"Mean ± standard deviation over {summary['networks']} networks of "
    head += f"{summary['parameters']['n_vertices']} vertices, in units of k:"
    lines = [
        head,
        "",
        f"| population | {' | '.join(COLUMNS.values())} | solves |",
        "|---|" + "---|" * (len(COLUMNS) + 1),
    ]
    for population, rows in summary["populations"].items():
        cells = [_number(rows[name]) for name in COLUMNS]
        ended = ", ".join(f"{count} {status}" for status, count in rows["status"].items())
        lines.append(f"| {population} | {' | '.join(cells)} | {ended} |")
    return "\n".join(lines)


def _number(row: dict) -> str:
    if row["mean"] < 1e-12 and row["std"] < 1e-12:
        return f"< {max(row['q95'], 1e-30):.0e}"
    return f"{row['mean']:.3g} ± {row['std']:.1g}"


def _claims(claims: list[dict]) -> str:
    holding = sum(claim["verdict"] == "holds" for claim in claims)
    lines = [f"{holding} of {len(claims)} tested claims hold; reasons stand in `results/ensemble/claims.md`.", ""]
    lines += ["| the paper says | here | |", "|---|---|---|"]
    for claim in claims:
        lines.append(f"| {claim['statement']} | {claim['value']} | {claim['verdict']} |")
    return "\n".join(lines)


if __name__ == "__main__":
    path = ROOT / "README.md"
    path.write_text(rendered(path.read_text(encoding="utf-8"), ROOT / "results"), encoding="utf-8")
