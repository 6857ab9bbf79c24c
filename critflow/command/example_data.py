"""The ensemble that the notebooks read: a stored one, or else a small one computed now."""

from __future__ import annotations

import os
from pathlib import Path

from critflow.command.main import main

_SMALL = ("n_vertices=100", "seeds=0:20", "strains=0.002,0.005,0.01")


def ensemble_path() -> Path:
    """The dataset of an ensemble: the file in the environment variable CRITFLOW_ENSEMBLE, or one of these.

    results/ensemble/ensemble.nc here or in a folder above, else small_ensemble/ensemble.nc here, of twenty networks
    of 100 vertices, which is computed in about 20 seconds where it does not exist.
    """
    if named := os.environ.get("CRITFLOW_ENSEMBLE"):
        return Path(named)
    here = Path.cwd()
    stored = (folder / "results" / "ensemble" / "ensemble.nc" for folder in (here, *here.parents))
    small = Path("small_ensemble") / "ensemble.nc"
    path = next((file for file in stored if file.is_file()), small)
    if path == small and not small.is_file():
        settings = [word for setting in _SMALL for word in ("--set", setting)]
        main(["run", "ensemble", *settings, "--workers", "0", "--out", str(small.parent)])
    return path
