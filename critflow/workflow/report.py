"""The report of a dataset: figures, animations, claims and summary.  It uses the dataset alone."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from critflow.result import CritflowError, StudyError
from critflow.workflow.dataset import opened_dataset
from critflow.workflow.folder import Folder
from critflow.workflow.store import replacing, write_text
from critflow.workflow.study import Claim, Study

FORMATS = ("png", "pdf", "svg")

_FRAME, _LAST_FRAME = 140, 2500  # milliseconds


class ReportError(CritflowError):
    """A part of the report could not be made; the dataset is complete."""


@dataclass(frozen=True)
class Report:
    """Parts that were written, and parts that need variables which the run does not store."""

    written: list[str] = field(default_factory=list)  # figures and animations
    claims: list[Claim] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)


def write_report(study: Study, folder: Folder, format: str = "png") -> Report:
    """Write every part of the report; an error in one part does not stop the others.

    Parts that need variables which are not stored are left out, and their files of an earlier run are deleted.
    Raises `ReportError` if a part could not be made.
    """
    if format not in FORMATS:
        raise StudyError(f"figures can be {', '.join(FORMATS)}, not {format!r}")
    report, errors = Report(), dict[str, Exception]()
    with opened_dataset(folder.dataset(study.name)) as dataset:
        for part, paths, write in _parts(study, folder, dataset, format, report):
            if not study.can_report(part):
                report.left_out.append(part)
                for path in paths:
                    path.unlink(missing_ok=True)
                continue
            try:
                write()
            except CritflowError:
                raise
            except Exception as error:
                errors[part] = error
    if errors:
        part, cause = next(iter(errors.items()))
        others = f" (and {len(errors) - 1} more parts)" if len(errors) > 1 else ""
        raise ReportError(f"{part!r} could not be made{others}: {type(cause).__name__}: {cause}") from cause
    return report


def texts(study: Study, dataset: xr.Dataset) -> dict[str, Callable[[], dict[str, str]]]:
    """For each part of the report that is text, a function that returns its files by name."""
    parts: dict[str, Callable[[], dict[str, str]]] = {}
    if (claims := study.claims) is not None:
        parts["claims"] = lambda: _claims_files(study, list(claims(dataset)))
    if (summary := study.summary) is not None:
        parts["summary"] = lambda: {"summary.json": _json(summary(dataset))}
    return parts


def _parts(
    study: Study, folder: Folder, dataset: xr.Dataset, format: str, report: Report
) -> Iterator[tuple[str, list[Path], Callable[[], None]]]:
    """Name, files and writer of every part."""
    for name, draw in study.figures.items():
        path = folder.figures / f"{name}.{format}"
        yield name, [path], partial(_write_figure, path, draw, dataset, report)
    for name, frames in study.animations.items():
        path = folder.figures / f"{name}.gif"
        yield name, [path], partial(_write_animation, path, frames, dataset, report)
    names = {"claims": ("claims.json", "claims.md"), "summary": ("summary.json",)}
    for part, made in texts(study, dataset).items():
        paths = [folder.path / name for name in names[part]]
        yield part, paths, partial(_write_texts, folder.path, made, report)


def _write_figure(path: Path, draw: Callable[[xr.Dataset], Figure], dataset: xr.Dataset, report: Report) -> None:
    # Axes in three dimensions compute with the NaN of missing data.
    with np.errstate(over="ignore", invalid="ignore"):
        figure = draw(dataset)
        path.parent.mkdir(exist_ok=True)
        with replacing(path) as partial_path:
            # Without the version of matplotlib equal data give equal bytes.
            metadata = {"Software": None} if path.suffix == ".png" else None
            figure.savefig(partial_path, format=path.suffix[1:], metadata=metadata)
    plt.close(figure)
    report.written.append(path.stem)


def _write_animation(
    path: Path, frames: Callable[[xr.Dataset], Iterable[Figure]], dataset: xr.Dataset, report: Report
) -> None:
    images = []
    for figure in frames(dataset):
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
        plt.close(figure)
    if not images:
        raise ValueError("an animation needs at least one frame")
    path.parent.mkdir(exist_ok=True)
    durations = [_FRAME] * (len(images) - 1) + [_LAST_FRAME]
    with replacing(path) as partial_path:
        images[0].save(partial_path, "GIF", save_all=True, append_images=images[1:], duration=durations, loop=0)
    report.written.append(path.stem)


def _write_texts(folder: Path, made: Callable[[], dict[str, str]], report: Report) -> None:
    files = made()
    for name, text in files.items():
        write_text(folder / name, text)
    if "claims.json" in files:
        report.claims.extend(Claim(**claim) for claim in json.loads(files["claims.json"]))


def _claims_files(study: Study, claims: Sequence[Claim]) -> dict[str, str]:
    """The claims as JSON, and as a Markdown table followed by the reasons."""
    lines = [f"# {study.title}", "", "| claim | the paper says | paper | here | verdict |", "|---|---|---|---|---|"]
    lines += [f"| {_cells(c.key, c.statement, c.paper, c.value, c.verdict)} |" for c in claims]
    reasons = [f"- **{c.key}** {c.verdict}: {c.because}" for c in claims if c.because]
    table = "\n".join([*lines, *(["", *reasons] if reasons else [])]) + "\n"
    return {"claims.json": _json([asdict(claim) for claim in claims]), "claims.md": table}


def _cells(*cells: str) -> str:
    return " | ".join(text.replace("|", "\\|").replace("\n", " ") for text in cells)


def _json(value: Any) -> str:
    return json.dumps(_plain(value), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _plain(value: Any) -> Any:
    """Arrays and NumPy scalars as plain values, NaN and infinity as null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic, xr.DataArray)):
        return _plain(np.asarray(value).tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
