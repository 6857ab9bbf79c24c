"""Fixtures: small runs of the studies, one for each process of the tests, and that of a test module, its `STUDY`."""

import json
import re
from contextlib import nullcontext

import pytest
import xarray as xr
from small_studies import SETTINGS

from critflow.command.main import main
from critflow.engine.code_digest import load_study, named_studies


def studies_in(folder):
    """The names of the studies in a folder, in alphabetical order."""
    return sorted(name for name, path in named_studies().items() if path.resolve().is_relative_to(folder))


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
def claims_of_study(runs, run_study, capsys, assert_picture):
    """A function that runs a study, reports it and resumes it, and returns its claims by their keys."""

    def of(name):
        folder, _ = runs(name)
        study = load_study(name).study
        for figure in study.figures:
            assert_picture(folder / "figures" / f"{figure}.png", most=10**6)
        for animation in study.animations:
            assert (folder / "figures" / f"{animation}.gif").read_bytes().startswith(b"GIF89a")
        claims = {claim["key"]: claim for claim in json.loads((folder / "claims.json").read_text())}
        assert claims and all(claim["because"] for claim in claims.values() if claim["verdict"] == "differs")
        capsys.readouterr()
        run_study(name, folder)
        assert re.search(r"\b(\d+) of \1 requested cases were stored before", capsys.readouterr().out)
        return claims

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
