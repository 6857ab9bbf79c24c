"""Write results/README.md from what the studies wrote: `python -m workflows.pages.results`.

`python -m workflows.pages.results --run [STUDY ...]` first runs studies at their full size with two workers
(one for those that allow no more), each in a separate folder, records their times in results/times.json, and copies
what git keeps of them.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from critflow.workflow.load import load_study

from .paper import EQUATIONS, FIGURES, MORE

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "results"
HEAD = """# Results

Every study of `workflows/`: its command, the time that it takes on two cores, its figures, and which claims of the
paper hold. The netCDF files are made by the commands and are not kept here. This page is written by
`python -m workflows.pages.results` from the claims and summaries beside it.
"""


def studies() -> list[str]:
    """The studies in the order in which the paper comes to them."""
    return list(dict.fromkeys(figure.study for figure in (*FIGURES, *MORE)))


def rendered(results: Path = RESULTS) -> str:
    """The text of results/README.md."""
    times = json.loads((results / "times.json").read_text(encoding="utf-8"))
    claims = {study: _claims(results, study) for study in studies()}
    parts = [HEAD, _overview(claims, times, results), *(_study(study, results) for study in studies()), _table(claims)]
    return "\n".join(parts)


def _claims(results: Path, study: str) -> list[dict]:
    return json.loads((results / study / "claims.json").read_text(encoding="utf-8"))


def _count(claims: list[dict]) -> str:
    tested = [claim for claim in claims if claim["verdict"] != "measured"]
    return f"{sum(claim['verdict'] == 'holds' for claim in tested)} of {len(tested)}"


def _overview(claims: dict[str, list[dict]], times: dict[str, float], results: Path) -> str:
    lines = ["| study | command | seconds | claims that hold | made by |", "|---|---|---|---|---|"]
    for study, its in claims.items():
        took = f"{times[study]:.0f}" if study in times else "not timed"
        count = f"[{_count(its)}]({study}/claims.md)"
        lines.append(
            f"| [{study}](#{study}) | `critflow run {study}` | {took} | {count} | {_made_by(study, results)} |"
        )
    total = [claim for its in claims.values() for claim in its]
    lines += ["", f"Together {_count(total)} tested claims hold.", ""]
    return "\n".join(lines)


def _made_by(study: str, results: Path) -> str:
    """The version, and the commit where the manifest knows it."""
    file = results / study / "manifest.json"
    if not file.exists():
        return "an earlier version, without a manifest"
    said = json.loads(file.read_text(encoding="utf-8"))["dataset"]
    words = [said["source"], said.get("commit", "")[:7], "changed" if said.get("commit_dirty") == "true" else ""]
    return f"[{' '.join(filter(None, words))}]({study}/manifest.json)"


def _study(study: str, results: Path) -> str:
    shown = [figure for figure in (*FIGURES, *MORE) if figure.study == study]
    lines = [f"## {study}", ""]
    for figure in shown:
        lines.append(f"- {figure.meaning}" + (f" (`{figure.label}`)" if figure.label else ""))
    lines += [f"- `critflow run {study}`; claims in [{study}/claims.md]({study}/claims.md)", ""]
    pictures = sorted((results / study / "figures").glob("*.png")) + sorted((results / study / "figures").glob("*.gif"))
    lines += [f"![{study}: {picture.stem}]({study}/figures/{picture.name})" for picture in pictures]
    return "\n".join([*lines, ""])


def _table(claims: dict[str, list[dict]]) -> str:
    lines = [
        "## The paper, label by label",
        "",
        "Functions are those of `critflow`, tests those of `tests/`; claims come from the studies, with the label of",
        "what they belong to as the beginning of their key.",
        "",
        "| label | what it is | where | held by | verdict |",
        "|---|---|---|---|---|",
    ]
    lines += [_row(f"`{e.label}`", e.meaning, f"`{e.function}`", f"`{e.test}`", e.verdict) for e in EQUATIONS]
    for figure in (*FIGURES, *MORE):
        its = claims[figure.study]
        command, table = f"`critflow run {figure.study}`", f"[claims]({figure.study}/claims.md)"
        label = f"`{figure.label}`" if figure.label else "(beyond the paper)"
        lines.append(_row(label, figure.meaning, command, table, f"{_count(its)} claims hold"))
    for study, its in claims.items():
        for claim in its:
            verdict = f"{claim['verdict']}: {claim['because']}" if claim["because"] else claim["verdict"]
            lines.append(
                _row(f"`{claim['key']}`", claim["statement"], f"`critflow run {study}`", claim["value"], verdict)
            )
    return "\n".join([*lines, ""])


def _row(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"


def run_anew(names: list[str]) -> None:
    """Run studies at their full size, note the seconds that each took, and keep their figures, claims and summary."""
    file = RESULTS / "times.json"
    times = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    for study in names:
        with tempfile.TemporaryDirectory() as folder:
            made = Path(folder) / study
            workers = str(load_study(study).study.worker_count(None, available=2))
            command = [Path(sys.executable).with_name("critflow"), "run", study, "--workers", workers, "--out", made]
            begin = time.perf_counter()
            subprocess.run(command, cwd=ROOT, check=True)
            times[study] = round(time.perf_counter() - begin, 1)
            (RESULTS / study).mkdir(exist_ok=True)
            for kept in ("figures", "claims.json", "claims.md", "summary.json", "manifest.json"):
                if (made / kept).is_dir():
                    shutil.rmtree(RESULTS / study / kept, ignore_errors=True)
                    shutil.copytree(made / kept, RESULTS / study / kept)
                elif (made / kept).exists():
                    shutil.copy(made / kept, RESULTS / study / kept)
        file.write_text(json.dumps(times, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        run_anew(sys.argv[2:] or studies())
    (RESULTS / "README.md").write_text(rendered(), encoding="utf-8")
