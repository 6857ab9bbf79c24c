"""One case of a critflow dataset as a network: an xarray object with edges, offsets, cell, coordinates and σ."""

from __future__ import annotations

from typing import Any

import numpy as np

from critflow.exchange.data import NetworkData
from critflow.result import InputError

_NEEDED = ("edges", "offsets", "cell", "coordinates")


def from_dataset(case: Any) -> NetworkData:
    """A case of a dataset, selected by its axis values, such as `dataset.sel(seed=3, population="bulk_modulus")`."""
    missing = [name for name in _NEEDED if name not in case]
    if missing:
        raise InputError(f"this dataset contains no configurations: it lacks {', '.join(missing)}")
    if np.ndim(case["edges"]) != 2:
        raise InputError("choose one case of the dataset, such as dataset.sel(seed=3, population='bulk_modulus')")
    coordinates = np.asarray(case["coordinates"], dtype=float)
    if not np.isfinite(coordinates).all():
        raise InputError("this case of the dataset has no configuration: see its status, or choose another")
    return NetworkData(
        edges=np.asarray(case["edges"]),
        positions=coordinates,
        cell=np.asarray(case["cell"]),
        offsets=np.asarray(case["offsets"]),
        force_densities=np.asarray(case["sigma"]) if "sigma" in case else None,
        source="critflow dataset",
    )
