"""What is read off a finished dataset: figures, claims and the scalar summary.  No physics is called here."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

from critflow.result import CritflowError, IntegrityError, Status, StudyError
from critflow.workflow.errors import ReportError
from critflow.workflow.folder import Folder
from critflow.workflow.manifest import write_manifest
from critflow.workflow.pictures import gif, picture
from critflow.workflow.probe import refusal
from critflow.workflow.store import check_seal, write_text, written_beside
from critflow.workflow.study import Claim, Study

_ANEW = "run the study again to write it anew"
FORMATS = ("png", "pdf", "svg")


@dataclass(frozen=True)
class Report:
    """What was read off a dataset, and what could not be because the run left its variables out."""

    written: list[str] = field(default_factory=list)  # figures and animations by name
    claims: list[Claim] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)


def left_out_by(study: Study, error: Exception) -> bool:
    """Whether an error of xarray is about a variable that this run was asked to leave out, or a dimension of one."""
    here = {*study.axis_names, *(name for variable in study.variables for name in (variable.name, *variable.dims))}
    missing = {name for variable in study.left_out for name in (variable.name, *variable.dims)} - here
    return isinstance(error, (KeyError, AttributeError, ValueError)) and any(
        f"'{name}'" in str(error) for name in missing
    )


@contextmanager
def opened_dataset(path: Path, *, known: bool = False) -> Iterator[xr.Dataset]:
    """A dataset that a study wrote, or a sentence about why it cannot be read; `known` when this process wrote it."""
    if not path.exists():
        raise StudyError(f"there is no dataset {path}: run the study first")
    unreadable = f"{path} is not a readable dataset"
    if not path.is_file():
        raise IntegrityError(f"{unreadable}: it is not a file: {_ANEW}")
    check_seal(path)
    if not known and (reason := refusal(path)):
        raise IntegrityError(f"{unreadable}: {reason}: {_ANEW}")
    try:
        dataset = xr.open_dataset(path, engine="netcdf4")
    except MemoryError:
        raise
    except Exception as error:  # attributes can make the decoding raise anything
        raise IntegrityError(f"{unreadable}: {_ANEW}") from error
    with dataset:
        axes = dataset.attrs.get("axes")
        if "study" not in dataset.attrs or not isinstance(axes, str):
            raise IntegrityError(f"{path} was not written by `critflow run`: it names no study")
        status = dataset.get("status")
        if status is None or status.dtype.kind != "i" or not set(axes.split()) <= set(map(str, dataset.indexes)):
            raise IntegrityError(f"{path} was not written by `critflow run`: it has no status along labelled axes")
        if not np.isin(status.values, list(Status)).all():
            raise IntegrityError(f"{path} was not written by `critflow run`: its status has no meaning")
        yield dataset


def write_report(study: Study, folder: Folder, format: str = "png", *, known: bool = False) -> Report:
    """Write all that the study reads off its dataset; one bad part does not keep others back.

    What needs variables that the run left out is left out too, and files of it from a fuller run are deleted.
    """
    if format not in FORMATS:
        raise StudyError(f"figures can be {', '.join(FORMATS)}, not {format!r}")
    report = Report()
    troubles: dict[str, Exception] = {}

    @contextmanager
    def part(what: str, *files: Path) -> Iterator[None]:
        try:
            yield
        except CritflowError:
            raise
        except Exception as error:
            if left_out_by(study, error):
                report.left_out.append(what)
                for file in files:
                    file.unlink(missing_ok=True)
            else:
                troubles[what] = error

    with opened_dataset(folder.dataset(study.name), known=known) as dataset:
        for name, draw in study.figures.items():
            # Where nothing is to be drawn stands NaN, which the layout of three-dimensional axes computes with.
            path = folder.figures / f"{name}.{format}"
            with part(f"figure {name!r}", path), np.errstate(over="ignore", invalid="ignore"):
                figure = draw(dataset)
                _write_picture(path, picture(figure, format))
                plt.close(figure)
                report.written.append(name)
                report.files.append(path)
        for name, frames in study.animations.items():
            path = folder.figures / f"{name}.gif"
            with part(f"animation {name!r}", path):
                _write_picture(path, gif(frames(dataset)))
                report.written.append(name)
                report.files.append(path)
        if study.claims is not None:
            words, table = folder.path / "claims.json", folder.path / "claims.md"
            with part("the claims", words, table):
                claims = list(study.claims(dataset))
                for file, text in zip((words, table), claims_texts(study, claims), strict=True):
                    write_text(file, text)
                    report.files.append(file)
                report.claims.extend(claims)
        if study.summary is not None:
            path = folder.path / "summary.json"
            with part("the summary", path):
                write_text(path, summary_text(study.summary(dataset)))
                report.files.append(path)
        write_manifest(folder.path, dataset.attrs, report.files)
    if troubles:
        what, error = next(iter(troubles.items()))
        others = f" (and {len(troubles) - 1} more)" if len(troubles) > 1 else ""
        raise ReportError(f"{what} could not be made{others}: {type(error).__name__}: {error}") from error
    return report


def _write_picture(path: Path, content: bytes) -> None:
    path.parent.mkdir(exist_ok=True)
    with written_beside(path) as partial:
        partial.write_bytes(content)


def claims_texts(study: Study, claims: Sequence[Claim]) -> tuple[str, str]:
    """What claims.json and claims.md say."""
    return _json([asdict(claim) for claim in claims]), claims_table(study, claims)


def summary_text(summary: Mapping[str, Any]) -> str:
    """What summary.json says."""
    return _json(summary)


def claims_table(study: Study, claims: Sequence[Claim]) -> str:
    """The claims as a Markdown table, the reasons of those that differ below it."""
    lines = [f"# {study.title}", "", "| claim | the paper says | paper | here | verdict |", "|---|---|---|---|---|"]
    lines += [f"| {_cells(c.key, c.statement, c.paper, c.value, c.verdict)} |" for c in claims]
    reasons = [f"- **{c.key}** {c.verdict}: {c.because}" for c in claims if c.because]
    return "\n".join([*lines, *(["", *reasons] if reasons else [])]) + "\n"


def _cells(*texts: str) -> str:
    return " | ".join(text.replace("|", "\\|").replace("\n", " ") for text in texts)


def _json(value: Any) -> str:
    return json.dumps(_plain(value), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _plain(value: Any) -> Any:
    """Arrays and their scalars as plain values, NaN and infinity as null; `json` refuses what it has no word for."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic, xr.DataArray)):
        return _plain(np.asarray(value).tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
