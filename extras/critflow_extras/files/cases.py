"""One case of a dataset as a figure, with its certificate."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

from critflow.manifold import CriticalConfiguration
from critflow.network_files import stored_configuration
from critflow.networks import Network
from critflow.result import InputError, Status
from critflow_extras.certificates.certify import certificate_text
from critflow_extras.drawing.checks import require_picture
from critflow_extras.drawing.draw import network_figure
from critflow_extras.files.hints import choose_case


def draw_case(dataset: xr.Dataset, words: Sequence[str], path: Path | None, folder: Path) -> str:
    """Draw the case that the `axis=value` words choose, and return its certificate as text.

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
    network = Network(arrays["edges"], arrays["offsets"], arrays["cell"])
    critical = CriticalConfiguration(network, sigma, x, network.bond_vectors(x))
    title = ", ".join(f"{axis} {value}" for axis, value in axes)
    text = certificate_text(critical, title, outcome)
    figure = network_figure(network.edges, network.offsets, arrays["cell"], x, sigma, critical.lengths, title)
    path = path or folder / f"{name}.png"
    figure.savefig(path, dpi=200)
    plt.close(figure)
    return f"{text}\ndrawn in {path}"
