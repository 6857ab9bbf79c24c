"""Fixtures: small runs of the studies, one for each process of the tests, and that of a test module, its `STUDY`."""

from contextlib import nullcontext

import pytest
import xarray as xr
from small_studies import SETTINGS

from critflow.command.main import main


def words(study, *settings):
    """The settings of the small run of a study as words of the command; later settings replace earlier ones."""
    chosen = dict(setting.split("=", 1) for setting in (*SETTINGS[study], *settings))
    return [f"--set={key}={value}" for key, value in chosen.items()]


@pytest.fixture(scope="session")
def run_study(empty_pictures):
    """A function that runs the study of this name into a folder and returns its dataset."""

    def run(study, folder, *settings, drawn=False):
        command = ["run", study, "--workers", "0", "--out", str(folder), *words(study, *settings)]
        with nullcontext() if drawn else empty_pictures():
            assert main(command) == 0
        with xr.open_dataset(folder / f"{study}.nc") as dataset:
            return dataset.load()

    return run


@pytest.fixture(scope="session")
def runs(run_study, tmp_path_factory):
    """Folder and dataset of the small run of each study, made at first use."""
    made = {}

    def of(study):
        if study not in made:
            folder = tmp_path_factory.mktemp(study) / "out"
            made[study] = folder, run_study(study, folder, drawn=True)
        return made[study]

    return of


@pytest.fixture
def folder(request, runs):
    """The folder of the small run of the study of this module; tests do not change it."""
    return runs(request.module.STUDY)[0]


@pytest.fixture
def dataset(request, runs):
    """The dataset of the small run of the study of this module; tests do not change it."""
    return runs(request.module.STUDY)[1]


@pytest.fixture(scope="module", autouse=True)
def quick(undrawn_but_in_sweeps):
    """Studies are run without drawing their pictures, unless the sweeps run too."""
