"""The report of a dataset: figures, animations, claims and summary.  It uses the dataset alone."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
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
from critflow.workflow.claim import Claim, claims_files
from critflow.workflow.dataset import opened_dataset
from critflow.workflow.folder import Folder
from critflow.workflow.store import replacing
from critflow.workflow.study import Study

FORMATS = ("png", "pdf", "svg")

_FRAME, _LAST_FRAME = 140, 2500  # milliseconds


class ReportError(CritflowError):
    """A part of the report could not be made; the dataset is complete."""


@dataclass(frozen=True)
class Report:
    """Parts that were written, and parts that need variables which the run does not store."""

    written: list[str] = field(default_factory=list)
    claims: list[Claim] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)


# A part of the report: its name, its files, and the function that makes their contents from the dataset.
Part = tuple[str, list[Path], Callable[[xr.Dataset], list[bytes]]]


def write_report(study: Study, folder: Folder, format: str = "png") -> Report:
    """Write every part of the report; an error in one part does not stop the others.

    Parts that need variables which are not stored are left out, and their files of an earlier run are deleted.
    Raises `ReportError` if a part could not be made.
    """
    if format not in FORMATS:
        raise StudyError(f"figures can be {', '.join(FORMATS)}, not {format!r}")
    report, errors = Report(), dict[str, Exception]()
    with opened_dataset(folder.dataset(study.name)) as dataset:
        pictures = [(name, format, partial(_figure, draw, format)) for name, draw in study.figures.items()]
        pictures += [(name, "gif", partial(_animation, frames)) for name, frames in study.animations.items()]
        parts: list[Part] = [(name, [folder.figures / f"{name}.{ending}"], make) for name, ending, make in pictures]
        for name, paths, make in [*parts, *text_parts(study, folder)]:
            if not study.can_report(name):
                report.left_out.append(name)
                for path in paths:
                    path.unlink(missing_ok=True)
                continue
            try:
                contents = make(dataset)
            except Exception as error:
                errors[name] = error
                continue
            for path, content in zip(paths, contents, strict=True):
                path.parent.mkdir(exist_ok=True)
                with replacing(path) as partial_path:
                    partial_path.write_bytes(content)
            report.written.append(name)
            if name == "claims":
                report.claims.extend(Claim(**claim) for claim in json.loads(contents[0]))
    if errors:
        name, cause = next(iter(errors.items()))
        others = f" (and {len(errors) - 1} more parts)" if len(errors) > 1 else ""
        raise ReportError(f"{name!r} could not be made{others}: {type(cause).__name__}: {cause}") from cause
    return report


def text_parts(study: Study, folder: Folder) -> list[Part]:
    """The parts that are text: equal datasets give equal bytes."""
    parts, path = list[Part](), folder.path
    if (claims := study.claims) is not None:
        files = [path / "claims.json", path / "claims.md"]
        parts.append(("claims", files, lambda dataset: _claims_files(study, dataset, claims(dataset))))
    if (summary := study.summary) is not None:
        parts.append(("summary", [path / "summary.json"], lambda dataset: [_json(summary(dataset))]))
    return parts


def _figure(draw: Callable[[xr.Dataset], Figure], format: str, dataset: xr.Dataset) -> list[bytes]:
    file = io.BytesIO()
    with np.errstate(over="ignore", invalid="ignore"):  # axes in three dimensions compute with NaN of missing data
        figure = _noted(draw(dataset), dataset)
        if (engine := figure.get_layout_engine()) is not None:
            # `savefig` would draw all twice, the first time for the layout alone.
            engine.execute(figure)
            figure.set_layout_engine("none")
        # Without the version of matplotlib equal data give equal bytes.
        figure.savefig(file, format=format, metadata={"Software": None} if format == "png" else None)
    plt.close(figure)
    return [file.getvalue()]


def _animation(frames: Callable[[xr.Dataset], Iterable[Figure]], dataset: xr.Dataset) -> list[bytes]:
    images, file = [], io.BytesIO()
    for figure in frames(dataset):
        canvas = FigureCanvasAgg(_noted(figure, dataset))
        canvas.draw()
        images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
        plt.close(figure)
    if not images:
        raise ValueError("an animation needs at least one frame")
    durations = [_FRAME] * (len(images) - 1) + [_LAST_FRAME]
    images[0].save(file, "GIF", save_all=True, append_images=images[1:], duration=durations, loop=0)
    return [file.getvalue()]


def code_note(dataset: xr.Dataset) -> str:
    """The sentence about a dataset whose cases were computed by several versions of the code, else empty."""
    if "code" not in dataset or "flag_meanings" not in dataset["code"].attrs:
        return ""
    return f"the cases are of {len(dataset['code'].attrs['flag_meanings'].split())} versions of the code"


def _noted(figure: Figure, dataset: xr.Dataset) -> Figure:
    if note := code_note(dataset):
        figure.text(0.005, 0.002, note, fontsize=6, color="#C00000")
    return figure


def _claims_files(study: Study, dataset: xr.Dataset, claims: Iterable[Claim]) -> list[bytes]:
    """The claims as JSON, and as Markdown."""
    axis = study.axes[0]
    note = code_note(dataset)
    texts = claims_files(study.title, claims, axis.counted(dataset.sizes[axis.name]), note)
    return [text.encode() for text in texts]


def _json(value: Any) -> bytes:
    return (json.dumps(_plain(value), indent=1, allow_nan=False, ensure_ascii=False) + "\n").encode()


def _plain(value: Any) -> Any:
    """Arrays and NumPy scalars as plain values, NaN and infinity as null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic, xr.DataArray)):
        return _plain(np.asarray(value).tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
