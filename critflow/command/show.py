"""One stored configuration: its figure, and the certificate that it is critical."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

from critflow.extensions import provided
from critflow.manifold import CriticalConfiguration
from critflow.networks import Network
from critflow.pictures import network_figure
from critflow.result import InputError, Status
from critflow.workflow.selected import case_title, stored_configuration


def show_configuration(case: xr.Dataset, path: Path) -> str:
    """Draw one case of a dataset to `path` and return its certificate as text.

    Raises `InputError` for a dataset without the arrays of a configuration, or a case without result.
    """
    outcome = Status(int(case["status"]))
    if outcome in (Status.failed, Status.missing):
        raise InputError(f"{case_title(case)} has no configuration: {outcome.message}")
    arrays: dict[str, Any] = stored_configuration(case)
    sigma, x = arrays["sigma"], arrays["position"]
    if sigma is None or not np.isfinite(sigma).all():
        raise InputError("this case has no stresses: choose another, or see its status")
    network = Network(arrays["edges"], arrays["offsets"], arrays["cell"])
    critical = CriticalConfiguration(network, sigma, x, network.bond_vectors(x))
    title = ", ".join(f"{axis} {case[axis].item()}" for axis in case.attrs["axes"].split())
    text = provided("certificate_text", "certificates")(critical, title, outcome)
    figure = network_figure(network.edges, network.offsets, arrays["cell"], x, sigma, critical.lengths, title)
    figure.savefig(path, dpi=200)
    plt.close(figure)
    return f"{text}\ndrawn in {path}"
