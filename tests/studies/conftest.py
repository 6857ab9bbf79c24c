"""Small runs of the studies, one for each process of the tests, and the study of a test module: its `STUDY`."""

from contextlib import nullcontext

import pytest
import xarray as xr
from extras_there import skip_without, used_by_file

from critflow.command.main import main
from critflow.engine.code_digest import named_studies

SETTINGS = {
    "allostery": (
        *("seeds=0:1", "n_vertices=40", "loads=0.1,1.0", "sizes=24,40", "fractions=0.2,0.6", "starts=1", "steps=100"),
    ),
    "boundary": ("seeds=0:3", "n_vertices=40"),
    "ensemble": ("seeds=0:3", "n_vertices=60"),
    "gallery": ("seeds=1:3", "n_vertices=60", "starts=2"),
    "reference_numbers": (
        *("seeds=0:1", "n_vertices=40", "n_vertices_cells=40", "onsets=0.05,0.1", "columns=3", "candidates=2"),
    ),
    "reach": (
        *("seeds=0:1", "n_vertices=16", "directions=3", "samples=3", "thresholds=0.3", "ascent=10", "sizes=24"),
        *("ratios=-0.5,0.5", "surface_vertices=24", "surface_directions=8"),
    ),
    "percolation": ("seeds=0:3", "n_vertices=20,40", "spreads=0.02,0.1,0.5"),
    "shear": (
        *("seeds=0:3", "n_vertices=40,80", "ascent_vertices=60", "steps=0,1,3,10,40,200", "n_steps=400"),
        *("fractions=0.3,0.6", "detailed_seeds=2", "n_starts=3", "thresholds=0.1,0.3"),
    ),
    "statements": ("seeds=0:1", "n_vertices=40"),
    "stiffening": (
        *("seeds=0:1", "n_vertices=24", "sources=max_B_0,random_stress", "isogonal_vertices=24"),
        *("coefficients=0.1,0.3", "strains=0.01"),
    ),
    "tension_inference": ("seeds=0:3", "n_vertices=20", "noises=1e-6,1e-3"),
    "three_bar": ("s=-2.1:2.1:0.3", "span=2.0"),
    "weak_forces": ("seeds=0:1", "n_vertices=24", "kappas=0.000001,0.0001"),
    "three_dimensions": ("seeds=0:2", "n_vertices=60"),
    "topology": ("seeds=0:1", "n_vertices=24", "cuts=3", "pruned_vertices=40", "pruned_edges=4"),
}


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
        skip_without(used_by_file(named_studies()[study]))
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


@pytest.fixture(autouse=True)
def with_its_extras(request):
    """A row of a table of studies is left out where an extra that its study uses is not there."""
    row = request.node.callspec.params.values() if hasattr(request.node, "callspec") else ()
    for study in {one for one in row if isinstance(one, str)} & named_studies().keys():
        skip_without(used_by_file(named_studies()[study]))
