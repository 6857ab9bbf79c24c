"""One case of a dataset: its choice by axis values, and the arrays of its configuration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from critflow.result import InputError
from critflow.workflow.study import nearest, require

if TYPE_CHECKING:
    import xarray as xr


def choose_case(dataset: xr.Dataset, words: Sequence[str]) -> xr.Dataset:
    """The case with the axis values of the `axis=value` words; an axis with one value may be omitted."""
    axes = dataset.attrs["axes"].split()
    chosen: dict[str, int] = {}
    for word in words:
        name, equals, text = word.partition("=")
        require(bool(equals), f"--set {word} has no value: write --set {word}=VALUE")
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


def case_title(case: xr.Dataset, separator: str = "-") -> str:
    """Axis values of a case, in the order of the axes."""
    return separator.join(f"{axis}-{case[axis].item()}" for axis in case.attrs["axes"].split())


def stored_configuration(case: Any) -> dict[str, np.ndarray | None]:
    """Edges, offsets, cell, position and stresses of a case, by name; no stresses are None.

    Raises `InputError` for a dataset without configurations, several cases, and a case without a configuration.
    """
    if "position" not in case and "coordinates" in case:
        raise InputError("this dataset has the names of schema 3: convert it, see docs/howto/dataset.md")
    if missing := [name for name in ("edges", "offsets", "cell", "position") if name not in case]:
        raise InputError(f"this dataset contains no configurations: it lacks {', '.join(missing)}")
    if several := [dim for dim in case["position"].dims if dim not in ("vertex", "axis")]:
        example = ", ".join(
            f"{dim}={case[dim].values[0].item()!r}" if dim in case.coords else f"{dim}=0" for dim in several
        )
        chosen = f"dataset.sel({example})" if set(several) <= set(case.coords) else f"dataset.isel({example})"
        raise InputError(f"choose one {' and one '.join(several)} of the dataset, as in {chosen}")
    position = np.asarray(case["position"], dtype=float)
    if not np.isfinite(position).all():
        raise InputError("this case of the dataset has no configuration: see its status, or choose another")
    arrays: dict[str, np.ndarray | None] = {name: np.asarray(case[name]) for name in ("edges", "offsets", "cell")}
    return arrays | {"position": position, "sigma": np.asarray(case["sigma"]) if "sigma" in case else None}
