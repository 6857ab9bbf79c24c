"""The report of a dataset: figures, animations, claims and summary.  It uses the dataset alone."""

from __future__ import annotations

import io
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from critflow.engine.dataset import opened_dataset
from critflow.engine.store import Folder, replacing
from critflow.engine.study import DIFFERENCES, KINDS, VALID, Claim, Study, Validity, plural, valid_members
from critflow.result import CritflowError, StudyError

FORMATS = ("png", "pdf", "svg")
_MEANING = '"Differs" means that the sentence of the paper and the measurement disagree.'

_MOVING, _FRAME, _LAST_FRAME = "gif", 140, 2500  # ending of animations; milliseconds


class ReportError(CritflowError):
    """A part of the report could not be made; the dataset is complete."""


def write_report(study: Study, folder: Folder, format: str = "png") -> tuple[list[str], list[str]]:
    """Write every part of the report; an error in one part does not stop the others.

    Parts that need variables which are not stored are left out, and their files of an earlier run are deleted.
    Returns lines about the parts, and lines about the verdicts.  Raises `ReportError` if a part could not be made.
    """
    if format not in FORMATS:
        raise StudyError(f"figures can be {', '.join(FORMATS)}, not {format!r}")
    written, left_out, claims, errors = list[str](), list[str](), list[Claim](), dict[str, Exception]()
    with opened_dataset(folder.dataset(study.name)) as dataset:
        # A figure and an animation may have the same name.
        pictures = [(name, format) for name in study.figures] + [(name, _MOVING) for name in study.animations]
        parts = [(name, [folder.figures / f"{name}.{ending}"], ending) for name, ending in pictures]
        parts += [(name, paths, "") for name, paths in text_files(study, folder).items()]
        for name, paths, ending in parts:
            if not study.can_report(name):
                left_out.append(name)
                for path in paths:
                    path.unlink(missing_ok=True)
                continue
            try:
                contents = _picture(study, name, dataset, ending) if ending else texts(study, name, dataset)
            except Exception as error:
                errors[name] = error
                continue
            for path, content in zip(paths, contents, strict=True):
                path.parent.mkdir(exist_ok=True)
                with replacing(path) as partial:
                    partial.write_bytes(content)
            written.append(name)
            if name == "claims" and not ending:
                claims = [Claim(**claim) for claim in json.loads(contents[0])]
    if errors:
        name, cause = next(iter(errors.items()))
        others = f" (and {len(errors) - 1} more parts)" if len(errors) > 1 else ""
        raise ReportError(f"{name!r} could not be made{others}: {type(cause).__name__}: {cause}") from cause
    parts_of = {"": written, "not made, because the run does not store their variables: ": left_out}
    lines = [f"{folder.path}: {text}{', '.join(names)}" for text, names in parts_of.items() if names]
    return lines, _verdicts(study, claims, folder) if claims else []


def _verdicts(study: Study, claims: Sequence[Claim], folder: Folder) -> list[str]:
    """The verdicts of a report in words, and those of the committed run of the study."""
    link = f": see {folder.path / 'claims.md'}"
    tested = [text for kind in KINDS if (text := verdict_sentence(claims, kind, link))]
    known = [f"{_MEANING} {study.committed}".rstrip()] if verdict_sentence(claims, "paper", "") else []
    return [*(tested or [f"Measured values, without a verdict{link}."]), *known]


def _picture(study: Study, name: str, dataset: xr.Dataset, ending: str) -> list[bytes]:
    """The file of a figure or an animation, on which the versions of the code stand where there are several."""

    def noted(figure: Figure) -> Figure:
        if note := _code_note(dataset):
            figure.text(0.005, 0.002, note, fontsize=6, color="#C00000")
        return figure

    file = io.BytesIO()
    if ending == _MOVING:
        images = []
        for figure in study.animations[name](dataset):
            canvas = FigureCanvasAgg(noted(figure))
            canvas.draw()
            images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
            plt.close(figure)
        if not images:
            raise ValueError("an animation needs at least one frame")
        durations = [_FRAME] * (len(images) - 1) + [_LAST_FRAME]
        images[0].save(file, "GIF", save_all=True, append_images=images[1:], duration=durations, loop=0)
        return [file.getvalue()]
    with np.errstate(over="ignore", invalid="ignore"):  # axes in three dimensions compute with NaN of missing data
        figure = noted(study.figures[name](dataset))
        if (engine := figure.get_layout_engine()) is not None:
            # `savefig` would draw all twice, the first time for the layout alone.
            engine.execute(figure)
            figure.set_layout_engine("none")
        # Without the version of matplotlib equal data give equal bytes.
        figure.savefig(file, format=ending, metadata={"Software": None} if ending == "png" else None)
    plt.close(figure)
    return [file.getvalue()]


