"""Write results/README.md of both packages from the committed results: `python -m workflows.pages.results`.

`python -m workflows.pages.results --run STUDY ...` first runs studies at their full size with two workers (one for
those that allow no more), each in a temporary folder, copies figures, claims and summary to results/reference of their
package, and records seconds, version and commit in its runs.json.
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

from critflow.engine.code_digest import load_study, named_studies

from ..paper.statements import STATEMENTS
from .packages import CRITFLOW, PACKAGES, ROOT, Package, package_of
from .paper import EQUATIONS, FIGURES, printed
from .tables import head, row
from .verdicts import committed, counts, statement_counts

KEPT = ("figures", "claims.json", "claims.md", "summary.json")
# Visible difference of a colour component, and the part of a picture that may have it.
_VISIBLE, _VISIBLE_PART = 6, 0.03
HEAD = """# Results of {package.name}

`critflow run NAME` writes to `results/NAME/`, which git ignores. `reference/NAME/` has what git keeps of a run:
figures, claims and summary. They are made from the dataset of a run, sometimes by later code than the run itself.
Times are seconds with one or two processes, on two cores that other programs shared. This page is written by
`python -m workflows.pages.results`.
"""


def studies(package: Package) -> list[str]:
    """The studies with committed results: those of the figures of the paper and of its statements, then all others."""
    figures = FIGURES[package.name]
    first = [figure.study for figure in figures if figure.label] + [known.study for known in STATEMENTS.values()]
    present = sorted(folder.name for folder in package.reference.iterdir() if folder.is_dir())
    known = dict.fromkeys([*first, *(figure.study for figure in figures), *present])
    return [study for study in known if study in present]


def rendered(package: Package) -> str:
    """The text of results/README.md."""
    sections = [_study(study, package) for study in studies(package)]
    equations = [_equations()] if package == CRITFLOW else []
    return "\n".join([HEAD.format(package=package), _overview(package), *sections, *equations])


def _overview(package: Package) -> str:
    """One row a study, with its verdicts on statements of the paper, then those of all studies."""
    runs = json.loads((package.reference / "runs.json").read_text(encoding="utf-8"))
    claims = committed(package)
    lines = head("study", "what it computes", "seconds", "claims", "made by")
    for study in studies(package):
        page = f"reference/{study}/claims.md"
        title = (package.folder / "results" / page).read_text(encoding="utf-8").split("\n", 1)[0].removeprefix("# ")
        run = runs[study]
        verdicts = f"[{counts(claims[study]) or 'measurements'}]({page})"
        made_by = f"{run['source']} {run['commit'][:7]}"
        lines.append(row(f"[{study}](#{study})", title, f"{run['seconds']:.0f}", verdicts, made_by))
    return "\n".join([*lines, "", *([statement_counts(package), ""] if package == CRITFLOW else [])])


def _study(study: str, package: Package) -> str:
    """Its pictures in the order of the paper, each with its number and content, and links to those not listed."""
    folder = package.reference / study / "figures"
    present = sorted(file for kind in ("png", "gif") for file in folder.glob(f"*.{kind}"))
    lines, shown = [f"## {study}"], set[Path]()
    for figure in (figure for figure in FIGURES[package.name] if figure.study == study):
        label = printed(figure.label) or "Beyond the paper"
        files = [file for name in figure.pictures for file in present if file.stem == name]
        pictures = [f"![{label}](reference/{study}/figures/{file.name})" for file in files]
        lines += ["", *pictures, "", f"*{label}: {figure.meaning}. {figure.seen}".rstrip() + "*"]
        shown |= {*files}
    if others := [file for file in present if file not in shown]:
        names = (f"[{file.stem}](reference/{study}/figures/{file.name})" for file in others)
        lines += ["", f"More pictures: {', '.join(names)}."]
    if len(lines) == 1:
        lines += ["", f"It has no figures: [its claims](reference/{study}/claims.md)."]
    return "\n".join([*lines, ""])


def _equations() -> str:
    """One row for each equation of the paper: its function, its test and its verdict."""
    lines = [
        "## The paper, number by number",
        "",
        "Equations have the numbers that the paper prints. Functions are in `critflow`, tests in `tests/`, unless the",
        "folder is named.",
        "",
        *head("paper", "meaning", "function", "test", "verdict"),
    ]
    lines += [row(printed(e.label), e.meaning, f"`{e.function}`", f"`{e.test}`", e.verdict) for e in EQUATIONS]
    return "\n".join([*lines, ""])


def run_again(names: list[str]) -> None:
    """Run studies at their full size and keep their figures, claims and summaries with the record of the run."""
    for study in names:
        reference = package_of(named_studies()[study]).reference
        file = reference / "runs.json"
        runs = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        with tempfile.TemporaryDirectory() as folder:
            made = Path(folder) / study
            workers = str(load_study(study).study.worker_count(None, available=2))
            command = [Path(sys.executable).with_name("critflow"), "run", study, "--workers", workers, "--out", made]
            begin = time.perf_counter()
            subprocess.run(command, cwd=ROOT, check=True)
            seconds = round(time.perf_counter() - begin, 1)
            with xr.open_dataset(made / f"{study}.nc") as dataset:
                versions = {name: dataset.attrs.get(name, "") for name in ("source", "commit")}
            runs[study] = {"seconds": seconds, **versions}
            keep(made, reference / study)
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
        run_again(sys.argv[2:] or [study for package in PACKAGES for study in studies(package)])
    for package in PACKAGES:
        (package.folder / "results" / "README.md").write_text(rendered(package), encoding="utf-8")
