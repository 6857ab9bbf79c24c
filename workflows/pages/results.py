"""Write results/README.md from the committed results: `python -m workflows.pages.results`.

`python -m workflows.pages.results --run [STUDY ...]` first runs studies at their full size with two workers (one for
those that allow no more), each in a temporary folder, copies figures, claims and summary to results/reference, and
records seconds, version and commit in results/reference/runs.json.
"""

import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import xarray as xr
from PIL import Image, ImageSequence

from critflow.engine.code_digest import load_study
from critflow.engine.study import Claim

from ..paper.statements import STATEMENTS
from .paper import EQUATIONS, FIGURES, printed
from .tables import head, row
from .verdicts import committed, counts, statement_counts

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "results" / "README.md"
REFERENCE = ROOT / "results" / "reference"
KEPT = ("figures", "claims.json", "claims.md", "summary.json")
# Visible difference of a colour component, and the part of a picture that may have it.
_VISIBLE, _VISIBLE_PART = 6, 0.03
HEAD = """# Results

`critflow run NAME` writes to `results/NAME/`, which git ignores. `results/reference/NAME/` contains the results of the
paper that git keeps: figures, claims and summaries, with the lock files of the versions that made them. The netCDF
files are made by the commands. Figures and claims are made from the dataset of a run, sometimes by later code than the
run itself. Times are seconds with one or two processes, on two cores that other programs shared. This page is written
by `python -m workflows.pages.results`.
"""


def studies() -> list[str]:
    """The studies with committed results: those of the statements and the figures of the paper, then all others."""
    first = [figure.study for figure in FIGURES if figure.label]
    of_statements = [known.study for known in STATEMENTS.values()]
    return list(dict.fromkeys([*first, *of_statements, *(figure.study for figure in FIGURES)]))


def rendered(reference: Path = REFERENCE) -> str:
    """The text of results/README.md."""
    runs = json.loads((reference / "runs.json").read_text(encoding="utf-8"))
    runs_of = committed(reference)
    claims = {study: runs_of.get(study, []) for study in studies()}
    overview = _overview(claims, runs, reference)
    parts = [HEAD, overview, *(_study(study, reference) for study in studies()), _table(claims)]
    return "\n".join(parts)


def _overview(claims: dict[str, list[Claim]], runs: dict[str, dict], reference: Path) -> str:
    """One row a study, with the verdicts of the statements of the paper that it tests, and those of all studies."""
    lines = head("study", "command", "seconds", "statements of the paper", "made by")
    for study, its_claims in claims.items():
        run = runs.get(study, {})
        seconds = f"{run['seconds']:.0f}" if run.get("seconds") else ""
        made_by = f"{run.get('source', '')} {run.get('commit', '')[:7]}".strip()
        verdicts = f"[{counts(its_claims) or 'none'}](reference/{study}/claims.md)"
        lines.append(row(f"[{study}](#{study})", f"`critflow run {study}`", seconds, verdicts, made_by))
    return "\n".join([*lines, "", statement_counts(reference), ""])


def _study(study: str, reference: Path) -> str:
    """Its pictures in the order of the paper, each with its number and content, and links to those not listed."""
    claims, folder = f"reference/{study}/claims.md", reference / study / "figures"
    lines = [f"## {study}", "", f"- `critflow run {study}`; claims in [{claims}]({claims})"]
    shown: list[str] = []
    for figure in (figure for figure in FIGURES if figure.study == study):
        caption = f"{printed(figure.label) or 'Beyond the paper'}: {figure.meaning}"
        files = [
            f"{name}.{kind}"
            for name in figure.pictures
            for kind in ("png", "gif")
            if (folder / f"{name}.{kind}").is_file()
        ]
        lines += [
            "",
            *(_picture(study, file, caption) for file in files),
            "",
            f"*{caption}. {figure.seen}".rstrip() + "*",
        ]
        shown += files
    others = sorted({file.name for kind in ("png", "gif") for file in folder.glob(f"*.{kind}")} - set(shown))
    if others:
        links = (f"[{Path(file).stem}](reference/{study}/figures/{file})" for file in others)
        lines += ["", f"More pictures: {', '.join(links)}."]
    return "\n".join([*lines, ""])


def _picture(study: str, file: str, text: str) -> str:
    return f"![{text}](reference/{study}/figures/{file})"


def _table(claims: dict[str, list[Claim]]) -> str:
    lines = [
        "## The paper, number by number",
        "",
        "Functions are in `critflow` unless their folder is named, tests in `tests/`. Equations and figures have the",
        "numbers that the paper prints; its claims stand in the tables of the studies.",
        "",
        *head("paper", "meaning", "where", "checked by", "verdict"),
    ]
    lines += [row(printed(e.label), e.meaning, f"`{e.function}`", f"`{e.test}`", e.verdict) for e in EQUATIONS]
    for figure in FIGURES:
        command, table = f"`critflow run {figure.study}`", f"[claims](reference/{figure.study}/claims.md)"
        label = printed(figure.label) if figure.label else "(beyond the paper)"
        lines.append(row(label, figure.meaning, command, table, counts(claims[figure.study])))
    return "\n".join([*lines, ""])


def run_again(names: list[str]) -> None:
    """Run studies at their full size and keep their figures, claims and summaries with the record of the run."""
    file = REFERENCE / "runs.json"
    runs = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    for study in names:
        with tempfile.TemporaryDirectory() as folder:
            made = Path(folder) / study
            workers = str(load_study(study).study.worker_count(None, available=2))
            command = [Path(sys.executable).with_name("critflow"), "run", study, "--workers", workers, "--out", made]
            begin = time.perf_counter()
            subprocess.run(command, cwd=ROOT, check=True)
            seconds = round(time.perf_counter() - begin, 1)
            with xr.open_dataset(made / f"{study}.nc") as dataset:
                runs[study] = {
                    "seconds": seconds,
                    **{name: dataset.attrs.get(name, "") for name in ("source", "commit")},
                }
            keep(made, REFERENCE / study)
        file.write_text(json.dumps(runs, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def keep(made: Path, kept: Path) -> None:
    """Copy the files of a results folder that git keeps."""
    kept.mkdir(parents=True, exist_ok=True)
    for name in KEPT:
        if (made / name).is_dir():
            shutil.rmtree(kept / name, ignore_errors=True)
            shutil.copytree(made / name, kept / name)
            for picture in sorted({*(kept / name).glob("*.png"), *(kept / name).glob("*.gif")}):
                reduce(picture)
        elif (made / name).exists():
            shutil.copy(made / name, kept / name)
        else:
            (kept / name).unlink(missing_ok=True)


def reduce(picture: Path) -> None:
    """Store a PNG file with 256 colours where the difference is invisible, and a GIF file with 48 colours."""
    with Image.open(picture) as image:
        frames = [frame.convert("RGB") for frame in ImageSequence.Iterator(image)]
        durations = [frame.info.get("duration", 0) for frame in ImageSequence.Iterator(image)]
        resolution = image.info.get("dpi")
    if picture.suffix == ".gif":
        palette = frames[len(frames) // 2].quantize(48, dither=Image.Dither.NONE)
        few, *others = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
        few.save(picture, save_all=True, append_images=others, duration=durations, loop=0, optimize=False)
        return
    few = frames[0].quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    error = np.abs(np.asarray(frames[0]).astype(int) - np.asarray(few.convert("RGB"))).max(axis=2)
    if np.mean(error > _VISIBLE) < _VISIBLE_PART:
        few.save(picture, optimize=True, dpi=resolution)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        run_again(sys.argv[2:] or studies())
    PAGE.write_text(rendered(), encoding="utf-8")