def text_files(study: Study, folder: Folder) -> dict[str, list[Path]]:
    """The parts of a report that are text, and their files."""
    files = {"claims": ("claims.json", "claims.md"), "summary": ("summary.json",)}
    return {part: [folder.path / name for name in names] for part, names in files.items() if getattr(study, part)}


def texts(study: Study, name: str, dataset: xr.Dataset) -> list[bytes]:
    """The contents of the files of a part that is text: equal datasets give equal bytes.

    Members with `valid` = 0 enter neither claims nor summary.
    """
    axis, valid = study.axes[0], dataset[VALID] == Validity.valid
    dataset = valid_members(dataset)
    if name == "summary" and study.summary is not None:
        summary = _plain(study.summary(dataset))
        return [(json.dumps(summary, indent=1, allow_nan=False, ensure_ascii=False) + "\n").encode()]
    sound = int(valid.any([dim for dim in valid.dims if dim != axis.name]).sum())
    total = axis.counted(valid.sizes[axis.name])
    sample = total if sound == valid.sizes[axis.name] else f"{sound} of {total}"
    claims = [replace(c, sample=c.sample or sample) for c in (study.claims(dataset) if study.claims else ())]
    listed = json.dumps([asdict(claim) for claim in claims], indent=1, ensure_ascii=False) + "\n"
    # In Markdown a list for each kind; the note on the dataset stands below the title.
    note = _code_note(dataset)
    lines = [f"# {study.title}", *(["", f"{note[0].upper()}{note[1:]}."] if note else [])]
    if not claims:
        lines += ["", "No statement is tested: those of this study are on generated networks, with all that it runs."]
    for kind in KINDS:
        if of_kind := [claim for claim in claims if claim.kind == kind]:
            lines += ["", f"## {KINDS[kind].capitalize()}", ""]
            if text := verdict_sentence(of_kind, kind, ""):
                lines += [f"{text} {_MEANING}" if kind == "paper" else text, ""]
            lines += entries(of_kind)
    return [listed.encode(), ("\n".join(lines) + "\n").encode()]


def _code_note(dataset: xr.Dataset) -> str:
    """The sentence about a dataset whose cases were computed by several versions of the code, else empty."""
    if "code" not in dataset or "flag_meanings" not in dataset["code"].attrs:
        return ""
    return f"the cases are of {len(dataset['code'].attrs['flag_meanings'].split())} versions of the code"


def _plain(value: Any) -> Any:
    """Arrays and NumPy scalars as plain values, NaN and infinity as null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic, xr.DataArray)):
        return _plain(np.asarray(value).tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


# Claims in words


def counted(verdicts: Mapping[str, int]) -> str:
    """The verdicts in words: "15 hold, 2 differ and 1 is undecided"."""
    forms = {
        "holds": ("holds", "hold"),
        "differs": ("differs", "differ"),
        "undecided": ("is undecided", "are undecided"),
    }
    parts = [f"{number} {words[number != 1]}" for name, words in forms.items() if (number := verdicts.get(name, 0))]
    return " and ".join(filter(None, (", ".join(parts[:-1]), *parts[-1:])))


def verdict_sentence(claims: Iterable[Claim], kind: str, link: str) -> str:
    """The verdicts of a run on one kind of claims for its reader, empty if none was tested."""
    verdicts = Counter(claim.verdict for claim in claims if claim.kind == kind and claim.verdict != "measured")
    if not (number := verdicts.total()):
        return ""
    of = {"paper": "of the paper", "ours": "of ours", "check": "on the library"}[kind]
    return f"Of {plural(number, 'statement')} {of} that this study tests, {counted(verdicts)}{link}."


def entries(claims: Iterable[Claim]) -> list[str]:
    """A list in Markdown that a terminal shows as well: one entry a claim, its value, criterion and variants below."""
    lines = []
    for claim in claims:
        place = f" ({claim.place})" if claim.place else ""
        named = {"measured": f"{claim.value} ({claim.sample})", "printed": claim.paper, "criterion": claim.criterion}
        below = [f"{name}: {text}" for name, text in named.items() if text]
        if claim.because:
            below.append(": ".join(filter(None, ("remark", DIFFERENCES.get(claim.difference), claim.because))))
        for row in claim.rows:
            notes = ", ".join(filter(None, (row.get("n", ""), row.get("verdict", ""))))
            below.append(f"{row['variant']}: {row['value']} ({notes})")
        lines += [f"- {claim.statement}{place}: **{claim.verdict}**", *(f"  - {text}" for text in below)]
    return [line.replace("\n", " ") for line in lines]
