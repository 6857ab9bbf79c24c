"""One stored configuration: its choice by axis values, its figure, and the certificate that it is critical."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

from critflow.critical.manifold import CriticalConfiguration
from critflow.extras.examine.report import certificate_text
from critflow.extras.files.data import from_dataset
from critflow.figures.plot import network_figure
from critflow.networks.network import Network
from critflow.result import InputError, Status
from critflow.workflow.study import nearest, require


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
        require(text in labels, f"{name} has no {text!r} here: {nearest(text, labels, f'values of {name}')}")
        chosen[name] = labels.index(text)
    for name in axes:
        clear, example = name in chosen or dataset.sizes[name] == 1, dataset[name].values[0]
        require(clear, f"which {name}? add --set {name}={example}, or another of its values")
    return dataset.isel({name: chosen.get(name, 0) for name in axes})


def case_title(case: xr.Dataset, separator: str = "-") -> str:
    """Axis values of a case, in the order of the axes."""
    return separator.join(f"{axis}-{case[axis].item()}" for axis in case.attrs["axes"].split())


def show_configuration(case: xr.Dataset, path: Path) -> str:
    """Draw one case of a dataset to `path` and return its certificate as text.

    Raises `InputError` for a dataset without the arrays of a configuration, or a case without result.
    """
    outcome = Status(int(case["status"]))
    if outcome in (Status.failed, Status.missing):
        raise InputError(f"{case_title(case)} has no configuration: {outcome.message}")
    data = from_dataset(case)
    sigma, x = data.force_densities, data.positions
    if sigma is None or not np.isfinite(sigma).all():
        raise InputError("this case has no stresses: choose another, or see its status")
    network = Network(data.edges, data.offsets, data.cell)  # type: ignore[arg-type]
    critical = CriticalConfiguration(network, sigma, x, network.bond_vectors(x))
    title = ", ".join(f"{axis} {case[axis].item()}" for axis in case.attrs["axes"].split())
    figure = network_figure(network.edges, network.offsets, np.asarray(data.cell), x, sigma, critical.lengths, title)
    figure.savefig(path, dpi=200)
    plt.close(figure)
    return f"{certificate_text(critical, title, outcome)}\ndrawn in {path}"
