"""One case of a dataset: its choice by the words of the command, and its figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.backend_bases import FigureCanvasBase

from critflow.engine.study import nearest, require
from critflow.network_files import require_folder, stored_configuration
from critflow.networks import Network
from critflow.numerics import norms
from critflow.pictures import network_figure
from critflow.result import InputError, Status

# Numbers of a case that are printed, where its dataset has them.
_PRINTED = ("B_0", "G_0", "C_B", "C_G")


def choose_case(dataset: xr.Dataset, words: Sequence[str]) -> xr.Dataset:
    """The case with the axis values of the `axis=value` words; an axis with one value may be omitted."""
    axes = dataset.attrs["axes"].split()
    chosen: dict[str, int] = {}
    for word in words:
        name, equals, text = word.partition("=")
        require(equals, f"--set {word} has no value: write --set {word}=VALUE")
        require(name in axes, f"the dataset has no axis {name!r}: {nearest(name, axes, 'axes')}")
        require(name not in chosen, f"{name} is set twice: a case has one value of it")
        labels = [str(label) for label in dataset[name].values]
        require(text in labels, f"{name} has no {text!r} here: {_choices(name, text, dataset[name].values, labels)}")
        chosen[name] = labels.index(text)
    for name in axes:
        clear, example = name in chosen or dataset.sizes[name] == 1, dataset[name].values[0]
        require(clear, f"which {name}? add --set {name}={example}, or another of its values")
    return dataset.isel({name: chosen.get(name, 0) for name in axes})


def _choices(name: str, text: str, values: np.ndarray, labels: Sequence[str]) -> str:
    """The values of an axis: the first and last of consecutive numbers, else the nearest word, or all of them."""
    if values.dtype.kind in "iu" and len(values) > 1 and (np.diff(values) == 1).all():
        return f"{name}s are {labels[0]} to {labels[-1]}"
    if values.dtype.kind in "iuf":
        return f"the values of {name} are {', '.join(labels)}"
    return nearest(text, labels, f"values of {name}")


def draw_case(dataset: xr.Dataset, words: Sequence[str], path: Path | None, folder: Path) -> str:
    """Draw the case that the `axis=value` words choose, and return its status and moduli as text.

    path  of the figure; by default it is named after the case, in the folder

    Raises `InputError` for a dataset without the arrays of a configuration, or a case without result.
    """
    if path is not None:
        require_picture(path)
    case = choose_case(dataset, words)
    axes = [(axis, case[axis].item()) for axis in case.attrs["axes"].split()]
    name = "-".join(f"{axis}-{value}" for axis, value in axes)
    outcome = Status(int(case["status"]))
    if outcome in (Status.failed, Status.missing):
        raise InputError(f"{name} has no configuration: {outcome.message}")
    arrays: dict[str, Any] = stored_configuration(case)
    sigma, x = arrays["sigma"], arrays["position"]
    if sigma is None or not np.isfinite(sigma).all():
        raise InputError("this case has no stresses: choose another, or see its status")
    graph = arrays["edges"], arrays["offsets"], arrays["cell"]
    lengths = norms(Network(*graph).bond_vectors(x))
    title = ", ".join(f"{axis} {value}" for axis, value in axes)
    path = path or folder / f"{name}.png"
    network_figure(*graph, x, sigma, lengths, title).savefig(path, dpi=200)
    numbers = [f"{key} = {float(case[key]):.6g} k" for key in _PRINTED if key in case and not case[key].dims]
    return "\n".join([f"{title}: {outcome}, {outcome.message}", ", ".join(numbers), f"drawn in {path}"])


def require_picture(path: Path) -> None:
    """Raise `InputError` where a figure cannot be saved to a path."""
    if path.suffix[1:].lower() not in FigureCanvasBase.get_supported_filetypes():
        raise InputError(f"a picture cannot have the ending {path.suffix!r}: choose .png, .pdf or .svg")
    require_folder(path)
