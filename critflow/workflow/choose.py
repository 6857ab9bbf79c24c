"""One case out of a merged dataset, chosen by its axis labels."""

from __future__ import annotations

from collections.abc import Sequence

import xarray as xr

from critflow.result import StudyError
from critflow.workflow.study import nearest


def choose_case(dataset: xr.Dataset, words: Sequence[str]) -> xr.Dataset:
    """The case that the `axis=value` words name; an axis with a single value need not be named."""
    axes = dataset.attrs["axes"].split()
    chosen: dict[str, int] = {}
    for word in words:
        name, equals, text = word.partition("=")
        if not equals:
            raise StudyError(f"--set {word} has no value: write --set {word}=VALUE")
        if name not in axes:
            raise StudyError(f"the dataset has no axis {name!r}: {nearest(name, axes, 'axes')}")
        if name in chosen:
            raise StudyError(f"{name} is set twice: one case has one value of it")
        labels = [str(label) for label in dataset[name].values]
        if text not in labels:
            raise StudyError(f"{name} has no {text!r} here: {nearest(text, labels, f'values of {name}')}")
        chosen[name] = labels.index(text)
    for name in axes:
        if name not in chosen and dataset.sizes[name] > 1:
            raise StudyError(f"which {name}? add --set {name}={dataset[name].values[0]}, or another of its values")
    return dataset.isel({name: chosen.get(name, 0) for name in axes})
